// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/scenario/check_pours.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numbers>
#include <optional>
#include <vector>

#include "core/constants.h"

namespace soilvdb::inline v0::io {
namespace {

/// The ground at the beginning of the run.
std::shared_ptr<const InitialTerrain> ground_of(const Ground& ground) {
  if (ground.chunks().empty()) return ground.shared_terrain();
  return make_ground_terrain({std::shared_ptr<void>(), &ground});
}

bool is_underground(const Vec3& p, const InitialTerrain& terrain, double h, double error_m) {
  std::array<float, kChunkVoxels> phi;
  terrain.distance(p, h, h, phi.data());
  return phi[0] < -error_m;
}

/// Could a bucket have dug at that place before the pour begins?
bool may_be_dug(const Pour& pour, const std::vector<MachineInput>& machines) {
  return std::any_of(machines.begin(), machines.end(), [&](const MachineInput& m) {
    if (!m.has_motion()) return true;
    if (m.motion.begin_s() >= pour.begin_s) return false;
    const std::vector<Box3>& blocks = m.swept.blocks();
    return std::any_of(blocks.begin(), blocks.end(),
                       [&](const Box3& block) { return block.contains(pour.at_m); });
  });
}

}  // namespace

void check_pours(const Scenario& scenario, const Site& site) {
  if (scenario.pours.empty()) return;
  const double h = site.ground->voxel_size_m();
  const std::shared_ptr<const InitialTerrain> terrain = ground_of(*site.ground);
  // The error of a dug surface is half a voxel.
  const double error_m = site.ground->chunks().empty() ? h / 1000 : h / 2;
  for (const Pour& pour : scenario.pours) {
    const Vec3& p = pour.at_m;
    const std::string at =
        fmt::format("pour '{}' at x {:.2f}, y {:.2f}, z {:.2f}", pour.name, p.x(), p.y(), p.z());
    if (!site.bounds.contains(p.head<2>())) {
      throw InputError(
          scenario.file,
          fmt::format("{} is outside the terrain, which covers x {:.1f} to {:.1f}, y {:.1f} to "
                      "{:.1f}; both must be in the same coordinates",
                      at, site.bounds.min().x(), site.bounds.max().x(), site.bounds.min().y(),
                      site.bounds.max().y()));
    }
    if (const double far_m = (p - site.ground->origin()).cwiseAbs().maxCoeff();
        far_m >= kMaxIndex * h) {
      throw InputError(
          scenario.file,
          fmt::format("{} is {:.0f} m from the site's origin, more than the {:g} m that voxels of "
                      "{:g} m can number; a voxel_size of {:.2g} or more would do",
                      at, far_m, kMaxIndex * h, h, 1.05 * far_m / kMaxIndex));
    }
    // A wider pile's ground is not examined as a whole.
    const double slope = std::tan(scenario.soil->repose_rad), most_m = kMaxPileCells * h;
    if (const double radius_m = std::cbrt(3 * pour.volume_m3 / (std::numbers::pi * slope));
        radius_m > most_m) {
      throw InputError(
          scenario.file,
          fmt::format("pour '{}' of {:g} m3 makes a cone with a radius of {:.1f} m; voxels of {:g} "
                      "m can have one of {:.1f} m: a voxel_size of {:.2g} or more would do",
                      pour.name, pour.volume_m3, radius_m, h, most_m,
                      1.05 * radius_m / kMaxPileCells));
    }
    const std::optional<double> height_m = terrain->height(p.x(), p.y());
    if (!height_m) {
      throw InputError(scenario.file,
                       fmt::format("{} falls where the terrain has no height; a terrain that has "
                                   "one there would do, or another place",
                                   at));
    }
    if (is_underground(p, *terrain, h, error_m) && !may_be_dug(pour, scenario.machines)) {
      throw InputError(scenario.file,
                       fmt::format("{} begins underground; the ground there is at z {:.2f}, and it "
                                   "must fall from above",
                                   at, *height_m));
    }
  }
}

}  // namespace soilvdb::inline v0::io
