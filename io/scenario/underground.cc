// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/scenario/underground.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <memory>
#include <optional>

#include "io/scenario/find_step.h"

namespace soilvdb::inline v0::io {
namespace {

/// A lower bound of the bucket's least depth below the ground, m; empty if it emerges at some row.
std::optional<double> depth_m(const MachineInput& machine, const InitialTerrain& terrain) {
  const Corners corners = bucket_corners(machine.bucket);
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < machine.motion.parts(); ++i) {
    const std::shared_ptr<const Motion> part = machine.motion.part(i);
    for (std::size_t row = 0; row < part->times_s().size(); ++row) {
      const Box3 box = box_at(part->row(row), corners);
      if (terrain.classify(box) != Content::kSoil) return std::nullopt;
      const Vec3 top(box.center().x(), box.center().y(), box.max().z());
      least = std::min(least, terrain.height(top.x(), top.y()).value_or(top.z()) - top.z());
    }
  }
  return least;
}

}  // namespace

void warn_of_underground(Scenario& scenario, const InitialTerrain& terrain) {
  for (const MachineInput& machine : scenario.machines) {
    if (!machine.has_motion()) continue;
    const std::optional<double> depth = depth_m(machine, terrain);
    if (!depth) continue;
    scenario.warnings.push_back(fmt::format(
        "{}: the bucket of {} is {:.3g} m or more below the ground all the time; heights of motion "
        "and terrain must be from the same zero, both above sea level or both above the ellipsoid",
        scenario.file.string(), machine.name, *depth));
  }
}

}  // namespace soilvdb::inline v0::io
