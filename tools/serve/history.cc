// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/history.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

#include "io/file/text.h"
#include "soilvdb/io/journal.h"
#include "soilvdb/io/scenario.h"
#include "tools/run/run_config.h"
#include "tools/run/run_folder.h"

namespace soilvdb::tools {
namespace {

namespace fs = std::filesystem;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// The time in a snapshot's name: soil_12.5.vdb, or of several at one time soil_12.5_99.vdb.
std::optional<double> time_of(const std::string& name) {
  const std::size_t begin = name.find('_') + 1, end = name.find_first_of('_', begin);
  const std::size_t dot = name.rfind('.');
  if (begin == 0 || dot == std::string::npos || dot <= begin) return {};
  return io::parse_number(name.substr(begin, std::min(end, dot) - begin));
}

class RecordedHistory : public History {
 public:
  RecordedHistory(Session start, fs::path folder)
      : start_(std::move(start)), folder_(std::move(folder)) {}

  Times times() override {
    if (!std::isfinite(times_.from_s)) begin();
    times_.snapshots_s.clear();
    std::error_code ignored;
    for (const fs::directory_entry& file : fs::directory_iterator(folder_, ignored)) {
      const std::string name = file.path().filename().string();
      if (!is_periodic(name)) continue;
      if (const auto time_s = time_of(name)) times_.snapshots_s.push_back(*time_s);
    }
    std::sort(times_.snapshots_s.begin(), times_.snapshots_s.end());
    return times_;
  }

  std::shared_ptr<Session> at(double time_s) override {
    return std::make_shared<Session>(start_.recorded(folder_, time_s));
  }

 private:
  /// Looks for the first time, and the last that there is by now.
  void begin() {
    io::JournalReader reader(folder_ / kJournalName);
    while (std::optional<io::JournalRecord> record = reader.next()) {
      const auto* fed = std::get_if<io::JournalState>(&*record);
      if (fed == nullptr || !std::isfinite(fed->time_s)) continue;
      if (!std::isfinite(times_.from_s)) times_.from_s = fed->time_s;
      times_.to_s = std::fmax(times_.to_s, fed->time_s);
    }
  }

  Session start_;
  fs::path folder_;
  Times times_ = {kNaN, kNaN, {}};
};

std::vector<SessionMachine> machines_of(const io::Scenario& scenario) {
  std::vector<SessionMachine> machines;
  for (const io::MachineInput& machine : scenario.machines)
    machines.push_back({machine.name, machine.bucket, machine.chain});
  return machines;
}

/// A run's snapshots.
class RunHistory : public History {
 public:
  RunHistory(fs::path folder, io::Scenario scenario, const io::JournalContent& journal)
      : folder_(std::move(folder)), scenario_(std::move(scenario)) {
    times_.to_s = journal.done.time_s;
    for (const io::JournalFile& file : journal.files) {
      const auto time_s = file.name == kFinalName ? times_.to_s : time_of(file.name);
      if (time_s && (is_periodic(file.name) || file.name == kFinalName))
        files_.emplace_back(*time_s, file.name);
    }
    std::sort(files_.begin(), files_.end());
    for (const auto& [time_s, name] : files_)
      if (times_.snapshots_s.empty() || times_.snapshots_s.back() != time_s)
        times_.snapshots_s.push_back(time_s);
    times_.from_s = 0;
    for (const io::MachineInput& machine : scenario_.machines)
      if (machine.has_motion()) times_.from_s = std::min(times_.from_s, machine.motion.begin_s());
  }

  Times times() override { return times_; }

  std::shared_ptr<Session> at(double time_s) override {
    const std::pair<double, std::string>* newest = nullptr;
    for (const auto& file : files_)
      if (file.first <= time_s) newest = &file;
    if (newest == nullptr) return std::make_shared<Session>(Session::open(scenario_.file));
    return std::make_shared<Session>(
        SessionSite{.voxel_size_m = scenario_.voxel_size_m,
                    .terrain = io::LevelSetTerrain{folder_ / newest->second},
                    .machines = machines_of(scenario_),
                    .earthmoving = {scenario_.soil, {}, {}}});
  }

 private:
  fs::path folder_;
  io::Scenario scenario_;
  Times times_;
  std::vector<std::pair<double, std::string>> files_;
};

}  // namespace

std::unique_ptr<History> make_recorded_history(Session start, fs::path folder) {
  return std::make_unique<RecordedHistory>(std::move(start), std::move(folder));
}

Opened open_folder(const fs::path& folder) {
  const fs::path file = folder / kJournalName;
  if (!io::is_journal(file))
    throw io::InputError(folder,
                         "is neither a scenario nor the folder of a run or a recording: there is "
                         "no journal in it");
  const io::JournalContent journal = io::read_journal(file);
  if (is_of_session(journal.config.text)) {
    const auto config = nlohmann::json::from_cbor(journal.config.text);
    const auto scenario = config.find("scenario");
    if (scenario == config.end() || !scenario->is_string())
      throw io::InputError(folder,
                           "is a recording of a program that built its site itself; that can show "
                           "it, this can't");
    const fs::path path = scenario->get<std::string>();
    Session start = Session::open(path);
    Session end = start.recorded(folder, std::numeric_limits<double>::infinity());
    return {std::move(end), path.stem().string(), make_recorded_history(std::move(start), folder)};
  }
  const RunConfig config = parse_run_config(journal.config.text, folder);
  io::Scenario scenario = io::read_scenario(config.options.scenario, {}, io::Motions::kOptional);
  if (config.options.voxel_size_m) scenario.voxel_size_m = *config.options.voxel_size_m;
  const std::string name = scenario.name;
  auto history = std::make_unique<RunHistory>(folder, std::move(scenario), journal);
  const std::shared_ptr<Session> end = history->at(std::numeric_limits<double>::infinity());
  return {std::move(*end), name, std::move(history)};
}

}  // namespace soilvdb::tools
