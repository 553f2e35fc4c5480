// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soilvdb resume: continues a run after a crash, a power cut or a signal, and restores damaged or
// missing files of a finished run.
#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "soilvdb/io/snapshot.h"
#include "tools/app/commands.h"
#include "tools/run/motion_unchanged.h"
#include "tools/run/run.h"
#include "tools/run/run_files.h"
#include "tools/run/text.h"

namespace soilvdb::tools {
namespace {

namespace fs = std::filesystem;

io::JournalContent open_run(const fs::path& folder) {
  std::error_code none;
  const fs::path file = folder / kJournalName;
  if (!fs::is_directory(folder, none))
    throw io::InputError(folder, "is not a folder; name the one a run writes to");
  if (!fs::exists(file, none))
    throw io::InputError(folder, "holds no run to go on with: it has no journal");
  return io::read_journal(file);
}

/// Removes faulty files from the journal's list. @return the faulty files
std::vector<RunFile> take_faulty(const fs::path& folder, io::JournalContent& journal) {
  std::vector<RunFile> faulty = check_files(folder, journal);
  std::erase_if(faulty, [](const RunFile& file) { return file.fault.empty(); });
  std::erase_if(journal.files, [&](const io::JournalFile& good) {
    return std::any_of(faulty.begin(), faulty.end(),
                       [&](const RunFile& file) { return file.known.name == good.name; });
  });
  return faulty;
}

/// The newest intact ground in the journal. If the run is finished, the newest before the faulty
/// files.
ResumePoint find_start(const fs::path& folder, const io::JournalContent& journal,
                       const std::vector<RunFile>& faulty, const io::Scenario& scenario,
                       const RunConfig& config) {
  const auto from_the_beginning = [&] {
    return ResumePoint{std::make_unique<SiteState>(model_of(scenario), io::open_site(scenario))};
  };
  const auto updates = static_cast<std::uint64_t>(
      Schedule(scenario, config.options.updates, config.ends_s, 0).total());
  if (!recording_is_whole(scenario, journal, updates)) {
    fmt::print("going on from the beginning, so that {} is complete\n", kMcapName);
    return from_the_beginning();
  }
  std::uint64_t end = std::numeric_limits<std::uint64_t>::max();
  for (auto file = faulty.rbegin(); file != faulty.rend(); ++file) {
    if (journal.ended && is_periodic(file->known.name)) end = file->known.updates;
  }
  std::vector<io::JournalFile> snapshots = journal.files;
  std::erase_if(snapshots, [&](const io::JournalFile& file) {
    // In an incremental run no snapshot continues the final one of a stopped run.
    const bool usable =
        is_periodic(file.name) || (file.name == kFinalName && !scenario.incremental_snapshots);
    return !usable || file.updates >= end;
  });
  // Ground at rest is a starting point only at the run's end, because a motion may have grown.
  const auto fits = [&](const SiteState& state, std::uint64_t seen) {
    return !state.rests_at_end() || seen == updates;
  };
  const auto refused = [](const std::string& why) {
    say(fmt::format("warning: {}; going on from an earlier state", why));
  };
  std::optional<ResumePoint> start =
      newest_snapshot(folder, snapshots, model_of(scenario), fits, refused);
  if (!start) start = from_the_beginning();
  fmt::print("going on from {}\n", start->snapshot.empty() ? "the beginning" : start->snapshot);
  return std::move(*start);
}

void warn_of(const std::vector<RunFile>& faulty, const fs::path& folder, const ResumePoint& start) {
  for (const RunFile& file : faulty) {
    if (file.outdated) continue;
    const bool anew = file.known.updates >= start.updates;
    say(fmt::format("warning: {}: {}; {}", (folder / file.known.name).string(), file.fault,
                    anew ? "it is made anew"
                         : "resume the run again once it is finished, and it is made anew"));
  }
}

/// Keeps a copy of a damaged journal before its good part is continued.
void keep_damaged(const fs::path& folder, const io::JournalContent& journal) {
  const fs::path file = folder / kJournalName, kept = folder / "journal.damaged";
  fs::copy_file(file, kept, fs::copy_options::overwrite_existing);
  say(
      fmt::format("warning: {}: is damaged at byte {}; what comes after is dug again, the damaged "
                  "journal is kept as {}",
                  file.string(), journal.good_bytes, kept.filename().string()));
}

}  // namespace

void resume(const ResumeOptions& options) {
  const Run::Clock::time_point begin = Run::Clock::now();
  const fs::path& path = options.folder;
  open_run(path);
  RunFolder folder(path);
  folder.lock();
  io::JournalContent journal = open_run(path);
  const std::vector<RunFile> faulty = take_faulty(path, journal);
  const io::JournalExtent& done = journal.done;
  const std::string reached =
      fmt::format(fmt::runtime(journal.ended ? "{}: the run is finished: {} to {} s\n"
                                             : "{}: {} acknowledged, to {} s\n"),
                  path.string(), counted(done.updates, "update"), time_text(done.time_s));
  if (journal.ended && faulty.empty() && !journal.damaged) {
    fmt::print("{}", reached);
    return;
  }
  RunConfig config = parse_run_config(journal.config.text, path);
  if (options.memory_mb) config.options.memory_mb = options.memory_mb;
  io::Scenario scenario = read_to_dig(config.options);
  check_motion_unchanged(path / kJournalName, scenario, config);
  fmt::print("{}", reached);
  std::fflush(stdout);
  for (const std::string& warning : scenario.warnings) say("warning: " + warning);
  folder.clear();
  with_threads(config.options.threads, [&](int threads) {
    ResumePoint start = find_start(path, journal, faulty, scenario, config);
    warn_of(faulty, path, start);
    if (journal.damaged) keep_damaged(path, journal);
    Run(std::move(config), std::move(scenario), folder, std::move(start), threads, begin)
        .resume(std::move(journal));
  });
}

}  // namespace soilvdb::tools
