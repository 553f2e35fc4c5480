// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A tool's distances out of OpenVDB's grids, and of a mesh by way of one.
#include <openvdb/tools/Dense.h>
#include <openvdb/tools/MeshToVolume.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>
#include <string>
#include <utility>

#include "core/constants.h"
#include "core/lattice/text.h"
#include "soilvdb/ground_grids.h"
#include "soilvdb/tool_shape.h"

namespace soilvdb::inline v0 {
namespace {

/// Has each edge of a mesh as many triangles on one side as on the other?
bool is_closed(const Mesh& mesh) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
  for (const auto& t : mesh.triangles) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = t[k], b = t[(k + 1) % 3];
      edges[std::minmax(a, b)] += a < b ? 1 : -1;
    }
  }
  return !edges.empty() &&
         std::all_of(edges.begin(), edges.end(), [](const auto& edge) { return edge.second == 0; });
}

openvdb::FloatGrid::Ptr grid_of(const Mesh& mesh, double voxel_size_m) {
  if (!(voxel_size_m > 0) || !std::isfinite(voxel_size_m))
    throw std::invalid_argument("a tool's voxels must be larger than 0 m");
  if (!is_closed(mesh))
    throw std::invalid_argument(
        "the tool's mesh isn't closed: an edge has no triangle beyond it, or one that is turned "
        "over");
  Eigen::AlignedBox3f box;
  for (const Eigen::Vector3f& p : mesh.points) {
    if (!p.allFinite())
      throw std::invalid_argument("the tool's mesh has a point that is not a number");
    if (p.cwiseAbs().maxCoeff() > kMaxToolReachM)
      throw std::invalid_argument("the tool's mesh reaches " +
                                  text(double{p.cwiseAbs().maxCoeff()}) +
                                  " m from its own origin, which is where the tool's frame is; "
                                  "bring it within 40 m, and its points to metres");
    box.extend(p);
  }
  if ((box.sizes().cast<double>() / voxel_size_m).array().max(1).prod() > kMaxToolVoxels)
    throw std::invalid_argument("the tool is too large for voxels of " + text(voxel_size_m) +
                                " m; give it larger ones");
  openvdb::initialize();
  std::vector<openvdb::Vec3s> points;
  for (const Eigen::Vector3f& p : mesh.points) points.emplace_back(p.x(), p.y(), p.z());
  std::vector<openvdb::Vec3I> triangles;
  for (const auto& t : mesh.triangles) triangles.emplace_back(t[0], t[1], t[2]);
  return openvdb::tools::meshToLevelSet<openvdb::FloatGrid>(
      *openvdb::math::Transform::createLinearTransform(voxel_size_m), points, triangles, kToolBand);
}

}  // namespace

ToolShape make_tool_shape(const openvdb::FloatGrid& grid) {
  const openvdb::Vec3d size = grid.voxelSize();
  const openvdb::Mat4d m = grid.transform().isLinear()
                               ? grid.transform().baseMap()->getAffineMap()->getMat4()
                               : openvdb::Mat4d::zero();
  bool cubic = size[0] > 0;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      cubic &= std::abs(m[i][j] - (i == j ? size[0] : 0)) <= kCubicTolerance * size[0];
  if (grid.getGridClass() != openvdb::GRID_LEVEL_SET || !cubic)
    throw std::invalid_argument(
        "a tool must be a level set with cubic voxels along the axes of its frame");
  openvdb::CoordBBox box = grid.evalActiveVoxelBoundingBox();
  if (box.empty()) throw std::invalid_argument("the tool has no inside");
  box.expand(1);
  if (static_cast<double>(box.volume()) > kMaxToolVoxels)
    throw std::invalid_argument("the tool has too many voxels; resample it to larger ones");
  openvdb::tools::Dense<float, openvdb::tools::LayoutZYX> dense(box);
  openvdb::tools::copyToDense(grid, dense);
  const openvdb::Vec3d first = grid.indexToWorld(box.min());
  const openvdb::Coord n = box.dim();
  return {Vec3(first[0], first[1], first[2]),
          size[0],
          Coord3(n[0], n[1], n[2]),
          {dense.data(), dense.data() + dense.valueCount()}};
}

std::string lost_by(const ToolShape& shape, const Mesh& mesh) {
  double mesh_m3 = 0;
  for (const auto& t : mesh.triangles) {
    const Vec3 a = mesh.points[t[0]].cast<double>(), b = mesh.points[t[1]].cast<double>(),
               c = mesh.points[t[2]].cast<double>();
    mesh_m3 += a.dot(b.cross(c)) / 6;
  }
  mesh_m3 = std::abs(mesh_m3);
  const double shape_m3 = shape.volume_m3();
  if (std::abs(shape_m3 - mesh_m3) <= kToolVolumeTolerance * mesh_m3) return "";
  return "the tool holds " + text(shape_m3, 4) + " m3 and its mesh " + text(mesh_m3, 4) +
         " m3: its voxels are too large for it, or the mesh overlaps itself or is hollow";
}

ToolShape::ToolShape(const Mesh& mesh, double voxel_size_m)
    : ToolShape(make_tool_shape(*grid_of(mesh, voxel_size_m))) {}

}  // namespace soilvdb::inline v0
