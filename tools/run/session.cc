// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/session.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <new>
#include <set>
#include <stdexcept>
#include <utility>

#include "soilvdb/io/scenario.h"
#include "tools/run/session_state.h"

namespace soilvdb::inline v0 {
namespace {

io::Site open_checked(const SessionSite& site) {
  if (!(site.voxel_size_m > 0) || !std::isfinite(site.voxel_size_m))
    throw std::invalid_argument(
        fmt::format("the voxel size is {} m; it must be more than 0", site.voxel_size_m));
  if (site.near_m && !site.near_m->allFinite())
    throw std::invalid_argument("the place where work begins must be finite");
  const auto* plane = std::get_if<io::PlaneTerrain>(&site.terrain);
  if (plane != nullptr && !(std::isfinite(plane->height_m) && plane->slope.allFinite()))
    throw std::invalid_argument("the plane's height and slope must be finite");
  return io::open_site(site.terrain, site.voxel_size_m, site.near_m);
}

constexpr double kNoTime = std::numeric_limits<double>::quiet_NaN();

/// The reason in a result, or none if there is no memory for it.
template <typename Result>
Result refused(Status status, const std::string& why) noexcept {
  Result result;
  result.status = status;
  try {
    result.why = why;
  } catch (...) {
  }
  return result;
}

}  // namespace

Session::Session(std::unique_ptr<State> state) : state_(std::move(state)) {}

Session::Session(SessionSite site)
    : state_(std::make_unique<State>(tools::SiteState(
          std::move(site.machines), std::move(site.earthmoving), open_checked(site)))) {}

Session Session::open(const std::filesystem::path& file, std::optional<double> voxel_size_m) {
  io::Scenario scenario = io::read_scenario(file, {}, io::Motions::kOptional);
  if (voxel_size_m) scenario.voxel_size_m = *voxel_size_m;
  auto state = std::make_unique<State>(tools::SiteState(scenario, io::open_site(scenario)));
  state->settings.recording = {.folder = {},
                               .sync_s = scenario.journal_sync_s,
                               .snapshot_every_s = scenario.snapshot_every_s,
                               .incremental = scenario.incremental_snapshots,
                               .keep = scenario.snapshots_kept};
  state->settings.scenario = std::filesystem::absolute(file);
  return Session(std::move(state));
}

Session::~Session() = default;
Session::Session(Session&&) noexcept = default;
Session& Session::operator=(Session&&) noexcept = default;

double Session::voxel_size_m() const { return state_->site.soil->voxel_size_m(); }
const Vec3& Session::origin() const { return state_->site.soil->origin(); }
const std::vector<SessionMachine>& Session::machines() const { return state_->machines; }

const Earthmoving& Session::earthmoving() const { return state_->earthmoving; }
const io::Site& Session::site() const { return state_->site; }

std::size_t Session::machine(std::string_view name) const {
  std::string all;
  for (std::size_t i = 0; i < state_->machines.size(); ++i) {
    if (state_->machines[i].name == name) return i;
    all += (i > 0 ? ", " : "") + state_->machines[i].name;
  }
  throw std::invalid_argument(
      fmt::format("there is no machine '{}'; there are: {}", name, all.empty() ? "none" : all));
}

Pose Session::pose(std::size_t machine, std::span<const double> joints) const {
  state_->require(machine);
  const std::optional<Chain>& chain = state_->machines[machine].chain;
  if (!chain)
    throw std::invalid_argument(
        fmt::format("{} has no joints; give it a pose", state_->name(machine)));
  const std::vector<std::string> names = chain->movable();
  if (joints.size() != names.size())
    throw std::invalid_argument(fmt::format("{} has {} joints, not {}: {}", state_->name(machine),
                                            names.size(), joints.size(), fmt::join(names, ", ")));
  for (std::size_t i = 0; i < joints.size(); ++i)
    if (!std::isfinite(joints[i]))
      throw std::invalid_argument(fmt::format("{}: joint '{}' is {}; it must be finite",
                                              state_->name(machine), names[i], joints[i]));
  return chain->world_from_bucket(joints);
}

std::optional<MachineState> Session::last(std::size_t machine) const {
  state_->require(machine);
  const State::Fed& fed = state_->fed[machine];
  if (fed.pose.position.hasNaN()) return {};
  return MachineState{machine, fed.time_s, fed.pose, fed.joints};
}

/// Calls `work(moving)`, which sets `moving` before anything changes that it can't take back.
template <typename Result, typename Work>
Result Session::State::guarded(const Work& work) noexcept {
  if (!broken.empty()) return refused<Result>(Status::kFailed, broken);
  bool moving = false;
  try {
    return work(moving);
  } catch (const NoGroundError& e) {
    if (!moving) return refused<Result>(Status::kNoGround, e.what());
    broken = e.what();
  } catch (const std::invalid_argument& e) {
    if (!moving) return refused<Result>(Status::kBadState, e.what());
    broken = e.what();
  } catch (const std::exception& e) {
    if (!moving) return refused<Result>(Status::kFailed, e.what());
    broken = e.what();
  }
  try {
    broken += "; the ground is of no use any more, restore a state";
  } catch (...) {
  }
  return refused<Result>(Status::kFailed, broken);
}

/// What was fed goes to the journal. Where that can't be known to be on disk although it must, the
/// result says so.
template <typename Result>
void Session::State::record(const io::JournalUpdate& update, Result& made) {
  ++fed_count;
  if (!recorder) return;
  if (!recorder->add(update) && settings.recording.sync_s == 0) {
    made.status = Status::kFailed;
    made.why = recorder->error();
  }
}

/// @param before where the machine was fed to before
template <typename Result>
void Session::State::record(const MachineState& state, const Fed& before, const Update& update,
                            Result& made) {
  if (!recorder) {
    ++fed_count;
    return;
  }
  io::MotionRows rows;
  rows.joints = !state.joints.empty();
  const auto add = [&](double time_s, const Pose& pose, std::span<const double> joints) {
    rows.times_s.push_back(time_s);
    if (rows.joints) {
      rows.values.insert(rows.values.end(), joints.begin(), joints.end());
    } else {
      const Vec3& p = pose.position;
      const auto& q = pose.rotation.coeffs();
      rows.values.insert(rows.values.end(), {p[0], p[1], p[2], q[0], q[1], q[2], q[3]});
    }
  };
  const bool on_time = state.time_s > before.time_s;
  if (on_time && before.joints.empty() != rows.joints)
    add(before.time_s, before.pose, before.joints);
  add(state.time_s, state.pose, state.joints);
  rows.columns = rows.values.size() / rows.times_s.size();
  record({.machine = static_cast<std::uint32_t>(state.machine),
          .begin_s = on_time ? before.time_s : kNoTime,
          .end_s = state.time_s,
          .cut_samples = samples(update.cut_m3),
          .bucket_samples = mass(update.bucket_m3),
          .ns = std::llround(1e3 * update.us),
          .rows = std::move(rows),
          .spilled = mass(update.spilled_m3),
          .slid = mass(update.slid_m3)},
         made);
}

BatchResult Session::update(std::span<const MachineState> states) noexcept {
  State& s = *state_;
  std::size_t at = 0;
  BatchResult result = s.guarded<BatchResult>([&](bool& moving) {
    BatchResult made;
    std::vector<State::Fed> fed = s.fed;
    std::deque<Motion> motions;
    std::vector<Move> moves;
    std::vector<State::Fed> before;  // each state
    for (; at < states.size(); ++at) {
      s.require(states[at].machine);
      before.push_back(fed[states[at].machine]);
      moves.push_back(s.move(*this, states[at], fed[states[at].machine], motions));
    }
    if (const std::optional<BadMove> bad = s.tracker->find_bad(moves)) {
      at = bad->move;
      made.status = bad->no_ground ? Status::kNoGround : Status::kBadState;
      made.why = s.name(moves[at].machine) + ": " + bad->why;
      return made;
    }
    s.require_room();
    moving = true;
    if (s.earthmoving.pours.empty()) {
      made.updates = s.tracker->update(moves);
    } else {
      for (std::size_t i = 0; i < moves.size(); ++i) {
        s.pour_before(states[i].time_s);
        made.updates.push_back(s.tracker->update(std::span(moves).subspan(i, 1)).front());
      }
    }
    s.fed = std::move(fed);
    double due_s = kNoTime;  // as one by one, but all of them are in it
    for (std::size_t i = 0; i < states.size(); ++i) {
      s.record(states[i], before[i], made.updates[i], made);
      if (s.is_snapshot_due(states[i].time_s)) due_s = std::fmax(due_s, states[i].time_s);
    }
    if (!std::isnan(due_s)) s.write_snapshot(due_s);
    return made;
  });
  result.bad = result.ok() ? 0 : at;
  return result;
}

StepResult Session::update(const MachineState& state) noexcept {
  State& s = *state_;
  return s.guarded<StepResult>([&](bool& moving) {
    s.require(state.machine);
    State::Fed fed = s.fed[state.machine];
    std::deque<Motion> motions;
    const Move move = s.move(*this, state, fed, motions);
    s.require_room();
    StepResult made;
    // A stroke of rigid soil is refused before it digs; else what it does on the way is.
    const bool one_stroke = !s.earthmoving.soil && !s.machines[state.machine].bucket.dump_angle_rad;
    if (!one_stroke) {
      if (const std::optional<BadMove> bad = s.tracker->find_bad(std::span(&move, 1))) {
        made.status = bad->no_ground ? Status::kNoGround : Status::kBadState;
        made.why = s.name(state.machine) + ": " + bad->why;
        return made;
      }
      moving = true;
      s.pour_before(state.time_s);
    }
    try {
      made.update = move.motion != nullptr
                        ? s.tracker->update(move.machine, *move.motion, move.begin_s, move.end_s)
                        : s.tracker->update(move.machine, move.to);
    } catch (const NoGroundError& e) {
      throw NoGroundError(s.name(state.machine) + ": " + e.what());
    } catch (const std::invalid_argument& e) {
      throw std::invalid_argument(s.name(state.machine) + ": " + e.what());
    } catch (...) {
      moving = true;
      throw;
    }
    std::swap(s.fed[state.machine], fed);
    s.record(state, fed, made.update, made);
    if (s.is_snapshot_due(state.time_s)) s.write_snapshot(state.time_s);
    return made;
  });
}

StepResult Session::pour(double until_s) noexcept {
  return state_->guarded<StepResult>([&](bool& moving) {
    if (std::isnan(until_s)) throw std::invalid_argument("the time must be a number");
    state_->require_room();
    StepResult made;
    moving = true;
    state_->pour(until_s);
    state_->record({.end_s = until_s, .kind = io::JournalUpdate::Kind::kPours}, made);
    if (state_->is_snapshot_due(until_s)) state_->write_snapshot(until_s);
    return made;
  });
}

StepResult Session::reset_clock(std::size_t machine) noexcept {
  State& s = *state_;
  return s.guarded<StepResult>([&](bool&) {
    s.require(machine);
    s.require_room();
    StepResult made;
    s.fed[machine].time_s = kNoTime;
    s.record(
        {.machine = static_cast<std::uint32_t>(machine), .kind = io::JournalUpdate::Kind::kClock},
        made);
    if (s.recorder) s.recorder->begin_schedule_again();
    return made;
  });
}

StepResult Session::come_to_rest() noexcept {
  return state_->guarded<StepResult>([&](bool& moving) {
    state_->require_room();
    StepResult made;
    moving = true;
    made.update = state_->tracker->come_to_rest(state_->last_s());
    state_->record({.end_s = state_->last_s(), .kind = io::JournalUpdate::Kind::kRest}, made);
    return made;
  });
}

const Ledger& Session::ledger(std::size_t machine) const {
  return state_->tracker->ledger(machine);
}
Ledger Session::total() const { return state_->tracker->total(); }
SiteLedger Session::books() const { return state_->tracker->site(); }
SiteLedger Session::booked() const { return state_->tracker->booked(); }

double Session::bucket_kg(std::size_t machine) const {
  const Ledger& of = ledger(machine);
  if (!state_->earthmoving.soil) return 0;
  return of.units.kg(of.load, of.sample_m3, *state_->earthmoving.soil);
}

double Session::change_m3() const { return state_->site.soil->change_m3(); }
std::uint64_t Session::ground_hash() const { return state_->site.soil->state_hash(); }
std::uint64_t Session::memory_bytes() const { return state_->site.soil->memory_bytes(); }

void Session::heights(std::span<const Vec2> xy_m, std::span<double> heights_m) {
  if (heights_m.size() < xy_m.size())
    throw std::invalid_argument("there must be room for as many heights as places");
  State& s = *state_;
  s.note_changes();
  if (!s.heights) s.heights = std::make_unique<SurfaceHeight>(*s.site.soil);
  s.heights->at(xy_m, heights_m);
}

Mesh Session::mesh() const { return mesh_all(*state_->site.soil); }

std::vector<SurfacePatch> Session::changed_patches() {
  State& s = *state_;
  s.note_changes();
  const std::vector<Coord3> chunks(s.unmeshed.begin(), s.unmeshed.end());
  std::vector<SurfacePatch> patches;
  for (const Coord3& block : blocks_touched(chunks)) patches.push_back({block, {}});
  tbb::parallel_for(std::size_t{0}, patches.size(), [&](std::size_t i) {
    patches[i].mesh = mesh_block(*s.site.soil, patches[i].block);
  });
  s.unmeshed.clear();
  return patches;
}

std::vector<Coord3> Session::changed_chunks() {
  State& s = *state_;
  s.note_changes();
  std::vector<Coord3> chunks(s.unmeshed.begin(), s.unmeshed.end());
  s.unmeshed.clear();
  return chunks;
}

std::vector<StepResult> update_many(std::span<Session* const> sessions,
                                    std::span<const MachineState> states) noexcept {
  std::vector<StepResult> results;
  try {
    results.resize(sessions.size());
    const std::set<const Session*> all(sessions.begin(), sessions.end());
    if (sessions.size() != states.size() || all.size() != sessions.size()) {
      const std::string why =
          sessions.size() != states.size()
              ? fmt::format("there are {} states for {} sessions", states.size(), sessions.size())
              : "a session is there twice";
      for (StepResult& result : results) result = refused<StepResult>(Status::kBadState, why);
      return results;
    }
    tbb::parallel_for(std::size_t{0}, sessions.size(), [&](std::size_t i) {
      // Who waits for parts of one session's update begins with no other's.
      tbb::this_task_arena::isolate([&] { results[i] = sessions[i]->update(states[i]); });
    });
  } catch (const std::exception& e) {
    for (StepResult& result : results) result = refused<StepResult>(Status::kFailed, e.what());
  }
  return results;
}

}  // namespace soilvdb::inline v0
