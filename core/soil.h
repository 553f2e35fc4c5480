// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The ground: base surface plus the voxels of the places where buckets have been.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "core/base_surface.h"
#include "core/samples.h"
#include "core/types.h"

namespace soilvdb {

/// One resident chunk of 8x8x8 voxels, at voxel x*64 + y*8 + z.
///
/// A voxel has a value and a cell. The value `phi` is the signed distance at the voxel's centre:
/// phi < 0 in soil, metres, clamped to +-band. The cell is the cube of one voxel's side about the
/// centre; it holds 64 sample points, and a bit of `samples` for each says whether it is soil.
/// Volumes are counted on samples, surfaces are read off phi.
struct Chunk {
  Coord3 origin;         ///< index of the first voxel, a multiple of 8
  float* phi = nullptr;  ///< 512 values, the buffer of the OpenVDB leaf
  Samples samples;
  std::uint32_t base = 0;  ///< samples of soil in the base surface
  std::uint32_t now = 0;   ///< samples of soil now
};

/// The 64 sample points of the cell of a voxel: a rank-1 lattice, turned and shifted as a hash of
/// the voxel's index chooses, so that counts are unbiased whatever the surface's direction.
const CellPoints& sample_points(const Coord3& voxel);

class SoilGrids;  // core/soil_grids.h: the OpenVDB side

/// The ground of a site.
///
/// World = origin + h * index: voxel (i, j, k) has its centre there. The origin is double, so that
/// indices, grids and meshes stay near zero on sites in UTM coordinates.
///
/// Invariants: a chunk that is not resident equals the base surface; soil only shrinks.
/// Not copyable. Const members may run together with each other, not with the others.
class Soil {
 public:
  /// @throw std::invalid_argument unless voxel_size_m is finite and > 0.
  Soil(double voxel_size_m, const Vec3& origin, std::shared_ptr<const BaseSurface> base);
  ~Soil();
  Soil(const Soil&) = delete;
  Soil& operator=(const Soil&) = delete;

  double voxel_size_m() const { return h_; }
  const Vec3& origin() const { return origin_; }
  double band_m() const { return 3 * h_; }
  /// Volume that one sample stands for, m^3.
  double sample_m3() const { return h_ * h_ * h_ / 64; }
  const BaseSurface& base() const { return *base_; }

  Vec3 world_from_index(const Vec3& index) const { return origin_ + h_ * index; }
  Vec3 index_from_world(const Vec3& p) const { return (p - origin_) / h_; }

  /// The chunk whose first voxel is `origin` (multiples of 8), or null if it isn't resident.
  Chunk* find(const Coord3& origin);
  const Chunk* find(const Coord3& origin) const;
  /// The same, made from the base surface if it isn't resident. Not thread-safe.
  Chunk& make(const Coord3& origin);
  /// Forgets a resident chunk: there the ground is the base surface again. Not thread-safe.
  void drop(const Coord3& origin);
  /// What a chunk that isn't resident would hold, its cells included.
  Content classify(const Coord3& origin) const;
  /// Tells that a chunk's phi was written. May run together with itself on other chunks.
  void phi_changed(const Chunk& chunk);
  /// phi of a chunk, resident or not, into 512 values.
  void read_phi(const Coord3& origin, float* phi) const;
  /// samples of a chunk, resident or not.
  void read_samples(const Coord3& origin, SampleWords& samples) const;

  /// Resident chunks, ordered by origin (x, then y, then z).
  std::vector<const Chunk*> chunks() const;

  /// Puts back a chunk as a snapshot held it. @throw std::invalid_argument if it is resident.
  /// @param base samples of soil that the base surface has there
  void restore(const Coord3& origin, const float* phi, const SampleWords& samples,
               std::uint32_t base);

  /// Height of the topmost soil at (x, y) of the world, m.
  std::optional<double> height(double x, double y) const;

  /// Volume of the ground now less that of the base surface, counted anew, m^3.
  double change_m3() const;
  std::uint64_t active_voxels() const;  ///< |phi| < band
  double resident_m2() const;           ///< footprint of the resident chunks
  std::uint64_t memory_bytes() const;
  /// Digest of voxel size, origin and every resident chunk's phi and samples.
  std::uint64_t state_hash() const;

  /// The level set as OpenVDB grids.
  SoilGrids& grids() { return *grids_; }
  const SoilGrids& grids() const { return *grids_; }

 private:
  struct Index;
  double h_;
  Vec3 origin_;
  std::shared_ptr<const BaseSurface> base_;
  std::unique_ptr<SoilGrids> grids_;
  std::unique_ptr<Index> index_;
};

}  // namespace soilvdb
