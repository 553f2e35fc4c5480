// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Coordinates of one frame as linear functions over the voxels of a chunk, for the inner loops.
#pragma once

#include <cmath>
#include <cstdint>

#include "core/types.h"

// Compiled once for any x86-64 and once for AVX2, chosen when the program starts. Both give the same
// bits: no contraction to fused multiply-add. Sanitizers can't run the choice that early.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define SOILVDB_FOR_CPUS __attribute__((target_clones("avx2", "default")))
#else
#define SOILVDB_FOR_CPUS
#endif

namespace soilvdb {

/// c + n . p, in voxels, over points p of a chunk in voxels from the low corner of its first cell.
struct Affine {
  float c = 0, nx = 0, ny = 0, nz = 0;

  Affine() = default;
  /// The coordinate along `axis` of the points; `from` is the first corner relative to the frame.
  Affine(const Vec3& axis, const Vec3& from)
      : c(static_cast<float>(axis.dot(from))),
        nx(static_cast<float>(axis.x())),
        ny(static_cast<float>(axis.y())),
        nz(static_cast<float>(axis.z())) {}

  float at(float x, float y, float z) const { return c + (nx * x + (ny * y + nz * z)); }
  /// The most it differs within `half` of a point along each axis, with room for rounding.
  float reach(float half) const {
    return half * (std::abs(nx) + std::abs(ny) + std::abs(nz)) + 1e-4f;
  }
  Affine moved(float x, float y, float z) const {
    Affine m = *this;
    m.c = at(x, y, z);
    return m;
  }
};

/// One frame's three coordinates.
struct AffineFrame {
  Affine x, y, z;

  AffineFrame() = default;
  /// @param index_from_frame the frame in index space, voxels
  AffineFrame(const Pose& index_from_frame, const Coord3& chunk) {
    const Eigen::Matrix3d axes = index_from_frame.rotation.toRotationMatrix();
    const Vec3 from = chunk.cast<double>() - Vec3::Constant(0.5) - index_from_frame.position;
    x = Affine(axes.col(0), from);
    y = Affine(axes.col(1), from);
    z = Affine(axes.col(2), from);
  }
  AffineFrame moved(float px, float py, float pz) const {
    AffineFrame m;
    m.x = x.moved(px, py, pz);
    m.y = y.moved(px, py, pz);
    m.z = z.moved(px, py, pz);
    return m;
  }
};

inline constexpr std::uint32_t bit32(int i) { return std::uint32_t{1} << i; }
/// bit(i) as a table, which the vectoriser can load.
struct BitTable {
  std::uint32_t bit[32];
  constexpr BitTable() : bit() {
    for (int i = 0; i < 32; ++i) bit[i] = bit32(i);
  }
};
inline constexpr BitTable kBits;

}  // namespace soilvdb
