// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/sweep_distance.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "core/lanes.h"
#include "core/soil.h"

namespace soilvdb {
namespace {

constexpr float kFar = std::numeric_limits<float>::max();
constexpr float kReach = 0.5f * (kLeafSide - 1);  ///< of a row's centres from its middle
constexpr float kBand2 = kBandVoxels * kBandVoxels;

/// What the sweep's distance to the voxels of a row is made of.
struct Row {
  /// To the surface that the mouth's edges trail, where it passed: squared, with its sign.
  Lanes trail2 = all_lanes(kFar);
  Lanes gone = all_lanes(kFar);    // how far a mouth that came back had been ahead
  Lanes mouth2 = all_lanes(kFar);  // to the mouth where it bounds the sweep, squared
  LaneMask leave = {};
};

/// Points of a row in the bucket frame.
struct Line {
  float at[3], step[3];
  SOILVDB_INLINE Line(const AffineFrame& frame, float x, float y) {
    for (int a = 0; a < 3; ++a) {
      at[a] = frame.axis[a].at(x, y, 0.5f);
      step[a] = frame.axis[a].nz;
    }
  }
  SOILVDB_INLINE Lanes lanes(int axis) const { return at[axis] + kLaneNumbers * step[axis]; }

 private:
  friend struct Lines;
  Line() = default;
};

/// The lines of the eight rows over x.
struct Lines {
  Lanes at[3];
  float step[3];
  SOILVDB_INLINE Lines(const AffineFrame& frame, float x) {
    for (int a = 0; a < 3; ++a) {
      const Affine& f = frame.axis[a];
      at[a] = f.c + (f.nx * x + (f.ny * (kLaneNumbers + 0.5f) + f.nz * 0.5f));
      step[a] = f.nz;
    }
  }
  SOILVDB_INLINE Line row(int k) const {
    Line line;
    for (int a = 0; a < 3; ++a) {
      line.at[a] = at[a][k];
      line.step[a] = step[a];
    }
    return line;
  }
  /// In the middles of the rows.
  SOILVDB_INLINE Lanes middle(int axis) const { return at[axis] + kReach * step[axis]; }
  /// The most that a row's centres differ from its middle, with room for rounding.
  SOILVDB_INLINE float reach(int axis) const { return kReach * std::abs(step[axis]) + 1e-4f; }
};

/// A segment of the path passes the row. The distance to the surface that the mouth's edges trail
/// is how far a point is beyond the edge when the mouth's plane passes it, over the length of the
/// gradient of that, sqrt(1 + (dy/dx)^2) or sqrt(1 + (dz/dx)^2).
/// @return the voxels that the mouth came back over
SOILVDB_INLINE LaneMask pass(const Line& f, const Line& g, float half_width, float height,
                             bool near_back, Row& row) {
  const Lanes u = f.lanes(0), v = g.lanes(0), ay = f.lanes(1), az = f.lanes(2);
  const LaneMask crosses = (u > 0) ^ (v > 0);
  const Lanes dx = v - u, dy = g.lanes(1) - ay, dz = g.lanes(2) - az;
  const Lanes s = -u / dx, y = ay + s * dy, z = az + s * dz;
  const Lanes dx2 = dx * dx, ny = abs(y) - half_width, nz = max(-z, z - height);
  const Lanes ey2 = ny * abs(ny) * (dx2 / (dx2 + dy * dy));
  const Lanes ez2 = nz * abs(nz) * (dx2 / (dx2 + dz * dz));
  const Lanes side2 = (ny > 0) & (nz > 0) ? ey2 + ez2 : max(ey2, ez2);
  row.trail2 = crosses ? min(row.trail2, side2) : row.trail2;
  if (near_back) row.leave |= crosses & (side2 < 0);
  return crosses & (u <= 0);
}

/// The mouth bounds the sweep at a pose: of points it passed where it stops, of others anywhere.
SOILVDB_INLINE void stand(const Line& at, float half_width, float height, bool always,
                          const Advance& last, const Advance& next, Row& row) {
  const Lanes x = at.lanes(0), y = at.lanes(1), z = at.lanes(2);
  const Lanes cy = min(max(y, all_lanes(-half_width)), all_lanes(half_width));
  const Lanes cz = min(max(z, all_lanes(0)), all_lanes(height));
  const Lanes d2 = x * x + (y - cy) * (y - cy) + (z - cz) * (z - cz);
  LaneMask bounds = row.trail2 >= 0;
  if (always) {
    bounds |= -1;
  } else {
    bounds |= (last.c + cy * last.y + cz * last.z > 0) ^ (next.c + cy * next.y + cz * next.z > 0);
  }
  row.mouth2 = bounds ? min(row.mouth2, d2) : row.mouth2;
}

/// phi = max(phi, value), in voxels, but for some lanes. @return whether any changed
SOILVDB_INLINE bool raise(Lanes value, LaneMask leave, std::int16_t* phi) {
  const Lanes band = all_lanes(kBandVoxels);
  const Lanes units = min(max(value, -band), band) * (static_cast<float>(kPhiMax) / kBandVoxels);
  const LaneMask whole =
      __builtin_convertvector(units + (units < 0 ? all_lanes(-0.5f) : all_lanes(0.5f)), LaneMask);
  LaneMask old;
  for (int k = 0; k < kLeafSide; ++k) old[k] = phi[k];
  const LaneMask up = (whole > old) & ~leave;
  const LaneMask raised = up ? whole : old;
  for (int k = 0; k < kLeafSide; ++k) phi[k] = static_cast<std::int16_t>(raised[k]);
  return bits(up) != 0;
}

/// Where rows are as seen from the mouth's plane: ahead of it if all of a row surely is.
struct Sides {
  LaneMask ahead, behind;
  SOILVDB_INLINE explicit Sides(const Lines& lines) {
    const Lanes u = lines.middle(0);
    ahead = u > lines.reach(0);
    behind = u < -lines.reach(0);
  }
};

/// Rows that may be nearer to the mouth than the root of `near2`.
SOILVDB_INLINE LaneMask rows_near(const Lines& lines, float half_width, float height, float near2) {
  const Lanes y = lines.middle(1), z = lines.middle(2), none = {};
  const Lanes ex = max(abs(lines.middle(0)) - lines.reach(0), none);
  const Lanes ey = max(abs(y) - (half_width + lines.reach(1)), none);
  const Lanes ez = max(max(-z, z - height) - lines.reach(2), none);
  return ex * ex + ey * ey + ez * ez < near2;
}

/// A segment came back over some voxels of a row: how far ahead of each the mouth was at most.
SOILVDB_INLINE void come_back(const SweptMouth& m, std::size_t segment, float x, float y,
                              LaneMask back, Row& row) {
  Lanes most = {};
  LaneMask ahead = back;
  for (std::size_t j = segment + 1; j-- > 0;) {
    const Lanes at = -Line(m.frames[j], x, y).lanes(0);
    ahead &= at >= 0;
    if (bits(ahead) == 0) break;
    most = ahead ? max(most, at) : most;
  }
  row.gone = back ? min(row.gone, most) : row.gone;
}

SOILVDB_FOR_CPUS bool carve_mouth_slab(const SweptMouth& m, float half_width, float height, float x,
                                       std::uint32_t rows, std::int16_t* phi) {
  Row row[kLeafSide];
  std::uint32_t met = 0;
  std::size_t ready = m.frames.size();  // the pose that `to` is of
  Lines from(m.frames[0], x), to = from;
  for (const std::uint32_t i : m.crossing) {
    from = i == ready ? to : Lines(m.frames[i], x);
    to = Lines(m.frames[i + 1], x);
    ready = i + 1;
    const Sides u(from), v(to);
    std::uint32_t passed = rows & bits(~((u.ahead & v.ahead) | (u.behind & v.behind)));
    met |= passed;
    for (; passed != 0; passed &= passed - 1) {
      const int k = std::countr_zero(passed);
      const LaneMask back = pass(from.row(k), to.row(k), half_width, height, i < m.settled, row[k]);
      if (bits(back) != 0) come_back(m, i, x, static_cast<float>(k) + 0.5f, back, row[k]);
    }
  }
  for (const std::uint32_t i : m.close) {
    const Lines lines(m.frames[i], x);
    std::uint32_t close = rows & bits(rows_near(lines, half_width, height, kBand2));
    met |= close;
    const bool inner = i > 0 && i + 1 < m.frames.size();
    const Advance last = inner ? m.advances[i - 1] : Advance{};
    const Advance next = inner ? m.advances[i] : Advance{};
    for (; close != 0; close &= close - 1) {
      const int k = std::countr_zero(close);
      stand(lines.row(k), half_width, height, m.bounds[i].always, last, next, row[k]);
    }
  }
  bool changed = false;
  for (; met != 0; met &= met - 1) {
    const int k = std::countr_zero(met);
    const Row& r = row[k];
    const Lanes distance = sqrt(min(abs(r.trail2), r.mouth2));
    changed |=
        raise(r.trail2 < 0 ? min(distance, r.gone) : -distance, r.leave, phi + kLeafSide * k);
  }
  return changed;
}

SOILVDB_FOR_CPUS std::uint32_t rows_near_any(std::span<const AffineFrame> frames,
                                             std::span<const std::uint32_t> poses, float half_width,
                                             float height, float x, float near) {
  LaneMask found = {};
  for (const std::uint32_t i : poses)
    found |= rows_near(Lines(frames[i], x), half_width, height, near * near);
  return bits(found);
}

/// phi = max(phi, -distance to the body), the body an outline in x and z with straight sides.
SOILVDB_FOR_CPUS bool carve_body_row(const Line& line, float half_width,
                                     const Eigen::Vector2f* outline, std::size_t points,
                                     std::int16_t* phi) {
  const Lanes x = line.lanes(0), y = line.lanes(1), z = line.lanes(2);
  Lanes d2 = all_lanes(kFar);
  LaneMask inside = {};
  for (std::size_t i = 0, j = points - 1; i < points; j = i++) {
    const float bx = outline[i].x() - outline[j].x(), bz = outline[i].y() - outline[j].y();
    const float by_length2 = 1 / (bx * bx + bz * bz), slope = bz != 0 ? bx / bz : 0.0f;
    const Lanes px = x - outline[j].x(), pz = z - outline[j].y();
    const Lanes s = min(max((px * bx + pz * bz) * by_length2, all_lanes(0)), all_lanes(1));
    const Lanes ex = px - s * bx, ez = pz - s * bz;
    d2 = min(d2, ex * ex + ez * ez);
    inside ^= ((pz < 0) ^ (pz < bz)) & (px < slope * pz);
  }
  const Lanes across = inside ? -sqrt(d2) : sqrt(d2), side = abs(y) - half_width;
  const Lanes d =
      (across > 0) & (side > 0) ? sqrt(across * across + side * side) : max(across, side);
  return raise(-d, LaneMask{}, phi);
}

}  // namespace

SweepDistance::SweepDistance(const Bucket& bucket, double voxel_size_m)
    : half_width_(static_cast<float>(bucket.width_m / 2 / voxel_size_m)),
      height_(static_cast<float>(bucket.height_m / voxel_size_m)) {
  for (const Vec2& p : bucket.profile) {
    outline_.emplace_back((p / voxel_size_m).cast<float>());
    outline_box_.extend(outline_.back());
  }
}

float SweepDistance::to_mouth2(const float* p, const float* reach) const {
  const float x = std::max(std::abs(p[0]) - reach[0], 0.0f);
  const float y = std::max(std::abs(p[1]) - half_width_ - reach[1], 0.0f);
  const float z = std::max(std::max(-p[2], p[2] - height_) - reach[2], 0.0f);
  return x * x + y * y + z * z;
}

float SweepDistance::to_body2(const float* p, const float* reach) const {
  const Eigen::Vector2f &low = outline_box_.min(), &high = outline_box_.max();
  const float x = std::max(std::max(low.x() - p[0], p[0] - high.x()) - reach[0], 0.0f);
  const float y = std::max(std::abs(p[1]) - half_width_ - reach[1], 0.0f);
  const float z = std::max(std::max(low.y() - p[2], p[2] - high.y()) - reach[2], 0.0f);
  return x * x + y * y + z * z;
}

std::uint32_t SweepDistance::rows_near_mouth(std::span<const AffineFrame> frames,
                                             std::span<const std::uint32_t> poses, float x,
                                             float spacing) const {
  return rows_near_any(frames, poses, half_width_, height_, x, kBandVoxels + spacing);
}

bool SweepDistance::carve_by_mouth(const SweptMouth& mouth, float x, std::uint32_t rows,
                                   std::int16_t* slab) const {
  return carve_mouth_slab(mouth, half_width_, height_, x, rows, slab);
}

bool SweepDistance::carve_by_body(const AffineFrame& frame, float x, float y,
                                  std::int16_t* row) const {
  const Line line(frame, x, y);
  float middle[3], reach[3];
  for (int a = 0; a < 3; ++a) {
    middle[a] = line.at[a] + kReach * line.step[a];
    reach[a] = frame.axis[a].reach(0, 0, kReach);
  }
  if (to_body2(middle, reach) > kBand2) return false;
  return carve_body_row(line, half_width_, outline_.data(), outline_.size(), row);
}

}  // namespace soilvdb
