// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soilvdb resume: goes on with a run that a crash, a power cut or a signal ended.
#include <fmt/format.h>

#include <cstdio>
#include <string>
#include <utility>

#include "io/checksum.h"
#include "io/snapshot.h"
#include "tools/commands.h"
#include "tools/job.h"
#include "tools/text.h"

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

/// The newest good ground that the journal knows of.
Start find_start(const fs::path& folder, const io::JournalContent& journal,
                 const io::Scenario& scenario) {
  for (auto file = journal.files.rbegin(); file != journal.files.rend(); ++file) {
    const fs::path path = folder / file->name;
    if (path.extension() != ".vdb" || file->updates == 0) continue;
    // Nothing goes on from the last one of a run that was stopped.
    if (scenario.incremental_snapshots && file->name == kFinalName) continue;
    try {
      if (io::file_digest(path) != io::FileDigest{file->size, file->crc})
        throw io::InputError(path, "is not what the journal says");
      io::SnapshotInfo info;
      Start start{io::read_snapshot(path, &info), file->updates, "", file->name, info.since};
      start.tracker_state = std::move(info.tracker_state);
      fmt::print("going on from {}\n", file->name);
      return start;
    } catch (const io::InputError& e) {
      fmt::print(stderr, "soilvdb: warning: {}; going on from what came before it\n", e.what());
    }
  }
  fmt::print("going on from the beginning\n");
  return {io::open_site(scenario), 0, ""};
}

/// Keeps a damaged journal before its good part is gone on with.
void keep_damaged(const fs::path& folder, const io::JournalContent& journal) {
  const fs::path file = folder / kJournalName, kept = folder / "journal.damaged";
  fs::copy_file(file, kept, fs::copy_options::overwrite_existing);
  fmt::print(stderr,
             "soilvdb: warning: {}: is damaged at byte {}; what comes after is dug again, the "
             "damaged journal is kept as {}\n",
             file.string(), journal.good_bytes, kept.filename().string());
}

}  // namespace

void resume(const ResumeOptions& options) {
  const Job::Clock::time_point begin = Job::Clock::now();
  const fs::path& path = options.folder;
  open_run(path);
  RunFolder folder(path);
  folder.lock();
  const io::JournalContent journal = open_run(path);
  const io::JournalExtent& done = journal.done;
  if (journal.ended) {
    fmt::print("{}: the run is finished: {} to {} s\n", path.string(),
               counted(static_cast<double>(done.updates), "update"), time_text(done.time_s));
    return;
  }
  RunConfig config = parse_run_config(journal.config.text, path);
  if (options.memory_mb) config.options.memory_mb = options.memory_mb;
  io::Scenario scenario = read_to_dig(config.options);  // before there are threads
  fmt::print("{}: {} acknowledged, to {} s\n", path.string(),
             counted(static_cast<double>(done.updates), "update"), time_text(done.time_s));
  std::fflush(stdout);
  with_threads(config.options.threads, [&](int threads) {
    Start start = find_start(path, journal, scenario);
    if (journal.damaged) keep_damaged(path, journal);
    Job(std::move(config), std::move(scenario), folder, std::move(start), threads, begin)
        .resume(journal);
  });
}

}  // namespace soilvdb::tools
