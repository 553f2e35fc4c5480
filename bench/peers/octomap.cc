// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// OctoMap: ground as occupied leaves; each step sets the leaves free whose centre the mouth sweeps
// over, and counts them.
//
// Best setting: only voxels in the step's box are looked at; nodes are set at once instead of by
// many hits, inner nodes are brought up to date once, after the last step; the count is kept as
// they go, so volume costs nothing more. (deleteNode() would be the other way, but in 1.9.7 it
// trips an assertion of its own when a node loses its last child.) Ground comes as one box around
// the dig, pruned, as a map made of scans would be; level ground ends where voxels do, which
// is worth a factor of four at 1.25 cm voxels.
#include <octomap/octomap.h>

#include <cmath>

#include "bench/engine.h"
#include "core/lattice/chunk_math.h"

namespace soilvdb::bench {
namespace {

class OctoMap : public Engine {
 public:
  explicit OctoMap(const Task& task)
      : task_(task), tree_(task.voxel_m), pose_(task.motion->pose(task.motion->begin_s())) {
    const Eigen::AlignedBox3d box = soil_reach(task);
    const Coord3 first = index(box.min()) - Coord3::Ones(),
                 last = index(box.max()) + Coord3::Ones();
    float phi[kChunkVoxels];
    const double h = task.voxel_m;
    for (int x = first.x(); x <= last.x(); x += kChunkSide) {
      for (int y = first.y(); y <= last.y(); y += kChunkSide) {
        for (int z = first.z(); z <= last.z(); z += kChunkSide) {
          task.terrain->distance(centre({x, y, z}), h, 3 * h, phi);
          for (int n = 0; n < kChunkVoxels; ++n) {
            if (phi[n] < 0) {
              tree_.setNodeValue(key(Coord3(x, y, z) + numbered_voxel(n)),
                                 tree_.getClampingThresMaxLog(), true);
            }
          }
        }
      }
    }
    tree_.updateInnerOccupancy();
    tree_.prune();
  }

  void advance(const Step& step) override {
    const Pose next = task_.motion->pose(step.t1);
    const StepSweep sweep(task_.bucket, pose_, next);
    const Coord3 first = index(sweep.box().min()), last = index(sweep.box().max());
    for (int x = first.x(); x <= last.x(); ++x) {
      for (int y = first.y(); y <= last.y(); ++y) {
        for (int z = first.z(); z <= last.z(); ++z) {
          const Coord3 voxel(x, y, z);
          if (!sweep.contains(centre(voxel))) continue;
          const octomap::OcTreeKey k = key(voxel);
          const octomap::OcTreeNode* node = tree_.search(k);
          if (node == nullptr || !tree_.isNodeOccupied(node)) continue;
          tree_.setNodeValue(k, tree_.getClampingThresMinLog(), true);
          ++removed_;
        }
      }
    }
    pose_ = next;
  }

  void finish() override { tree_.updateInnerOccupancy(); }
  double cut_m3() override { return static_cast<double>(removed_) * std::pow(task_.voxel_m, 3); }
  double memory_bytes() const override { return static_cast<double>(tree_.memoryUsage()); }

 private:
  static constexpr int kMiddle = 1 << 15;  // of OctoMap's 2^16 keys per axis

  Coord3 index(const Vec3& p) const {
    return ((p - task_.origin) / task_.voxel_m).array().floor().matrix().cast<int>();
  }
  Vec3 centre(const Coord3& voxel) const {
    return task_.origin + task_.voxel_m * (voxel.cast<double>() + Vec3::Constant(0.5));
  }
  static octomap::OcTreeKey key(const Coord3& voxel) {
    const Coord3 k = voxel + Coord3::Constant(kMiddle);
    return {static_cast<octomap::key_type>(k.x()), static_cast<octomap::key_type>(k.y()),
            static_cast<octomap::key_type>(k.z())};
  }

  Task task_;
  octomap::OcTree tree_;
  Pose pose_;
  std::int64_t removed_ = 0;
};

}  // namespace

std::unique_ptr<Engine> make_octomap(const Task& task) {
  Task levelled = task;
  levelled.origin.z() = soil_reach(task).max().z();
  return std::make_unique<OctoMap>(levelled);
}

}  // namespace soilvdb::bench
