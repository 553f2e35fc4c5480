// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The initial ground. Only the places that a bucket reaches get voxels.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>

#include "soilvdb/types.h"

namespace soilvdb::inline v0 {

class Ground;

/// Voxels per side of a chunk, the leaf of the tree.
inline constexpr int kChunkSide = 8;
inline constexpr int kChunkVoxels = kChunkSide * kChunkSide * kChunkSide;

/// Points spread over one voxel cell, in voxels from the cell's low corner, in [0, 1).
struct CellPoints {
  alignas(64) float x[64], y[64], z[64];
};

/// Period of the sample points along each axis, voxels. Grounds whose origins differ by multiples
/// of it have the same samples in the world.
inline constexpr int kLatticePeriod = 1 << 16;

/// The 64 sample points of a voxel's cell: a rank-1 lattice, rotated and shifted by a hash of the
/// voxel's index. Counts are thus unbiased for any surface direction.
const CellPoints& sample_points(const Coord3& voxel);
/// sample_points() in two steps: the pattern of a voxel, of kPatterns, and its points.
inline constexpr int kPatterns = 64;
int sample_pattern(const Coord3& voxel);
const CellPoints& pattern_points(int pattern);

/// One word of 64 samples per cell of a chunk; bit i of word n is set if point i of cell n is soil.
using SampleWords = std::array<std::uint64_t, kChunkVoxels>;
inline constexpr std::uint64_t kAllSoil = ~std::uint64_t{0};

/// The content of a box of ground.
enum class Content { kAir, kSoil, kMixed };

/// The undisturbed ground: the set of soil points, in world coordinates, m.
///
/// All members are const; threads may call them concurrently, except forget().
class InitialTerrain {
 public:
  virtual ~InitialTerrain() = default;

  /// Whether an axis-aligned box is surely free of soil, surely full of soil, or neither. Places
  /// without ground (NODATA, outside a raster) count as air.
  virtual Content classify(const Eigen::AlignedBox3d& box) const = 0;

  /// Whether the content of the box is known. False if the box reaches over ground without a height
  /// and is not above all ground near it.
  virtual bool has_data(const Eigen::AlignedBox3d& box) const = 0;

  /// Signed distance at the 8x8x8 voxel centres from `first` with spacing `h`, m: the true distance
  /// to the surface, negative in soil, clamped to +-band. Layout phi[x*64 + y*8 + z].
  virtual void distance(const Vec3& first, double h, double band, float* phi) const = 0;

  /// Soil samples of the cells around the voxel centres of distance(). @param chunk index of the
  /// first voxel, which selects the sample points
  virtual void samples(const Coord3& chunk, const Vec3& first, double h,
                       SampleWords& words) const = 0;

  /// Memory of cached heights or voxels, bytes.
  virtual std::uint64_t memory_bytes() const { return 0; }
  /// Frees data that can be read again. No other member may run at the same time.
  virtual void forget() const {}

  /// Height of the topmost soil at (x, y), m; std::nullopt without soil or where it is unknown.
  virtual std::optional<double> height(double x, double y) const = 0;

  /// The ground whose surface this is; null for other terrains.
  virtual const Ground* ground() const { return nullptr; }
};

/// z = height + slope . (x, y); unbounded.
std::unique_ptr<InitialTerrain> make_plane(double height_m, Vec2 slope);

/// Source of the heights of make_height_field().
class HeightSource {
 public:
  virtual ~HeightSource() = default;
  /// Reads a window of posts, row-major with rising y and x; NaN where there is no height.
  /// @param out nx * ny values, m. @throw std::runtime_error if the window cannot be read
  virtual void read(int x0, int y0, int nx, int ny, float* out) const = 0;
};

/// A regular grid of heights (posts) in world coordinates.
struct HeightGrid {
  int nx = 0, ny = 0;
  Vec2 first = Vec2::Zero();    ///< x, y of post (0, 0), the lowest, m
  Vec2 spacing = Vec2::Ones();  ///< > 0, m
};

/// The surface of a dug ground as initial terrain for another voxel size. Far from cuts it is that
/// ground's initial terrain. Its error is at most half a voxel of that ground.
std::unique_ptr<InitialTerrain> make_ground_terrain(std::shared_ptr<const Ground> ground);

/// Heights, bilinear between posts. Known on the rectangle of the posts, except patches with a NaN
/// post. Posts are read by tile on first use.
std::unique_ptr<InitialTerrain> make_height_field(const HeightGrid& grid,
                                                  std::shared_ptr<const HeightSource> source);

}  // namespace soilvdb::inline v0
