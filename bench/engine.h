// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What every engine under test offers: set up a dig, move the bucket on, tell the volume cut so
// far.
#pragma once

#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "soilvdb/bucket.h"
#include "soilvdb/initial_terrain.h"
#include "soilvdb/motion.h"

namespace soilvdb::bench {

/// An engine could not do a step (a peer's own error).
struct EngineFailed : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// A dig as an engine is given it.
struct Task {
  double voxel_m = 0;
  Vec3 origin = Vec3::Zero();  ///< engines put a lattice point here
  Bucket bucket;
  const Motion* motion = nullptr;
  std::shared_ptr<const InitialTerrain> terrain;
  Eigen::AlignedBox3d reach;  ///< of the mouth over the whole motion
  Eigen::AlignedBox3d site;   ///< ground that engines without a base surface represent
};

/// Part of the task's motion, one update.
struct Step {
  double t0 = 0, t1 = 0;
};

/// One engine on one dig. Steps follow on one another.
class Engine {
 public:
  virtual ~Engine() = default;
  /// What a user could have done ahead of time; not timed.
  virtual void prepare(const Step&) {}
  /// One update, the volume cut so far included (unless the engine's head says otherwise); timed.
  virtual void advance(const Step& step) = 0;
  /// What is left to do after the last step; timed.
  virtual void finish() {}
  /// Not timed.
  virtual double cut_m3() = 0;
  /// Steps that the engine could not do.
  virtual int failures() const { return 0; }
  virtual double memory_bytes() const { return 0; }
};

using MakeEngine = std::function<std::unique_ptr<Engine>(const Task&)>;

/// An engine by the name that tables, CSV files and plots know it by.
struct Peer {
  std::string name;
  MakeEngine make;
  bool grows_with_site = true;  ///< represents all of Task::site
};

/// soilvdb first, then the peers built in, in a fixed order.
const std::vector<Peer>& engines();
const Peer& engine(const std::string& name);

std::unique_ptr<Engine> make_soilvdb(const Task& task);
std::unique_ptr<Engine> make_paper(const Task& task);
/// The paper's method on a given number of cells per side instead of a grid that encloses the dig.
std::unique_ptr<Engine> make_paper_cube(const Task& task, int cells);
std::unique_ptr<Engine> make_openvdb_stock(const Task& task);
std::unique_ptr<Engine> make_openvdb_csg(const Task& task);
std::unique_ptr<Engine> make_octomap(const Task& task);
std::unique_ptr<Engine> make_cgal(const Task& task);

/// Corners of the mouth at a pose, in the order around it, world.
std::vector<Vec3> mouth_outline(const Bucket& bucket, const Pose& world_from_bucket);

/// The volume that the mouth sweeps between two poses when its points move in straight lines in the
/// bucket frame: the same membership test for the engines that test points. Exact for translations.
class StepSweep {
 public:
  StepSweep(const Bucket& bucket, const Pose& a, const Pose& b);
  const Eigen::AlignedBox3d& box() const { return box_; }
  bool contains(const Vec3& world) const {
    const double u = normal_a_.dot(world) - offset_a_, v = normal_b_.dot(world) - offset_b_;
    return (u > 0) != (v > 0) && crosses_mouth(world, u / (u - v));
  }

 private:
  bool crosses_mouth(const Vec3& world, double fraction) const;
  Pose a_, b_;  // bucket_from_world
  Vec3 normal_a_, normal_b_;
  double offset_a_, offset_b_;
  double half_width_, height_;
  Eigen::AlignedBox3d box_;
};

/// The task's reach at top cut off above the ground: what a dense grid has to enclose.
Eigen::AlignedBox3d soil_reach(const Task& task);

}  // namespace soilvdb::bench
