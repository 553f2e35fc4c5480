// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The ground before digging by levels of detail, as tiles of heights.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "soilvdb/io/site.h"
#include "soilvdb/session.h"

namespace soilvdb::tools {

/// Immutable, thread-safe.
class TerrainTiles {
 public:
  static constexpr int kSide = 256;  ///< steps between posts along a tile

  /// @param work area of machines, pours and hoppers, which is shown of unbounded ground
  TerrainTiles(const io::Site& site, const Eigen::AlignedBox2d& work);

  /// Bounds and levels, the finest first.
  nlohmann::ordered_json description() const;
  /// float32 heights of a tile, row-major from low y and low x, NaN without a height; empty if
  /// there is no such tile.
  /// @param other a surface to sample at the same posts; null: the terrain
  std::optional<std::string> tile(int level, int i, int j,
                                  const InitialTerrain* other = nullptr) const;

 private:
  struct Level {
    double spacing_m = 0;
    int nx = 0, ny = 0;
  };
  std::shared_ptr<const InitialTerrain> base_;
  const InitialTerrain* undug_;
  Eigen::AlignedBox2d bounds_;
  std::vector<Level> levels_;
};

/// The area of a session's machines, pours, hoppers and dug ground.
Eigen::AlignedBox2d work_area(const Session& session);

}  // namespace soilvdb::tools
