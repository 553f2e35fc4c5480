// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/live_site.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "io/file/json.h"
#include "soilvdb/tool_shape.h"
#include "tools/run/run_folder.h"
#include "tools/serve/line_values.h"

namespace soilvdb::tools {
namespace {

using Json = nlohmann::ordered_json;

std::string line_of(const Json& json) { return io::to_text(json); }

/// @throw std::invalid_argument
std::optional<std::uint64_t> sequence_of(const nlohmann::json& json) {
  if (!json.contains("sequence")) return {};
  constexpr std::uint64_t kMostExact = std::uint64_t{1} << 53;  // many programs count in doubles
  const nlohmann::json& number = json["sequence"];
  if (!number.is_number_unsigned() || number.get<std::uint64_t>() > kMostExact)
    throw std::invalid_argument("'sequence' must be a whole number from 0 on");
  return number.get<std::uint64_t>();
}

}  // namespace

LiveSite::LiveSite(Session session, std::string name)
    : session_(std::move(session)),
      name_(std::move(name)),
      fed_(session_),
      before_{session_.change_m3(), session_.mass_balance().ground} {
  follow_machines();
}

LiveSite::LiveSite(Session session, std::string name, WorkLog log, const ChangeBefore& before)
    : LiveSite(std::move(session), std::move(name)) {
  fed_.log = std::move(log);
  before_ = before;
}

void FedStates::note_time(std::optional<double> time_s) {
  if (time_s)
    latest_s = std::max(latest_s, time_s);
  else
    is_untimed = true;
}

void FedStates::add(const io::JournalUpdate& update) {
  ++count;
  log.add(update);
  places.add(update);
  if (!update.has_rows()) return;
  note_time(std::isnan(update.end_s) ? std::nullopt : std::optional(update.end_s));
  const bool digs = update.kind == io::JournalUpdate::Kind::kMove;
  dug[update.machine] = digs;
  if (digs) durations.add(static_cast<double>(update.ns) * 1e-3);
}

void LiveSite::record(const Recording& recording,
                      const std::function<void(const io::JournalExtent&)>& progress) {
  session_.record(recording, progress);
  recorded_ = true;
  hauled_ = session_.mass_balance_without_ground().hauled;
  fed_ = FedStates(session_);
  follow_machines();
  // The journal contains the loads, so cycles can be counted again.
  io::JournalReader reader(recording.folder / kJournalName);
  while (std::optional<io::JournalRecord> record = reader.next())
    if (const auto* fed = std::get_if<io::JournalUpdate>(&*record)) fed_.add(*fed);
  for (const auto& [machine, digs] : fed_.dug) feeds_[machine].dug_before = digs;
}

void LiveSite::undo(std::size_t machine, Undone& undone, FedStates fed) {
  session_.undo(undone);
  hauled_ = session_.mass_balance_without_ground().hauled;
  fed_ = std::move(fed);
  ++changes_of_past_;
  ++undos_;
  moved_[machine] = {};
  feeds_[machine].driven_to.reset();
  feeds_[machine].sequence = {};  // what was taken back may be sent again, corrected
  feeds_[machine].dug_before = true;
  for (const auto& [of, digs] : fed_.dug) feeds_[of].dug_before = digs;
  doubted_s_.assign(doubted_s_.size(), {});
}

StepResult LiveSite::feed(const MachineState& state) {
  const std::uint64_t before = session_.changes();
  return taken(state, session_.update(state), before);
}

void LiveSite::require_made(const StepResult& step, std::uint64_t before) {
  if (step.ok()) return;
  if (session_.changes() == before) throw std::runtime_error(step.why);
  not_on_disk_ = "it is taken, but not on disk yet: " + step.why;
}

void LiveSite::require_on_disk() const {
  if (!not_on_disk_.empty()) throw std::runtime_error(not_on_disk_);
}

StepResult LiveSite::taken(const MachineState& state, StepResult step, std::uint64_t before) {
  if (session_.changes() == before) return step;
  ++fed_.count;
  feeds_[state.machine].driven_to.reset();
  fed_.note_time(state.time_s);
  changes_of_past_ += fed_.log.machines()[state.machine].clock_is_set && state.time_s;
  fed_.durations.add(step.update.us);
  WorkLog::Place at{configuration_of(*session_.last(state.machine)), !state.joints.empty()};
  if (!at.joints) {
    const auto row = row_of(state.pose);
    at.numbers.assign(row.begin(), row.end());
  }
  fed_.places.add(state.machine, state.time_s, at);
  const Ledger& now = session_.ledger(state.machine);
  const std::int64_t hauled = session_.mass_balance_without_ground().hauled;
  if (fed_.log.add(state.machine, state.time_s, std::move(at),
                   {std::llround(step.update.cut_m3 / now.sample_m3), now.load,
                    std::llround(step.update.spilled_m3 / now.sample_m3 *
                                 static_cast<double>(now.units.loose)),
                    hauled - std::exchange(hauled_, hauled)}))
    moved_[state.machine] = Clock::now();
  if (after_state_) after_state_(state.machine);
  return step;
}

Json LiveSite::answer_to(const StepResult& step, std::size_t machine) {
  Json answer = {{"cut_m3", step.update.cut_m3}, {"bucket_m3", step.update.bucket_m3}};
  if (session_.earthmoving().soil) {
    answer["bucket_kg"] = session_.bucket_kg(machine);
    answer["spilled_m3"] = step.update.spilled_m3;
    answer["slid_m3"] = step.update.slid_m3;
  }
  return answer;
}

Json LiveSite::dig(const nlohmann::json& json, const MachineState& state) {
  const bool wants_force = asks_for_force(json, state.machine);
  if (const std::string why = session_.unlikely(state); !why.empty())
    throw std::invalid_argument(why);
  require_soon(state);
  const auto last = session_.last(state.machine);
  const std::uint64_t before = session_.changes();
  const StepResult step = feed(state);
  if (last && last->time_s && state.time_s && *state.time_s < *last->time_s && !step.ok() &&
      session_.changes() == before)
    throw std::invalid_argument(step.why + "; if its clock was ahead and is right now, " +
                                how_to_set_clock(state.machine));
  require_made(step, before);
  Json answer = answer_to(step, state.machine);
  if (wants_force) {
    const Resistance resistance = session_.resistance(state.machine);
    const Wrench all = resistance.total();
    answer["force_n"] = io::numbers(all.force);
    answer["moment_nm"] = io::numbers(all.moment);
    answer["limited"] = resistance.limited();
  }
  return answer;
}

/// A bucket in the ground stays where it was last: there is no way on which it did not dig.
Json LiveSite::place(const MachineState& state) {
  require_soon(state);
  const bool in_air = session_.in_air(state);
  StepResult step;
  step.update.bucket_m3 = session_.ledger(state.machine).bucket_m3();
  if (in_air) {
    const std::uint64_t before = session_.changes();
    step = taken(state, session_.place(state), before);
    require_made(step, before);
  } else if (state.base) {
    feeds_[state.machine].driven_to = state.base;
  }
  Json answer = answer_to(step, state.machine);
  answer["placed"] = in_air;
  return answer;
}

std::string LiveSite::feed(std::string_view line, const std::shared_ptr<const FeedSource>& source) {
  std::optional<std::uint64_t> number;
  std::size_t machine = 0, content = 0;
  std::uint64_t missed = 0;
  not_on_disk_.clear();
  const auto numbered = [&](Json& answer) {
    if (number) answer["sequence"] = *number;
    if (missed > 0) answer["missed"] = missed;
  };
  try {
    const nlohmann::json json = object_of(line);
    if (json.contains("clock")) {
      reset_clock(json);
      require_on_disk();
      return line_of({{"machine", json["machine"].get<std::string>()}, {"clock", "reset"}});
    }
    std::vector<double> joints;
    const MachineState state = parse(json, joints);
    machine = state.machine;
    MachineFeed& of = feeds_[machine];
    of.require_owner(source.get(), session_.machines()[machine].name);
    of.heard = MachineFeed::Clock::now();
    of.clock_ahead_s = clock_ahead_s(state);
    if (const auto given = sequence_of(json)) {
      content = std::hash<nlohmann::json>()(json);
      const SequenceCheck::Place place = of.sequence.check(*given, content);
      if (!place.answer_given.empty()) {
        if (source) of.source = source;  // after its link broke off it goes on by this one
        if (const std::string why = session_.recording_fault(); !why.empty())
          throw std::runtime_error(why);  // it may not be on disk
        return place.answer_given;
      }
      number = given;
      missed = place.missed;
    }
    const Fix fix = line_fix(json);
    const bool digs = fix == Fix::kFixed && (of.dug_before || !session_.in_air(state));
    Json answer = digs ? dig(json, state) : place(state);
    of.dug_before = fix == Fix::kFixed;
    of.fix = json.contains("fix") ? std::optional(fix) : std::nullopt;
    if (source) of.source = source;
    const io::JournalExtent done = session_.acknowledged();
    answer["acknowledged_s"] = done.updates > 0 ? Json(done.time_s) : Json();
    numbered(answer);
    if (number) {
      Json again = answer;
      again["repeated"] = true;
      of.sequence.taken(*number, content, line_of(again));
    }
    require_on_disk();
    for (const std::string& warning : session_.take_warnings()) answer["warning"] = warning;
    return line_of(answer);
  } catch (const std::exception& e) {
    Json answer = {{"error", e.what()}};
    numbered(answer);
    if (number) feeds_[machine].sequence.refused(*number);
    return line_of(answer);
  }
}

Json LiveSite::feeds() const {
  Json all = Json::array();
  const auto or_null = [](const auto& value) { return value ? Json(*value) : Json(); };
  for (std::size_t i = 0; i < feeds_.size(); ++i) {
    if (session_.is_retired(i)) continue;
    const MachineFeed& feed = feeds_[i];
    const std::string& name = session_.machines()[i].name;
    const bool owned = feed.source && feed.source->link == FeedSource::Link::kLive;
    Json one = {{"name", name},
                {"link", feed.link()},
                {"owner", owned ? Json(feed.source->name) : Json()},
                {"heard_s_ago", or_null(feed.silent_s())},
                {"sequence", or_null(feed.sequence.last())},
                {"fix", feed.fix ? Json(word_of(*feed.fix)) : Json()},
                {"time_s", nullptr},
                {"state", nullptr},
                {"bucket_m3", session_.ledger(i).bucket_m3()}};
    if (const std::optional<MachineState> last = session_.last(i)) {
      one["time_s"] = or_null(last->time_s);
      Json state = {{"machine", name}};
      if (last->time_s) state["time"] = *last->time_s;
      if (last->joints.empty()) {
        state["position"] = io::numbers(last->pose.position);
        state["rotation"] = io::numbers(last->pose.rotation.coeffs());
      }
      for (std::size_t j = 0; j < last->joints.size(); ++j)
        state["joints"][joints_[i][j]] = last->joints[j];
      if (last->base)
        state["base"] = {{"position", io::numbers(last->base->position)},
                         {"rotation", io::numbers(last->base->rotation.coeffs())}};
      one["state"] = std::move(state);
    }
    all.push_back(std::move(one));
  }
  const io::JournalExtent done = session_.acknowledged();
  return {{"machines", all}, {"acknowledged_s", done.updates > 0 ? Json(done.time_s) : Json()}};
}

/// A live machine works if it moved in recent real time; others, if they moved before the log's
/// end.
Json LiveSite::state() const {
  std::vector<bool> works;
  const bool fed = recorded_ || fed_.count > 0;
  for (std::size_t i = 0; i < moved_.size(); ++i)
    works.push_back(fed ? Clock::now() - moved_[i] < std::chrono::duration<double>(kIdleAfter_s)
                        : fed_.log.works(i));
  Json json = site_state(session_, fed_.log, works);
  const io::JournalExtent done = session_.acknowledged();
  json["acknowledged_s"] = done.updates > 0 ? Json(done.time_s) : Json();
  for (std::size_t i = 0, shown = 0; i < feeds_.size(); ++i) {
    if (session_.is_retired(i)) continue;
    Json& machine = json["machines"][shown++];
    const std::optional<double> silent_s = feeds_[i].silent_s();
    machine["link"] = feeds_[i].link();
    machine["heard_s_ago"] = silent_s ? Json(*silent_s) : Json();
    machine["fix"] = feeds_[i].fix ? Json(word_of(*feeds_[i].fix)) : Json();
  }
  Json scans = Json::array();
  for (const auto& [sensor, of] : scans_)
    scans.push_back(
        {{"sensor", sensor},
         {"time_s", of.time_s ? Json(*of.time_s) : Json()},
         {"heard_s_ago", std::chrono::duration<double>(Clock::now() - of.heard).count()},
         {"count", of.count}});
  json["scans"] = std::move(scans);
  return json;
}

Json LiveSite::description() const {
  const Ground& ground = *session_.site().ground;
  Json machines = Json::array();
  for (std::size_t i = 0; i < moved_.size(); ++i) {
    if (session_.is_retired(i)) continue;
    const SiteMachine& machine = session_.machines()[i];
    const double capacity_m3 = fed_.log.machines()[i].capacity_m3;
    Bucket drawn = machine.bucket;
    if (drawn.shape) {  // drawn as its bounding box
      const Vec3 low = drawn.shape->box_m().min(), high = drawn.shape->box_m().max();
      drawn.width_m = high.y() - low.y();
      drawn.height_m = high.z() - low.z();
      drawn.profile = {
          {low.x(), low.z()}, {high.x(), low.z()}, {high.x(), high.z()}, {low.x(), high.z()}};
    }
    Json one = {{"name", machine.name},
                {"width_m", drawn.width_m},
                {"height_m", drawn.height_m},
                {"capacity_m3", capacity_m3 > 0 ? Json(capacity_m3) : Json()}};
    for (const Vec2& point : drawn.profile) one["profile"].push_back(io::numbers(point));
    machines.push_back(std::move(one));
  }
  Json all = {{"type", "site"},
              {"name", name_},
              {"voxel_size_m", ground.voxel_size_m()},
              {"origin", io::numbers(ground.origin())},
              {"block_side", kBlockSide},
              {"machines", machines},
              {"soil", nullptr}};
  if (const auto& moves = session_.earthmoving().soil)
    all["soil"] = {{"repose_angle", moves->repose_rad},
                   {"swell", moves->swell},
                   {"density", moves->density_kg_m3}};
  return all;
}

io::Summary LiveSite::summary() const {
  io::Summary summary;
  summary.scenario = name_;
  summary.updates = fed_.durations;
  const io::JournalExtent done = session_.acknowledged();
  summary.acknowledged_s = done.time_s;
  summary.acknowledged_updates = done.updates;
  summary.total_s = std::chrono::duration<double>(Clock::now() - begin_).count();
  return summary;
}

RunTotals LiveSite::totals(const Session& ground) const {
  RunTotals totals{*ground.site().ground,
                   ground.earthmoving().soil,
                   ground.total(),
                   ground.mass_balance(),
                   {},
                   before_.change_m3,
                   before_.mass,
                   ground.surveyed()};
  const std::vector<Estimate> lips_m = ground.lip_errors_m();
  for (std::size_t i = 0; i < ground.machines().size(); ++i)
    totals.machines.push_back({ground.machines()[i].name, ground.machines()[i].bucket,
                               ground.ledger(i), 0,
                               i < lips_m.size() ? std::optional(lips_m[i]) : std::nullopt});
  return totals;
}

}  // namespace soilvdb::tools
