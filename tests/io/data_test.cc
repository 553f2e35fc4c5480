// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The digs in data/ are what data/README.md says of them.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <numbers>
#include <string>

#include "soilvdb/io/scenario.h"
#include "soilvdb/io/site.h"
#include "soilvdb/surface_height.h"
#include "soilvdb/tracker.h"

namespace soilvdb::io {
namespace data_test {

std::filesystem::path data(const std::string& name) {
  return std::filesystem::path(SOILVDB_SOURCE_DIR) / "data" / name;
}

TEST(HalfSine, TheLipFollowsItsHalfEllipse) {
  const Scenario s = read_scenario(data("half_sine.yaml"));
  const Motion& motion = *s.machines.at(0).motion.part(0);
  EXPECT_EQ(motion.begin_s(), 0);
  EXPECT_EQ(motion.end_s(), 1);
  double area = 0;
  Vec3 before = motion.pose(0).position;
  for (double t : motion.times_s()) {
    const Vec3 p = motion.pose(t).position;
    EXPECT_NEAR(p.x(), 2 - 0.5 * std::cos(std::numbers::pi * t), 1e-9);
    EXPECT_NEAR(p.z(), -0.25 * std::sin(std::numbers::pi * t), 1e-9);
    area -= (p.x() - before.x()) * (p.z() + before.z()) / 2;
    before = p;
  }
  const double exact = std::numbers::pi / 2 * 0.5 * 0.25;
  EXPECT_NEAR(area / exact, 1, 1e-5);
  EXPECT_NEAR(exact * s.machines[0].bucket.width_m, 0.0392699, 1e-7);
}

TEST(Excavator, StaysWithinItsLimitsAndDigsMouthForward) {
  const Scenario s = read_scenario(data("excavator.yaml"));
  EXPECT_TRUE(s.warnings.empty()) << s.warnings.front();
  const Motion& motion = *s.machines.at(0).motion.part(0);
  EXPECT_GT(motion.end_s(), 100);
  // While the mouth looks roughly level and the lip moves at digging speed, it moves mouth first.
  int digging = 0;
  for (std::size_t i = 1; i < motion.times_s().size(); ++i) {
    const Pose a = motion.pose(motion.times_s()[i - 1]), b = motion.pose(motion.times_s()[i]);
    if (b.position.z() > 432.3) continue;  // above all of the ground that is dug
    ++digging;
    const Vec3 mouth = b.rotation * Vec3::UnitX(), step = b.position - a.position;
    EXPECT_GT(mouth.dot(step), 0) << "at " << motion.times_s()[i];
  }
  EXPECT_GT(digging, 100);
}

TEST(Excavator, LoadsTheTruckPilesTheRestAndItsTrenchFailsInTheLastCycle) {
  Scenario s = read_scenario(data("excavator.yaml"));
  s.voxel_size_m = 0.1;
  const Site site = open_site(s);
  Tracker tracker(*site.ground, {s.machines.at(0).bucket}, Earthmoving{s.soil, s.pours, s.hoppers});
  constexpr double kLastCycle_s = 112;
  double slid_before_m3 = 0, slid_m3 = 0;
  const auto& motions = s.machines[0].motion;
  for (std::size_t part = 0; part < motions.parts(); ++part) {
    const auto motion = motions.part(part);
    for (std::size_t i = 1; i < motion->times_s().size(); ++i) {
      const double from = motion->times_s()[i - 1], to = motion->times_s()[i];
      (to < kLastCycle_s ? slid_before_m3 : slid_m3) +=
          tracker.update(0, *motion, from, to).slid_m3;
    }
  }
  slid_m3 += tracker.come_to_rest().slid_m3;
  const MassBalance balance = tracker.mass_balance();
  EXPECT_EQ(balance.ground + tracker.total().load + balance.pending + balance.hauled, 0);
  EXPECT_EQ(tracker.total().load, 0) << "the last load was tipped";
  // Five loads of not less than 0.8 of the struck capacity, none over the heaped one.
  const double hauled_m3 = balance.units.loose_samples(balance.hauled) * site.ground->sample_m3();
  EXPECT_GT(hauled_m3, 5 * 0.8 * 0.988);
  EXPECT_LT(hauled_m3, 5 * 1.258);
  // Three such loads at the angle of repose: lower than a cone, higher than a ridge along the lip.
  const auto top = surface_height(*site.ground, 512345.214, 5403636.118);
  const auto ground = site.ground->initial_terrain().height(512345.214, 5403636.118);
  const double slope = std::tan(s.soil->repose_rad);
  const auto cone_m = [&](double m3) {
    return std::cbrt(3 * m3 * slope * slope / std::numbers::pi);
  };
  const auto ridge_m3 = [&](double high_m) {
    return high_m * high_m * s.machines[0].bucket.width_m / slope +
           std::numbers::pi * std::pow(high_m / slope, 3) * slope / 3;
  };
  EXPECT_GT(ridge_m3(*top - *ground), 3 * 0.8 * 0.988);
  EXPECT_LT(*top - *ground, cone_m(3 * 1.258));
  EXPECT_GT(slid_m3, 1) << "both walls, 1.5 m high";
  EXPECT_LT(slid_before_m3, 0.5 * slid_m3);
}

}  // namespace data_test
}  // namespace soilvdb::io
