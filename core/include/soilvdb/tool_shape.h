// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A tool of any closed shape, and the ground without what it passes: blades, augers, rippers,
// drills.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "soilvdb/bucket.h"
#include "soilvdb/ground.h"
#include "soilvdb/mesher.h"
#include "soilvdb/types.h"

namespace soilvdb::inline v0 {

/// A closed body by its signed distances on a lattice of its own, m, negative inside, with
/// trilinear interpolation between them. Of a FloatGrid: make_tool_shape() in
/// soilvdb/ground_grids.h.
///
/// Copies share the distances. Const members may run on several threads.
class ToolShape {
 public:
  /// Of a closed mesh in the tool's frame, m.
  /// @param voxel_size_m of the distances. Flat faces are exact at any size; edges are rounded, and
  ///        what is thinner than two voxels is lost
  /// @throw std::invalid_argument if the mesh isn't closed, or too large for voxels of that size
  ToolShape(const Mesh& mesh, double voxel_size_m);
  /// @param first_m where the first distance is @param n how many there are along each axis
  /// @param distances_m x slowest, z fastest, clamped to a band or not
  ToolShape(const Vec3& first_m, double voxel_size_m, const Coord3& n,
            std::vector<float> distances_m);

  /// Around all of it, tool frame.
  const Eigen::AlignedBox3d& box_m() const { return box_m_; }
  /// Signed distance of a point of the tool's frame, m. Where the lattice doesn't reach, less than
  /// that, but above 0.
  double distance_m(const Vec3& p) const {
    const Vec3 at = (p - first_m_) / h_m_;
    for (int a = 0; a < 3; ++a)
      if (!(at[a] >= 0 && at[a] <= n_[a] - 1)) return beyond_m(at);
    return between(at);
  }
  /// What it holds, to some thousandths.
  double volume_m3() const;
  /// All of it as bytes, and back. @throw std::invalid_argument if these bytes aren't from save()
  std::string save() const;
  static ToolShape load(std::string_view bytes);

 private:
  void find_box();
  /// At a place within the lattice, in its voxels.
  double between(const Vec3& at) const {
    int cell[3];
    double t[3];
    for (int a = 0; a < 3; ++a) {
      cell[a] = std::min(static_cast<int>(at[a]), n_[a] - 2);
      t[a] = at[a] - cell[a];
    }
    const std::ptrdiff_t sy = n_.z(), sx = n_.y() * sy;
    const float* const d = distances_m_->data() + (cell[0] * sx + cell[1] * sy + cell[2]);
    const auto along_z = [&](const float* at_xy) {
      return at_xy[0] + t[2] * (double{at_xy[1]} - at_xy[0]);
    };
    const auto along_y = [&](const float* at_x) {
      const double low = along_z(at_x);
      return low + t[1] * (along_z(at_x + sy) - low);
    };
    const double low = along_y(d);
    return low + t[0] * (along_y(d + sx) - low);
  }
  /// At one that isn't.
  double beyond_m(const Vec3& at) const;

  Vec3 first_m_;
  double h_m_;
  Coord3 n_;
  std::shared_ptr<const std::vector<float>> distances_m_;
  Eigen::AlignedBox3d box_m_;
};

/// In words, where the volumes of a shape and of the mesh that it is of differ by more than 1 %;
/// empty: they don't.
std::string lost_by(const ToolShape& shape, const Mesh& mesh);

/// A machine's tool of that shape, in the shape's frame.
Bucket tool_of(ToolShape shape);

/// Samples that a tool took out of the ground.
struct ToolCut {
  std::int64_t samples = 0;
  std::int64_t loose = 0;  ///< of them
};

/// Level-set CSG decided at the samples: soil stays where max(soil, -tool) < 0. From pose to pose
/// (world_from_tool) the tool goes straight and turns evenly, as a bucket does, and takes all that
/// it comes to within 1/50 of a voxel; one pose alone takes what is in it. Guarantees: the same
/// path again takes nothing; the result is the same for any number of threads.
/// @throw NoGroundError where the terrain has no height; nothing was taken then
ToolCut subtract(Ground& ground, const ToolShape& tool, std::span<const Pose> path);

/// Soil where min(soil, body) < 0: what is built, a wall or a foundation. What is added is bank
/// soil. For ground that no tracker of soil that moves has begun with: its masses know nothing of
/// it.
/// @return samples that were added
std::int64_t unite(Ground& ground, const ToolShape& body, const Pose& world_from_body);

}  // namespace soilvdb::inline v0
