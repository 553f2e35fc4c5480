// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Height of the topmost soil at a position.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <unordered_map>
#include <vector>

#include "soilvdb/mesher.h"

namespace soilvdb::inline v0 {

/// Heights from the mesh of the resident ground, and from the initial terrain elsewhere.
///
/// The patches are cached, so many heights in one area cost little more than one. For one thread at
/// a time. The error is at most 0.15 voxel except at walls. The ground must outlive it.
class SurfaceHeight {
 public:
  explicit SurfaceHeight(const Ground& ground);
  /// Height of the topmost soil at (x, y) in the world, m; std::nullopt without soil.
  std::optional<double> at(double x, double y);
  /// Heights at many positions, NaN without soil. Runs in the caller's TBB arena. The bits do not
  /// depend on the number of threads or on the other positions.
  void at(std::span<const Vec2> xy_m, std::span<double> heights_m);
  /// Must receive the changed chunks of ChangeFollower::take() before the next query.
  void update(std::span<const Coord3> changed_chunks);

 private:
  /// A block's mesh, and its triangles above each column of voxels.
  struct Patch {
    Mesh mesh;
    Eigen::Vector2i first = {0, 0}, size = {0, 0};
    std::vector<std::uint32_t> begin;  ///< start of each column in `over`, y fastest, and the end
    std::vector<std::uint32_t> over;
  };
  struct Hash {
    std::size_t operator()(const Coord3& c) const {
      std::uint64_t bits = static_cast<std::uint32_t>(c.x());
      for (const int v : {c.y(), c.z()})
        bits = (bits ^ bits >> 29) * 0x9e3779b97f4a7c15u + static_cast<std::uint32_t>(v);
      return static_cast<std::size_t>(bits ^ bits >> 32);
    }
  };
  void add(const Coord3& chunk);
  void make(const Coord3& block, Patch& patch, CachedMesher* mesher) const;
  template <typename F>
  void each_block(double x, double y, const F& f) const;
  std::optional<double> look(double x, double y) const;

  const Ground& ground_;
  std::optional<CachedMesher> mesher_;  ///< from the first change between queries
  std::unordered_map<Coord3, std::vector<int>, Hash> blocks_;  ///< block z by column (x, y, 0)
  std::unordered_map<Coord3, Patch, Hash> patches_;
};

/// Thread-safe heights of a ground: each thread has its own SurfaceHeight.
std::function<std::optional<double>(double x, double y)> surface_heights(const Ground& ground);

/// One height. For many heights use SurfaceHeight.
std::optional<double> surface_height(const Ground& ground, double x, double y);

}  // namespace soilvdb::inline v0
