// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run_folder.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <algorithm>

#include "io/error.h"

namespace soilvdb::tools {

namespace fs = std::filesystem;

RunFolder::RunFolder(fs::path path) : path_(std::move(path)) {
  std::error_code error;
  fs::path there = fs::absolute(path_, error).lexically_normal();
  while (!fs::exists(there, error) && there.has_relative_path()) there = there.parent_path();
  if (!fs::is_directory(there, error))
    throw io::InputError(path_, fmt::format("can't be made, '{}' is not a folder; give another "
                                            "--out",
                                            there.string()));
  if (access(there.c_str(), W_OK | X_OK) != 0)
    throw io::InputError(
        path_, fmt::format("'{}' can't be written to; give another --out", there.string()));
}

void RunFolder::spare(const fs::path& input) const {
  std::error_code error;
  const std::string name = input.filename().string();
  const bool ours = name.starts_with("soil_") || name == kSummaryName || name == kUpdatesName;
  if (ours && fs::equivalent(input.parent_path().empty() ? "." : input.parent_path(), path_, error))
    throw io::InputError(input,
                         "is an input in the folder that the run writes to, and would be "
                         "written over; give another --out");
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
          path_, fmt::format("can't be made a folder: {}; give another --out", error.message()));
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

fs::path RunFolder::begin(const std::string& name) {
  if (!begun_) {
    std::error_code error;
    fs::remove(path_ / kSummaryName, error);
    begun_ = true;
  }
  return path_ / name;
}

void RunFolder::done(const std::string& name) {
  if (std::find(files_.begin(), files_.end(), name) == files_.end()) files_.push_back(name);
}

std::string RunFolder::safe() const {
  if (files_.empty()) return "nothing of this run is on disk";
  return fmt::format("safe in {}: {}", path_.string(), fmt::join(files_, ", "));
}

}  // namespace soilvdb::tools
