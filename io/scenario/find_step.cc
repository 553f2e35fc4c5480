// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/scenario/find_step.h"

#include <algorithm>
#include <memory>

namespace soilvdb::inline v0::io {
namespace {

constexpr double kLongestM = 500;

bool is_long(const Box3& box) { return box.sizes().head<2>().maxCoeff() > kLongestM; }

}  // namespace

bool surely_known(const Site& site, const Box3& box) {
  return !is_long(box) && site.ground->terrain().has_data(box);
}

bool surely_air(const Site& site, const Box3& box) {
  return !is_long(box) && site.ground->terrain().classify(box) == Content::kAir;
}

bool find_step(const MachineInput& machine, const std::function<bool(const Box3&)>& wanted,
               const std::function<bool(const Motion& part, const StepBox&)>& found) {
  constexpr std::size_t kBoxesPerPart = MotionFile::kPartSteps / SweptBoxes::kStepsPerBox;
  const std::vector<Box3>& blocks = machine.swept.blocks();
  std::shared_ptr<const Motion> part;
  std::size_t loaded = machine.motion.parts();
  for (std::size_t block = 0; block < blocks.size(); ++block) {
    if (!wanted(blocks[block])) continue;
    const std::size_t i = std::min(block / kBoxesPerPart, machine.motion.parts() - 1);
    if (i != loaded) part = machine.motion.part(loaded = i);
    const std::size_t steps = std::max<std::size_t>(part->times_s().size() - 1, 1);
    const std::size_t first = (block - i * kBoxesPerPart) * SweptBoxes::kStepsPerBox;
    for (const StepBox& step : step_boxes(*part, machine.bucket, first,
                                          std::min(first + SweptBoxes::kStepsPerBox, steps))) {
      if (found(*part, step)) return true;
    }
  }
  return false;
}

Box3 box_at(const Pose& world_from_bucket, const Corners& corners) {
  Box3 box;
  for (const auto& p : corners.colwise()) box.extend(world_from_bucket * Vec3(p));
  return box;
}

std::vector<Box3> close_boxes(const MachineInput& m, const Motion& part, std::size_t row,
                              double h) {
  const std::vector<double>& times = part.times_s();
  const std::vector<Pose> path =
      part.trace(times[row], times[std::min(row + 1, times.size() - 1)], m.bucket, h / 100, 8 * h);
  const Corners corners = bucket_corners(m.bucket);
  std::vector<Box3> boxes;
  Box3 last;
  for (const Pose& pose : path) {
    const Box3 box = box_at(pose, corners);
    if (!last.isEmpty() || path.size() == 1) boxes.push_back(box.merged(last));
    last = box;
  }
  return boxes;
}

}  // namespace soilvdb::inline v0::io
