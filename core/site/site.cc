// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/site.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iterator>
#include <limits>
#include <set>
#include <stdexcept>
#include <utility>

#include "core/constants.h"
#include "core/lattice/bytes.h"
#include "core/lattice/text.h"
#include "core/site/guarded.h"
#include "soilvdb/pour_parts.h"

namespace soilvdb::inline v0 {
namespace {

constexpr double kUnknown_s = std::numeric_limits<double>::quiet_NaN();  // in progress()
constexpr double kForever = std::numeric_limits<double>::infinity();

std::string listed(const std::vector<std::string>& names) {
  std::string all;
  for (const std::string& name : names) all += (all.empty() ? "" : ", ") + name;
  return all;
}

/// Without an exponent, where a time can be.
std::string time_text(double time_s) {
  constexpr double kLongest = 1e15;
  char buffer[64];
  if (std::abs(time_s) > kLongest) return text(time_s);
  return {buffer, std::to_chars(buffer, std::end(buffer), time_s, std::chars_format::fixed).ptr};
}

GroundScans::Work work_of(const Update& update) {
  return update.cut_m3 > 0 ? GroundScans::Work::kCut : GroundScans::Work::kOther;
}

std::vector<Bucket> buckets_of(const SiteModel& model) {
  std::set<std::string> names;
  std::vector<Bucket> buckets;
  for (const SiteMachine& machine : model.machines) {
    if (!names.insert(machine.name).second)
      throw std::invalid_argument("machine '" + machine.name +
                                  "' is there twice; names must differ");
    buckets.push_back(machine.bucket);
  }
  return buckets;
}

}  // namespace

std::size_t SiteModel::machine(std::string_view name) const {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < machines.size(); ++i) {
    if (machines[i].name == name) return i;
    names.push_back(machines[i].name);
  }
  throw std::invalid_argument("there is no machine '" + std::string(name) +
                              "'; there are: " + (names.empty() ? "none" : listed(names)));
}

Site::Site(std::shared_ptr<Ground> ground, SiteModel model)
    : ground_(std::move(ground)),
      model_(std::make_shared<SiteModel>(std::move(model))),
      tracker_(std::make_unique<Tracker>(*ground_, buckets_of(*model_), model_->earthmoving)),
      inputs_(model_->machines.size()) {}

Site::Site(const Site& other)
    : ground_(other.ground_->clone()),
      model_(other.model_),
      tracker_(std::make_unique<Tracker>(*ground_, *other.tracker_)),
      inputs_(other.inputs_),
      at_rest_(other.at_rest_),
      broken_(other.broken_),
      surveyed_(std::make_shared<SurveyedHeights>(*other.surveyed_)),
      survey_(other.survey_ ? std::make_unique<GroundScans>(*ground_, *other.survey_, surveyed_)
                            : nullptr),
      poured_s_(other.poured_s_),
      next_pour_s_(other.next_pour_s_) {}

std::string Site::name(std::size_t machine) const {
  return "machine '" + model_->machines[machine].name + "'";
}

void Site::require(std::size_t machine) const {
  const std::size_t count = model_->machines.size();
  if (machine < count) return;
  throw std::invalid_argument("there is no machine " + std::to_string(machine) + "; there are " +
                              std::to_string(count) + ", numbered from 0");
}

std::vector<double> configuration_of(const MachineState& state) {
  std::vector<double> values(state.joints.begin(), state.joints.end());
  if (state.base) Chain::add_base(values, *state.base);
  return values;
}

const Chain& Site::chain(std::size_t machine) const {
  const std::optional<Chain>& chain = model_->machines[machine].chain;
  if (!chain) throw std::invalid_argument(name(machine) + " has no joints; give it a pose");
  return *chain;
}

std::vector<double> Site::configuration(std::size_t machine, std::span<const double> joints,
                                        const std::optional<Pose>& base,
                                        const std::optional<Input>& before) const {
  const std::vector<std::string> names = chain(machine).movable();
  if (joints.size() != names.size())
    throw std::invalid_argument(name(machine) + " has " + std::to_string(names.size()) +
                                " joints, not " + std::to_string(joints.size()) + ": " +
                                listed(names));
  for (std::size_t i = 0; i < joints.size(); ++i)
    if (!std::isfinite(joints[i]))
      throw std::invalid_argument(name(machine) + ": joint '" + names[i] + "' is " +
                                  text(joints[i]) + "; it must be finite");
  if (base)
    if (const std::string what = validation_error(*base); !what.empty())
      throw std::invalid_argument(name(machine) + ": base: " + what);
  std::vector<double> made = configuration_of({.joints = joints, .base = base});
  if (!base && before && before->configuration.size() > names.size())
    made.insert(made.end(), before->configuration.end() - kPoseNumbers,
                before->configuration.end());
  return made;
}

Pose Site::pose(std::size_t machine, std::span<const double> joints,
                const std::optional<Pose>& base) const {
  require(machine);
  return chain(machine).world_from_bucket(configuration(machine, joints, base, inputs_[machine]));
}

Pose Site::base(std::size_t machine) const {
  require(machine);
  const std::optional<Input>& last = inputs_[machine];
  const Chain& of = chain(machine);
  return last && !last->configuration.empty() ? of.base_of(last->configuration)
                                              : of.world_from_root;
}

std::optional<MachineState> Site::last(std::size_t machine) const {
  require(machine);
  const std::optional<Input>& last = inputs_[machine];
  if (!last) return {};
  MachineState state{machine, last->time_s, last->pose, last->configuration};
  if (state.joints.empty()) return state;
  const std::size_t count = chain(machine).movable_count();
  if (state.joints.size() > count) state.base = pose_of(&state.joints[count]);
  state.joints = state.joints.first(count);
  return state;
}

Vec3 Site::direction(std::size_t machine) const {
  require(machine);
  return inputs_[machine] ? inputs_[machine]->direction : Vec3::Zero();
}

void Site::set_direction(Input& now, const std::optional<Input>& last) const {
  now.direction = last ? last->direction : Vec3::Zero();
  now.moved_from = last ? last->moved_from : now.pose.position;
  const Vec3 moved = now.pose.position - now.moved_from;
  if (moved.norm() < kLeastWay * ground_->voxel_size_m()) return;
  now.direction = moved.normalized();
  now.moved_from = now.pose.position;
}

void Site::cut_geometry(std::size_t machine, HeightMap& map, CutGeometry& out) const {
  require(machine);
  const std::optional<Input>& last = inputs_[machine];
  if (!last) throw std::invalid_argument(name(machine) + " meets no soil before its first state");
  out.read(map, *ground_, model_->machines[machine].bucket, last->pose, last->direction,
           tracker_->ledger(machine).bank_m3(),
           model_->earthmoving.soil ? model_->earthmoving.soil->swell : 0);
}

CutGeometry Site::cut_geometry(std::size_t machine, HeightMap& map) const {
  CutGeometry made;
  cut_geometry(machine, map, made);
  return made;
}

std::optional<double> Site::last_s() const {
  std::optional<double> last_s;
  for (const std::optional<Input>& input : inputs_)
    if (input && input->time_s) last_s = std::max(last_s.value_or(-kForever), *input->time_s);
  return last_s;
}

void Site::require_order(std::size_t machine, const std::optional<Input>& last,
                         std::optional<double> time_s) const {
  if (time_s && last && last->time_s && *time_s < *last->time_s)
    throw std::invalid_argument(name(machine) + ": time goes back from " +
                                time_text(*last->time_s) + " s to " + time_text(*time_s) + " s");
}

Site::Input Site::input(const MachineState& state) const {
  require(state.machine);
  return input(state, inputs_[state.machine]);
}

Site::Input Site::input(const MachineState& state, const std::optional<Input>& before) const {
  require(state.machine);
  if (state.time_s && !std::isfinite(*state.time_s))
    throw std::invalid_argument(name(state.machine) + ": the time must be finite");
  Input now{state.time_s, state.pose};
  if (!state.joints.empty()) {
    now.configuration = configuration(state.machine, state.joints, state.base, before);
    now.pose = chain(state.machine).world_from_bucket(now.configuration);
  } else if (state.base) {
    throw std::invalid_argument(name(state.machine) +
                                ": a base goes with joints; a pose is that of the bucket");
  }
  if (const std::string what = validation_error(now.pose); !what.empty())
    throw std::invalid_argument(name(state.machine) + ": " + what);
  return now;
}

std::vector<double> Site::like(const Input& input, const Input& other, std::size_t machine) const {
  std::vector<double> made = input.configuration;
  if (!made.empty() && made.size() < other.configuration.size())
    Chain::add_base(made, chain(machine).world_from_root);
  return made;
}

/// The move to a state: along a motion of two rows, as in a run, if both times are known.
/// @param last the machine's last state; becomes this one
/// @param motions owns the motions of moves
Move Site::move(const MachineState& state, std::optional<Input>& last,
                std::deque<Motion>& motions) const {
  Input now = input(state, last);
  const std::optional<double> before_s = last ? last->time_s : std::nullopt;
  require_order(state.machine, last, now.time_s);
  Move move;
  move.machine = state.machine;
  move.to = now.pose;
  if (now.time_s && before_s && *now.time_s > *before_s) {
    const std::vector<double> times_s = {*before_s, *now.time_s};
    if (!now.configuration.empty() && !last->configuration.empty()) {
      std::vector<double> rows = like(*last, now, state.machine);
      rows.insert(rows.end(), now.configuration.begin(), now.configuration.end());
      motions.emplace_back(times_s, std::move(rows), *model_->machines[state.machine].chain);
    } else {
      motions.emplace_back(times_s, std::vector<Pose>{last->pose, now.pose});
    }
    move.motion = &motions.back();
    move.begin_s = *before_s;
    move.end_s = *now.time_s;
  }
  if (!now.time_s) now.time_s = before_s;
  set_direction(now, last);
  last = std::move(now);
  return move;
}

void Site::fail(const std::string& why) noexcept {
  try {
    broken_ = why + "; the ground is unusable, restore a state";
  } catch (...) {
    broken_ = "no memory";  // short enough to need none
  }
}

BatchResult Site::update(std::span<const MachineState> states) noexcept {
  std::size_t at = 0;
  BatchResult result = guarded<BatchResult>([&](bool& moving) {
    BatchResult made;
    std::vector<std::optional<Input>> inputs = inputs_;
    std::deque<Motion> motions;
    std::vector<Move> moves;
    for (; at < states.size(); ++at) {
      require(states[at].machine);
      moves.push_back(move(states[at], inputs[states[at].machine], motions));
    }
    if (const std::optional<InvalidMove> invalid = tracker_->first_invalid(moves)) {
      at = invalid->move;
      made.status = invalid->no_ground ? Status::kNoGround : Status::kBadState;
      made.why = name(moves[at].machine) + ": " + invalid->why;
      return made;
    }
    ground_->evict();
    moving = true;
    for (std::size_t i = 0, end; i < moves.size(); i = end) {
      pour_before(states[i].time_s);
      for (end = i + 1; end < moves.size() && !pours_before(states[end].time_s);) ++end;
      const std::vector<Update> part = make(std::span(moves).subspan(i, end - i));
      made.updates.insert(made.updates.end(), part.begin(), part.end());
    }
    inputs_ = std::move(inputs);
    return made;
  });
  result.bad = result.ok() ? 0 : at;
  return result;
}

StepResult Site::update(const MachineState& state) noexcept {
  return guarded<StepResult>([&](bool& moving) {
    require(state.machine);
    std::optional<Input> last = inputs_[state.machine];
    std::deque<Motion> motions;
    const Move next = move(state, last, motions);
    ground_->evict();
    StepResult made;
    // sweep() refuses a stroke of rigid soil before it digs; other strokes are checked here.
    const SiteModel& m = *model_;
    const bool one_stroke = !m.earthmoving.soil && !m.machines[state.machine].bucket.dump_angle_rad;
    if (!one_stroke) {
      if (const std::optional<InvalidMove> invalid = tracker_->first_invalid(std::span(&next, 1))) {
        made.status = invalid->no_ground ? Status::kNoGround : Status::kBadState;
        made.why = name(state.machine) + ": " + invalid->why;
        return made;
      }
      moving = true;
      pour_before(state.time_s);
    }
    try {
      made.update = next.motion != nullptr
                        ? tracker_->update(next.machine, *next.motion, next.begin_s, next.end_s)
                        : tracker_->update(next.machine, next.to);
    } catch (const NoGroundError& e) {
      throw NoGroundError(name(state.machine) + ": " + e.what());
    } catch (const std::invalid_argument& e) {
      throw std::invalid_argument(name(state.machine) + ": " + e.what());
    } catch (...) {
      moving = true;
      throw;
    }
    std::swap(inputs_[state.machine], last);
    tell_survey(state.machine, work_of(made.update));
    return made;
  });
}

std::vector<Update> Site::make(std::span<const Move> moves) {
  if (!survey_) return tracker_->update(moves);
  std::vector<Update> made;
  for (const Move& move : moves) {
    made.push_back(tracker_->update(std::span(&move, 1)).front());
    tell_survey(move.machine, work_of(made.back()));
  }
  return made;
}

void Site::pour_until(double until_s) {
  if (!next_pour_s_ || until_s >= *next_pour_s_) {
    std::vector<double> times_s;
    next_pour_s_ = kForever;
    for (const Pour& pour : model_->earthmoving.pours) {
      const PourParts parts(pour, ground_->voxel_size_m());
      for (std::int64_t part = 1; part <= parts.count(); ++part) {
        const double falls_s = parts.falls_s(part);
        if (falls_s > until_s) next_pour_s_ = std::min(*next_pour_s_, falls_s);
        if (!(poured_s_ && falls_s <= *poured_s_) && falls_s <= until_s) times_s.push_back(falls_s);
      }
    }
    std::sort(times_s.begin(), times_s.end());
    times_s.erase(std::unique(times_s.begin(), times_s.end()), times_s.end());
    for (const double time_s : times_s)
      for (std::size_t i = 0; i < model_->earthmoving.pours.size(); ++i) tracker_->pour(i, time_s);
    tell_survey();
  }
  poured_s_ = std::max(poured_s_.value_or(until_s), until_s);
}

bool Site::pours_before(std::optional<double> time_s) const {
  return !model_->earthmoving.pours.empty() && time_s && (!next_pour_s_ || *time_s > *next_pour_s_);
}

void Site::pour_before(std::optional<double> time_s) {
  if (pours_before(time_s)) pour_until(std::nextafter(*time_s, -kForever));
}

StepResult Site::pour(double until_s) noexcept {
  return guarded<StepResult>([&](bool& moving) {
    if (std::isnan(until_s)) throw std::invalid_argument("the time must be a number");
    ground_->evict();
    moving = true;
    pour_until(until_s);
    return StepResult();
  });
}

StepResult Site::place(const MachineState& state) noexcept {
  return guarded<StepResult>([&](bool& moving) {
    Input now = input(state);
    std::optional<Input>& last = inputs_[state.machine];
    require_order(state.machine, last, now.time_s);
    const std::string why = tracker_->misplaced(state.machine, now.pose);
    if (!why.empty()) throw std::invalid_argument(name(state.machine) + ": " + why);
    ground_->evict();
    moving = true;
    pour_before(state.time_s);
    StepResult made;
    made.update = tracker_->place(state.machine, now.pose, now.time_s);
    tell_survey();
    if (!now.time_s && last) now.time_s = last->time_s;
    set_direction(now, std::nullopt);
    last = std::move(now);
    return made;
  });
}

StepResult Site::reset_clock(std::size_t machine) noexcept {
  return guarded<StepResult>([&](bool&) {
    require(machine);
    if (inputs_[machine]) inputs_[machine]->time_s.reset();
    return StepResult();
  });
}

StepResult Site::come_to_rest() noexcept {
  return guarded<StepResult>([&](bool& moving) {
    ground_->evict();
    StepResult made;
    moving = true;
    made.update = tracker_->come_to_rest(last_s());
    tell_survey();
    return made;
  });
}

std::string Site::progress() const {
  std::string out;
  put_text(out, tracker_->state());
  put(out, at_rest_);
  put(out, std::uint64_t{inputs_.size()});
  for (const std::optional<Input>& input : inputs_) {
    put(out, input && input->time_s ? *input->time_s : kUnknown_s);
    put(out, input ? input->pose : Pose{Vec3::Constant(kUnknown_s), {1, 0, 0, 0}});
    put(out, std::uint64_t{input ? input->configuration.size() : 0});
    if (!input) continue;
    for (const double value : input->configuration) put(out, value);
  }
  const Input none;
  for (const std::optional<Input>& input : inputs_)
    put(out, (input ? *input : none).direction, (input ? *input : none).moved_from);
  surveyed_->save(out);
  if (survey_) survey_->save(out);
  return out;
}

void Site::set_progress(std::string_view bytes) {
  const std::string_view tracker = take_text(bytes);
  bool at_rest = false;
  std::uint64_t count = 0;
  take(bytes, at_rest, count);
  if (count > model_->machines.size())
    throw std::invalid_argument("the state is of " + std::to_string(count) +
                                " machines; this site has " +
                                std::to_string(model_->machines.size()));
  std::vector<std::optional<Input>> inputs;
  for (std::size_t i = 0; i < count; ++i) {
    const SiteMachine& machine = model_->machines[i];
    Input now;
    double time_s = kUnknown_s;
    std::uint64_t numbers = 0;
    take(bytes, time_s, now.pose, numbers);
    if (numbers != 0 && (!machine.chain || !machine.chain->takes(numbers)))
      throw std::invalid_argument("the state is of a machine with other joints");
    std::vector<double>& values = now.configuration;
    values.resize(numbers);
    for (double& value : values) take(bytes, value);
    const bool placed = !now.pose.position.hasNaN();
    const bool drives = numbers != 0 && numbers != machine.chain->movable_count();
    if (std::isinf(time_s) || (placed && !is_valid(now.pose)) ||
        !std::all_of(values.begin(), values.end(),
                     [](double value) { return std::isfinite(value); }) ||
        (drives && !is_valid(pose_of(&values[numbers - kPoseNumbers]))))
      throw std::invalid_argument("the state has an invalid machine");
    if (!std::isnan(time_s)) now.time_s = time_s;
    inputs.push_back(placed ? std::optional(std::move(now)) : std::nullopt);
  }
  for (std::optional<Input>& input : inputs) {
    Vec3 direction, from;
    take(bytes, direction, from);
    if (!direction.allFinite() || !from.allFinite())
      throw std::invalid_argument("the state has an invalid machine");
    if (!input) continue;
    input->direction = direction;
    input->moved_from = from;
  }
  auto surveyed = SurveyedHeights::load(bytes);
  std::unique_ptr<GroundScans> survey;
  if (!bytes.empty()) {
    survey = new_survey();
    survey->load(bytes);
    if (!bytes.empty()) throw std::invalid_argument("the state is of a site with more");
  }
  tracker_->restore(tracker, count);
  survey_ = std::move(survey);
  *surveyed_ = std::move(surveyed);
  inputs.resize(model_->machines.size());
  inputs_ = std::move(inputs);
  poured_s_.reset();
  next_pour_s_.reset();
  at_rest_ = at_rest;
}

}  // namespace soilvdb::inline v0
