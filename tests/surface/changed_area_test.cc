// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The area that a change covers, against that of the solids that were dug.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "soilvdb/difference.h"
#include "soilvdb/tracker.h"

namespace soilvdb {
namespace changed_area_test {

constexpr double kPi = std::numbers::pi;

/// A mouth that goes straight, all else as it is, turned by `yaw` about a place that is on no
/// voxel's side.
struct Drag {
  double width, height, z;  // of the lip's middle
  double roll = 0, y = 0, length = 2, rise = 0, pitch = 0;

  void dig(Ground& ground, double yaw) const {
    Bucket bucket;
    bucket.width_m = width;
    bucket.height_m = height;
    Tracker tracker(ground, {bucket});
    const Eigen::Quaterniond turn = from_rpy(0, 0, yaw);
    for (const double s : {0.0, 1.0}) {
      const Vec3 at(s * length, y, z + s * rise);
      tracker.update(0, {Vec3(0.013, -0.027, 0) + turn * at, turn * from_rpy(roll, pitch, 0)});
    }
  }
};

struct Case {
  std::string name;
  double area_m2;
  std::vector<Drag> before, after;
  double slope = 0;                    // of the ground along the drag
  double exact = 0.02, across = 0.05;  // relative
};

std::vector<Case> cases() {
  const auto groove = [](double w, double roll, double d) {
    return w / 2 * std::cos(roll) + d / std::tan(roll) +
           (d + w / 2 * std::sin(roll)) * std::tan(roll);
  };
  std::vector<Case> all;
  for (const double w : {0.1, 0.17, 0.3, 0.8})
    all.push_back({"tunnel", 2 * w, {}, {{w, 0.5, -1.5}}});
  for (const double roll : {0.2, 0.7, 1.2})
    all.push_back({"rolled tunnel",
                   2 * (0.8 * std::cos(roll) + 0.5 * std::sin(roll)),
                   {},
                   {{0.8, 0.5, -1.5, roll}}});
  for (const double w : {0.16, 0.6, 1.5}) all.push_back({"trench", 2 * w, {}, {{w, 2, -0.51}}});
  for (const double roll : {0.4, 0.7, kPi / 4, 1.1})
    all.push_back({"groove", 2 * groove(0.8, roll, 0.1), {}, {{0.8, 2, -0.1, roll}}});
  all.push_back({"undercut", 2 * 0.6, {{0.6, 2, -1}}, {{0.6, 2, -1}, {1.2, 0.4, -1}}});
  all.push_back({"undercut of 8 cm",
                 2 * 0.16,
                 {{0.6, 2, -1}},
                 {{0.6, 2, -1}, {0.76, 0.4, -1}},
                 0,
                 0.02,
                 0.1});
  all.push_back({"2 cm of a wall", 2 * 0.04, {{0.6, 2, -1}}, {{0.64, 2, -1}}, 0, 0.08, 0.2});
  all.push_back({"2 cm of a floor", 2 * 0.6, {{0.6, 2, -1}}, {{0.6, 2, -1.02}}, 0, 0.02, 0.12});
  all.push_back({"2 cm of a roof", 2 * 0.6, {{0.6, 0.4, -1}}, {{0.6, 0.42, -1}}, 0, 0.02, 0.12});
  all.push_back({"tunnel beneath a trench", 2 * 1.0, {{1.0, 0.5, -1.5}}, {{0.6, 2, -0.51}}});
  all.push_back({"skim", 2 * 0.9, {}, {{0.9, 1, -0.012}}});
  const double steep = std::atan(1.7);
  for (const double d : {0.1, 0.3})
    all.push_back({"shave of a steep slope",
                   0.8 * (1 + d * std::sin(steep) * std::cos(steep)),
                   {},
                   {{0.8, 0.5, -d, 0, 0, 1, 1.7, -steep}},
                   1.7,
                   0.03});
  return all;
}

TEST(ChangedArea, IsThatOfTheSolids) {
  for (const Case& c : cases()) {
    for (const double yaw : {0.0, 0.3, 0.7}) {
      const Vec2 slope = c.slope * Vec2(std::cos(yaw), std::sin(yaw));
      const std::shared_ptr<const InitialTerrain> terrain =
          make_plane(-slope.dot(Vec2(0.013, -0.027)), slope);
      const auto area = [&](double h, double k) {
        Ground before(h, Vec3::Zero(), terrain), after(k, Vec3::Zero(), terrain);
        for (const Drag& drag : c.before) drag.dig(before, yaw);
        for (const Drag& drag : c.after) drag.dig(after, yaw);
        SCOPED_TRACE(::testing::Message() << c.name << " " << yaw << " " << h << " " << k);
        const double tolerance = h == k ? c.exact : c.across;
        EXPECT_NEAR(difference(before, after, true).area_m2 / c.area_m2, 1, tolerance);
      };
      for (const double h : {0.05, 0.025}) area(h, h);
      for (const auto& [h, k] : {std::pair(0.05, 0.025), {0.025, 0.05}, {0.05, 0.07}}) area(h, k);
    }
  }
}

}  // namespace changed_area_test
}  // namespace soilvdb
