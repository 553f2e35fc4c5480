// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Laws of what a bucket holds and of where more leaves it, for buckets and attitudes of all kinds.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/support/capacity_fixture.h"

namespace soilvdb::test {
namespace capacity_laws_test {

constexpr double kPi = std::numbers::pi;

/// Calls f with buckets, attitudes and slopes of all kinds.
template <typename Function>
void for_many(const Function& f) {
  Random random(2);
  for (int i = 0; i < 400; ++i) {
    SCOPED_TRACE(i);
    const Bucket bucket = i % 4 == 0 ? round_bucket() : random.bucket();
    const Eigen::Quaterniond attitude = random.machines_attitude();
    f(bucket, attitude, random(0.1, 1.5));
  }
}

TEST(Capacity, GoesWithTheCubeOfSize) {
  constexpr double kScale = 2.7;
  for_many([&](const Bucket& small, const Eigen::Quaterniond& attitude, double slope) {
    Bucket large = small;
    large.width_m *= kScale, large.height_m *= kScale;
    for (Vec2& p : large.profile) p *= kScale;
    const BucketCapacity a = capacity(small).at(attitude, slope),
                         b = capacity(large).at(attitude, slope);
    EXPECT_NEAR(b.volume_m3 / std::pow(kScale, 3), a.volume_m3, kRounding);
    EXPECT_LT((b.spill / kScale - a.spill).norm(), kRounding);
  });
}

TEST(Capacity, IsTheSameInAMirror) {
  for_many([&](const Bucket& bucket, const Eigen::Quaterniond& q, double slope) {
    const Eigen::Quaterniond mirrored(q.w(), -q.x(), q.y(), -q.z());
    const Capacity c = capacity(bucket);
    const BucketCapacity a = c.at(q, slope), b = c.at(mirrored, slope);
    EXPECT_EQ(a.volume_m3, b.volume_m3);
    const Vec3 up = q.conjugate() * Vec3::UnitZ();
    if (std::abs(up.y()) > kRounding) {  // else both side plates may be as good
      EXPECT_LT((a.spill - b.spill.cwiseProduct(Vec3(1, -1, 1))).norm(), kRounding);
    }
  });
}

TEST(Capacity, OfABucketUpsideDownIsThatOfOneWithItsEdgesSwapped) {
  for_many([&](const Bucket& bucket, const Eigen::Quaterniond& q, double slope) {
    Bucket swapped = bucket;
    std::reverse(swapped.profile.begin(), swapped.profile.end());
    for (Vec2& p : swapped.profile) p.y() = bucket.height_m - p.y();
    const Eigen::Quaterniond turned = q * from_rpy(kPi, 0, 0);  // mirrored in y as well
    EXPECT_NEAR(capacity(bucket).at(q, slope).volume_m3,
                capacity(swapped).at(turned, slope).volume_m3, kRounding);
  });
}

TEST(Capacity, DoesNotDependOnHeading) {
  for_many([&](const Bucket& bucket, const Eigen::Quaterniond& q, double slope) {
    const Capacity c = capacity(bucket);
    const BucketCapacity a = c.at(q, slope), b = c.at(from_rpy(0, 0, 2.1) * q, slope);
    EXPECT_NEAR(a.volume_m3, b.volume_m3, kRounding);
  });
}

TEST(Capacity, GrowsWithRepose) {
  for_many([&](const Bucket& bucket, const Eigen::Quaterniond& q, double) {
    const Capacity c = capacity(bucket);
    double before_m3 = 0;
    for (const double slope : {0.0, 0.1, 0.3, 0.6, 0.9, 1.2, 2.0, 5.0}) {
      const double held_m3 = c.at(q, slope).volume_m3;
      EXPECT_GE(held_m3, before_m3 - 2 * kQuadrature * c.struck_m3()) << slope;
      before_m3 = held_m3;
    }
  });
}

TEST(Capacity, DoesNotSeePointsAddedToStraightSides) {
  constexpr int kParts =
      16;  // each integrated by itself, so what differs is the integration's error
  for_many([&](const Bucket& bucket, const Eigen::Quaterniond& q, double slope) {
    Bucket divided = bucket;
    divided.profile.clear();
    for (std::size_t i = 0; i + 1 < bucket.profile.size(); ++i) {
      for (int j = 0; j < kParts; ++j)
        divided.profile.push_back(bucket.profile[i] +
                                  (bucket.profile[i + 1] - bucket.profile[i]) * j / kParts);
    }
    divided.profile.push_back(bucket.profile.back());
    const Capacity c = capacity(bucket);
    EXPECT_NEAR(c.at(q, slope).volume_m3, capacity(divided).at(q, slope).volume_m3,
                kQuadrature * c.struck_m3());
  });
}

TEST(Capacity, DoesNotJumpWhereTheMouthIsAsSteepAsRepose) {
  constexpr double kStep = 1e-7;
  const Capacity c = capacity(bulging_bucket());
  for (const double slope : {0.3, 0.7, 1.2}) {
    for (const double way : {0.0, 0.4, kPi / 2, 2.0, 3.5}) {
      const auto held_m3 = [&](double tilt) {
        return c
            .at(with_up({std::cos(tilt), std::sin(tilt) * std::sin(way),
                         std::sin(tilt) * std::cos(way)}),
                slope)
            .volume_m3;
      };
      const double tilt = std::atan(slope);
      EXPECT_NEAR(held_m3(tilt - kStep), held_m3(tilt + kStep), kQuadrature * c.struck_m3());
      EXPECT_NEAR(held_m3(tilt), c.struck_m3(), kQuadrature * c.struck_m3());
    }
  }
}

TEST(CapacitySpill, IsAPointOfTheRimThanWhichNoneIsLess) {
  constexpr int kPoints = 200;
  for_many([&](const Bucket& bucket, const Eigen::Quaterniond& q, double slope) {
    const Vec3 up = q.conjugate() * Vec3::UnitZ();
    const Vec3 spill = capacity(bucket).at(q, slope).spill;
    const double y = bucket.width_m / 2, z = bucket.height_m;
    EXPECT_EQ(spill.x(), 0);
    EXPECT_LE(std::abs(spill.y()), y);
    EXPECT_TRUE(spill.z() >= 0 && spill.z() <= z);
    if (up.x() >= 0) {
      EXPECT_TRUE(std::abs(spill.y()) == y || spill.z() == 0 || spill.z() == z);
    }
    // The middle of the body, by quadrangles between its sides and the mouth's plane.
    double area = 0;
    Vec3 middle = Vec3::Zero();
    for (std::size_t i = 0; i + 1 < bucket.profile.size(); ++i) {
      const Vec2 &a = bucket.profile[i], &b = bucket.profile[i + 1];
      const double strip = (b.y() - a.y()) / 6;
      area -= 3 * strip * (a.x() + b.x());
      middle.x() -= strip * (a.x() * a.x() + a.x() * b.x() + b.x() * b.x());
      middle.z() -= strip * (a.y() * (2 * a.x() + b.x()) + b.y() * (a.x() + 2 * b.x()));
    }
    middle /= area;
    const auto sum_m = [&](const Vec3& rim) {
      const Vec3 way = q * (middle - rim);
      return slope * way.head<2>().norm() - way.z();
    };
    for (int i = 0; i <= kPoints; ++i) {
      const double s = double(i) / kPoints;
      for (const Vec3& rim : {Vec3(0, y * (2 * s - 1), 0), Vec3(0, y * (2 * s - 1), z),
                              Vec3(0, -y, z * s), Vec3(0, y, z * s)})
        EXPECT_LE(sum_m(spill), sum_m(rim) + kRounding);
    }
  });
}

}  // namespace capacity_laws_test
}  // namespace soilvdb::test
