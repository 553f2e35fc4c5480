// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Coordinates of one frame as linear functions over the voxels of a chunk, for the inner loops.
#pragma once

#include <cmath>
#include <cstdint>

#include "core/constants.h"
#include "soilvdb/types.h"

// Compiled for any x86-64, for AVX2 and for AVX-512, chosen when the program starts. All give the
// same bits: no contraction to fused multiply-add. Sanitizers cannot run that choice.
#if defined(SOILVDB_FOR_CPUS)  // the build chose
#elif defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define SOILVDB_FOR_CPUS __attribute__((target_clones("arch=x86-64-v4", "avx2", "default")))
#else
#define SOILVDB_FOR_CPUS
#endif

namespace soilvdb::inline v0 {

/// c + n . p, in voxels, over points p of a chunk in voxels from the low corner of its first cell.
struct Affine {
  float c = 0, nx = 0, ny = 0, nz = 0;

  Affine() = default;
  Affine(float constant, float along_x, float along_y, float along_z)
      : c(constant), nx(along_x), ny(along_y), nz(along_z) {}
  /// The coordinate along `axis` of the points; `from` is the first corner relative to the frame.
  Affine(const Vec3& axis, const Vec3& from)
      : c(static_cast<float>(axis.dot(from))),
        nx(static_cast<float>(axis.x())),
        ny(static_cast<float>(axis.y())),
        nz(static_cast<float>(axis.z())) {}

  float at(float x, float y, float z) const { return c + (nx * x + (ny * y + nz * z)); }
  /// Largest difference over a box with these half sides, with room for rounding.
  float half_range(float half_x, float half_y, float half_z) const {
    return half_x * std::abs(nx) + half_y * std::abs(ny) + half_z * std::abs(nz) + kBoxRounding;
  }
  friend Affine operator+(const Affine& a, const Affine& b) {
    return {a.c + b.c, a.nx + b.nx, a.ny + b.ny, a.nz + b.nz};
  }
  friend Affine operator-(const Affine& a, const Affine& b) {
    return {a.c - b.c, a.nx - b.nx, a.ny - b.ny, a.nz - b.nz};
  }
  friend Affine operator*(float s, const Affine& a) {
    return {s * a.c, s * a.nx, s * a.ny, s * a.nz};
  }
  Affine moved(float x, float y, float z) const {
    Affine m = *this;
    m.c = at(x, y, z);
    return m;
  }
};

/// A frame's three coordinates.
struct AffineFrame {
  Affine axis[3];  // x, y, z

  AffineFrame() = default;
  /// @param axes columns are the frame's axes; @param position the frame's origin, index space
  AffineFrame(const Eigen::Matrix3d& axes, const Vec3& position, const Coord3& chunk) {
    const Vec3 from = chunk.cast<double>() - Vec3::Constant(0.5) - position;
    for (int a = 0; a < 3; ++a) axis[a] = Affine(axes.col(a), from);
  }
};

/// 1 << i as a table, which the vectoriser can load.
struct BitTable {
  std::uint32_t bit[32];
  constexpr BitTable() : bit() {
    for (int i = 0; i < 32; ++i) bit[i] = std::uint32_t{1} << i;
  }
};
inline constexpr BitTable kBits;

}  // namespace soilvdb::inline v0
