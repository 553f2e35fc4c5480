// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/history.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <utility>

#include "io/file/json.h"
#include "io/file/text.h"
#include "soilvdb/io/journal.h"
#include "tools/run/run_config.h"
#include "tools/run/run_folder.h"

namespace soilvdb::tools {
namespace {

namespace fs = std::filesystem;

/// The time in a snapshot's name: soil_12.5.vdb, or soil_12.5_99.vdb if several have this time.
std::optional<double> snapshot_time(const std::string& name) {
  const std::size_t begin = name.find('_') + 1, end = name.find_first_of('_', begin);
  const std::size_t dot = name.rfind('.');
  if (begin == 0 || dot == std::string::npos || dot <= begin) return {};
  return io::parse_number(name.substr(begin, std::min(end, dot) - begin));
}

/// The options of the run that wrote a journal.
RunOptions options_of(const fs::path& folder, const io::JournalContent& journal) {
  if (!is_of_session(journal.config.text))
    return parse_run_config(journal.config.text, folder).options;
  const auto config = io::from_cbor(journal.config.text);
  const auto scenario = config.find("scenario");
  if (scenario == config.end() || !scenario->is_string())
    throw io::InputError(
        folder,
        "is a recording of a program with a site of its own; only that program can show it");
  RunOptions options;
  options.scenario = scenario->get<std::string>();
  return options;
}

}  // namespace

History::Times History::times() {
  if (!times_.from_s) {
    constexpr double kForever_s = std::numeric_limits<double>::infinity();
    const WorkLog all = log(start_.recorded(folder_, -kForever_s), kForever_s);
    times_.from_s = all.from_s();
    times_.to_s = all.time_s();
  }
  times_.snapshots_s.clear();
  std::error_code ignored;
  for (const fs::directory_entry& file : fs::directory_iterator(folder_, ignored)) {
    const std::string name = file.path().filename().string();
    if (!is_periodic(name)) continue;
    if (const auto time_s = snapshot_time(name)) times_.snapshots_s.push_back(*time_s);
  }
  std::sort(times_.snapshots_s.begin(), times_.snapshots_s.end());
  return times_;
}

Past History::at(double time_s) const {
  auto there = ground_at(time_s);
  return {there, std::make_shared<const WorkLog>(log(*there, time_s))};
}

std::shared_ptr<Session> History::ground_at(double time_s) const {
  return std::make_shared<Session>(start_.recorded(folder_, time_s));
}

StatesAfter History::states_after(std::size_t machine, double time_s) const {
  return start_.states_after(folder_, machine, time_s);
}

std::pair<std::shared_ptr<Undone>, FedStates> History::without(
    const StatesAfter& states, std::optional<double> snapshot_every_s,
    const std::function<void()>& go_on) const {
  FedStates fed(start_.recorded(folder_, -std::numeric_limits<double>::infinity()));
  auto undone =
      start_.without(folder_, states, snapshot_every_s, [&](const io::JournalUpdate& update) {
        fed.add(update);
        go_on();
      });
  return {std::move(undone), std::move(fed)};
}

/// The machines' work up to a time. @param there has all machines
WorkLog History::log(const Session& there, double time_s) const {
  WorkLog log(there);
  const fs::path journal = folder_ / kJournalName;
  std::uint64_t left = io::updates_until(journal, time_s);
  io::JournalReader reader(journal);
  while (left > 0) {
    std::optional<io::JournalRecord> record = reader.next();
    if (!record) break;
    auto* update = std::get_if<io::JournalUpdate>(&*record);
    if (update == nullptr) continue;
    if (update->end_s > time_s)  // by a clock that was ahead
      update->begin_s = update->end_s = std::nan("");
    log.add(*update);
    left -= update->ends_update;
  }
  return log;
}

Opened open_folder(const fs::path& folder) {
  const fs::path file = folder / kJournalName;
  if (!io::is_journal(file))
    throw io::InputError(folder,
                         "is neither a scenario nor the folder of a run or a recording: there is "
                         "no journal in it");
  const RunOptions options = options_of(folder, io::read_journal(file));
  Session start = Session::open(options.scenario, options.voxel_size_m);
  const ChangeBefore before = {start.change_m3(), start.mass_balance().ground};
  const std::string name = options.scenario.stem().string();
  auto history = std::make_unique<History>(std::move(start), folder);
  const Past end = history->at(std::numeric_limits<double>::infinity());
  return {std::move(*end.site), *end.log, before, name, std::move(history)};
}

}  // namespace soilvdb::tools
