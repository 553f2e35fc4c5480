// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/session.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
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
  return io::open_site(site.terrain, site.voxel_size_m, site.near_m);
}

using Kind = io::JournalUpdate::Kind;

constexpr double kNoTime = std::numeric_limits<double>::quiet_NaN();  // in a journal

}  // namespace

Session::Session(std::unique_ptr<State> state) : state_(std::move(state)) {}

Session::Session(SessionSite site) {
  const bool endless = std::holds_alternative<io::PlaneTerrain>(site.terrain);
  const std::vector<Pour>& pours = site.earthmoving.pours;
  if (endless && !site.near_m && !pours.empty() && is_place(pours.front().at_m))
    site.near_m = pours.front().at_m;
  io::Site opened = site.opened ? *std::move(site.opened) : open_checked(site);
  state_ = std::make_unique<State>(
      tools::SiteState({std::move(site.machines), std::move(site.earthmoving)}, std::move(opened)));
  state_->settings.limits = site.limits;
  state_->settings.floats = endless && !site.near_m;
}

Session Session::open(const std::filesystem::path& file, std::optional<double> voxel_size_m) {
  io::Scenario scenario = io::read_scenario(file, {}, io::Motions::kOptional);
  if (voxel_size_m) scenario.voxel_size_m = *voxel_size_m;
  auto state =
      std::make_unique<State>(tools::SiteState(tools::model_of(scenario), io::open_site(scenario)));
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

double Session::voxel_size_m() const { return state_->site.ground->voxel_size_m(); }
const Vec3& Session::origin() const { return state_->site.ground->origin(); }
const std::vector<SiteMachine>& Session::machines() const { return state_->model().machines; }

const Earthmoving& Session::earthmoving() const { return state_->model().earthmoving; }
const io::Site& Session::site() const { return state_->site; }

std::size_t Session::machine(std::string_view name) const { return state_->model().machine(name); }

Pose Session::pose(std::size_t machine, std::span<const double> joints,
                   const std::optional<Pose>& base) const {
  return state_->pose(machine, joints, base);
}

Pose Session::base(std::size_t machine) const { return state_->base(machine); }

std::optional<MachineState> Session::last(std::size_t machine) const {
  return state_->last(machine);
}

void Session::set_limits(bool on) { state_->settings.limits = on; }
bool Session::limits() const { return state_->settings.limits; }

std::string Session::unlikely(const MachineState& state) const {
  if (state.machine >= machines().size()) state_->input(state);  // throws
  std::optional<State::Input> last = state_->inputs_[state.machine];
  return state_->unlikely(state, last);
}

std::vector<std::string> Session::take_warnings() { return std::exchange(state_->warnings, {}); }

/// Makes updates by `work()` if recording is possible, and records them by `record_made(result)`.
template <typename Result, typename Work, typename Record>
Result Session::State::recorded(const Work& work, const Record& record_made) noexcept {
  Result made;
  const bool hauls = recorder && !model().earthmoving.hoppers.empty();
  try {
    require_recording();
    const auto so_far = [&] { return tracker().mass_balance_without_ground().hauled; };
    const std::int64_t before = hauls ? so_far() : 0;
    made = work();
    hauled = hauls ? std::optional(so_far() - before) : std::nullopt;
  } catch (const std::exception& e) {
    made.status = Status::kFailed;
    made.why = e.what();
  }
  if (!made.ok()) return made;
  try {
    record_made(made);
  } catch (const std::exception& e) {
    fail(e.what());
    made.status = Status::kFailed;
    made.why = broken_;
  }
  return made;
}

/// work() on a site whose place is that of its first state, or was before if it is refused.
template <typename Result, typename Work>
Result Session::State::placed(const MachineState& first, const Work& work) {
  const Vec3 before = site.ground->origin();
  Result made;
  try {
    if (settings.floats) float_to(input(first).pose.position);
    made = work();
  } catch (const std::invalid_argument& e) {
    made.status = Status::kBadState;
    made.why = e.what();
  }
  if (!made.ok() && site.ground->origin() != before) float_to(before);
  return made;
}

/// Could the machines have these states, one after another? @param refused why not, and which
bool Session::State::is_likely(std::span<const MachineState> states, BatchResult& refused) const {
  std::map<std::size_t, std::optional<Input>> last;
  for (std::size_t i = 0; i < states.size(); ++i) {
    try {
      const std::size_t machine = states[i].machine;
      if (machine >= inputs_.size()) require(machine);  // throws
      refused.why = unlikely(states[i], last.try_emplace(machine, inputs_[machine]).first->second);
    } catch (const std::invalid_argument& e) {
      refused.why = e.what();
    }
    if (refused.why.empty()) continue;
    refused.status = Status::kBadState;
    refused.bad = i;
    return false;
  }
  return true;
}

/// Records an update. If it must be on disk now but may not be, the result has an error.
template <typename Result>
void Session::State::record(const io::JournalUpdate& update, Result& made) {
  ++fed_count;
  if (!recorder) return;
  if (!recorder->add(update) && settings.recording.sync_s == 0) {
    made.status = Status::kFailed;
    made.why = recording_error(recorder->error());
  }
}

/// @param before the machine's last state @param now the same as `state`
template <typename Result>
void Session::State::record(const MachineState& state, const std::optional<Input>& before,
                            const Input& now, const Update& update, Result& made, Kind kind) {
  if (!recorder) {
    ++fed_count;
    return;
  }
  io::MotionRows rows;
  rows.joints = !state.joints.empty();
  const auto add = [&](double time_s, const Pose& pose, std::span<const double> joints) {
    rows.times_s.push_back(time_s);
    const std::array<double, 7> row = row_of(pose);
    const std::span<const double> values = rows.joints ? joints : row;
    rows.values.insert(rows.values.end(), values.begin(), values.end());
  };
  const double time_s = state.time_s.value_or(kNoTime);
  const double before_s = before ? before->time_s.value_or(kNoTime) : kNoTime;
  const bool on_time = time_s > before_s;
  if (on_time && before->configuration.empty() != rows.joints)
    add(before_s, before->pose, like(*before, now, state.machine));
  add(time_s, state.pose, now.configuration);
  rows.columns = rows.values.size() / rows.times_s.size();
  record({.machine = static_cast<std::uint32_t>(state.machine),
          .begin_s = on_time ? before_s : kNoTime,
          .end_s = time_s,
          .cut_samples = samples(update.cut_m3),
          .bucket_samples = mass(update.bucket_m3),
          .ns = std::llround(1e3 * update.us),
          .rows = std::move(rows),
          .spilled = mass(update.spilled_m3),
          .slid = mass(update.slid_m3),
          .kind = kind,
          .hauled = update.spilled_m3 != 0 || hauled != 0 ? hauled : std::nullopt},
         made);
}

BatchResult Session::update(std::span<const MachineState> states) noexcept {
  State& s = *state_;
  std::vector<std::optional<State::Input>> inputs;  // before each state
  std::vector<State::Way> ways;
  return s.recorded<BatchResult>(
      [&] {
        if (s.recorder) inputs = s.inputs_;
        if (BatchResult refused; s.settings.limits && !s.is_likely(states, refused)) return refused;
        for (std::size_t i = 0; i < s.inputs_.size(); ++i) ways.push_back(s.way(i));
        if (states.empty()) return BatchResult();
        return s.placed<BatchResult>(states.front(),
                                     [&] { return static_cast<Site&>(s).update(states); });
      },
      [&](BatchResult& made) {
        for (std::size_t i = 0; i < ways.size(); ++i) s.look_backwards(i, ways[i]);
        if (states.size() > 1 && s.hauled != 0) s.hauled.reset();
        if (!s.recorder) {
          s.fed_count += states.size();
          return;
        }
        std::optional<double> due_s;  // as in single updates, but the snapshot contains all states
        for (std::size_t i = 0; i < states.size(); ++i) {
          const std::optional<double> time_s = states[i].time_s;
          std::optional<State::Input>& before = inputs[states[i].machine];
          State::Input now = s.input(states[i], before);
          s.record(states[i], before, now, made.updates[i], made);
          if (!time_s && before) now.time_s = before->time_s;
          before = std::move(now);
          if (time_s && s.is_snapshot_due(*time_s))
            due_s = std::max(due_s.value_or(*time_s), *time_s);
        }
        if (due_s) s.write_snapshot(*due_s);
      });
}

StepResult Session::update(const MachineState& state) noexcept {
  State& s = *state_;
  std::optional<State::Input> before;
  State::Way way;
  return s.recorded<StepResult>(
      [&] {
        if (s.recorder && state.machine < s.inputs_.size()) before = s.inputs_[state.machine];
        if (BatchResult refused; s.settings.limits && !s.is_likely({&state, 1}, refused))
          return StepResult{refused.status, std::move(refused.why), {}};
        way = s.way(state.machine);
        return s.placed<StepResult>(state, [&] { return static_cast<Site&>(s).update(state); });
      },
      [&](StepResult& made) {
        s.look_backwards(state.machine, way);
        s.record(state, before, *s.inputs_[state.machine], made.update, made);
        if (state.time_s && s.is_snapshot_due(*state.time_s)) s.write_snapshot(*state.time_s);
      });
}

StepResult Session::place(const MachineState& state) noexcept {
  State& s = *state_;
  return s.recorded<StepResult>(
      [&] {
        return s.placed<StepResult>(state, [&] {
          std::optional<State::Input> anywhere;
          if (std::string why = s.settings.limits ? s.unlikely(state, anywhere) : ""; !why.empty())
            return StepResult{Status::kBadState, std::move(why), {}};
          return static_cast<Site&>(s).place(state);
        });
      },
      [&](StepResult& made) {
        s.backwards[state.machine].way_m = 0;
        s.record(state, std::nullopt, *s.inputs_[state.machine], made.update, made, Kind::kPlace);
        if (state.time_s && s.is_snapshot_due(*state.time_s)) s.write_snapshot(*state.time_s);
      });
}

bool Session::in_air(const MachineState& state) const {
  const Pose at = state_->input(state).pose;
  return state_->tracker().misplaced(state.machine, at).empty();
}

StepResult Session::pour(double until_s) noexcept {
  State& s = *state_;
  return s.recorded<StepResult>([&] { return static_cast<Site&>(s).pour(until_s); },
                                [&](StepResult& made) {
                                  s.record({.end_s = until_s, .kind = Kind::kPours}, made);
                                  if (s.is_snapshot_due(until_s)) s.write_snapshot(until_s);
                                });
}

StepResult Session::reset_clock(std::size_t machine) noexcept {
  State& s = *state_;
  return s.recorded<StepResult>(
      [&] { return static_cast<Site&>(s).reset_clock(machine); },
      [&](StepResult& made) {
        s.record({.machine = static_cast<std::uint32_t>(machine), .kind = Kind::kClock}, made);
      });
}

StepResult Session::come_to_rest() noexcept {
  State& s = *state_;
  return s.recorded<StepResult>(
      [&] { return static_cast<Site&>(s).come_to_rest(); },
      [&](StepResult& made) {
        s.record({.end_s = s.last_s().value_or(kNoTime), .kind = Kind::kRest}, made);
      });
}

StepResult Session::scan(const Sensor& sensor, std::span<const Vec3> points_m) noexcept {
  State& s = *state_;
  StepResult made;
  try {
    if (s.settings.floats && is_place(sensor.pose.position)) s.float_to(sensor.pose.position);
    made = static_cast<Site&>(s).scan(sensor, points_m);
  } catch (const std::exception& e) {
    made = {Status::kFailed, e.what(), {}};
  }
  if (!made.ok()) return made;
  for (const SiteMachine& machine : s.model().machines) {
    if (!machine.chain || !machine.chain->bodies) continue;
    if (std::string warning = machine.chain->bodies->take_warning(); !warning.empty())
      s.warnings.push_back(std::move(warning));
  }
  if (!points_m.empty()) s.look_at_pose(sensor);
  s.settings.floats = false;
  ++s.fed_count;
  return made;
}

StepResult Session::apply_scans(Survey& survey) noexcept {
  State& s = *state_;
  std::string record;
  return s.recorded<StepResult>(
      [&] { return static_cast<Site&>(s).apply_scans(survey, s.recorder ? &record : nullptr); },
      [&](StepResult& made) {
        const std::string doubt = survey.rays.doubt();
        if (!doubt.empty() && !std::exchange(s.warned_of_rays, true))
          s.warnings.push_back("scans: " + doubt);
        if (record.empty()) return;  // no scan came since
        io::JournalUpdate update{.end_s = s.last_s().value_or(kNoTime), .kind = Kind::kSurvey};
        update.survey = io::pack_survey(record);
        s.record(update, made);
      });
}

StepResult Session::survey(const SurveyHeights& heights, SurveyVolumes& volumes) noexcept {
  State& s = *state_;
  std::string record;
  return s.recorded<StepResult>(
      [&] {
        return static_cast<Site&>(s).survey(heights, volumes, s.recorder ? &record : nullptr);
      },
      [&](StepResult& made) {
        s.settings.floats = false;
        io::JournalUpdate update{.end_s = s.last_s().value_or(kNoTime), .kind = Kind::kSurvey};
        if (s.recorder) update.survey = io::pack_survey(record);
        s.record(update, made);
      });
}

void Session::begin_near(const Vec3& at_m) {
  if (state_->settings.floats && is_place(at_m)) state_->float_to(at_m);
}

void Session::sigmas(std::span<const Vec2> xy_m, std::span<double> sigmas_m,
                     std::span<double> seen) {
  state_->sigmas(xy_m, sigmas_m, seen);
}

std::vector<Coord2> Session::seen_squares() const { return state_->seen_squares(); }

const Ledger& Session::ledger(std::size_t machine) const {
  return state_->tracker().ledger(machine);
}
std::optional<Surveyed> Session::surveyed() const {
  const Surveyed& all = state_->tracker().surveyed();
  if (!state_->survey_ && all.removed == 0 && all.added == 0) return {};
  return all;
}
std::vector<Estimate> Session::lip_errors_m() const { return state_->lip_errors_m(); }
Ledger Session::total() const { return state_->tracker().total(); }
MassBalance Session::mass_balance() const { return state_->tracker().mass_balance(); }
MassBalance Session::mass_balance_without_ground() const {
  return state_->tracker().mass_balance_without_ground();
}

double Session::bucket_kg(std::size_t machine) const {
  const Ledger& of = ledger(machine);
  if (!earthmoving().soil) return 0;
  return of.units.kg(of.load, of.sample_m3, *earthmoving().soil);
}

double Session::change_m3() const { return state_->site.ground->change_m3(); }
std::uint64_t Session::ground_hash() const { return state_->site.ground->state_hash(); }
std::uint64_t Session::memory_bytes() const { return state_->site.ground->memory_bytes(); }

HeightMap& Session::height_map() {
  State& s = *state_;
  if (!s.height_map) s.height_map.emplace(*s.site.ground);
  return *s.height_map;
}

LookResult Session::heights(std::span<const Vec2> xy_m, std::span<double> heights_m,
                            std::optional<double> ceiling_m) noexcept {
  return LookResult::of([&] { height_map().at(xy_m, heights_m, ceiling_m).check(); },
                        heights_m.first(std::min(xy_m.size(), heights_m.size())));
}

template <typename T>
LookResult Session::height_map(const MapPlace& place, MapLayer layer, std::span<T> out,
                               std::optional<double> ceiling_m,
                               const InitialTerrain* design) noexcept {
  const auto look = [&] {
    const auto* const around = std::get_if<MapAround>(&place);
    const MapGrid grid = around != nullptr ? map_around(*around) : std::get<MapGrid>(place);
    state_->reach(grid);
    height_map().map(grid, layer, out, ceiling_m, design).check();
  };
  return LookResult::of(look, out);
}
template LookResult Session::height_map(const MapPlace&, MapLayer, std::span<float>,
                                        std::optional<double>, const InitialTerrain*) noexcept;
template LookResult Session::height_map(const MapPlace&, MapLayer, std::span<double>,
                                        std::optional<double>, const InitialTerrain*) noexcept;

LookResult Session::cast(std::span<const Vec3> origins_m, std::span<const Vec3> directions,
                         std::span<double> ranges_m) noexcept {
  return LookResult::of([&] { height_map().cast(origins_m, directions, ranges_m).check(); },
                        ranges_m);
}

LookResult Session::prepare_looks(const Eigen::AlignedBox2d& area_m) noexcept {
  return LookResult::of([&] { height_map().prepare(area_m).check(); });
}

MapGrid Session::map_around(const MapAround& around) const {
  const std::optional<MachineState> last = this->last(around.machine);
  if (!last)
    throw std::invalid_argument("machine '" + machines()[around.machine].name +
                                "' has no place before its first state, by update() or place()");
  return MapGrid::around(last->pose.position.head<2>(), around.cell_m, around.nx, around.ny,
                         around.turned ? &last->pose : nullptr);
}

template <typename T>
LookResult height_maps(std::span<Session* const> sessions, std::span<const MapPlace> places,
                       MapLayer layer, std::span<T> out, std::optional<double> ceiling_m,
                       const InitialTerrain* design) noexcept {
  std::size_t worst = sessions.size();  // the first with a fault
  LookResult fault;
  const auto look = [&] {
    const std::size_t count = sessions.size();
    if (places.size() != count && places.size() != 1)
      throw std::invalid_argument("there must be a place for each session, or one for all");
    if (std::set<const Session*>(sessions.begin(), sessions.end()).size() != count)
      throw std::invalid_argument("a session is there twice");
    const std::size_t cells = count > 0 ? out.size() / count : 0;
    if (out.size() != cells * count)
      throw std::invalid_argument("there must be room for as many cells for each session");
    std::mutex lock;
    tbb::parallel_for(std::size_t{0}, count, [&](std::size_t i) {
      Session& session = *sessions[i];
      const MapPlace& place = places[places.size() == 1 ? 0 : i];
      const std::span<T> map = out.subspan(i * cells, cells);
      const auto* const around = std::get_if<MapAround>(&place);
      LookResult made;
      if (around != nullptr && around->machine < session.machines().size() &&
          !session.last(around->machine)) {
        // It has no place, but all else must be right.
        const MapGrid one{session.origin().head<2>(), around->cell_m, 1, 1};
        made = session.height_map(one, layer, map.first(std::min<std::size_t>(1, cells)), ceiling_m,
                                  design);
        std::fill(map.begin(), map.end(), std::numeric_limits<T>::quiet_NaN());
      } else {
        made = session.height_map(place, layer, map, ceiling_m, design);
      }
      if (made.ok()) return;
      const std::lock_guard guard(lock);
      if (i > worst) return;
      worst = i;
      fault = std::move(made);
    });
  };
  LookResult all = LookResult::of(look, out);
  if (!all.ok() || fault.ok()) return all;
  // The other maps are as they should be.
  all = LookResult::of([&] { fault.why = fmt::format("site {}: {}", worst, fault.why); });
  if (!all.ok()) return all;
  return fault;
}
template LookResult height_maps(std::span<Session* const>, std::span<const MapPlace>, MapLayer,
                                std::span<float>, std::optional<double>,
                                const InitialTerrain*) noexcept;
template LookResult height_maps(std::span<Session* const>, std::span<const MapPlace>, MapLayer,
                                std::span<double>, std::optional<double>,
                                const InitialTerrain*) noexcept;

Vec3 Session::direction(std::size_t machine) const { return state_->direction(machine); }

CutGeometry Session::cut_geometry(std::size_t machine) {
  return state_->cut_geometry(machine, height_map());
}

Resistance Session::resistance(std::size_t machine, const SoilStrength* soil, bool crescents) {
  if (soil == nullptr && !earthmoving().soil)
    throw std::invalid_argument("soil is rigid here; give the soil whose resistance is asked for");
  const SoilStrength strength = soil ? *soil : SoilStrength::of(*earthmoving().soil);
  state_->cut_geometry(machine, height_map(), state_->cut);
  return state_->cut.resistance(strength, crescents);
}

std::vector<double> Session::joint_loads(std::size_t machine, const Wrench& wrench) const {
  state_->require(machine);
  const std::optional<State::Input>& last = state_->inputs_[machine];
  const SiteMachine& of = machines()[machine];
  if (!last || last->configuration.empty())
    throw std::invalid_argument("machine '" + of.name + "' has no state that was given by joints");
  return of.chain->joint_loads(last->configuration, wrench.force, wrench.moment);
}

bool Session::has_machines_of(const Session& other) const {
  if (&state_->model() == &other.state_->model()) return true;
  const auto machines = [](const Session& session) {
    return session.state_->description(/*with_ground=*/false)["machines"];
  };
  return machines(*this) == machines(other);
}

BoundaryVolume Session::volume(const std::vector<Vec2>& boundary, const InitialTerrain* design,
                               bool with_sigma) {
  const io::Site& site = state_->site;
  BoundaryVolume volume = volume_inside(
      site, *io::undug_site(site).ground, boundary,
      [this](std::span<const Vec2> xy_m, std::span<double> z) { heights(xy_m, z).check(); },
      design);
  if (with_sigma) volume.sigma_m3 = state_->volume_sigma_m3(boundary);
  return volume;
}

Estimate Session::cut_m3(std::size_t machine) { return state_->cut_m3(machine); }

Heap Session::heap(const std::vector<Vec2>& boundary) { return state_->heap(boundary); }

void Session::mesh_heights(std::span<const Vec2> xy_m, std::span<double> heights_m) {
  if (heights_m.size() < xy_m.size())
    throw std::invalid_argument("there must be room for as many heights as places");
  State& s = *state_;
  if (!s.mesh_heights) s.mesh_heights.emplace(*s.site.ground);
  s.mesh_heights->surface.update(s.mesh_heights->changes.take());
  s.mesh_heights->surface.at(xy_m, heights_m);
}

Mesh Session::mesh() const { return mesh_all(*state_->site.ground); }

std::vector<SurfacePatch> Session::changed_patches() {
  State& s = *state_;
  std::vector<SurfacePatch> patches;
  for (const Coord3& block : blocks_touched(s.patches.take())) patches.push_back({block, {}});
  try {
    tbb::parallel_for(std::size_t{0}, patches.size(), [&](std::size_t i) {
      patches[i].mesh = mesh_block(*s.site.ground, patches[i].block);
    });
  } catch (...) {
    s.patches = ChangeFollower(*s.site.ground);  // reports all patches again
    throw;
  }
  return patches;
}

std::vector<Coord3> Session::changed_chunks() { return state_->chunks.take(); }

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
      for (StepResult& result : results) result = {Status::kBadState, why, {}};
      return results;
    }
    tbb::parallel_for(std::size_t{0}, sessions.size(), [&](std::size_t i) {
      // Keeps a waiting thread from starting another session's update inside this one.
      tbb::this_task_arena::isolate([&] { results[i] = sessions[i]->update(states[i]); });
    });
  } catch (const std::exception& e) {
    for (StepResult& result : results) result = {Status::kFailed, e.what(), {}};
  }
  return results;
}

}  // namespace soilvdb::inline v0
