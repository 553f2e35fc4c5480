// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/run_past.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include "soilvdb/io/snapshot.h"
#include "tools/run/run.h"
#include "tools/run/run_files.h"
#include "tools/run/session_state.h"
#include "tools/run/text.h"

namespace soilvdb::tools {
namespace {

namespace fs = std::filesystem;

/// Moves that are dug at once, as far as machines are apart.
constexpr std::size_t kPastBatch = 256;

io::Scenario read_past_scenario(const RunConfig& config) {
  io::Scenario scenario = io::read_scenario(config.options.scenario, {}, io::Motions::kOptional);
  if (config.options.voxel_size_m) scenario.voxel_size_m = *config.options.voxel_size_m;
  return scenario;
}

/// Joints at a time between two of these rows.
std::vector<double> joints_at(const io::MotionRows& rows, double time_s) {
  const auto after = std::upper_bound(rows.times_s.begin(), rows.times_s.end(), time_s);
  const auto to = static_cast<std::size_t>(
      std::min(after - rows.times_s.begin(), std::ptrdiff_t(rows.times_s.size()) - 1));
  const std::size_t from = to > 0 ? to - 1 : 0;
  const double begin_s = rows.times_s[from], end_s = rows.times_s[to];
  const double share =
      end_s > begin_s ? std::clamp((time_s - begin_s) / (end_s - begin_s), 0.0, 1.0) : 1;
  std::vector<double> joints;
  for (std::size_t k = 0; k < rows.columns; ++k) {
    const double a = rows.values[from * rows.columns + k], b = rows.values[to * rows.columns + k];
    joints.push_back(share == 1 ? b : a + share * (b - a));
  }
  return joints;
}

}  // namespace

RunPast::RunPast(fs::path folder)
    : folder_(std::move(folder)),
      journal_(io::read_journal(folder_ / kJournalName)),
      config_(parse_run_config(journal_.config.text, folder_)),
      scenario_(read_past_scenario(config_)) {}

double RunPast::begin_s() const {
  double begin_s = std::numeric_limits<double>::infinity();
  for (const io::MachineInput& machine : scenario_.machines)
    if (machine.has_motion()) begin_s = std::min(begin_s, machine.motion.begin_s());
  for (const Pour& pour : scenario_.pours) begin_s = std::min(begin_s, pour.begin_s);
  return begin_s;
}

void RunPast::moves(double until_s, const std::function<void(const io::JournalMove&)>& each) const {
  io::JournalReader reader(folder_ / kJournalName);
  std::uint64_t updates = 0;
  while (const std::optional<io::JournalRecord> record = reader.next()) {
    const auto* move = std::get_if<io::JournalMove>(&*record);
    if (move == nullptr) continue;
    if (move->end_s > until_s || updates == journal_.done.updates) return;
    updates += move->ends_update;
    each(*move);
  }
}

struct RunPast::Start {
  io::Site site;
  std::uint64_t updates = 0;
  std::string tracker_state = {};
  bool at_rest = false;
};

/// The newest good ground that has seen no more than so many updates.
/// @param whole those are all of a run that came to its end
RunPast::Start RunPast::find_start(std::uint64_t updates, bool whole) const {
  for (auto file = journal_.files.rbegin(); file != journal_.files.rend(); ++file) {
    if (file->updates == 0 || file->updates > updates) continue;
    if (!is_periodic(file->name) && file->name != kFinalName) continue;
    if (!fault_of(folder_ / file->name, *file).empty()) continue;
    try {
      io::SnapshotInfo info;
      Start start{io::read_snapshot(folder_ / file->name, &info), file->updates};
      start.tracker_state = std::move(info.tracker_state);
      if (scenario_.soil) start.at_rest = take_at_rest(start.tracker_state);
      if (whole || !start.at_rest) return start;
    } catch (const io::InputError&) {
    }  // the journal holds what it held, too
  }
  return {io::open_site(scenario_)};
}

Session RunPast::at(double time_s) const {
  const std::size_t machines = scenario_.machines.size();
  std::vector<std::optional<io::JournalMove>> last(machines);
  std::uint64_t updates = 0, count = 0;
  moves(time_s, [&](const io::JournalMove& move) {
    updates += move.ends_update;
    if (move.machine < machines) last[move.machine] = move;
  });
  const bool whole = journal_.ended && updates == journal_.done.updates;
  Start start = find_start(updates, whole);

  std::vector<SessionMachine> all;
  for (const io::MachineInput& machine : scenario_.machines)
    all.push_back({machine.name, machine.bucket, machine.chain});
  auto state = std::make_unique<Session::State>(
      std::move(all), Earthmoving{scenario_.soil, scenario_.pours, scenario_.hoppers},
      std::move(start.site));
  if (start.updates > 0) state->tracker->restore(start.tracker_state);
  state->scenario = fs::absolute(scenario_.file);

  const auto check = [&](const io::JournalMove& move, const Update& update) {
    if (state->samples(update.cut_m3) == move.cut_samples &&
        state->mass(update.bucket_m3) == move.bucket_samples)
      return;
    throw std::runtime_error(fmt::format(
        "{}: the move of {} to {} s doesn't cut what it cut; it was another version of soilvdb "
        "that dug it",
        (folder_ / kJournalName).string(),
        move.machine < machines ? scenario_.machines[move.machine].name : "a pour",
        time_text(move.end_s)));
  };
  std::vector<io::JournalMove> batch;
  const auto dig = [&] {
    std::deque<Motion> motions;
    std::vector<Move> ways;
    for (const io::JournalMove& move : batch) {
      const std::optional<Chain>& chain = scenario_.machines[move.machine].chain;
      const Motion& way = motions.emplace_back(io::motion_of(move.rows, chain.value_or(Chain())));
      ways.push_back({move.machine, {}, &way, move.begin_s, move.end_s});
    }
    const std::vector<Update> made = state->tracker->update(ways);
    for (std::size_t i = 0; i < batch.size(); ++i) check(batch[i], made[i]);
    batch.clear();
  };
  moves(time_s, [&](const io::JournalMove& move) {
    const bool seen = count < start.updates;
    count += move.ends_update;
    if (seen) return;
    if (move.machine < machines) {
      batch.push_back(move);
      if (batch.size() == kPastBatch) dig();
      return;
    }
    dig();
    check(move, state->tracker->pour(move.machine - machines, move.end_s));
  });
  dig();
  if (whole && scenario_.soil && !start.at_rest) state->tracker->come_to_rest(journal_.done.time_s);

  for (std::size_t i = 0; i < machines; ++i) {
    if (!last[i]) continue;
    const std::optional<Chain>& chain = scenario_.machines[i].chain;
    Session::State::Fed& fed = state->fed[i];
    fed.time_s = last[i]->end_s;
    fed.pose = io::motion_of(last[i]->rows, chain.value_or(Chain())).pose(fed.time_s);
    if (last[i]->rows.joints) fed.joints = joints_at(last[i]->rows, fed.time_s);
  }
  state->fed_count = updates;
  return Session(std::move(state));
}

}  // namespace soilvdb::tools
