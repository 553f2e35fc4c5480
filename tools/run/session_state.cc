// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Steps of a session's state.
#include "tools/run/session_state.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "io/file/text.h"
#include "io/motion/motion_checks.h"
#include "soilvdb/io/error.h"
#include "soilvdb/lattice.h"
#include "tools/run/text.h"

namespace soilvdb::inline v0 {
namespace {

/// Longest way between two states.
constexpr double kFarthestMove_m = 100;
/// How far from a site's origin a map may be, voxels.
constexpr double kMapReach = 1 << 23;

}  // namespace

void Session::State::become(SiteState&& other) {
  std::optional<HeightMap> of_other;
  if (height_map) of_other.emplace(*other.site.ground, *height_map);
  set_memory_limit(*other.site.ground);
  patches.switch_to(*other.site.ground);
  chunks.switch_to(*other.site.ground);
  mesh_heights.reset();
  height_map = std::move(of_other);
  for (Backwards& so_far : backwards) so_far.way_m = 0;
  other.backwards = std::move(backwards);
  other.warnings = std::move(warnings);
  const std::shared_ptr<const SiteModel> model = model_;  // keeps references to it valid
  SiteState::operator=(std::move(other));
  model_ = model;
}

void Session::State::require_recording() {
  if (!recorder) return;
  try {
    recorder->check();
  } catch (const io::DiskFull& e) {
    throw io::DiskFull(recording_error(e.what()));
  } catch (const std::exception& e) {
    throw std::runtime_error(recording_error(e.what()));
  }
}

std::string Session::State::recording_error(const std::string& why) const {
  if (recorder->waits())
    return fmt::format("{}; states are refused until there is room; {} is good to {} s", why,
                       folder->path().string(), tools::time_text(recorder->acknowledged().time_s));
  return fmt::format("{}; {} is good to {} s; stop recording or mend that and open it again", why,
                     folder->path().string(), tools::time_text(recorder->acknowledged().time_s));
}

/// Updates do not wait for snapshots: while one is being written, a later one takes its place.
bool Session::State::is_snapshot_due(double time_s) {
  if (!recorder || !recorder->error().empty() || !std::isfinite(time_s)) return false;
  return !(recorder->would_be_due(time_s) && recorder->is_busy()) && recorder->due(time_s);
}

void Session::State::float_to(const Vec3& near_m) {
  const Ground& ground = *site.ground;
  const bool is_fresh = ground.chunk_count() == 0 &&
                        std::none_of(inputs_.begin(), inputs_.end(),
                                     [](const auto& input) { return input.has_value(); });
  if (!settings.floats || !is_fresh || !is_place(near_m)) return;
  const double h = ground.voxel_size_m();
  if (lattice_origin(h, near_m) == ground.origin()) return;
  if (recorder) {
    constexpr double kFarthest = 1 << 22;  // voxels; a tracker takes twice that
    if ((near_m - ground.origin()).cwiseAbs().maxCoeff() < kFarthest * h) return;
    throw std::invalid_argument(
        fmt::format("the first state is at x {:.0f}, y {:.0f}, z {:.0f} m, too far from a recorded "
                    "site at {:.0f}, "
                    "{:.0f}, {:.0f}; say near it when the site is made",
                    near_m.x(), near_m.y(), near_m.z(), ground.origin().x(), ground.origin().y(),
                    ground.origin().z()));
  }
  become(SiteState(model(), io::open_site(site.reference.terrain, h, near_m)));
}

void Session::State::reach(const MapGrid& grid) {
  const auto is_far = [&] {
    const Vec2 away_m = grid.first_m - site.ground->origin().head<2>();
    return away_m.allFinite() &&
           away_m.cwiseAbs().maxCoeff() > kMapReach * site.ground->voxel_size_m();
  };
  if (!is_far()) return;
  const double x = grid.first_m.x(), y = grid.first_m.y();
  if (!recorder) float_to({x, y, site.ground->terrain().height(x, y).value_or(0)});
  if (!is_far()) return;
  const Vec3& origin = site.ground->origin();
  throw std::invalid_argument(fmt::format(
      "a map must be within {:.0f} m of the site's origin, which is at ({:.0f}, {:.0f}); `near` "
      "says where work begins, by default a plane's first state does",
      kMapReach * site.ground->voxel_size_m(), origin.x(), origin.y()));
}

std::string Session::State::unlikely(const MachineState& state, std::optional<Input>& last) const {
  Input now = input(state, last);
  const SiteMachine& machine = model().machines[state.machine];
  const auto fault = [&]() -> std::string {
    const bool by_joints = !now.configuration.empty();
    if (by_joints)
      if (std::string why = io::state_fault(*machine.chain, now.configuration); !why.empty())
        return why;
    if (!last) return "";
    const auto far = [&](const char* what, const Pose& from, const Pose& to) -> std::string {
      const double way_m = (to.position - from.position).norm();
      if (way_m <= kFarthestMove_m) return "";
      return fmt::format(
          "{}would move {:.6g} m in one state; are these metres? Consecutive states are at most {} "
          "m apart",
          what, way_m, kFarthestMove_m);
    };
    const bool both_by_joints = by_joints && !last->configuration.empty();
    if (both_by_joints)
      if (std::string why = far("its base ", machine.chain->base_of(last->configuration),
                                machine.chain->base_of(now.configuration));
          !why.empty())
        return why;
    if (std::string why = far("", last->pose, now.pose); !why.empty()) return why;
    const double after_s = now.time_s && last->time_s ? *now.time_s - *last->time_s : -1;
    if (after_s < 0) return "";  // unknown, or refused anyway
    return both_by_joints
               ? io::state_fault(*machine.chain, last->configuration, now.configuration, after_s)
               : io::state_fault(last->pose, now.pose, after_s);
  };
  const std::string why = fault();
  if (!why.empty()) return fmt::format("machine '{}': {}", machine.name, why);
  if (!now.time_s && last) now.time_s = last->time_s;
  last = std::move(now);
  return "";
}

void Session::State::look_at_pose(const Sensor& sensor) {
  if (sensor.pose_shift_sigma_m > 0 || sensor.pose_turn_sigma_rad > 0) return;
  SeenFrom& first = seen_from.try_emplace(sensor.name, SeenFrom{sensor.pose}).first->second;
  const bool stays = sensor.pose.position == first.pose.position &&
                     sensor.pose.rotation.isApprox(first.pose.rotation);
  if (stays || std::exchange(first.warned, true)) return;
  warnings.push_back(fmt::format(
      "scans: sensor '{}' has moved, and each of its poses is believed to the last millimetre; "
      "give "
      "their standard deviations, pose_shift_sigma in m and pose_turn_sigma in rad ('pose' of a "
      "scenario or header), or another sensor another name",
      io::printable(sensor.name)));
}

void Session::State::warn_of_voxels(std::size_t first) {
  for (std::size_t i = first; i < model().machines.size(); ++i) {
    const SiteMachine& machine = model().machines[i];
    if (std::string told =
            tools::voxel_doubt(machine.name, machine.bucket, site.ground->voxel_size_m());
        !told.empty())
      warnings.push_back(std::move(told));
  }
}

Session::State::Way Session::State::way(std::size_t machine) const {
  if (machine >= inputs_.size()) return {};
  const Ledger& of = tracker().ledger(machine);
  return {inputs_[machine] ? std::optional(inputs_[machine]->pose) : std::nullopt, of.captured,
          of.displaced};
}

void Session::State::look_backwards(std::size_t machine, const Way& before) {
  if (!before.pose) return;
  const Way now = way(machine);
  std::string warning =
      SiteState::look_backwards(machine, *before.pose, *now.pose, now.captured > before.captured,
                                now.displaced > before.displaced);
  if (!warning.empty()) warnings.push_back(std::move(warning));
}

}  // namespace soilvdb::inline v0
