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
constexpr float kHalf = 0.5f * kLeafSide;

/// What the sweep's distance to the voxels of a row is made of.
struct Row {
  Lanes trail = all_lanes(kFar);   // to the surface that the mouth's edges trail, where it passed
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
};

/// A segment of the path passes the row. The distance to the surface that the mouth's edges trail
/// is how far a point is beyond the edge when the mouth's plane passes it, over the length of the
/// gradient of that, sqrt(1 + (dy/dx)^2) or sqrt(1 + (dz/dx)^2).
/// @return bit k: the mouth came back over voxel k
SOILVDB_INLINE std::uint32_t pass(const Line& f, const Line& g, float half_width, float height,
                                  bool near_back, Row& row) {
  const Lanes u = f.lanes(0), v = g.lanes(0), ay = f.lanes(1), az = f.lanes(2);
  const LaneMask crosses = (u > 0) ^ (v > 0);
  const Lanes dx = v - u, dy = g.lanes(1) - ay, dz = g.lanes(2) - az;
  const Lanes s = -u / dx, y = ay + s * dy, z = az + s * dz;
  const Lanes size = abs(dx), dx2 = dx * dx;
  const Lanes ey = (abs(y) - half_width) * size / sqrt(dx2 + dy * dy);
  const Lanes ez = max(-z, z - height) * size / sqrt(dx2 + dz * dz);
  const Lanes side = (ey > 0) & (ez > 0) ? sqrt(ey * ey + ez * ez) : max(ey, ez);
  row.trail = crosses ? min(row.trail, side) : row.trail;
  if (near_back) row.leave |= crosses & (side < 0);
  return bits(crosses & (u <= 0));
}

/// The mouth bounds the sweep at a pose: of points it passed where it stops, of others anywhere.
SOILVDB_INLINE void stand(const Line& at, float half_width, float height, bool always,
                          const Advance& last, const Advance& next, Row& row) {
  const Lanes x = at.lanes(0), y = at.lanes(1), z = at.lanes(2);
  const Lanes cy = min(max(y, all_lanes(-half_width)), all_lanes(half_width));
  const Lanes cz = min(max(z, all_lanes(0)), all_lanes(height));
  const Lanes d2 = x * x + (y - cy) * (y - cy) + (z - cz) * (z - cz);
  LaneMask bounds = row.trail >= 0;
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

SOILVDB_FOR_CPUS bool carve_mouth_row(const SweptMouth& m, float half_width, float height, float x,
                                      float y, std::int16_t* phi) {
  Row row;
  bool met = false;
  for (const std::uint32_t i : m.crossing) {
    const Line f(m.frames[i], x, y), g(m.frames[i + 1], x, y);
    const float f_end = f.at[0] + (kLeafSide - 1) * f.step[0];
    const float g_end = g.at[0] + (kLeafSide - 1) * g.step[0];
    if (std::min(std::min(f.at[0], f_end), std::min(g.at[0], g_end)) > 0 ||
        std::max(std::max(f.at[0], f_end), std::max(g.at[0], g_end)) <= 0) {
      continue;
    }
    met = true;
    std::uint32_t backwards = pass(f, g, half_width, height, i < m.settled, row);
    for (; backwards != 0; backwards &= backwards - 1) {
      // How far ahead of the point the mouth was at most, before it came back over it.
      const int k = std::countr_zero(backwards);
      float most = 0;
      for (std::size_t j = i + 1; j-- > 0;) {
        const float at = -m.frames[j].axis[0].at(x, y, static_cast<float>(k) + 0.5f);
        if (at < 0) break;
        most = std::max(most, at);
      }
      row.gone[k] = std::min(row.gone[k], most);
    }
  }
  for (const std::uint32_t i : m.close) {
    const Line at(m.frames[i], x, y);
    // From the row's middle.
    const float px = at.at[0] + 3.5f * at.step[0], py = at.at[1] + 3.5f * at.step[1];
    const float pz = at.at[2] + 3.5f * at.step[2];
    const float ey = std::max(std::abs(py) - half_width, 0.0f);
    const float ez = std::max(std::max(-pz, pz - height), 0.0f);
    constexpr float kNear = kBandVoxels + kHalf;
    if (px * px + ey * ey + ez * ez > kNear * kNear) continue;
    met = true;
    const bool inner = i > 0 && i + 1 < m.frames.size();
    stand(at, half_width, height, m.bounds[i].always, inner ? m.advances[i - 1] : Advance{},
          inner ? m.advances[i] : Advance{}, row);
  }
  if (!met) return false;
  const Lanes mouth = sqrt(row.mouth2);
  const Lanes distance =
      row.trail < 0 ? -min(min(-row.trail, mouth), row.gone) : min(row.trail, mouth);
  return raise(-distance, row.leave, phi);
}

SOILVDB_FOR_CPUS std::uint32_t rows_near(const AffineFrame* frames, std::size_t count,
                                         float half_width, float height, float x, float near) {
  LaneMask found = {};
  for (std::size_t i = 0; i < count; ++i) {
    const AffineFrame& f = frames[i];
    const auto lanes = [&](int axis) {
      return f.axis[axis].at(x, 0.5f, kHalf) + kLaneNumbers * f.axis[axis].ny;
    };
    const Lanes px = lanes(0), py = lanes(1), pz = lanes(2);
    const Lanes ey = max(abs(py) - half_width, all_lanes(0));
    const Lanes ez = max(max(-pz, pz - height), all_lanes(0));
    found |= px * px + ey * ey + ez * ez < near * near;
  }
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

float SweepDistance::to_mouth(const float* p) const {
  const float dy = std::max(std::abs(p[1]) - half_width_, 0.0f);
  const float dz = std::max(std::max(-p[2], p[2] - height_), 0.0f);
  return std::sqrt(p[0] * p[0] + dy * dy + dz * dz);
}

float SweepDistance::to_body_at_least(const float* p) const {
  const float dy = std::max(std::abs(p[1]) - half_width_, 0.0f);
  const float across = outline_box_.exteriorDistance(Eigen::Vector2f(p[0], p[2]));
  return std::sqrt(across * across + dy * dy);
}

std::uint32_t SweepDistance::rows_near_mouth(std::span<const AffineFrame> frames, float x,
                                             float spacing) const {
  return rows_near(frames.data(), frames.size(), half_width_, height_, x,
                   kBandVoxels + kHalf - 0.5f + spacing);
}

bool SweepDistance::carve_by_mouth(const SweptMouth& mouth, float x, float y,
                                   std::int16_t* row) const {
  return carve_mouth_row(mouth, half_width_, height_, x, y, row);
}

bool SweepDistance::carve_by_body(const AffineFrame& frame, float x, float y,
                                  std::int16_t* row) const {
  const Line line(frame, x, y);
  const float middle[3] = {line.at[0] + 3.5f * line.step[0], line.at[1] + 3.5f * line.step[1],
                           line.at[2] + 3.5f * line.step[2]};
  if (to_body_at_least(middle) > kBandVoxels + kHalf) return false;
  return carve_body_row(line, half_width_, outline_.data(), outline_.size(), row);
}

}  // namespace soilvdb
