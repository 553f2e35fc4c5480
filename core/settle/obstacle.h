// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A bucket as what falls and slides meets it.
#pragma once

#include <vector>

#include "core/settle/ground_window.h"
#include "soilvdb/bucket.h"

namespace soilvdb::inline v0 {

/// The lowest point of a bucket over each column of cells. Nothing at all unless given one.
class Obstacle {
 public:
  Obstacle() = default;
  Obstacle(const Bucket& bucket, const Pose& world_from_bucket, const Soil& soil);

  /// Does it stand in soil whose surface is that high? @param x, y cell
  bool blocks(int x, int y, double top) const;

 private:
  Coord2 first_ = Coord2::Zero();
  int nx_ = 0, ny_ = 0;
  std::vector<float> lowest_;  // index space, cells above the ground's index 0
};

}  // namespace soilvdb::inline v0
