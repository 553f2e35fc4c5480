// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/difference.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <functional>
#include <memory>
#include <numbers>
#include <utility>
#include <vector>

#include "soilvdb/lattice.h"
#include "soilvdb/tracker.h"

namespace soilvdb {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kArea = 0.02;  // relative: what is asked of diff's area

Bucket bucket(double width_m, double height_m) {
  Bucket b;
  b.width_m = width_m;
  b.height_m = height_m;
  return b;
}

/// A mouth that stays upright while its lip follows half a sine below the ground.
struct HalfSine {
  Vec2 from{0.013, -0.027};
  double yaw = 0, width = 0.6, length = 2, depth = 0.3, ground = 0;
  double area_m2() const { return width * length; }

  void dig(Soil& soil, double begin = 0, double end = 1) const {
    Tracker tracker(soil, {bucket(width, 1)});
    for (int i = 0; i <= 100; ++i) {
      const double s = begin + (end - begin) * i / 100;
      const Vec2 at = from + s * length * Vec2(std::cos(yaw), std::sin(yaw));
      tracker.update(0,
                     {{at.x(), at.y(), ground - depth * std::sin(kPi * s)}, from_rpy(0, 0, yaw)});
    }
  }
};

std::shared_ptr<const BaseSurface> plane(double height_m, const Vec2& slope = Vec2::Zero()) {
  return make_plane(height_m, slope);
}

TEST(Difference, OfAPitHasItsAreaAndVolume) {
  for (const double yaw : {0.0, 0.4, 1.1}) {
    for (const double h : {0.05, 0.1}) {
      SCOPED_TRACE(testing::Message() << yaw << " " << h);
      const auto ground = plane(0.013);
      const Soil before(h, Vec3::Zero(), ground);
      Soil after(h, Vec3::Zero(), ground);
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
        SCOPED_TRACE(testing::Message() << slope << " " << yaw << " " << h);
        HalfSine trench;
        trench.yaw = yaw;
        // The same across the slope, along which it stays level.
        const Vec2 across(-std::sin(yaw), std::cos(yaw));
        const auto ground = plane(-slope * across.dot(trench.from), slope * across);
        const Soil before(h, Vec3::Zero(), ground);
        Soil after(h, Vec3::Zero(), ground);
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
  const auto ground = plane(0.02);
  const Soil before(0.05, Vec3::Zero(), ground);
  Soil after(0.05, Vec3::Zero(), ground);
  Tracker tracker(after, {bucket(2, 2)});
  for (const double x : {0.33, 5.33})
    tracker.update(0, {{x, 0.21, 0.015}, Eigen::Quaterniond::Identity()});
  EXPECT_NEAR(difference(before, after, true).area_m2, 10, kArea * 10);
}

TEST(Lattice, IsTheSameWhateverPlaceComesFirst) {
  for (const double h : {0.025, 0.05, 0.1}) {
    const double period = kLatticePeriod * h;
    const Vec3 at(556449.9, 5394951.3, 540);
    const Vec3 origin = lattice_origin(h, at);
    EXPECT_LE((origin - at).cwiseAbs().maxCoeff(), period / 2);
    for (const Vec3& step : {Vec3(30, -40, 5), Vec3(5 * period, 0, 0), Vec3(-2000, 999, -700)}) {
      const auto ground = plane(0);
      const Soil a(h, origin, ground), b(h, lattice_origin(h, at + step), ground);
      const auto shift = lattice_shift(a, b);
      ASSERT_TRUE(shift.has_value());
      EXPECT_LT((a.world_from_index(shift->cast<double>()) - b.origin()).norm(), 1e-6);
      const Coord3 voxel(7, -3, 11);
      EXPECT_EQ(&sample_points(voxel), &sample_points(voxel + *shift));
    }
  }
  const auto ground = plane(0);
  EXPECT_EQ(lattice_shift({0.1, Vec3::Zero(), ground}, {0.05, Vec3::Zero(), ground}), std::nullopt);
  for (const double x : {10.0, -10.0}) {
    EXPECT_EQ(lattice_shift({0.1, Vec3::Zero(), ground}, {0.1, Vec3(x, 0, 0), ground}),
              std::nullopt);
  }
}

TEST(Lattice, TheSameDigOnOtherOriginsIsTheSame) {
  constexpr double kVoxel = 0.05;
  HalfSine trench;
  trench.from = {556449.9, 5394951};
  trench.yaw = 0.3;
  trench.ground = 540;  // samples lie in the ground's plane but for rounding
  const auto ground = plane(540);
  const Vec3 origin = lattice_origin(kVoxel, {556449.9, 5394951, 540});
  const Vec3 period = Vec3::Constant(kLatticePeriod * kVoxel);
  Soil a(kVoxel, origin, ground), b(kVoxel, lattice_origin(kVoxel, origin + period), ground);
  ASSERT_NE(a.origin(), b.origin());
  const Soil before(kVoxel, origin, ground);
  trench.dig(a);
  trench.dig(b);
  const Difference whole = difference(before, a, true), none = difference(a, b, true);
  EXPECT_GT(whole.cut_m3, 0.2);
  EXPECT_TRUE(none.exact);
  // Samples on the very edge of what the bucket passes may be on either side of it.
  EXPECT_LT(none.cut_m3 + none.fill_m3, 1e-5 * whole.cut_m3);
  EXPECT_NEAR(difference(before, b, true).cut_m3, whole.cut_m3, 1e-5 * whole.cut_m3);
}

TEST(BoxDifference, OfTheSameDigWithOtherVoxelsIsWithinItsError) {
  const auto ground = plane(0.013, {0.05, -0.02});
  HalfSine trench;
  trench.yaw = 0.4;
  const Soil before(0.1, Vec3::Zero(), ground);
  Soil coarse(0.1, Vec3::Zero(), ground), fine(0.05, Vec3::Zero(), ground);
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
void drag(Soil& soil, double width_m, const Vec3& from, double yaw, double roll = 0) {
  Tracker tracker(soil, {bucket(width_m, 0.5)});
  const Eigen::Quaterniond turn = from_rpy(0, 0, yaw);
  for (const double x : {0.0, 2.0})
    tracker.update(0, {turn * (from + Vec3(x, 0, 0)), turn * from_rpy(roll, 0, 0)});
}

/// Both ways, for each pair of voxels: what was cut and filled, within what it says it may err by.
void expect_cut_and_fill(const std::function<void(Soil&)>& first,
                         const std::function<void(Soil&)>& second, double cut_m3, double fill_m3,
                         double most_error_m3, const Vec2& slope = Vec2::Zero()) {
  const auto ground = plane(0, slope);
  for (const auto& [h, k] :
       {std::pair(0.05, 0.05), {0.05, 0.025}, {0.025, 0.05}, {0.05, 0.07}, {0.07, 0.05}}) {
    SCOPED_TRACE(testing::Message() << h << " " << k);
    Soil before(h, Vec3::Zero(), ground), after(k, Vec3::Zero(), ground);
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
    expect_cut_and_fill([&](Soil& s) { drag(s, 0.8, at - Vec3(0, 0, 1.5), yaw); },
                        [&](Soil& s) { drag(s, 0.8, at - Vec3(0, 0, 0.5), yaw); }, 0.8, 0.8, 0.04);
    // Tunnels that share a layer: 0.3 m of each are apart, with nothing between.
    expect_cut_and_fill([&](Soil& s) { drag(s, 0.8, at - Vec3(0, 0, 1.5), yaw); },
                        [&](Soil& s) { drag(s, 0.8, at - Vec3(0, 0, 1.2), yaw); }, 0.48, 0.48,
                        0.08);
    // And side by side.
    expect_cut_and_fill([&](Soil& s) { drag(s, 0.8, at - Vec3(0, 0, 1.5), yaw); },
                        [&](Soil& s) { drag(s, 0.8, at - Vec3(0, 0.8, 1.5), yaw); }, 0.8, 0.8, 0.1);
  }
}

TEST(BoxDifference, KeepsCutAndFillApartWhereSurfacesCross) {
  // Squares of 0.5 m, one turned by an eighth, share a regular octagon.
  const double side = 0.5, octagon = 2 * (std::numbers::sqrt2 - 1) * side * side;
  const double apart = 2 * (side * side - octagon);
  const auto turned = [&](double roll) {
    return [side, roll](Soil& s) {
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
    return [=](Soil& s) {
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
  const auto ground = plane(0.013);
  const HalfSine trench;
  auto first = std::make_shared<Soil>(0.05, Vec3::Zero(), ground);
  trench.dig(*first, 0, 0.5);
  Soil second(0.1, Vec3::Zero(), make_soil_surface(first));
  trench.dig(second, 0.5, 1);
  Soil whole(0.05, Vec3::Zero(), ground);
  trench.dig(whole);
  const Difference rest = difference(*first, second, false);
  EXPECT_NEAR(rest.net_m3, second.change_m3(), 1e-12);
  const Difference none = difference(whole, second, false);
  EXPECT_LT(none.cut_m3, none.error_m3);
  EXPECT_LT(none.fill_m3, none.error_m3);
}

/// Soil in a box of both, m^3.
double soil_m3(const Soil& soil, const Eigen::AlignedBox3d& box) {
  std::int64_t count = 0;
  const double h = soil.voxel_size_m();
  SampleWords words;
  for (double x = box.min().x(); x < box.max().x() - h / 2; x += 8 * h)
    for (double y = box.min().y(); y < box.max().y() - h / 2; y += 8 * h)
      for (double z = box.min().z(); z < box.max().z() - h / 2; z += 8 * h) {
        const Vec3 first = soil.index_from_world(Vec3(x, y, z) + Vec3::Constant(h / 2));
        soil.read_samples(first.array().round().matrix().cast<int>(), words);
        for (const std::uint64_t word : words) count += std::popcount(word);
      }
  return static_cast<double>(count) * soil.sample_m3();
}

TEST(SoilSurface, HoldsTheVolumeOfTheGroundItIsOf) {
  const auto ground = plane(0.013);
  auto dug = std::make_shared<Soil>(0.05, Vec3::Constant(0.025), ground);
  HalfSine trench;
  trench.yaw = 0.4;
  trench.dig(*dug);
  const Eigen::AlignedBox3d box(Vec3(-1.6, -1.6, -1.6), Vec3(3.2, 3.2, 1.6));
  const double before = soil_m3(*dug, box), cut = -dug->change_m3();
  for (const double h : {0.025, 0.1, 0.2}) {
    const Soil soil(h, Vec3::Constant(h / 2), make_soil_surface(dug));
    // Half a voxel of the ground that was dug, on all that was dug, is what is promised.
    EXPECT_NEAR(soil_m3(soil, box), before, 0.02 * cut) << h;
  }
}

TEST(SoilSurface, IsTheGroundsOwnBaseWhereNobodyDug) {
  const auto ground = plane(0.013, {0.2, 0.1});
  auto dug = std::make_shared<Soil>(0.05, Vec3::Zero(), ground);
  HalfSine().dig(*dug);
  const Soil on_it(0.1, Vec3::Zero(), make_soil_surface(dug)), own(0.1, Vec3::Zero(), ground);
  SampleWords a, b;
  for (int z = -16; z <= 16; z += 8) {
    const Coord3 far(80, 80, z);
    on_it.read_samples(far, a);
    own.read_samples(far, b);
    EXPECT_EQ(a, b);
  }
  EXPECT_EQ(*on_it.base().height(20, 20), *ground->height(20, 20));
  EXPECT_TRUE(on_it.is_air({Vec3(0.9, -0.1, -0.2), Vec3(1.1, 0.1, 1)}));
  EXPECT_FALSE(on_it.is_air({Vec3(0.9, -0.1, -0.5), Vec3(1.1, 0.1, 1)}));
  EXPECT_EQ(on_it.base().classify({Vec3(0.9, -0.1, -0.8), Vec3(1.1, 0.1, -0.6)}), Content::kSoil);
}

}  // namespace
}  // namespace soilvdb
