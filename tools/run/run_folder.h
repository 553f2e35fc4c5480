// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The folder a run writes to: checked first, made late, and left as it was when a run turns out to
// have wrong input.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace soilvdb::tools {

/// Checks on construction that the folder is there or could be made, without making it.
class RunFolder {
 public:
  /// @throw io::InputError if it isn't a folder and can't become one, or can't be written to.
  explicit RunFolder(std::filesystem::path path);
  ~RunFolder();
  RunFolder(const RunFolder&) = delete;
  RunFolder& operator=(const RunFolder&) = delete;

  const std::filesystem::path& path() const { return path_; }

  /// @throw io::InputError if the run would write over `input`.
  void spare(const std::filesystem::path& input) const;

  /// Makes the folder. @throw io::InputError if that can't be done.
  void make();

  /// Keeps other runs out of the folder.
  /// @throw io::InputError if another run is at work in it; std::runtime_error if it can't be
  /// opened.
  void lock();

  /// Clears it of what a run that crashed left half done.
  void clear() const;

  /// Takes back make(): removes the folders it made, if they are still empty.
  void unmake();

  /// Prepares to replace the run that the folder holds, if it holds one.
  /// @param writes is it the name of a file that the new run writes?
  /// @throw io::InputError if that has dug and isn't finished: `soilvdb resume` can go on with it;
  /// and if the new run would write over a file that is there and of no run.
  void replace(const std::function<bool(const std::string&)>& writes);
  /// The files of that run.
  const std::vector<std::string>& replaced() const { return replaced_; }

  /// Removes those of the files that a run writes beside its journal; others are left alone.
  /// @throw std::runtime_error naming the file and the cause.
  void remove(const std::vector<std::string>& names) const;

  /// The file `name` is whole and on disk.
  void done(const std::string& name);
  /// It was deleted.
  void forget(const std::string& name);
  const std::vector<std::string>& files() const { return files_; }

 private:
  bool replace_run();

  std::filesystem::path path_;
  std::vector<std::filesystem::path> made_;  ///< outermost first
  std::vector<std::string> replaced_, files_;
  int descriptor_ = -1;  ///< holds the lock
};

inline constexpr const char* kFinalName = "soil_final.vdb";
inline constexpr const char* kSummaryName = "summary.json";
inline constexpr const char* kJournalName = "journal";
inline constexpr const char* kUpdatesName = "updates.csv";
inline constexpr const char* kMcapName = "soil.mcap";

/// Is it the name of a snapshot on the way?
bool is_periodic(const std::string& name);
/// Is it that of any file that a run writes beside its journal?
bool is_output(const std::string& name);

}  // namespace soilvdb::tools
