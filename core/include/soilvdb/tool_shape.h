// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A tool of any closed shape (blades, augers, rippers, drills) and its subtraction from the ground.
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

/// A closed body as signed distances on its own lattice, m, negative inside, with trilinear
/// interpolation. make_tool_shape() in soilvdb/ground_grids.h converts a FloatGrid.
///
/// Copies share the distances. Threads may call const members concurrently.
class ToolShape {
 public:
  /// From a closed mesh in the tool frame, m.
  /// @param voxel_size_m of the distances. Flat faces are exact at any size; edges are rounded, and
  ///        parts thinner than two voxels are lost
  /// @throw std::invalid_argument if the mesh is not closed, or too large at this voxel size
  ToolShape(const Mesh& mesh, double voxel_size_m);
  /// @param first_m position of the first distance. @param n number of distances per axis
  /// @param distances_m x slowest, z fastest, clamped to a band or not
  /// @throw std::invalid_argument if the number of distances differs from n, or the body is empty
  ToolShape(const Vec3& first_m, double voxel_size_m, const Coord3& n,
            std::vector<float> distances_m);

  /// Bounds of the body, tool frame.
  const Eigen::AlignedBox3d& box_m() const { return box_m_; }
  /// Signed distance of a point, tool frame, m. Outside the lattice: a lower bound above 0.
  double distance_m(const Vec3& p) const {
    const Vec3 at = (p - first_m_) / h_m_;
    for (int a = 0; a < 3; ++a)
      if (!(at[a] >= 0 && at[a] <= n_[a] - 1)) return beyond_m(at);
    return between(at);
  }
  /// Volume, to some thousandths.
  double volume_m3() const;
  /// Serialization. @throw std::invalid_argument if the bytes are not from save()
  std::string save() const;
  static ToolShape load(std::string_view bytes);

 private:
  void find_box();
  /// Distance at a position within the lattice, in its voxels.
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
  /// Lower bound at a position outside the lattice, in its voxels.
  double beyond_m(const Vec3& at) const;

  Vec3 first_m_;
  double h_m_;
  Coord3 n_;
  std::shared_ptr<const std::vector<float>> distances_m_;
  Eigen::AlignedBox3d box_m_;
};

/// A message if the volumes of a shape and of its source mesh differ by more than 1 %, else empty.
std::string lost_by(const ToolShape& shape, const Mesh& mesh);

/// A tool for a machine, in the frame of the shape.
Bucket tool_of(ToolShape shape);

/// Samples that a tool removed from the ground.
struct ToolCut {
  std::int64_t samples = 0;
  std::int64_t loose = 0;  ///< loose samples among them
};

/// Level-set CSG at the samples: soil remains where max(soil, -tool) < 0. Between poses
/// (world_from_tool) the tool moves straight and turns evenly, as a bucket. It removes all soil in
/// its sweep to within 1/50 of a voxel; a single pose removes the soil inside the tool. Guarantees:
/// a repeated path removes no soil; the result does not depend on the number of threads.
/// @throw NoGroundError where the terrain has no height; no soil was removed then
ToolCut subtract(Ground& ground, const ToolShape& tool, std::span<const Pose> path);

/// Adds bank soil where min(soil, body) < 0, for a built wall or foundation. Call it before a
/// tracker with moving soil starts on the ground: its mass balance does not count this soil.
/// @return number of added samples
std::int64_t unite(Ground& ground, const ToolShape& body, const Pose& world_from_body);

}  // namespace soilvdb::inline v0
