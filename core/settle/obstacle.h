// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A bucket as an obstacle to soil that falls and slides.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/constants.h"
#include "core/ground/ground_columns.h"
#include "soilvdb/bucket.h"

namespace soilvdb::inline v0 {

/// The lowest point of a bucket over each column of cells; by default no bucket.
class Obstacle {
 public:
  Obstacle() = default;
  Obstacle(const Bucket& bucket, const Pose& world_from_bucket, const Ground& ground);

  bool empty() const { return lowest_.empty(); }
  /// The cells of the columns that it is over.
  Eigen::AlignedBox2i cells() const { return {first_, first_ + Coord2(nx_ - 1, ny_ - 1)}; }
  /// Does it reach into soil whose surface is at `top`, or is less than `clearance` cells above it?
  /// @param x, y cell
  bool blocks(int x, int y, double top, float clearance) const;

 private:
  friend class BlockedColumns;
  Coord2 first_ = Coord2::Zero();
  int nx_ = 0, ny_ = 0;
  std::vector<float> lowest_;  // index space, cells above the ground's index 0
};

/// Columns that take and give no soil: those in which a tool stands, and those that it surrounds,
/// where soil would pile up as in a well. Each tool is looked at when a column under it is asked
/// for.
class BlockedColumns {
 public:
  /// @param ground, obstacles must outlive it
  BlockedColumns(GroundColumns& ground, std::span<const Obstacle* const> obstacles,
                 float clearance = kObstacleClearance);
  bool operator()(const Coord2& cell) { return over_.contains(cell) && blocks(cell); }

 private:
  struct Mask {
    const Obstacle* obstacle;
    std::vector<std::uint8_t> blocked;  // over its cells, by x then y; empty: not looked at yet
  };
  bool blocks(const Coord2& cell);
  void look_at(Mask& mask);

  GroundColumns* ground_;
  float clearance_;  // cells
  std::vector<Mask> masks_;
  Eigen::AlignedBox2i over_;  // around all of them
};

}  // namespace soilvdb::inline v0
