// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Tools on ground whose soil moves, how it must lie in the end, and what is wrong with soil at
// rest.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <utility>
#include <vector>

#include "tests/support/earthmoving_fixture.h"

namespace soilvdb::test {

// ---- What is wrong with soil at rest ----

inline constexpr std::pair<int, int> kAround[] = {{-1, -1}, {-1, 0}, {-1, 1}, {0, -1},
                                                  {0, 1},   {1, -1}, {1, 0},  {1, 1}};
/// Columns over which a slope is measured: between neighbours, the error of counts is a slope.
inline constexpr int kFar = 3;
/// Error of the difference of two counted heights, cells.
inline constexpr double kCounts = 0.1;
/// What stands so far above, or lacks so far below, all columns around is no slope, cells: the
/// steepest here is 0.93 to the next column, and 1.32 to the next aslant.
inline constexpr double kSpike = 1.5;

inline double loose_depth(const GroundColumn& column) {
  return column.known ? column.top - column.bank : 0;
}

/// Finds what is wrong in a window, but not in some of its columns: soil may lean on a tool there.
class Faults {
 public:
  /// @param taken cells
  Faults(const GroundWindow& window, double repose_rad, const Eigen::AlignedBox2i& taken = {})
      : window_(window) {
    for (int x = kFar; x + kFar < window.nx(); ++x) {
      for (int y = kFar; y + kFar < window.ny(); ++y) {
        if (taken.contains(window.first() + Coord2(x, y))) continue;
        hanging_ += window.at(x, y).hangs != 0;
        if (!window.at(x, y).known) continue;
        look_for_spikes(x, y);
        // Not a film on steps of the bank.
        if (loose_depth(window.at(x, y)) > 0.5) over_rad_.push_back(steepest_rad(x, y, repose_rad));
      }
    }
    std::sort(over_rad_.begin(), over_rad_.end());
  }

  std::size_t loose_columns() const { return over_rad_.size(); }
  /// How much steeper than repose a share of the columns with loose soil are at most, rad.
  double over_rad(double share) const {
    if (over_rad_.empty()) return 0;
    const double last = static_cast<double>(over_rad_.size() - 1);
    return over_rad_[static_cast<std::size_t>(share * last)];
  }
  int needles() const { return needles_; }  ///< loose soil above all columns around
  int slits() const { return slits_; }      ///< holes that soil beside them should have filled
  int hanging() const { return hanging_; }  ///< loose soil that nothing is under

 private:
  /// The steepest of eight ways down, rad beyond repose; 0 if none is too steep.
  double steepest_rad(int x, int y, double repose_rad) const {
    const GroundColumn& from = window_.at(x, y);
    double most = 0;
    for (const auto& [dx, dy] : kAround) {
      // Over a brink soil is as steep as it lies on its own bank. Bank on the way holds it, too.
      double floor = from.bank;
      bool known = true;
      for (int i = 1; i <= kFar; ++i) {
        const GroundColumn& to = window_.at(x + i * dx, y + i * dy);
        known = known && to.known;
        floor = std::max(floor, i < kFar ? to.bank : to.top);
      }
      if (!known) continue;
      most = std::max(
          most, std::atan2(from.top - floor - kCounts, kFar * std::hypot(dx, dy)) - repose_rad);
    }
    return most;
  }
  void look_for_spikes(int x, int y) {
    const GroundColumn& middle = window_.at(x, y);
    double lowest = std::numeric_limits<double>::infinity(), highest = -lowest, deepest = 0;
    for (const auto& [dx, dy] : kAround) {
      const GroundColumn& beside = window_.at(x + dx, y + dy);
      if (!beside.known) return;
      lowest = std::min(lowest, beside.top);
      highest = std::max(highest, beside.top);
      deepest = std::max(deepest, loose_depth(beside));
    }
    // Bank stands as it was cut: only what is loose counts.
    needles_ += middle.top - std::max(highest, middle.bank) > kSpike;
    slits_ += middle.top < lowest - kSpike && deepest >= kSpike;
  }

  const GroundWindow& window_;
  std::vector<double> over_rad_;
  int needles_ = 0, slits_ = 0, hanging_ = 0;
};

// ---- Tools ----

inline constexpr double kBladeDepth = 0.15;
/// A dozer's: hollow before it, open at its ends.
inline Bucket blade(double width_m, double height_m) {
  return {width_m,
          height_m,
          {{0, 0}, {-kBladeDepth, height_m / 3}, {-kBladeDepth, 2 * height_m / 3}, {0, height_m}},
          {}};
}

/// Height of the ridge before a blade that was pushed some way, m. It gains what is cut, and loses
/// at each end what stands beside the blade as it passes: the section of a slope of repose.
/// @param swell loose volume over bank volume
inline double pushed_height_m(double width_m, double depth_m, double way_m, double slope,
                              double swell) {
  constexpr double kStep_m = 1e-4;
  double height_m = kStep_m;
  for (double at_m = 0; at_m < way_m; at_m += kStep_m) {
    const double gain_m2 = width_m * depth_m * swell - height_m * height_m / slope;
    // A prism as wide as the blade, and a quarter of a cone before each of its ends.
    const double area_m2 =
        width_m * height_m / slope + std::numbers::pi * height_m * height_m / (2 * slope * slope);
    height_m += kStep_m * gain_m2 / area_m2;
  }
  return height_m;
}

/// One machine whose bucket is a tool, and its ground.
struct ToolSite {
  Bucket bucket;
  Earthmoving all;
  Ground ground;
  Tracker tracker;
  ToolSite(double voxel, std::shared_ptr<const InitialTerrain> base, Bucket b, Earthmoving a)
      : bucket(std::move(b)),
        all(std::move(a)),
        ground(voxel, Vec3::Zero(), std::move(base)),
        tracker(ground, {bucket}, all) {}

  double repose_rad() const { return all.soil->repose_rad; }
  double slope() const { return std::tan(repose_rad()); }
  double load_m3() const { return tracker.ledger(0).bucket_m3(); }
  double loose_m3() const {
    return static_cast<double>(loose_samples(ground)) * ground.sample_m3();
  }

  /// Moves the bucket along poses given on flat ground at heading 0. The site is turned about its
  /// origin, and they are as high above its terrain.
  void go(double yaw, const std::vector<Pose>& path) {
    for (const Pose& pose : path) tracker.update(0, placed(yaw, pose));
  }
  Pose placed(double yaw, const Pose& pose) const {
    const Eigen::Quaterniond turn(Eigen::AngleAxisd(yaw, Vec3::UnitZ()));
    Pose at{turn * pose.position, turn * pose.rotation};
    at.position.z() += ground.terrain().height(at.position.x(), at.position.y()).value();
    return at;
  }
};

/// Poses from one to another, without the first.
inline void add_way(std::vector<Pose>& path, const Pose& to, int steps) {
  const Pose from = path.back();
  for (int i = 1; i <= steps; ++i)
    path.push_back(interpolate(from, to, static_cast<double>(i) / steps));
}

/// Calls `f(place, column)` with places as they would be at heading 0.
template <typename F>
void each_column(const Ground& ground, double yaw, const F& f) {
  const GroundWindow window = all_of(ground);
  const Eigen::Rotation2Dd back(-yaw);
  for (int x = 0; x < window.nx(); ++x) {
    for (int y = 0; y < window.ny(); ++y) {
      const Coord2 cell = window.first() + Coord2(x, y);
      const Vec3 at = ground.world_from_index(Vec3(cell.x(), cell.y(), 0));
      if (window.at(x, y).known) f(Vec2(back * at.head<2>()), window.at(x, y));
    }
  }
}

/// Height of a ridge whose crest is as long as the lip, with half a cone at each end.
inline double ridge_height_m(double volume_m3, double width_m, double slope) {
  double low = 0, high = 100;
  for (int i = 0; i < 60; ++i) {
    const double a = (low + high) / 2;
    const double holds =
        width_m * a * a / slope + std::numbers::pi * a * a * a / (3 * slope * slope);
    (holds < volume_m3 ? low : high) = a;
  }
  return low;
}

/// A scene mirrored about the plane y = 0, or not, and then turned about the z axis.
struct Turn {
  double yaw = 0;
  bool mirrored = false;

  Vec2 operator()(Vec2 p) const {
    if (mirrored) p.y() = -p.y();
    return Eigen::Rotation2Dd(yaw) * p;
  }
  Pose operator()(const Pose& pose) const {
    const Eigen::Quaterniond turn(Eigen::AngleAxisd(yaw, Vec3::UnitZ()));
    Pose at = pose;
    if (mirrored) {
      const Eigen::Quaterniond& r = pose.rotation;
      at.position.y() = -at.position.y();
      at.rotation = Eigen::Quaterniond(r.w(), -r.x(), r.y(), -r.z());
    }
    return {turn * at.position, turn * at.rotation};
  }
};

}  // namespace soilvdb::test
