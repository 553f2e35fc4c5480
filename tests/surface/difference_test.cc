// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/difference.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <memory>
#include <numbers>
#include <utility>

#include "soilvdb/tracker.h"
#include "tests/support/difference_fixture.h"

namespace soilvdb {
namespace difference_test {

constexpr double kArea = 0.02;  // relative: what is asked of diff's area

TEST(Difference, OfAPitHasItsAreaAndVolume) {
  for (const double yaw : {0.0, 0.4, 1.1}) {
    for (const double h : {0.05, 0.1}) {
      SCOPED_TRACE(::testing::Message() << yaw << " " << h);
      const auto terrain = plane(0.013);
      const Ground before(h, Vec3::Zero(), terrain);
      Ground after(h, Vec3::Zero(), terrain);
      Tracker tracker(after, {bucket(1.3, 2)});
      const Vec2 from(0.21, 0.34), along(std::cos(yaw), std::sin(yaw));
      for (const double s : {0.0, 2.2}) {
        const Vec2 at = from + s * along;
        tracker.update(0, {{at.x(), at.y(), -0.487}, from_rpy(0, 0, yaw)});
      }
      const Difference d = difference(before, after, true);
      EXPECT_TRUE(d.exact);
      EXPECT_NEAR(d.cut_m3, 1.3 * 2.2 * 0.5, d.error_m3 * 2);
      EXPECT_EQ(d.fill_m3, 0);
      EXPECT_NEAR(d.area_m2, 1.3 * 2.2, kArea * 1.3 * 2.2);
      EXPECT_NEAR(difference(after, before, true).area_m2, d.area_m2, 1e-9);
    }
  }
}

TEST(Difference, OfAHalfSineAtAnAngleHasItsArea) {
  for (const double slope : {0.0, 0.3}) {
    for (const double yaw : {0.0, 0.3, 0.9, 2.2}) {
      for (const double h : {0.025, 0.05, 0.1}) {
        // Six voxels across, of which one side runs out along the slope: 4 % at most.
        if (slope > 0 && h == 0.1) continue;
        SCOPED_TRACE(::testing::Message() << slope << " " << yaw << " " << h);
        HalfSine trench;
        trench.yaw = yaw;
        // The same across the slope, along which it stays level.
        const Vec2 across(-std::sin(yaw), std::cos(yaw));
        const auto terrain = plane(-slope * across.dot(trench.from), slope * across);
        const Ground before(h, Vec3::Zero(), terrain);
        Ground after(h, Vec3::Zero(), terrain);
        trench.dig(after);
        double area = trench.area_m2();
        if (slope > 0) {  // downhill the ground lies below the lip for a part of the way
          area = 0;
          for (int i = 0; i < 1000; ++i) {
            const double deep = trench.depth * std::sin(kPi * (i + 0.5) / 1000);
            area += std::min(trench.width, trench.width / 2 + deep / slope) * trench.length / 1000;
          }
        }
        EXPECT_NEAR(difference(before, after, true).area_m2, area, kArea * area);
      }
    }
  }
}

TEST(Difference, OfWhatIsSkimmedHasItsArea) {
  const auto terrain = plane(0.02);
  const Ground before(0.05, Vec3::Zero(), terrain);
  Ground after(0.05, Vec3::Zero(), terrain);
  Tracker tracker(after, {bucket(2, 2)});
  for (const double x : {0.33, 5.33})
    tracker.update(0, {{x, 0.21, 0.015}, Eigen::Quaterniond::Identity()});
  EXPECT_NEAR(difference(before, after, true).area_m2, 10, kArea * 10);
}

TEST(BoxDifference, OfTheSameDigWithOtherVoxelsIsWithinItsError) {
  const auto terrain = plane(0.013, {0.05, -0.02});
  HalfSine trench;
  trench.yaw = 0.4;
  const Ground before(0.1, Vec3::Zero(), terrain);
  Ground coarse(0.1, Vec3::Zero(), terrain), fine(0.05, Vec3::Zero(), terrain);
  trench.dig(coarse);
  trench.dig(fine);
  const Difference none = difference(coarse, fine, true), back = difference(fine, coarse, true);
  EXPECT_FALSE(none.exact);
  EXPECT_LT(none.cut_m3, none.error_m3);
  EXPECT_LT(none.fill_m3, none.error_m3);
  EXPECT_LT(none.area_m2, kArea * trench.area_m2());
  EXPECT_NEAR(none.net_m3, fine.change_m3() - coarse.change_m3(), 1e-12);
  EXPECT_NEAR(none.cut_m3, back.fill_m3, 1e-12);
  const Difference whole = difference(before, fine, true);
  EXPECT_NEAR(whole.cut_m3, -fine.change_m3(), whole.error_m3);
  EXPECT_LT(whole.error_m3, 0.02 * whole.cut_m3);
  EXPECT_NEAR(whole.area_m2, trench.area_m2(), kArea * trench.area_m2());
}

/// A mouth of 0.8 m x 0.5 m that goes straight for 2 m.
void drag(Ground& ground, double width_m, const Vec3& from, double yaw, double roll = 0) {
  Tracker tracker(ground, {bucket(width_m, 0.5)});
  const Eigen::Quaterniond turn = from_rpy(0, 0, yaw);
  for (const double x : {0.0, 2.0})
    tracker.update(0, {turn * (from + Vec3(x, 0, 0)), turn * from_rpy(roll, 0, 0)});
}

/// Both ways, for each pair of voxels: what was cut and filled, within what it says it may err by.
void expect_cut_and_fill(const std::function<void(Ground&)>& first,
                         const std::function<void(Ground&)>& second, double cut_m3, double fill_m3,
                         double most_error_m3, const Vec2& slope = Vec2::Zero()) {
  const auto terrain = plane(0, slope);
  for (const auto& [h, k] :
       {std::pair(0.05, 0.05), {0.05, 0.025}, {0.025, 0.05}, {0.05, 0.07}, {0.07, 0.05}}) {
    SCOPED_TRACE(::testing::Message() << h << " " << k);
    Ground before(h, Vec3::Zero(), terrain), after(k, Vec3::Zero(), terrain);
    first(before);
    second(after);
    const Difference d = difference(before, after, true), back = difference(after, before, true);
    EXPECT_NEAR(d.cut_m3, cut_m3, d.error_m3);
    EXPECT_NEAR(d.fill_m3, fill_m3, d.error_m3);
    EXPECT_NEAR(back.fill_m3, d.cut_m3, 1e-12);
    EXPECT_NEAR(back.error_m3, d.error_m3, 1e-12);
    EXPECT_NEAR(d.net_m3, after.change_m3() - before.change_m3(), 1e-9);
    EXPECT_NEAR(d.fill_m3 - d.cut_m3, d.net_m3, 1e-9);
    EXPECT_LT(d.error_m3, most_error_m3);
  }
}

TEST(BoxDifference, KeepsCutAndFillAboveEachOtherApart) {
  for (const double yaw : {0.0, 0.4}) {
    SCOPED_TRACE(yaw);
    const Vec3 at(0.011, 0.013, 0);
    // A tunnel in one, a trench above it in the other.
    expect_cut_and_fill([&](Ground& s) { drag(s, 0.8, at - Vec3(0, 0, 1.5), yaw); },
                        [&](Ground& s) { drag(s, 0.8, at - Vec3(0, 0, 0.5), yaw); }, 0.8, 0.8,
                        0.04);
    // Tunnels that share a layer: 0.3 m of each are apart, with nothing between.
    expect_cut_and_fill([&](Ground& s) { drag(s, 0.8, at - Vec3(0, 0, 1.5), yaw); },
                        [&](Ground& s) { drag(s, 0.8, at - Vec3(0, 0, 1.2), yaw); }, 0.48, 0.48,
                        0.08);
    // And side by side.
    expect_cut_and_fill([&](Ground& s) { drag(s, 0.8, at - Vec3(0, 0, 1.5), yaw); },
                        [&](Ground& s) { drag(s, 0.8, at - Vec3(0, 0.8, 1.5), yaw); }, 0.8, 0.8,
                        0.1);
  }
}

TEST(BoxDifference, KeepsCutAndFillApartWhereSurfacesCross) {
  // Squares of 0.5 m, one turned by an eighth, share a regular octagon.
  const double side = 0.5, octagon = 2 * (std::numbers::sqrt2 - 1) * side * side;
  const double apart = 2 * (side * side - octagon);
  const auto turned = [&](double roll) {
    return [side, roll](Ground& s) {
      const Vec3 up = from_rpy(roll, 0, 0) * Vec3(0, 0, side / 2);
      drag(s, side, Vec3(0.011, 0.013, -1.5) - up, 0, roll);
    };
  };
  expect_cut_and_fill(turned(0), turned(kPi / 4), apart, apart, 0.04);
}

TEST(BoxDifference, KeepsCutAndFillApartOnASteepSlope) {
  // Along it the lips are a tenth of a metre and three below the ground, the mouths at right
  // angles.
  const double steep = std::atan(1.7), width = 0.8, length = std::hypot(1, 1.7);
  const auto shave = [&](double depth) {
    return [=](Ground& s) {
      Tracker tracker(s, {bucket(width, 0.5)});
      for (const double x : {0.0, 1.0})
        tracker.update(0, {{x, 0.013, 1.7 * x - depth}, from_rpy(0, -steep, 0)});
    };
  };
  const double shallow = 0.1 * std::cos(steep), deep = 0.3 * std::cos(steep);
  const double shift = 0.2 * std::sin(steep), both = (length - shift) * shallow;
  expect_cut_and_fill(shave(0.1), shave(0.3), width * (length * deep - both),
                      width * (length * shallow - both), 0.02, {1.7, 0});
}

TEST(BoxDifference, FollowsGroundThatWasDugFromGround) {
  const auto terrain = plane(0.013);
  const HalfSine trench;
  auto first = std::make_shared<Ground>(0.05, Vec3::Zero(), terrain);
  trench.dig(*first, 0, 0.5);
  Ground second(0.1, Vec3::Zero(), make_ground_terrain(first));
  trench.dig(second, 0.5, 1);
  Ground whole(0.05, Vec3::Zero(), terrain);
  trench.dig(whole);
  const Difference rest = difference(*first, second, false);
  EXPECT_NEAR(rest.net_m3, second.change_m3(), 1e-12);
  const Difference none = difference(whole, second, false);
  EXPECT_LT(none.cut_m3, none.error_m3);
  EXPECT_LT(none.fill_m3, none.error_m3);
}

}  // namespace difference_test
}  // namespace soilvdb
