// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soilvdb verify: checks whether all files of a run are intact, and up to which time.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "soilvdb/io/error.h"
#include "soilvdb/io/journal.h"
#include "soilvdb/io/snapshot.h"
#include "tools/app/commands.h"
#include "tools/run/motion_unchanged.h"
#include "tools/run/run.h"
#include "tools/run/run_files.h"
#include "tools/run/run_folder.h"
#include "tools/run/text.h"

namespace soilvdb::tools {
namespace {

namespace fs = std::filesystem;

/// Calls `read`; a damaged file becomes a result instead of a usage error.
template <typename F>
auto judged(F read) {
  try {
    return read();
  } catch (const io::InputError& e) {
    throw std::runtime_error(e.what());
  }
}

/// Why a run or a session can't be continued; empty if it can.
std::string fault_of_inputs(const fs::path& folder, const io::JournalContent& journal) {
  try {
    if (is_of_session(journal.config.text)) {
      check_record_format(journal.config.text, folder);
      return "";
    }
    const RunConfig config = parse_run_config(journal.config.text, folder);
    check_motion_unchanged(folder / kJournalName, read_to_dig(config.options), config);
  } catch (const io::InputError& e) {
    return e.what();
  }
  return "";
}

/// Does the journal mark this file for deletion?
bool goes(const io::JournalContent& journal, const std::string& name) {
  return std::find(journal.removed.begin(), journal.removed.end(), name) != journal.removed.end();
}

/// The fault of a journal with fewer updates than its run's summary. A summary is written when all
/// updates are in the journal on disk, so such a journal was truncated or overwritten.
std::string fault_of_end(const fs::path& folder, const io::JournalContent& journal) {
  if (goes(journal, kSummaryName)) return "";  // of an earlier run
  std::ifstream in(folder / kSummaryName);
  const nlohmann::json summary = nlohmann::json::parse(in, nullptr, /*allow_exceptions=*/false);
  const auto acknowledged = nlohmann::json::json_pointer("/acknowledged/updates");
  if (!summary.is_object() || !summary.contains(acknowledged)) return "";
  const nlohmann::json& updates = summary[acknowledged];
  if (!updates.is_number_unsigned() || updates <= journal.done.updates) return "";
  return fmt::format("is damaged: it ends after {}, and held {} when {} was written",
                     counted(journal.done.updates, "update"), updates.get<std::uint64_t>(),
                     kSummaryName);
}

/// Prints files that look like a run's but are not in its journal. They are no fault: a crash or a
/// user may have left them.
void list_unknown(const fs::path& folder, const io::JournalContent& journal) {
  const bool of_session = is_of_session(journal.config.text);
  std::vector<std::string> names;
  std::error_code none;
  for (const auto& entry : fs::directory_iterator(folder, none)) {
    const std::string name = entry.path().filename().string();
    const auto is_it = [&](const io::JournalFile& known) { return known.name == name; };
    const bool is_run_s =
        is_output(name) &&
        (name.ends_with(".vdb") || !name.starts_with("soil_") || name.starts_with("soil_final."));
    const bool is_beside = of_session && name.starts_with("soil") && name.ends_with(".mcap");
    if ((is_run_s || is_beside) && entry.is_regular_file(none) && !goes(journal, name) &&
        std::none_of(journal.files.begin(), journal.files.end(), is_it))
      names.push_back(name);
  }
  std::sort(names.begin(), names.end());
  for (const std::string& name : names) {
    std::string itself;
    if (io::is_snapshot(folder / name)) {
      try {
        io::SnapshotInfo info;
        io::read_snapshot(folder / name, &info);
        itself = fmt::format("; by itself good, the ground at {} s", time_text(info.time_s));
      } catch (const io::InputError& e) {
        itself = fmt::format("; {}", e.what());
      }
    }
    fmt::print("{:<20} {}{}\n", name,
               of_session && name.ends_with(".mcap") ? "is beside the recording"
                                                     : "exists, but is not in the journal",
               itself);
  }
}

io::JournalContent journal_of(const fs::path& folder) {
  try {
    return judged([&] { return io::read_journal(folder / kJournalName); });
  } catch (const std::runtime_error&) {
    list_unknown(folder, {});
    throw;
  }
}

void verify_run(const fs::path& folder) {
  const io::JournalContent journal = journal_of(folder);
  const bool of_session = is_of_session(journal.config.text);
  std::vector<std::string> faults;
  const auto report = [&](const std::string& name, const std::string& fault,
                          const std::string& good) {
    fmt::print("{:<20} {}\n", name, fault.empty() ? good : fault);
    if (!fault.empty()) faults.push_back(fmt::format("{} {}", name, fault));
  };
  const std::string reached = fmt::format("{} to {} s", counted(journal.done.updates, "update"),
                                          time_text(journal.done.time_s));
  report(kJournalName,
         journal.damaged
             ? fmt::format("is damaged at byte {}: {} are good", journal.good_bytes, reached)
             : fault_of_end(folder, journal),
         fmt::format("good: {}{}{}", reached,
                     of_session      ? ", recorded by a session"
                     : journal.ended ? ", finished"
                                     : ", not finished: `soilvdb resume` goes on",
                     journal.torn_bytes == 0 ? ""
                                             : fmt::format("; {} bytes after it never became whole",
                                                           journal.torn_bytes)));
  for (const RunFile& file : check_files(folder, journal))
    if (!file.outdated) report(file.known.name, file.fault, "good");
  list_unknown(folder, journal);
  const std::string inputs = journal.ended ? "" : fault_of_inputs(folder, journal);
  if (of_session ? !inputs.empty() : !journal.ended) report("inputs", inputs, "good");
  if (faults.empty()) {
    fmt::print("\n{}: intact, good to {} s\n", folder.string(), time_text(journal.done.time_s));
    return;
  }
  throw std::runtime_error(fmt::format(
      "{}: {}; the journal is good to {} s{}", folder.string(), fmt::join(faults, "; "),
      time_text(journal.done.time_s),
      !inputs.empty() ? ""
      : of_session    ? ", from which it goes on"
                      : fmt::format(", from which `soilvdb resume {}` makes what is missing or "
                                       "damaged anew",
                                    folder.string())));
}

void verify_snapshot(const fs::path& file) {
  io::SnapshotInfo info;
  judged([&] { return io::read_snapshot(file, &info); });
  fmt::print("{}: intact, the ground{} at {} s\n", file.string(),
             info.scenario.empty() ? "" : " of " + info.scenario, time_text(info.time_s));
}

void verify_journal(const fs::path& file) {
  const io::JournalContent journal = judged([&] { return io::read_journal(file); });
  if (journal.damaged)
    throw std::runtime_error(fmt::format("{}: is damaged at byte {}; good to {} s", file.string(),
                                         journal.good_bytes, time_text(journal.done.time_s)));
  fmt::print("{}: intact, {} to {} s\n", file.string(), counted(journal.done.updates, "update"),
             time_text(journal.done.time_s));
}

/// Verifies any other output of a run.
void verify_output(const fs::path& file) {
  const fs::path journal = file.parent_path() / kJournalName;
  std::error_code none;
  if (fs::exists(journal, none)) {
    for (const io::JournalFile& known : io::read_journal(journal).files) {
      if (known.name != file.filename()) continue;
      const std::string what = fault_of(file, known);
      if (!what.empty()) throw std::runtime_error(fmt::format("{}: {}", file.string(), what));
      fmt::print("{}: intact\n", file.string());
      return;
    }
  }
  throw io::InputError(file,
                       "can't be verified: it is not a snapshot, and not in a journal beside it");
}

}  // namespace

void verify(const fs::path& path) {
  std::error_code none;
  if (fs::is_directory(path, none)) {
    if (!fs::exists(path / kJournalName, none))
      throw io::InputError(path, "holds no run: it has no journal; name a snapshot to verify it");
    verify_run(path);
  } else if (io::is_snapshot(path)) {
    verify_snapshot(path);
  } else if (io::is_journal(path)) {
    verify_journal(path);
  } else {
    if (!fs::exists(path, none)) throw io::InputError(path, "no such file or folder");
    verify_output(path);
  }
}

}  // namespace soilvdb::tools
