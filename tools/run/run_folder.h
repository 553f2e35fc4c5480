// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The folder of a run: it is checked first, made late, and left unchanged if the input is wrong.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace soilvdb::tools {

/// The constructor checks that the folder exists or can be made, without making it.
class RunFolder {
 public:
  /// @throw io::InputError if it is not and can't become a folder, or is not writable.
  explicit RunFolder(std::filesystem::path path);
  ~RunFolder();
  RunFolder(const RunFolder&) = delete;
  RunFolder& operator=(const RunFolder&) = delete;

  const std::filesystem::path& path() const { return path_; }

  /// @throw io::InputError if the run would write over `input`.
  void spare(const std::filesystem::path& input) const;

  /// Makes the folder. @throw io::InputError if that fails.
  void make();

  /// Locks the folder against other runs.
  /// @throw io::InputError if another run uses it; std::runtime_error if it can't be opened.
  void lock();

  /// Removes partial files of a crashed run.
  void clear() const;

  /// Undoes make(): removes the folders that it made, if they are still empty.
  void unmake();

  /// Prepares to replace the folder's run, if there is one.
  /// @param writes does the new run write a file of this name?
  /// @throw io::InputError if that run has dug and is not finished, because `soilvdb resume` can
  ///        continue it; or if the new run would overwrite a file of no run.
  void replace(const std::function<bool(const std::string&)>& writes);
  /// The files of that run.
  const std::vector<std::string>& replaced() const { return replaced_; }

  /// Removes some of a run's files beside its journal, and no other files.
  /// @throw std::runtime_error naming the file and the cause.
  void remove(const std::vector<std::string>& names) const;

  /// Marks a file as complete and on disk.
  void done(const std::string& name);
  /// Marks a file as deleted.
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

/// Is it the name of a periodic snapshot?
bool is_periodic(const std::string& name);
/// Is it the name of a file that any run writes beside its journal?
bool is_output(const std::string& name);

}  // namespace soilvdb::tools
