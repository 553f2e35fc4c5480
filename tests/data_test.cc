// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The digs in data/ are what data/README.md says of them.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <numbers>
#include <string>

#include "soilvdb/io/scenario.h"

namespace soilvdb::io {
namespace {

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

}  // namespace
}  // namespace soilvdb::io
