// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The ground before anyone dug: never voxelised as a whole, only where a bucket comes.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>

#include "soilvdb/types.h"

namespace soilvdb::inline v0 {

class Ground;

/// Voxels per side of a chunk, in which ground gets voxels: a leaf of the tree.
inline constexpr int kChunkSide = 8;
inline constexpr int kChunkVoxels = kChunkSide * kChunkSide * kChunkSide;

/// Points spread over one voxel cell, in voxels from the cell's low corner, each in [0, 1).
struct CellPoints {
  alignas(64) float x[64], y[64], z[64];
};

/// Voxels along each axis after which sample points repeat, so that grounds whose origins lie so
/// far apart, or a multiple of it, have the same samples in the same places of the world.
inline constexpr int kLatticePeriod = 1 << 16;

/// The 64 sample points of the cell of a voxel: a rank-1 lattice, turned and shifted as a hash of
/// the voxel's index chooses, so that counts are unbiased whatever the surface's direction.
const CellPoints& sample_points(const Coord3& voxel);
/// The same in two steps: which of the kPatterns a voxel has, and its points.
inline constexpr int kPatterns = 64;
int sample_pattern(const Coord3& voxel);
const CellPoints& pattern_points(int pattern);

/// One word of 64 samples per cell of a chunk; bit i of word n: point i of cell n is soil.
using SampleWords = std::array<std::uint64_t, kChunkVoxels>;
inline constexpr std::uint64_t kAllSoil = ~std::uint64_t{0};

/// What a box of ground holds.
enum class Content { kAir, kSoil, kMixed };

/// The undisturbed ground: a set of points of the world, soil.
///
/// All members are const and safe to call from several threads. World coordinates, metres.
class InitialTerrain {
 public:
  virtual ~InitialTerrain() = default;

  /// Is the axis-aligned box surely free of soil, surely full of it, or neither? Where there is no
  /// ground (NODATA, outside a raster) counts as air.
  virtual Content classify(const Eigen::AlignedBox3d& box) const = 0;

  /// Is it known what the box holds? False where it comes over ground without a height and isn't
  /// above all the ground near it.
  virtual bool has_data(const Eigen::AlignedBox3d& box) const = 0;

  /// Signed distance at the 8x8x8 voxel centres that start at `first` and are `h` apart: true
  /// distance to the surface, negative in soil, clamped to +-band. phi[x*64 + y*8 + z].
  virtual void distance(const Vec3& first, double h, double band, float* phi) const = 0;

  /// Which samples of a chunk are soil: those of the cells around the voxels whose centres are as
  /// for distance(). @param chunk index of the first voxel, which chooses the sample points
  virtual void samples(const Coord3& chunk, const Vec3& first, double h,
                       SampleWords& words) const = 0;

  /// What it holds of heights read or voxels, in bytes.
  virtual std::uint64_t memory_bytes() const { return 0; }
  /// Gives back what can be read again. May run beside no other member.
  virtual void forget() const {}

  /// Height of the topmost soil at (x, y); nothing where there is none or it isn't known.
  virtual std::optional<double> height(double x, double y) const = 0;

  /// The soil whose surface this is, if it is one's.
  virtual const Ground* ground() const { return nullptr; }
};

/// z = height + slope . (x, y); unbounded.
std::unique_ptr<InitialTerrain> make_plane(double height_m, Vec2 slope);

/// Where a HeightField gets its heights from.
class HeightSource {
 public:
  virtual ~HeightSource() = default;
  /// Reads a window of posts, row-major from low y to high y and low x to high x, NaN where there
  /// is no height. @param out nx * ny values, m. @throw std::runtime_error if it can't be read.
  virtual void read(int x0, int y0, int nx, int ny, float* out) const = 0;
};

/// A regular grid of heights (posts) in world coordinates.
struct HeightGrid {
  int nx = 0, ny = 0;
  Vec2 first = Vec2::Zero();    ///< x, y of post (0, 0), the one with the lowest x and y
  Vec2 spacing = Vec2::Ones();  ///< > 0
};

/// The surface of ground that was dug, for soil with voxels of another size; the ground's own base
/// surface where nothing is dug near. It may be off by half a voxel of that ground.
std::unique_ptr<InitialTerrain> make_ground_terrain(std::shared_ptr<const Ground> ground);

/// Heights bilinear between posts; known on the rectangle of the posts, less every patch one of
/// whose four posts is NaN. Posts are read by tile, when first needed.
std::unique_ptr<InitialTerrain> make_height_field(const HeightGrid& grid,
                                                  std::shared_ptr<const HeightSource> source);

}  // namespace soilvdb::inline v0
