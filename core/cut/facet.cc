// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/cut/facet.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "core/lattice/lanes.h"
#include "core/tool/polygon.h"

namespace soilvdb::inline v0 {
namespace {

/// A stroke's coordinates u, v, y, dy, z, dz of eight boxes in a line.
struct Line {
  Lanes u, v, y, dy, z, dz;
};

/// From the middle of the first box, `step` to the next.
SOILVDB_INLINE Lanes along(const Affine& a, float x, float y, float z, float Affine::*step) {
  return a.at(x, y, z) + kLaneNumbers * (a.*step);
}
SOILVDB_INLINE Line along(const Stroke& s, float x, float y, float z, float Affine::*step) {
  return {along(s.u, x, y, z, step),  along(s.v, x, y, z, step), along(s.y, x, y, z, step),
          along(s.dy, x, y, z, step), along(s.z, x, y, z, step), along(s.dz, x, y, z, step)};
}

/// Largest difference of these coordinates over a box from those at its middle.
struct Reach {
  float u, v, y, z;
  Reach(const Stroke& s, float half_x, float half_y, float half_z)
      : u(s.u.half_range(half_x, half_y, half_z)),
        v(s.v.half_range(half_x, half_y, half_z)),
        y(s.y.half_range(half_x, half_y, half_z) + s.dy.half_range(half_x, half_y, half_z) +
          s.slack),
        z(s.z.half_range(half_x, half_y, half_z) + s.dz.half_range(half_x, half_y, half_z) +
          s.slack) {}
};

/// Bit k is for box k.
struct Seen {
  std::uint32_t may = 0;       // the facet may pass through it
  std::uint32_t within_y = 0;  // where the facet's plane passes it, that is between the outline's
  std::uint32_t within_z = 0;  // bounds in y, in z
  std::uint32_t sure = 0;      // the facet's plane passes all of it
};

SOILVDB_INLINE Seen look(const Line& l, const Reach& r, const Stroke& s) {
  const LaneMask u_ahead = l.u > r.u, v_ahead = l.v > r.v;
  const LaneMask u_behind = l.u < -r.u, v_behind = l.v < -r.v;
  const Lanes y_reach = abs(l.dy) + r.y, z_reach = abs(l.dz) + r.z;
  const LaneMask missed = (u_ahead & v_ahead) | (u_behind & v_behind);
  const LaneMask meets = (l.y + y_reach >= s.y_low) & (l.y - y_reach <= s.y_high) &
                         (l.z + z_reach >= s.z_low) & (l.z - z_reach <= s.z_high);
  const LaneMask within_y = (l.y - y_reach > s.y_low) & (l.y + y_reach < s.y_high);
  const LaneMask within_z = (l.z - z_reach > s.z_low) & (l.z + z_reach < s.z_high);
  const LaneMask sure = (u_ahead & v_behind) | (u_behind & v_ahead);
  return {bits(meets & ~missed), bits(within_y), bits(within_z), bits(sure)};
}

/// Bit i is set if sample i is ahead of the facet's plane.
inline std::uint64_t ahead_of_plane(const CellPoints& p, Affine a) {
  std::uint32_t half[2];
  for (int g = 0; g < 2; ++g) {
    std::uint32_t bits = 0;
    for (int i = 0; i < 32; ++i) {
      const int n = g * 32 + i;
      bits |= a.at(p.x[n], p.y[n], p.z[n]) > 0 ? kBits.bit[i] : 0u;
    }
    half[g] = bits;
  }
  return std::uint64_t{half[1]} << 32 | half[0];
}

/// Bit i is set if sample i crosses the facet's plane.
inline std::uint64_t crossing_plane(const CellPoints& p, Affine a, Affine b) {
  std::uint32_t half[2];
  for (int g = 0; g < 2; ++g) {
    std::uint32_t bits = 0;
    for (int i = 0; i < 32; ++i) {
      const int n = g * 32 + i;
      const float u = a.at(p.x[n], p.y[n], p.z[n]), v = b.at(p.x[n], p.y[n], p.z[n]);
      bits |= ((u > 0) != (v > 0)) ? kBits.bit[i] : 0u;
    }
    half[g] = bits;
  }
  return std::uint64_t{half[1]} << 32 | half[0];
}

/// A stroke in one cell, over which the bends hardly differ.
struct CellStroke {
  Affine u, v, y, dy, z, dz;
  float bend_x, bend_y, bend_z;
  CellStroke(const Stroke& s, float x, float y0, float z0)
      : u(s.u.moved(x, y0, z0)),
        v(s.v.moved(x, y0, z0)),
        y(s.y.moved(x, y0, z0)),
        dy(s.dy.moved(x, y0, z0)),
        z(s.z.moved(x, y0, z0)),
        dz(s.dz.moved(x, y0, z0)),
        bend_x(s.bend[0].at(x + 0.5f, y0 + 0.5f, z0 + 0.5f)),
        bend_y(s.bend[1].at(x + 0.5f, y0 + 0.5f, z0 + 0.5f)),
        bend_z(s.bend[2].at(x + 0.5f, y0 + 0.5f, z0 + 0.5f)) {}
};

/// The time, from -1 to 1, at which a point with x coordinates u and v at the ends crosses the
/// plane: (u + v) / (u - v) on a straight way, with one correction for the bend. The reversed
/// stroke gives the same bits.
template <typename Value>
SOILVDB_INLINE Value time_of_crossing(const CellStroke& s, float u, float v) {
  const Value by_length = 1 / (Value(u) - Value(v));
  const Value straight = (Value(u) + Value(v)) * by_length;
  const Value bent = straight + 2 * s.bend_x * (1 - straight * straight) * by_length;
  return std::min(std::max(bent, Value(-1)), Value(1));
}
/// A coordinate of a point at that time.
template <typename Value>
SOILVDB_INLINE Value coordinate(float middle, float half_way, float bend, Value t) {
  return middle + (t * half_way + bend * (1 - t * t));
}

/// Bit i is set if sample i crosses the facet's rectangle. @param kY, kZ the bounds to test
template <bool kY, bool kZ>
SOILVDB_INLINE std::uint64_t crossing_rectangle(const CellPoints& p, const CellStroke& cell,
                                                const Stroke& stroke) {
  const CellStroke s = cell;  // so that the compiler knows nothing else writes to it
  const float y_low = stroke.y_low, y_high = stroke.y_high;
  const float z_low = stroke.z_low, z_high = stroke.z_high;
  std::uint32_t half[2];
  for (int g = 0; g < 2; ++g) {
    std::uint32_t bits = 0;
    for (int i = 0; i < 32; ++i) {
      const int n = g * 32 + i;
      const float px = p.x[n], py = p.y[n], pz = p.z[n];
      const float u = s.u.at(px, py, pz), v = s.v.at(px, py, pz);
      const float t = time_of_crossing<float>(s, u, v);
      bool in = (u > 0) != (v > 0);
      if (kY) {
        const float y = coordinate(s.y.at(px, py, pz), s.dy.at(px, py, pz), s.bend_y, t);
        in = in & (y >= y_low) & (y <= y_high);
      }
      if (kZ) {
        const float z = coordinate(s.z.at(px, py, pz), s.dz.at(px, py, pz), s.bend_z, t);
        in = in & (z >= z_low) & (z <= z_high);
      }
      bits |= in ? kBits.bit[i] : 0u;
    }
    half[g] = bits;
  }
  return std::uint64_t{half[1]} << 32 | half[0];
}

/// The samples of `candidates`, which all cross the plane, inside the facet's outline.
std::uint64_t crossing_outline(const CellPoints& p, const CellStroke& s, const Facet& facet,
                               double h, std::uint64_t candidates) {
  std::uint64_t hit = 0;
  for (; candidates != 0; candidates &= candidates - 1) {
    const int n = std::countr_zero(candidates);
    const float px = p.x[n], py = p.y[n], pz = p.z[n];
    const auto t = time_of_crossing<double>(s, s.u.at(px, py, pz), s.v.at(px, py, pz));
    const double y = coordinate(s.y.at(px, py, pz), s.dy.at(px, py, pz), s.bend_y, t);
    const double z = coordinate(s.z.at(px, py, pz), s.dz.at(px, py, pz), s.bend_z, t);
    if (inside(facet.outline, h * Vec2(y, z))) hit |= candidates & -candidates;
  }
  return hit;
}

}  // namespace

Stroke::Stroke(const AffineFrame& from, const AffineFrame& middle, const AffineFrame& to,
               const Facet& facet, double voxel_size_m)
    : u(from.axis[0]),
      v(to.axis[0]),
      y(0.5f * (from.axis[1] + to.axis[1])),
      dy(0.5f * (to.axis[1] - from.axis[1])),
      z(0.5f * (from.axis[2] + to.axis[2])),
      dz(0.5f * (to.axis[2] - from.axis[2])) {
  const float scale = static_cast<float>(1 / voxel_size_m);
  y_low = static_cast<float>(facet.low.x()) * scale;
  y_high = static_cast<float>(facet.high.x()) * scale;
  z_low = static_cast<float>(facet.low.y()) * scale;
  z_high = static_cast<float>(facet.high.y()) * scale;
  slack = 0;
  constexpr float kHalf = 0.5f * kChunkSide;
  for (int a = 0; a < 3; ++a) {
    bend[a] = middle.axis[a] - 0.5f * (from.axis[a] + to.axis[a]);
    slack = std::max(
        slack, std::abs(bend[a].at(kHalf, kHalf, kHalf)) + bend[a].half_range(kHalf, kHalf, kHalf));
  }
}

SOILVDB_FOR_CPUS Cut cut_samples(Samples& samples, Samples& loose, const Coord3& origin,
                                 const Stroke& stroke, const Facet& facet, double h,
                                 Booking booking) {
  const Reach row(stroke, 0.5f, 0.5f, 0.5f * kChunkSide), one(stroke, 0.5f, 0.5f, 0.5f);
  const bool any_loose = loose.heap_bytes() > 0;
  Cut cut;
  for (int x = 0; x < kChunkSide; ++x) {
    std::uint32_t rows = samples.rows_with_soil(x);
    if (rows == 0) continue;
    const float x0 = static_cast<float>(x), cx = x0 + 0.5f;
    rows &= look(along(stroke, cx, 0.5f, 0.5f * kChunkSide, &Affine::ny), row, stroke).may;
    for (; rows != 0; rows &= rows - 1) {
      const int y = std::countr_zero(rows), n = 64 * x + kChunkSide * y;
      const float y0 = static_cast<float>(y);
      const Seen seen = look(along(stroke, cx, y0 + 0.5f, 0.5f, &Affine::nz), one, stroke);
      for (std::uint32_t soil = samples.any_of_row(n) & seen.may; soil != 0; soil &= soil - 1) {
        const int z = std::countr_zero(soil);
        const std::uint64_t word = samples.word(n + z);
        const bool all_y = (seen.within_y >> z & 1) != 0, all_z = (seen.within_z >> z & 1) != 0;
        const bool middle = facet.rectangle && all_y && all_z;
        std::uint64_t hit = word;
        if (!middle || (seen.sure >> z & 1) == 0) {
          const CellPoints& points = sample_points(origin + Coord3(x, y, z));
          const float z0 = static_cast<float>(z);
          if (middle || !facet.rectangle) {
            hit &= crossing_plane(points, stroke.u.moved(x0, y0, z0), stroke.v.moved(x0, y0, z0));
            if (!middle && hit != 0)
              hit = crossing_outline(points, CellStroke(stroke, x0, y0, z0), facet, h, hit);
          } else {
            const CellStroke cell(stroke, x0, y0, z0);
            hit &= all_y   ? crossing_rectangle<false, true>(points, cell, stroke)
                   : all_z ? crossing_rectangle<true, false>(points, cell, stroke)
                           : crossing_rectangle<true, true>(points, cell, stroke);
          }
        }
        if (hit == 0) continue;
        samples.set_word(n + z, word ^ hit);
        std::uint64_t captured = booking == Booking::kDisplaced ? 0 : hit;
        if (booking == Booking::kCapturedAhead) {
          const CellPoints& points = sample_points(origin + Coord3(x, y, z));
          captured &= ahead_of_plane(points, stroke.u.moved(x0, y0, static_cast<float>(z)));
        }
        cut.all.captured += std::popcount(captured);
        cut.all.displaced += std::popcount(hit ^ captured);
        if (!any_loose) continue;
        const std::uint64_t loose_word = loose.word(n + z), loose_hit = loose_word & hit;
        if (loose_hit == 0) continue;
        loose.set_word(n + z, loose_word ^ loose_hit);
        cut.loose.captured += std::popcount(loose_hit & captured);
        cut.loose.displaced += std::popcount(loose_hit & ~captured);
      }
    }
  }
  return cut;
}

namespace {

Facet rectangle(const Pose& bucket_from_facet, double y_low, double y_high, double z_high) {
  return {bucket_from_facet, {}, {y_low, 0}, {y_high, z_high}, true};
}

}  // namespace

std::vector<Facet> facets(const Bucket& bucket) {
  if (bucket.shape) return {};
  const double half = bucket.width_m / 2;
  std::vector<Facet> all{rectangle(Pose{}, -half, half, bucket.height_m)};
  for (std::size_t i = 1; i < bucket.profile.size(); ++i) {
    const Vec2 a = bucket.profile[i - 1], along = bucket.profile[i] - a;
    Eigen::Matrix3d axes;
    axes.col(1) = Vec3::UnitY();
    axes.col(2) = Vec3(along.x(), 0, along.y()).normalized();
    axes.col(0) = axes.col(1).cross(axes.col(2));
    all.push_back(
        rectangle({{a.x(), 0, a.y()}, Eigen::Quaterniond(axes)}, -half, half, along.norm()));
  }
  if (bucket.profile.empty()) return all;
  // The two sides: the facet's x is the bucket's y, its y the bucket's z, its z the bucket's x.
  Eigen::Matrix3d axes;
  axes << 0, 0, 1, 1, 0, 0, 0, 1, 0;
  for (const double y : {-half, half}) {
    Facet side{{{0, y, 0}, Eigen::Quaterniond(axes)}, {}, {}, {}, false};
    Eigen::AlignedBox2d bounds;
    for (const Vec2& p : bucket.profile) {
      side.outline.emplace_back(p.y(), p.x());
      bounds.extend(side.outline.back());
    }
    side.low = bounds.min();
    side.high = bounds.max();
    all.push_back(side);
  }
  return all;
}

}  // namespace soilvdb::inline v0
