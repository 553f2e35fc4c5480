// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Height of the topmost soil at a place.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <unordered_map>
#include <vector>

#include "soilvdb/mesher.h"

namespace soilvdb::inline v0 {

/// Heights of the ground, read off its mesh where it is resident and off the base surface
/// elsewhere.
///
/// Keeps the patches it made, so many heights of one place cost little more than one. For one
/// thread. Within 0.15 voxel of the true height but at walls.
class SurfaceHeight {
 public:
  explicit SurfaceHeight(const Ground& ground);
  /// Height of the topmost soil at (x, y) of the world, m; nothing where there is none.
  std::optional<double> at(double x, double y);
  /// The same of many places, NaN where there is none; in the caller's TBB arena. The same bits for
  /// any number of threads, and whichever places come together.
  void at(std::span<const Vec2> xy_m, std::span<double> heights_m);
  /// To be told what changed of the ground, as a ChangeFollower lists it, before the next look.
  void update(std::span<const Coord3> changed_chunks);

 private:
  /// A block's mesh, and which of its triangles are over each column of voxels.
  struct Patch {
    Mesh mesh;
    Eigen::Vector2i first = {0, 0}, size = {0, 0};
    std::vector<std::uint32_t> begin;  ///< of a column's in `over`, y fastest, and the end
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
  std::optional<CachedMesher> mesher_;  ///< once the ground changes between looks
  std::unordered_map<Coord3, std::vector<int>, Hash> blocks_;  ///< z of those in a column; its z 0
  std::unordered_map<Coord3, Patch, Hash> patches_;
};

/// Heights of a ground for several threads, each with a SurfaceHeight of its own.
std::function<std::optional<double>(double x, double y)> surface_heights(const Ground& ground);

/// One height. Many of one ground: SurfaceHeight.
std::optional<double> surface_height(const Ground& ground, double x, double y);

}  // namespace soilvdb::inline v0
