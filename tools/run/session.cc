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
#include "soilvdb/pour_parts.h"
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

/// Up to where pours come down before a machine moves at that time: it goes first.
double before(double time_s) {
  return std::nextafter(time_s, -std::numeric_limits<double>::infinity());
}

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

Session::State::State(std::vector<SessionMachine> machines_, Earthmoving earthmoving_,
                      io::Site site_)
    : machines(std::move(machines_)),
      earthmoving(std::move(earthmoving_)),
      site(std::move(site_)),
      fed(machines.size()) {
  std::set<std::string> names;
  std::vector<Bucket> buckets;
  for (const SessionMachine& machine : machines) {
    if (!names.insert(machine.name).second)
      throw std::invalid_argument(
          fmt::format("machine '{}' is there twice; names must differ", machine.name));
    buckets.push_back(machine.bucket);
  }
  tracker = std::make_unique<Tracker>(*site.soil, std::move(buckets), earthmoving);
}

Session::State::State(const State& other)
    : machines(other.machines),
      earthmoving(other.earthmoving),
      site{other.site.soil->clone(), other.site.reference, other.site.crs_wkt, other.site.bounds,
           other.site.beneath},
      tracker(std::make_unique<Tracker>(*site.soil, *other.tracker)),
      fed(other.fed),
      poured_s(other.poured_s),
      unmeshed(other.unmeshed) {}

std::string Session::State::name(std::size_t machine) const {
  return fmt::format("machine '{}'", machines[machine].name);
}

/// Tells those who look what changed since they did.
void Session::State::note_changes() {
  const std::vector<Coord3> changed = site.soil->take_touched();
  unmeshed.insert(changed.begin(), changed.end());
  if (heights) heights->update(changed);
}

Session::Session(std::unique_ptr<State> state) : state_(std::move(state)) {}

Session::Session(SessionSite site)
    : state_(std::make_unique<State>(std::move(site.machines), std::move(site.earthmoving),
                                     open_checked(site))) {}

Session Session::open(const std::filesystem::path& file) {
  const io::Scenario scenario = io::read_scenario(file);
  std::vector<SessionMachine> machines;
  for (const io::MachineInput& machine : scenario.machines) {
    const std::shared_ptr<const Motion> motion = machine.motion.part(0);
    std::optional<Chain> chain;
    if (!motion->joint_values().empty()) chain = motion->chain();
    machines.push_back({machine.name, machine.bucket, std::move(chain)});
  }
  return Session(std::make_unique<State>(
      std::move(machines), Earthmoving{scenario.soil, scenario.pours, scenario.hoppers},
      io::open_site(scenario)));
}

Session::~Session() = default;
Session::Session(Session&&) noexcept = default;
Session& Session::operator=(Session&&) noexcept = default;

double Session::voxel_size_m() const { return state_->site.soil->voxel_size_m(); }
const Vec3& Session::origin() const { return state_->site.soil->origin(); }
const std::vector<SessionMachine>& Session::machines() const { return state_->machines; }

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
  if (machine >= state_->machines.size())
    throw std::invalid_argument(
        fmt::format("there is no machine {}; there are {}", machine, state_->machines.size()));
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

/// The move to a state: along a motion of two rows, as a run's, where times are known.
/// @param last fed to the machine before, then this
/// @param motions keeps those that moves are along
/// @throw std::invalid_argument
Move Session::State::move(const Session& session, const MachineState& state, Fed& last,
                          std::deque<Motion>& motions) const {
  const double time_s = state.time_s;
  if (std::isinf(time_s))
    throw std::invalid_argument(fmt::format("{}: the time must be finite", name(state.machine)));
  if (time_s < last.time_s)
    throw std::invalid_argument(fmt::format("{}: time goes back from {} s to {} s",
                                            name(state.machine), last.time_s, time_s));
  Fed now{time_s, state.pose, {state.joints.begin(), state.joints.end()}};
  if (!now.joints.empty()) now.pose = session.pose(state.machine, state.joints);
  if (!is_sane(now.pose))
    throw std::invalid_argument(name(state.machine) +
                                ": the pose is no place on this site, or no rotation");
  Move move;
  move.machine = state.machine;
  move.to = now.pose;
  if (time_s > last.time_s) {
    const std::vector<double> times_s = {last.time_s, time_s};
    if (!now.joints.empty() && !last.joints.empty()) {
      std::vector<double> rows = last.joints;
      rows.insert(rows.end(), now.joints.begin(), now.joints.end());
      motions.emplace_back(times_s, std::move(rows), *machines[state.machine].chain);
    } else {
      motions.emplace_back(times_s, std::vector<Pose>{last.pose, now.pose});
    }
    move.motion = &motions.back();
    move.begin_s = last.time_s;
    move.end_s = time_s;
  }
  if (std::isnan(time_s)) now.time_s = last.time_s;
  last = std::move(now);
  return move;
}

/// Pours come down in the order of their parts' times.
void Session::State::pour(double until_s) {
  std::vector<double> times_s;
  for (const Pour& pour : earthmoving.pours) {
    const PourParts parts(pour, site.soil->voxel_size_m());
    for (std::int64_t part = 1; part <= parts.count(); ++part)
      if (const double s = parts.falls_s(part); s > poured_s && s <= until_s) times_s.push_back(s);
  }
  std::sort(times_s.begin(), times_s.end());
  times_s.erase(std::unique(times_s.begin(), times_s.end()), times_s.end());
  for (const double time_s : times_s)
    for (std::size_t i = 0; i < earthmoving.pours.size(); ++i) tracker->pour(i, time_s);
  poured_s = std::max(poured_s, until_s);
}

double Session::State::last_s() const {
  double last_s = std::numeric_limits<double>::quiet_NaN();
  for (const Fed& machine : fed) last_s = std::fmax(last_s, machine.time_s);
  return last_s;
}

/// @throw std::invalid_argument if there is none of that number
void Session::State::require(std::size_t machine) const {
  if (machine < machines.size()) return;
  throw std::invalid_argument(
      fmt::format("there is no machine {}; there are {}", machine, machines.size()));
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

BatchResult Session::update(std::span<const MachineState> states) noexcept {
  State& s = *state_;
  std::size_t at = 0;
  BatchResult result = s.guarded<BatchResult>([&](bool& moving) {
    BatchResult made;
    std::vector<State::Fed> fed = s.fed;
    std::deque<Motion> motions;
    std::vector<Move> moves;
    for (; at < states.size(); ++at) {
      s.require(states[at].machine);
      moves.push_back(s.move(*this, states[at], fed[states[at].machine], motions));
    }
    if (const std::optional<BadMove> bad = s.tracker->find_bad(moves)) {
      at = bad->move;
      made.status = bad->no_ground ? Status::kNoGround : Status::kBadState;
      made.why = s.name(moves[at].machine) + ": " + bad->why;
      return made;
    }
    moving = true;
    if (s.earthmoving.pours.empty()) {
      made.updates = s.tracker->update(moves);
    } else {
      for (std::size_t i = 0; i < moves.size(); ++i) {
        if (!std::isnan(states[i].time_s)) s.pour(before(states[i].time_s));
        made.updates.push_back(s.tracker->update(std::span(moves).subspan(i, 1)).front());
      }
    }
    s.fed = std::move(fed);
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
      if (!std::isnan(state.time_s)) s.pour(before(state.time_s));
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
    s.fed[state.machine] = std::move(fed);
    return made;
  });
}

StepResult Session::update(std::size_t machine, const Motion& motion, double begin_s,
                           double end_s) noexcept {
  State& s = *state_;
  return s.guarded<StepResult>([&](bool& moving) {
    s.require(machine);
    StepResult made;
    const Move move{machine, {}, &motion, begin_s, end_s};
    if (begin_s < s.fed[machine].time_s)
      throw std::invalid_argument(fmt::format("{}: time goes back from {} s to {} s",
                                              s.name(machine), s.fed[machine].time_s, begin_s));
    if (const std::optional<BadMove> bad = s.tracker->find_bad(std::span(&move, 1))) {
      made.status = bad->no_ground ? Status::kNoGround : Status::kBadState;
      made.why = s.name(machine) + ": " + bad->why;
      return made;
    }
    moving = true;
    made.update = s.tracker->update(machine, motion, begin_s, end_s);
    s.fed[machine] = {end_s, motion.pose(end_s), {}};
    return made;
  });
}

StepResult Session::pour(double until_s) noexcept {
  return state_->guarded<StepResult>([&](bool& moving) {
    if (std::isnan(until_s)) throw std::invalid_argument("the time must be a number");
    StepResult made;
    moving = true;
    state_->pour(until_s);
    return made;
  });
}

StepResult Session::come_to_rest() noexcept {
  return state_->guarded<StepResult>([&](bool& moving) {
    StepResult made;
    moving = true;
    made.update = state_->tracker->come_to_rest(state_->last_s());
    return made;
  });
}

const Ledger& Session::ledger(std::size_t machine) const {
  return state_->tracker->ledger(machine);
}
Ledger Session::total() const { return state_->tracker->total(); }
SiteLedger Session::books() const { return state_->tracker->site(); }

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
