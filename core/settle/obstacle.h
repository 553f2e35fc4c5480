// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A bucket as an obstacle to soil that falls and slides.
#pragma once

#include <cstdint>
#include <vector>

#include "core/settle/ground_window.h"
#include "soilvdb/bucket.h"

namespace soilvdb::inline v0 {

/// The lowest point of a bucket over each column of cells; by default no bucket.
class Obstacle {
 public:
  Obstacle() = default;
  Obstacle(const Bucket& bucket, const Pose& world_from_bucket, const Ground& ground);

  /// Does it reach into soil whose surface is at `top`? @param x, y cell
  bool blocks(int x, int y, double top) const;

 private:
  friend class BlockedColumns;
  Coord2 first_ = Coord2::Zero();
  int nx_ = 0, ny_ = 0;
  std::vector<float> lowest_;  // index space, cells above the ground's index 0
};

/// Columns of a window that take and give no soil: those in which an obstacle stands, and those
/// that it surrounds, where soil would pile up as in a well.
class BlockedColumns {
 public:
  BlockedColumns(const GroundWindow& window, const Obstacle& obstacle);
  /// @param x, y in the window, from 0
  bool operator()(int x, int y) const {
    const int i = x - first_.x(), j = y - first_.y();
    if (i < 0 || j < 0 || i >= nx_ || j >= ny_) return false;
    return blocked_[static_cast<std::size_t>(i * ny_ + j)] != 0;
  }

 private:
  Coord2 first_;
  int nx_, ny_;
  std::vector<std::uint8_t> blocked_;
};

}  // namespace soilvdb::inline v0
