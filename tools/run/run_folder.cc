// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/run_folder.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <regex>
#include <stdexcept>
#include <thread>

#include "soilvdb/io/error.h"
#include "soilvdb/io/journal.h"
#include "tools/run/text.h"

namespace soilvdb::tools {

namespace fs = std::filesystem;

RunFolder::RunFolder(fs::path path) : path_(std::move(path)) {
  std::error_code error;
  fs::path there = fs::absolute(path_, error).lexically_normal();
  while (!fs::exists(there, error) && there.has_relative_path()) there = there.parent_path();
  if (!fs::is_directory(there, error))
    throw io::InputError(
        path_, fmt::format("can't be made, '{}' is not a folder; name another", there.string()));
  if (access(there.c_str(), W_OK | X_OK) != 0)
    throw io::InputError(
        path_,
        fmt::format("'{}' can't be written to; make it so or name another folder", there.string()));
}

RunFolder::~RunFolder() {
  if (descriptor_ >= 0) close(descriptor_);
}

void RunFolder::lock() {
  descriptor_ = open(path_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor_ < 0 && errno != EACCES)
    throw std::runtime_error(
        fmt::format("{}: can't be opened: {}", path_.string(), std::strerror(errno)));
  // Some network file systems can't lock folders; then no other run is kept out. A killed process
  // may need a moment to end.
  for (int tries = 50; descriptor_ >= 0 && flock(descriptor_, LOCK_EX | LOCK_NB) != 0; --tries) {
    if (errno != EWOULDBLOCK) break;
    if (tries == 0)
      throw io::InputError(
          path_,
          "another run or recording is at work in this folder; end that, or name another folder");
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
}

void RunFolder::clear() const {
  const std::regex half_done(
      R"(\.(soil_.*|summary\.json|journal|measures\.json)\.[0-9]+-[0-9]+\.tmp|(updates\.csv|soil\.mcap)\.part)");
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(path_, error))
    if (std::regex_match(entry.path().filename().string(), half_done))
      fs::remove(entry.path(), error);
}

void RunFolder::spare(const fs::path& input) const {
  std::error_code error;
  const fs::path file = fs::weakly_canonical(input, error);
  const std::string name = file.filename().string();
  const bool ours = is_output(name) || name == kJournalName;
  if (ours && fs::equivalent(file.parent_path(), path_, error))
    throw io::InputError(input,
                         "is an input in the folder that the run writes to, and would be "
                         "written over; name another folder");
}

void RunFolder::make() {
  std::vector<fs::path> missing;
  std::error_code error;
  fs::path at = fs::absolute(path_).lexically_normal();
  if (!at.has_filename()) at = at.parent_path();  // a trailing slash
  for (; !fs::exists(at, error) && at.has_relative_path(); at = at.parent_path())
    missing.push_back(at);
  for (auto folder = missing.rbegin(); folder != missing.rend(); ++folder) {
    fs::create_directory(*folder, error);
    if (error) {
      unmake();
      throw io::InputError(
          path_, fmt::format("can't be made a folder: {}; name another folder", error.message()));
    }
    made_.push_back(*folder);
  }
}

void RunFolder::unmake() {
  std::error_code error;
  for (auto folder = made_.rbegin(); folder != made_.rend(); ++folder) {
    if (!fs::is_empty(*folder, error) || error) return;
    fs::remove(*folder, error);
  }
  made_.clear();
}

void RunFolder::replace(const std::function<bool(const std::string&)>& writes) {
  const bool unfinished = replace_run();
  std::vector<std::string> strange;
  std::error_code none;
  for (const auto& entry : fs::directory_iterator(path_, none)) {
    const std::string name = entry.path().filename().string();
    if (!writes(name) || std::find(replaced_.begin(), replaced_.end(), name) != replaced_.end())
      continue;
    // A crash may have separated a snapshot from its record in the journal.
    (unfinished && is_periodic(name) ? replaced_ : strange).push_back(name);
  }
  if (strange.empty()) return;
  std::sort(strange.begin(), strange.end());
  throw io::InputError(path_, fmt::format("holds {}, which is in no journal there and would be "
                                          "overwritten; move it away or name another folder",
                                          fmt::join(strange, ", ")));
}

/// @return whether there is an unfinished run
bool RunFolder::replace_run() {
  const fs::path file = path_ / kJournalName;
  std::error_code none;
  if (!fs::exists(file, none)) return false;
  io::JournalContent journal;
  try {
    journal = io::read_journal(file);
  } catch (const io::InputError& e) {
    throw io::InputError(fmt::format("{}; remove the folder or name another", e.what()));
  }
  if (journal.damaged)
    throw io::InputError(
        path_, fmt::format("holds a run whose journal is damaged; `soilvdb resume {}` goes on with "
                           "what is good of it; to begin anew remove the folder or give another "
                           "--out",
                           path_.string()));
  if (!journal.ended && journal.done.updates > 0)
    throw io::InputError(
        path_, fmt::format("holds a run that isn't finished, good to {} s; `soilvdb resume {}` "
                           "goes on with it; to begin anew remove the folder or name another",
                           time_text(journal.done.time_s), path_.string()));
  replaced_ = std::move(journal.removed);
  for (const io::JournalFile& known : journal.files) replaced_.push_back(known.name);
  return !journal.ended;
}

void RunFolder::remove(const std::vector<std::string>& names) const {
  for (const std::string& name : names) {
    std::error_code error;
    if (is_output(name)) fs::remove(path_ / name, error);
    if (error)
      throw std::runtime_error(
          fmt::format("{}: can't be deleted: {}", (path_ / name).string(), error.message()));
  }
}

void RunFolder::done(const std::string& name) {
  if (std::find(files_.begin(), files_.end(), name) == files_.end()) files_.push_back(name);
}

void RunFolder::forget(const std::string& name) { std::erase(files_, name); }

bool is_periodic(const std::string& name) {
  return is_output(name) && name.ends_with(".vdb") && name != kFinalName;
}

bool is_output(const std::string& name) {
  if (name.find('/') != name.npos) return false;
  return name.starts_with("soil_") || name == kSummaryName || name == kUpdatesName ||
         name == kMcapName;
}

}  // namespace soilvdb::tools
