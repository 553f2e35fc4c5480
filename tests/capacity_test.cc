// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a bucket holds, against closed forms, laws, and columns of soil under a rim of many points.
#include "soilvdb/capacity.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <numbers>
#include <random>

namespace soilvdb {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kRounding = 1e-12;   // m and m^3, of buckets of about 1 m
constexpr double kQuadrature = 2e-5;  // of the struck volume, where the lip isn't level

const std::vector<Vec2> kRound = {{0, 0},        {-0.45, 0.09}, {-0.80, 0.32}, {-0.92, 0.62},
                                  {-0.85, 0.90}, {-0.55, 1.10}, {0, 1.15}};
/// Reaches beyond both edges of the mouth.
const std::vector<Vec2> kBulging = {{0, 0},      {-0.5, -0.3}, {-0.9, 0.2}, {-0.6, 0.5},
                                    {-1.0, 0.9}, {-0.4, 1.5},  {0, 1.15}};

Bucket round_bucket() { return {1.2, 1.15, kRound, {}}; }
Bucket bulging_bucket() { return {1.2, 1.15, kBulging, {}}; }
Bucket box(double width, double height, double depth) {
  return {width, height, {{0, 0}, {-depth, 0}, {-depth, height}, {0, height}}, {}};
}
Capacity capacity(const Bucket& bucket) { return Capacity::of(bucket).value(); }

/// An attitude in which the world's up is this direction of the bucket.
Eigen::Quaterniond with_up(const Vec3& up) {
  const Vec3 axis = up.cross(Vec3::UnitZ());
  return Eigen::Quaterniond(Eigen::AngleAxisd(std::atan2(axis.norm(), up.z()), axis.normalized()));
}
Eigen::Quaterniond pitched(double angle) { return from_rpy(0, angle, 0); }

class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  double operator()(double low, double high) {
    return low + (high - low) * static_cast<double>(engine_() >> 11) * 0x1p-53;
  }
  Eigen::Quaterniond attitude() {
    for (;;) {
      Eigen::Vector4d q;
      for (double& part : q) part = draw();
      if (q.norm() > 0.1 && q.norm() < 1) return Eigen::Quaterniond(q.normalized());
    }
  }
  /// Any, or level along the lip, or nearly so.
  Eigen::Quaterniond machines_attitude() {
    const double kind = (*this)(0, 3);
    if (kind < 1) return attitude();
    const double bank = kind < 2 ? 0 : 0.4 * draw();
    return from_rpy(bank, 0, 0) * pitched((*this)(-2.8, 1.2));
  }
  /// Round about the middle of the mouth, or ragged.
  Bucket bucket() {
    for (;;) {
      Bucket b{(*this)(0.4, 2), (*this)(0.4, 1.5), {}, {}};
      const int points = 1 + static_cast<int>((*this)(0, 9));
      const double depth = (*this)(0.4, 1.3), ragged = (*this)(-0.5, 0.8);
      std::vector<double> angles;
      for (int i = 0; i < points; ++i) angles.push_back((*this)(0.02, kPi - 0.02));
      std::sort(angles.begin(), angles.end());
      b.profile.emplace_back(0, 0);
      for (const double a : angles) {
        const double r = 1 - std::max(0.0, ragged) * (*this)(0, 1);
        const double wide = b.height_m * (0.5 + 0.2 * std::max(0.0, ragged));
        b.profile.emplace_back(-depth * r * std::sin(a), b.height_m / 2 - wide * r * std::cos(a));
      }
      b.profile.emplace_back(0, b.height_m);
      try {
        b.validate();
        return b;
      } catch (const std::invalid_argument&) {
      }
    }
  }

 private:
  double draw() { return (*this)(-1, 1); }
  std::mt19937_64 engine_;
};

// ---- An integration of its own ------------------------------------------------------------------

/// Vertical columns in the world through walls and mouth, filled up to the least cone of many
/// points of the rim.
class Columns {
 public:
  Columns(const Bucket& bucket, const Eigen::Quaterniond& world_from_bucket, double slope)
      : bucket_(bucket), turn_(world_from_bucket.toRotationMatrix()), slope_(slope) {
    const double y = bucket.width_m / 2, z = bucket.height_m;
    const std::array<Vec3, 5> corners = {Vec3(0, -y, 0), Vec3(0, y, 0), Vec3(0, y, z),
                                         Vec3(0, -y, z), Vec3(0, -y, 0)};
    for (std::size_t i = 0; i < 4; ++i)
      sides_.push_back({turn_ * corners[i], turn_ * (corners[i + 1] - corners[i])});
    for (const Vec3& p : extremes(bucket)) box_.extend((turn_ * p).head<2>().eval());
  }

  struct Sum {
    double volume_m3 = 0;
    double error_m3 = 0;  // by which corners and middles of cells differ
  };
  /// Cells are quartered until corners and middle agree to `fine_m3`.
  Sum sum(double fine_m3) const {
    constexpr int kCells = 32;
    Sum sum;
    const Vec2 size = box_.sizes() / kCells;
    std::vector<double> corners_m;
    for (int i = 0; i <= kCells; ++i) {
      for (int j = 0; j <= kCells; ++j)
        corners_m.push_back(column_m(box_.min() + size.cwiseProduct(Vec2(i, j))));
    }
    for (int i = 0; i < kCells; ++i) {
      for (int j = 0; j < kCells; ++j) {
        const double* c = &corners_m[static_cast<std::size_t>(i * (kCells + 1) + j)];
        add(box_.min() + size.cwiseProduct(Vec2(i, j)), size,
            {c[0], c[1], c[kCells + 1], c[kCells + 2]}, fine_m3, sum);
      }
    }
    return sum;
  }

 private:
  void add(const Vec2& low, const Vec2& size, const std::array<double, 4>& c, double fine_m3,
           Sum& sum) const {
    constexpr double kSmallest = 1e-4;
    const auto at = [&](double i, double j) {
      return column_m(low + Vec2(i * size.x(), j * size.y()));
    };
    const double middle = at(0.5, 0.5), mean = (c[0] + c[1] + c[2] + c[3]) / 4, area = size.prod();
    const double change_m3 = std::abs(middle - mean) * area;
    if (change_m3 > fine_m3 && size.maxCoeff() > kSmallest) {
      const Vec2 half = size / 2, x(half.x(), 0), y(0, half.y());
      const double west = at(0, 0.5), east = at(1, 0.5), south = at(0.5, 0), north = at(0.5, 1);
      add(low, half, {c[0], west, south, middle}, fine_m3, sum);
      add(low + y, half, {west, c[1], middle, north}, fine_m3, sum);
      add(low + x, half, {south, middle, c[2], east}, fine_m3, sum);
      add(low + half, half, {middle, north, east, c[3]}, fine_m3, sum);
      return;
    }
    sum.volume_m3 += (2 * middle + mean) / 3 * area;
    sum.error_m3 += change_m3;
  }
  struct Side {
    Vec3 from, way;
  };
  struct Crossing {
    double z;
    bool mouth;
    bool operator<(const Crossing& o) const { return z < o.z; }
  };

  double column_m(const Vec2& at) const {
    crossings_.clear();
    // The bucket's coordinates along the column are p + z * d.
    const Vec3 p = turn_.transpose() * Vec3(at.x(), at.y(), 0), d = turn_.row(2).transpose();
    const double half = bucket_.width_m / 2;
    const auto& outline = bucket_.profile;
    for (std::size_t i = 0; i < outline.size(); ++i) {
      const bool mouth = i + 1 == outline.size();
      const Vec2 &a = outline[i], &b = outline[mouth ? 0 : i + 1];
      const Vec2 normal(b.y() - a.y(), a.x() - b.x());
      const double speed = normal.x() * d.x() + normal.y() * d.z();
      if (speed == 0) continue;
      const double z = (normal.x() * (a.x() - p.x()) + normal.y() * (a.y() - p.z())) / speed;
      if (std::abs(p.y() + z * d.y()) > half) continue;
      const Vec2 q(p.x() + z * d.x(), p.z() + z * d.z());
      if ((q - a).dot(b - a) >= 0 && (q - b).dot(a - b) > 0) crossings_.push_back({z, mouth});
    }
    for (const double y : {-half, half}) {
      if (d.y() == 0) continue;
      const double z = (y - p.y()) / d.y();
      if (winds_about({p.x() + z * d.x(), p.z() + z * d.z()})) crossings_.push_back({z, false});
    }
    std::sort(crossings_.begin(), crossings_.end());
    if (crossings_.size() % 2 != 0) return 0;  // along an edge
    if (crossings_.empty() || crossings_[0].mouth) return 0;
    const double top = surface(at);
    double sum = 0;
    for (std::size_t i = 0; i < crossings_.size(); i += 2) {
      const Crossing &floor = crossings_[i], &roof = crossings_[i + 1];
      sum += std::max(0.0, (roof.mouth ? top : std::min(top, roof.z)) - floor.z);
    }
    return sum;
  }

  bool winds_about(const Vec2& q) const {
    double turns = 0;
    for (std::size_t i = 0; i < bucket_.profile.size(); ++i) {
      const Vec2 &a = bucket_.profile[i], &b = bucket_.profile[(i + 1) % bucket_.profile.size()];
      const bool up = a.y() <= q.y() && q.y() < b.y(), down = b.y() <= q.y() && q.y() < a.y();
      if (!up && !down) continue;
      const double left = (b.x() - a.x()) * (q.y() - a.y()) - (q.x() - a.x()) * (b.y() - a.y());
      if (up && left > 0) turns += 1;
      if (down && left < 0) turns -= 1;
    }
    return turns != 0;
  }

  /// Points of each side at equal distances, then again as many about the least of them: along a
  /// straight line a cone is convex.
  double surface(const Vec2& at) const {
    constexpr int kPoints = 12;
    double least = std::numeric_limits<double>::infinity();
    for (const auto& [from, way] : sides_) {
      const Vec2 to = from.head<2>() - at;
      const double c = to.squaredNorm(), b = to.dot(way.head<2>());
      const double a = way.head<2>().squaredNorm();
      double middle = 0.5, reach = 0.5, best = least, best_s = 0.5;
      for (int level = 0; level < 3; ++level) {
        for (int i = 0; i <= kPoints; ++i) {
          const double s = std::clamp(middle + reach * (2.0 * i / kPoints - 1), 0.0, 1.0);
          const double z =
              from.z() + s * way.z() + slope_ * std::sqrt(std::max(0.0, c + s * (2 * b + s * a)));
          if (i == 0 || z < best) best = z, best_s = s;
        }
        middle = best_s, reach *= 2.0 / kPoints;
      }
      least = std::min(least, best);
    }
    return least;
  }

  const Bucket& bucket_;
  Eigen::Matrix3d turn_;
  double slope_;
  std::vector<Side> sides_;
  Eigen::AlignedBox2d box_;
  mutable std::vector<Crossing> crossings_;
};

TEST(Capacity, IsThatOfColumnsUnderManyPointsOfTheRim) {
  constexpr double kTolerance = 1e-3;  // of what is held, or of a twentieth of the bucket
  constexpr int kCases = 200;
  Random random(1);
  int some = 0, heaped = 0;
  for (int i = 0; i < kCases; ++i) {
    SCOPED_TRACE(i);
    const Bucket bucket = random.bucket();
    const Eigen::Quaterniond attitude = random.machines_attitude();
    const double slope = random(0, 10) < 1 ? 0 : random(0.2, 1.4);
    const Capacity c = capacity(bucket);
    const double held_m3 = c.at(attitude, slope).volume_m3;
    const double unit_m3 = std::max(held_m3, c.struck_m3() / 20);
    const Columns::Sum sum = Columns(bucket, attitude, slope).sum(3e-7 * unit_m3);
    EXPECT_LE(sum.error_m3, kTolerance * unit_m3) << "columns are too few";
    EXPECT_NEAR(held_m3, sum.volume_m3, kTolerance * unit_m3);
    some += held_m3 > c.struck_m3() / 20;
    heaped += held_m3 > c.struck_m3();
  }
  EXPECT_GT(some, kCases / 2);
  EXPECT_GT(heaped, kCases / 10);
}

// ---- Closed forms -------------------------------------------------------------------------------

TEST(Capacity, StruckIsTheBodyAndHeapedTheStandardsRoofUponIt) {
  for (const auto& [long_m, wide_m] : {std::pair(1.5, 1.1), std::pair(1.0, 1.0)}) {
    const double roof_m3 = long_m * wide_m * wide_m / 4 - wide_m * wide_m * wide_m / 12;
    for (const Bucket& bucket : {box(long_m, wide_m, 0.7), box(wide_m, long_m, 0.7)}) {
      const Capacity c = capacity(bucket);
      EXPECT_NEAR(c.struck_m3(), 0.7 * long_m * wide_m, kRounding);
      EXPECT_NEAR(c.heaped_m3(), c.struck_m3() + roof_m3, kRounding);
      const Eigen::Quaterniond level = with_up(Vec3::UnitX());
      EXPECT_NEAR(c.at(level, 1).volume_m3, c.heaped_m3(), kRounding);
      EXPECT_NEAR(c.at(level, 0.5).volume_m3, c.struck_m3() + roof_m3 / 2, kRounding);
      EXPECT_NEAR(c.at(level, 0).volume_m3, c.struck_m3(), kRounding);
    }
  }
  const Capacity round = capacity(round_bucket());
  EXPECT_NEAR(round.struck_m3(), 1.2 * 0.82355, kRounding);
  EXPECT_NEAR(round.heaped_m3() - round.struck_m3(), 1.2 * 1.15 * 1.15 / 4 - std::pow(1.15, 3) / 12,
              kRounding);
}

TEST(Capacity, OfWaterInATippedBoxIsAPrism) {
  const double width = 1.3, height = 0.9, depth = 0.7;
  const Capacity c = capacity(box(width, height, depth));
  for (const double angle : {0.05, 0.3, 0.6, 0.9, 1.2, 1.5}) {
    const auto prism_m3 = [&](double side, double along) {
      const double drop = side * std::tan(angle);
      return along *
             (drop < depth ? side * (depth - drop / 2) : depth * depth / 2 / std::tan(angle));
    };
    const double x = std::cos(angle), s = std::sin(angle);
    for (const double sign : {-1.0, 1.0}) {
      EXPECT_NEAR(c.at(with_up({x, 0, sign * s}), 0).volume_m3, prism_m3(height, width), kRounding);
      EXPECT_NEAR(c.at(with_up({x, sign * s, 0}), 0).volume_m3, prism_m3(width, height),
                  kQuadrature * c.struck_m3());
    }
  }
  // Over a corner: less by the wedge above it.
  const Vec3 up = Vec3(1, 0.3, 0.2).normalized();
  EXPECT_NEAR(c.at(with_up(up), 0).volume_m3,
              width * height * (depth - (0.3 * width + 0.2 * height) / 2),
              kQuadrature * c.struck_m3());
}

TEST(Capacity, OverTheLipAloneIsThatOfWaterInABucketCurledFurtherByRepose) {
  const Capacity c = capacity(round_bucket());
  for (const double repose : {0.2, 0.61, 0.9}) {
    for (double pitch = 0; pitch > repose - kPi / 2; pitch -= 0.1) {
      EXPECT_NEAR(c.at(pitched(pitch), std::tan(repose)).volume_m3,
                  c.at(pitched(pitch - repose), 0).volume_m3, kRounding);
    }
  }
}

TEST(Capacity, IsNothingWithTheMouthDown) {
  for (const double slope : {0.0, 0.3, 0.7, 1.0}) {
    for (const Bucket& bucket : {round_bucket(), box(1, 0.8, 0.6), box(0.8, 1, 1.6)}) {
      const Capacity c = capacity(bucket);
      EXPECT_EQ(c.at(with_up(-Vec3::UnitX()), slope).volume_m3, 0);
      EXPECT_EQ(c.at(with_up(Vec3(-1, 0.1, 0.2).normalized()), slope).volume_m3, 0);
      EXPECT_EQ(c.at(from_rpy(0.3, 0.9, 2), slope).volume_m3, 0);
    }
  }
}

TEST(Capacity, WithTheMouthDownIsWhatLiesBesideTheMouth) {
  // A shelf 0.2 above the mouth's plane and 0.5 wide; the rest of the body is above the mouth.
  const std::vector<Vec2> shelf = {{0, 0},       {-0.2, 0}, {-0.2, -0.5},
                                   {-0.8, -0.5}, {-0.8, 1}, {0, 1}};
  std::vector<Vec2> swapped;
  for (auto p = shelf.rbegin(); p != shelf.rend(); ++p) swapped.emplace_back(p->x(), 1 - p->y());
  for (const auto& profile : {shelf, swapped}) {
    const Bucket bucket{1.5, 1, profile, {}};
    bucket.validate();
    const Capacity c = capacity(bucket);
    for (const double slope : {0.3, 0.5, 1.0, 1.5}) {
      const double high_m = std::max(0.0, 0.5 * slope - 0.2);
      EXPECT_NEAR(c.at(with_up(-Vec3::UnitX()), slope).volume_m3, 1.5 * high_m * high_m / 2 / slope,
                  kRounding);
    }
  }
}

TEST(Capacity, IsUnlimitedWithoutAProfile) { EXPECT_FALSE(Capacity::of({1.2, 0.9, {}, {}})); }

// ---- Laws ---------------------------------------------------------------------------------------

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
    const Hold a = capacity(small).at(attitude, slope), b = capacity(large).at(attitude, slope);
    EXPECT_NEAR(b.volume_m3 / std::pow(kScale, 3), a.volume_m3, kRounding);
    EXPECT_LT((b.spill / kScale - a.spill).norm(), kRounding);
  });
}

TEST(Capacity, IsTheSameInAMirror) {
  for_many([&](const Bucket& bucket, const Eigen::Quaterniond& q, double slope) {
    const Eigen::Quaterniond mirrored(q.w(), -q.x(), q.y(), -q.z());
    const Capacity c = capacity(bucket);
    const Hold a = c.at(q, slope), b = c.at(mirrored, slope);
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
    const Hold a = c.at(q, slope), b = c.at(from_rpy(0, 0, 2.1) * q, slope);
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

// ---- Spill --------------------------------------------------------------------------------------

TEST(CapacitySpill, IsTheMiddleOfTheLowerEdgeOfALevelBucket) {
  const Capacity c = capacity(round_bucket());
  for (const double pitch : {-0.9, -0.4, 0.0, 0.6}) {
    EXPECT_LT(c.at(pitched(pitch), 0.7).spill.norm(), kRounding) << pitch;
  }
  for (const double pitch : {-2.3, -2.8, -3.14}) {
    EXPECT_LT((c.at(pitched(pitch), 0.7).spill - Vec3(0, 0, 1.15)).norm(), kRounding) << pitch;
  }
}

TEST(CapacitySpill, IsTheLowerCornerOfOneBankedBeyondRepose) {
  const Capacity c = capacity(round_bucket());
  EXPECT_LT((c.at(from_rpy(0.7, -0.2, 0), 0.7).spill - Vec3(0, -0.6, 0)).norm(), kRounding);
  EXPECT_LT((c.at(from_rpy(-0.7, -0.2, 0), 0.7).spill - Vec3(0, 0.6, 0)).norm(), kRounding);
}

TEST(CapacitySpill, FallsStraightOutOfAMouthThatLooksDown) {
  const Vec3 spill = capacity(box(1, 0.8, 0.6)).at(with_up(-Vec3::UnitX()), 0.7).spill;
  EXPECT_LT((spill - Vec3(0, 0, 0.4)).norm(), kRounding);
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

}  // namespace
}  // namespace soilvdb
