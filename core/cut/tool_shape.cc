// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/tool_shape.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "core/constants.h"
#include "core/lattice/bytes.h"

namespace soilvdb::inline v0 {
ToolShape::ToolShape(const Vec3& first_m, double voxel_size_m, const Coord3& n,
                     std::vector<float> distances_m)
    : first_m_(first_m),
      h_m_(voxel_size_m),
      n_(n),
      distances_m_(std::make_shared<const std::vector<float>>(std::move(distances_m))) {
  if (!(h_m_ > 0) || (n.array() < 2).any() || distances_m_->size() != n.cast<std::size_t>().prod())
    throw std::invalid_argument("a tool needs a distance for each point of its lattice");
  find_box();
}

/// Crossings of the lattice's edges give the bounds: along an axis, a crossing of the interpolated
/// distances is farthest at an edge of a cell.
void ToolShape::find_box() {
  const std::vector<float>& d = *distances_m_;
  const Coord3 step(n_.y() * n_.z(), n_.z(), 1);
  for (int x = 0; x < n_.x(); ++x)
    for (int y = 0; y < n_.y(); ++y)
      for (int z = 0; z < n_.z(); ++z) {
        const Coord3 at(x, y, z);
        const int k = at.dot(step);
        const float here = d[static_cast<std::size_t>(k)];
        if (!(here < 0)) continue;
        const Vec3 p = first_m_ + h_m_ * at.cast<double>();
        box_m_.extend(p);
        for (int axis = 0; axis < 3; ++axis)
          for (const int side : {-1, 1}) {
            if (at[axis] + side < 0 || at[axis] + side >= n_[axis]) continue;
            const float there = d[static_cast<std::size_t>(k + side * step[axis])];
            if (there >= 0)
              box_m_.extend(p + side * h_m_ * here / (here - there) * Vec3::Unit(axis));
          }
      }
  if (box_m_.isEmpty()) throw std::invalid_argument("the tool has no inside");
}

double ToolShape::beyond_m(const Vec3& at) const {
  const Vec3 held = at.cwiseMax(Vec3::Zero()).cwiseMin((n_ - Coord3::Ones()).cast<double>());
  const double beyond = h_m_ * (at - held).norm();
  return std::max(beyond, between(held) - beyond);
}

double ToolShape::volume_m3() const {
  double cells = 0;
  for (int x = 0; x + 1 < n_.x(); ++x)
    for (int y = 0; y + 1 < n_.y(); ++y)
      for (int z = 0; z + 1 < n_.z(); ++z) {
        const Vec3 low(x, y, z);
        int inside = 0;
        for (int k = 0; k < 8; ++k) inside += between(low + Vec3(k & 1, k >> 1 & 1, k >> 2)) < 0;
        if (inside == 0 || inside == 8) {
          cells += inside / 8;
          continue;
        }
        double parts = 0;  // each cut by a plane at that distance
        for (int k = 0; k < kToolVolumeParts * kToolVolumeParts * kToolVolumeParts; ++k) {
          const Vec3 part(k % kToolVolumeParts, k / kToolVolumeParts % kToolVolumeParts,
                          k / kToolVolumeParts / kToolVolumeParts);
          const double distance =
              between(low + (part + Vec3::Constant(0.5)) / kToolVolumeParts) / h_m_;
          parts += std::clamp(0.5 - kToolVolumeParts * distance, 0.0, 1.0);
        }
        cells += parts / (kToolVolumeParts * kToolVolumeParts * kToolVolumeParts);
      }
  return cells * h_m_ * h_m_ * h_m_;
}

std::string ToolShape::save() const {
  std::string out;
  for (const double v : first_m_) put(out, v);
  put(out, h_m_);
  for (const int n : n_) put(out, n);
  for (const float d : *distances_m_) put(out, d);
  return out;
}

ToolShape ToolShape::load(std::string_view bytes) {
  Vec3 first_m;
  double h_m = 0;
  Coord3 n;
  for (double& v : first_m) take(bytes, v);
  take(bytes, h_m);
  for (int& v : n) take(bytes, v);
  std::vector<float> distances_m(bytes.size() / sizeof(float));
  for (float& d : distances_m) take(bytes, d);
  if (!bytes.empty()) throw std::invalid_argument("these bytes are not a tool's shape");
  return {first_m, h_m, n, std::move(distances_m)};
}

Bucket tool_of(ToolShape shape) {
  const Eigen::AlignedBox3d& box = shape.box_m();
  const double far_m = box.min().cwiseAbs().cwiseMax(box.max().cwiseAbs()).norm();
  Bucket bucket{2 * far_m, far_m, {}, {}};
  bucket.shape = std::make_shared<const ToolShape>(std::move(shape));
  return bucket;
}

}  // namespace soilvdb::inline v0
