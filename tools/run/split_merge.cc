// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/split_merge.h"

#include <fmt/format.h>

#include <map>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "core/constants.h"
#include "core/ground/soil_writer.h"
#include "io/file/atomic_file.h"
#include "soilvdb/chunk_range.h"
#include "soilvdb/io/checksum.h"
#include "soilvdb/io/journal.h"
#include "soilvdb/io/snapshot.h"
#include "tools/run/run_config.h"
#include "tools/run/run_files.h"
#include "tools/run/run_folder.h"
#include "tools/run/schedule.h"
#include "tools/run/site_state.h"
#include "tools/run/text.h"

namespace soilvdb::tools {
namespace {

namespace fs = std::filesystem;

/// Is a chunk there as it is here?
bool same(const Soil& a, const Soil& b, const Coord3& origin) {
  if ((a.find(origin) == nullptr) != (b.find(origin) == nullptr)) return false;
  SampleWords mine, other;
  a.read_samples(origin, mine);
  b.read_samples(origin, other);
  return mine == other;
}

std::vector<std::size_t> numbers_of(const std::vector<std::string>& names,
                                    const io::Scenario& scenario) {
  std::vector<std::size_t> numbers;
  for (std::size_t m = 0; m < scenario.machines.size(); ++m)
    for (const std::string& name : names)
      if (scenario.machines[m].name == name) numbers.push_back(m);
  if (numbers.size() != names.size())
    throw io::InputError(scenario.file, "has other machines than when it was split");
  return numbers;
}

/// A part must be finished and its ground intact.
void check_part(const RunOptions& options, std::int64_t updates) {
  const fs::path& part = *options.out;
  const io::JournalContent journal = io::read_journal(part / kJournalName);
  check_is_part(journal, options);
  std::string fault = "isn't finished";
  if (journal.ended && !journal.damaged &&
      journal.done.updates == static_cast<std::uint64_t>(updates)) {
    fault = fmt::format("has no {}", kFinalName);
    for (const io::JournalFile& file : journal.files)
      if (file.name == kFinalName) fault = fault_of(part / kFinalName, file);
    if (!fault.empty()) fault = fmt::format("{} {}", kFinalName, fault);
  }
  if (!fault.empty())
    throw std::runtime_error(
        fmt::format("{}: {}; `soilvdb part dig` goes on with it", part.string(), fault));
}

/// Ground and machines that parts are put into.
class Whole {
 public:
  Whole(const fs::path& start, const io::Scenario& scenario)
      : state_(scenario, io::read_snapshot(start, &info_)), before_(state_.site.soil->clone()) {
    if (!info_.tracker_state.empty()) state_.set_progress(info_.tracker_state);
  }

  void put(const fs::path& part, const std::vector<std::size_t>& machines) {
    io::SnapshotInfo info;
    const io::Site site = io::read_snapshot(part / kFinalName, &info);
    for (const Chunk* chunk : site.soil->chunks()) {
      if (same(*site.soil, *before_, chunk->origin)) continue;
      const auto [other, first] = changed_by_.emplace(chunk->origin, part);
      if (!first) refuse(other->second, part, chunk->origin);
      SoilWriter(*state_.site.soil).copy_from(*site.soil, chunk->origin);
    }
    state_.set_progress(info.tracker_state, machines);
  }

  void write(const fs::path& file, const std::string& scenario, double time_s, bool surface) const {
    io::SnapshotInfo info = state_.snapshot_info(time_s);
    info.scenario = scenario;
    info.surface = surface;
    io::write_snapshot(file, state_.site, info);
  }

 private:
  [[noreturn]] void refuse(const fs::path& a, const fs::path& b, const Coord3& chunk) const {
    const Vec3 at = state_.site.soil->world_from_index(chunk.cast<double>());
    throw std::runtime_error(fmt::format(
        "{} and {} both changed the ground at {}, {}, {} m, so they weren't apart; remove both and "
        "dig them again",
        a.string(), b.string(), number(at.x()), number(at.y()), number(at.z())));
  }

  io::SnapshotInfo info_;
  SiteState state_;
  std::unique_ptr<Soil> before_;
  std::map<Coord3, fs::path, Before> changed_by_;
};

/// The updates of a part, one after another.
class PartUpdates {
 public:
  PartUpdates(const fs::path& part, std::vector<std::size_t> machines)
      : file_(part / kJournalName), machines_(std::move(machines)), reader_(new Reader(file_)) {
    advance();
  }
  bool at_end() const { return !next_; }
  bool has(std::size_t machine) const {
    return std::find(machines_.begin(), machines_.end(), machine) != machines_.end();
  }
  io::JournalUpdate take(const Step& step) {
    if (!next_ || !is_update(step, *next_))
      throw std::runtime_error(fmt::format(
          "{}: has another move than the scenario at {} s; the motions have changed since it was "
          "split: put them back, or split it anew",
          file_.string(), time_text(step.end_s)));
    io::JournalUpdate update = std::move(*next_);
    advance();
    return update;
  }

 private:
  using Reader = io::JournalReader;
  void advance() {
    next_.reset();
    while (std::optional<io::JournalRecord> record = reader_->next()) {
      if (auto* update = std::get_if<io::JournalUpdate>(&*record)) {
        next_ = std::move(*update);
        return;
      }
    }
  }

  fs::path file_;
  std::vector<std::size_t> machines_;
  std::unique_ptr<Reader> reader_;
  std::optional<io::JournalUpdate> next_;
};

/// All parts' updates, in the order of the whole, into a journal.
/// @return how many updates they are
std::uint64_t join_journals(const fs::path& folder, const SplitPlan& plan,
                            const io::Scenario& scenario, io::JournalWriter& journal) {
  Schedule schedule(scenario, plan.options.updates, plan.ends_s,
                    kPathTolerance * scenario.voxel_size_m);
  std::uint64_t count = 0;
  std::optional<Step> step = schedule.next();
  for (std::size_t w = 0; w < plan.windows.size(); ++w) {
    std::vector<PartUpdates> parts;
    for (std::size_t p = 0; p < plan.windows[w].parts.size(); ++p)
      parts.emplace_back(*part_options(folder, plan, w, p).out,
                         numbers_of(plan.windows[w].parts[p].machines, scenario));
    const auto left = [](const PartUpdates& part) { return !part.at_end(); };
    while (std::any_of(parts.begin(), parts.end(), left)) {
      const auto of = [&](const PartUpdates& part) { return step && part.has(step->machine); };
      const auto part = std::find_if(parts.begin(), parts.end(), of);
      if (part == parts.end())
        throw std::runtime_error(
            fmt::format("{}: its motions have changed since it was split: put "
                        "them back, or split it anew",
                        scenario.file.string()));
      journal.add(part->take(*step));
      count += step->ends_update;
      step = schedule.next();
    }
  }
  return count;
}

void write_journal(const fs::path& folder, const SplitPlan& plan, const io::Scenario& scenario) {
  const io::Site undug = io::read_snapshot(window_start(folder, 0));
  const RunConfig config{whole_options(folder, plan), undug.soil->change_m3(), plan.ends_s, 0};
  const fs::path file = folder / kPartsName / kJournalName;
  const std::uint64_t size = io::begin_journal(file, {to_bytes(config, scenario)});
  {
    // Each record by itself, as the scenario may ask for, would take as long as digging did: until
    // all is there nobody goes on with it.
    constexpr double kSync_s = 1;
    io::JournalWriter journal(file, size, {}, kSync_s);
    const std::uint64_t updates = join_journals(folder, plan, scenario, journal);
    const io::FileDigest digest = io::file_digest(folder / kFinalName);
    journal.add(io::JournalFile{kFinalName, updates, digest.size, digest.crc});
    journal.flush();
  }
  fs::rename(file, folder / kJournalName);
  io::sync_folder(folder / kJournalName);
}

}  // namespace

bool is_merged(const fs::path& folder, const SplitPlan& plan, std::size_t window) {
  std::error_code none;
  const bool last = window + 1 == plan.windows.size();
  return fs::exists(folder / kJournalName, none) ||
         (!last && fs::exists(window_start(folder, window + 1), none));
}

void merge_window(const fs::path& folder, const SplitPlan& plan, std::size_t window,
                  const io::Scenario& scenario) {
  const SplitPlan::Window& when = plan.windows.at(window);
  Whole whole(window_start(folder, window), scenario);
  for (std::size_t p = 0; p < when.parts.size(); ++p) {
    const RunOptions part = part_options(folder, plan, window, p);
    check_part(part, when.parts[p].updates);
    whole.put(*part.out, numbers_of(when.parts[p].machines, scenario));
  }
  const bool last = window + 1 == plan.windows.size();
  whole.write(last ? folder / kFinalName : window_start(folder, window + 1), scenario.name,
              when.end_s, last);
  if (last) write_journal(folder, plan, scenario);
}

}  // namespace soilvdb::tools
