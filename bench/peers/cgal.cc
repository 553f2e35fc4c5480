// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// CGAL: ground and the step's hexahedron as closed triangle meshes, corefined and subtracted
// (corefine_and_compute_difference), then volume() of what is left.
//
// Best setting: exact predicates, inexact constructions (the kernel its manual recommends for
// speed); plane ground is a box of 12 triangles, other ground has a grid of posts one voxel apart;
// the hexahedron is the mouth at both ends of a step, each step's a ten-millionth of a voxel larger
// than the one before, so that no faces are coplanar. A step
// whose corefinement throws, or whose result is not closed, is retried with a larger hexahedron; if
// that fails too the step is left out and counted as a failure.
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/corefinement.h>
#include <CGAL/Polygon_mesh_processing/measure.h>
#include <CGAL/Polygon_mesh_processing/orientation.h>
#include <CGAL/Surface_mesh.h>

#include <cmath>

#include "bench/engine.h"

namespace soilvdb::bench {
namespace {

namespace pmp = CGAL::Polygon_mesh_processing;
using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using SurfaceMesh = CGAL::Surface_mesh<Kernel::Point_3>;
using Vertex = SurfaceMesh::Vertex_index;

class Cgal : public Engine {
 public:
  explicit Cgal(const Task& task)
      : task_(task),
        middle_(task.reach.center()),
        pose_(task.motion->pose(task.motion->begin_s())) {
    const Vec3 margin = Vec3::Constant(4 * task.voxel_m);
    box_ = Eigen::AlignedBox3d(task.reach.min() - margin, task.reach.max() + margin);
    if (!task.site.isEmpty()) box_.extend(task.site);
    make_ground(is_plane() ? 1 : 0);
    initial_m3_ = CGAL::to_double(pmp::volume(soil_));
  }

  void advance(const Step& step) override {
    const Pose next = task_.motion->pose(step.t1);
    ++steps_;
    const double hair = 1e-7 * task_.voxel_m;
    if (!subtract(next, steps_ * hair) && !subtract(next, (steps_ + 0.5) * hair)) ++failures_;
    now_m3_ = CGAL::to_double(pmp::volume(soil_));
    pose_ = next;
  }
  double cut_m3() override { return initial_m3_ - now_m3_; }
  int failures() const override { return failures_; }

 private:
  bool is_plane() const {
    const Vec3 size = box_.sizes();
    const auto height = [&](double s, double t) {
      return task_.ground->height(box_.min().x() + s * size.x(), box_.min().y() + t * size.y())
          .value_or(box_.min().z());
    };
    const double z00 = height(0, 0), dx = height(1, 0) - z00, dy = height(0, 1) - z00;
    for (const double s : {0.13, 0.5, 0.77, 1.0}) {
      for (const double t : {0.11, 0.5, 0.83, 1.0}) {
        if (std::abs(z00 + s * dx + t * dy - height(s, t)) > 1e-9) return false;
      }
    }
    return true;
  }

  /// Posts on top, the same posts at the bottom, sides between. @param n posts less one, 0: by
  /// voxel
  void make_ground(int n) {
    const Vec3 size = box_.sizes();
    const int nx = n > 0 ? n : std::max(1, static_cast<int>(std::ceil(size.x() / task_.voxel_m)));
    const int ny = n > 0 ? n : std::max(1, static_cast<int>(std::ceil(size.y() / task_.voxel_m)));
    std::vector<Vertex> top, bottom;
    double lowest = box_.min().z();
    for (int i = 0; i <= nx; ++i) {
      for (int j = 0; j <= ny; ++j) {
        const double x = box_.min().x() + i * size.x() / nx, y = box_.min().y() + j * size.y() / ny;
        const double z = task_.ground->height(x, y).value_or(box_.min().z());
        lowest = std::min(lowest, z - 4 * task_.voxel_m);
        top.push_back(add(soil_, {x, y, z}));
      }
    }
    for (const Vertex v : top) {
      const auto& p = soil_.point(v);
      bottom.push_back(soil_.add_vertex({p.x(), p.y(), lowest - middle_.z()}));
    }
    const auto id = [ny](int i, int j) { return static_cast<std::size_t>(i * (ny + 1) + j); };
    const auto quad = [this](Vertex a, Vertex b, Vertex c, Vertex d) {
      soil_.add_face(a, b, c);
      soil_.add_face(a, c, d);
    };
    for (int i = 0; i < nx; ++i) {
      for (int j = 0; j < ny; ++j) {
        const auto a = id(i, j), b = id(i + 1, j), c = id(i + 1, j + 1), d = id(i, j + 1);
        quad(top[a], top[b], top[c], top[d]);
        quad(bottom[a], bottom[d], bottom[c], bottom[b]);
      }
    }
    const auto wall = [&](std::size_t a, std::size_t b) {  // a to b with the ground to the left
      quad(bottom[a], bottom[b], top[b], top[a]);
    };
    for (int i = 0; i < nx; ++i) {
      wall(id(i, 0), id(i + 1, 0));
      wall(id(i + 1, ny), id(i, ny));
    }
    for (int j = 0; j < ny; ++j) {
      wall(id(nx, j), id(nx, j + 1));
      wall(id(0, j + 1), id(0, j));
    }
  }

  Vertex add(SurfaceMesh& mesh, const Vec3& p) const {
    const Vec3 local = p - middle_;
    return mesh.add_vertex({local.x(), local.y(), local.z()});
  }

  bool subtract(const Pose& next, double grow_m) {
    SurfaceMesh tool;
    std::vector<Vertex> v;
    Vec3 centre = Vec3::Zero();
    std::vector<Vec3> corners;
    for (const Pose& pose : {pose_, next}) {
      for (const Vec3& corner : mouth_corners(task_.bucket, pose)) corners.push_back(corner);
    }
    for (const Vec3& corner : corners) centre += corner / 8;
    for (const Vec3& corner : corners)
      v.push_back(add(tool, corner + grow_m * (corner - centre).normalized()));
    constexpr std::size_t kTriangles[12][3] = {{0, 1, 2}, {0, 2, 3}, {4, 6, 5}, {4, 7, 6},
                                               {0, 4, 5}, {0, 5, 1}, {1, 5, 6}, {1, 6, 2},
                                               {2, 6, 7}, {2, 7, 3}, {3, 7, 4}, {3, 4, 0}};
    for (const auto& t : kTriangles) tool.add_face(v[t[0]], v[t[1]], v[t[2]]);
    try {
      if (!pmp::is_outward_oriented(tool)) pmp::reverse_face_orientations(tool);
      SurfaceMesh result, soil = soil_;
      const bool manifold = pmp::corefine_and_compute_difference(
          soil, tool, result, CGAL::parameters::throw_on_self_intersection(true));
      if (!manifold || !CGAL::is_closed(result)) return false;
      soil_ = std::move(result);
      return true;
    } catch (const std::exception&) {
      return false;
    }
  }

  Task task_;
  Vec3 middle_;
  Eigen::AlignedBox3d box_;
  SurfaceMesh soil_;
  Pose pose_;
  double initial_m3_ = 0, now_m3_ = 0;
  int steps_ = 0, failures_ = 0;
};

}  // namespace

std::unique_ptr<Engine> make_cgal(const Task& task) { return std::make_unique<Cgal>(task); }

}  // namespace soilvdb::bench
