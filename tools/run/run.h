// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A run, new or continued: its motions, its record, and its output files.
#pragma once

#include <tbb/global_control.h>
#include <tbb/info.h>
#include <tbb/task_arena.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "soilvdb/io/journal.h"
#include "soilvdb/io/scenario.h"
#include "tools/run/progress.h"
#include "tools/run/recorder.h"
#include "tools/run/run_config.h"
#include "tools/run/run_folder.h"
#include "tools/run/run_outputs.h"
#include "tools/run/schedule.h"
#include "tools/run/site_state.h"

namespace soilvdb::tools {

class Run {
 public:
  using Clock = RunOutputs::Clock;

  /// @param folder must outlive the run
  /// @param begin when the command began
  /// @throw io::InputError if there is nothing to dig before a bad row
  Run(RunConfig config, io::Scenario scenario, RunFolder& folder, ResumePoint start, int threads,
      Clock::time_point begin);

  /// Digs from the beginning of the motion to its end, to a bad row, or to a signal.
  /// @throw io::InputError, with nothing written, if the first update finds the input wrong
  /// @throw std::runtime_error with the files that are safe.
  void run();

  /// Continues a journal: its updates are not dug again if `start` contains them, else they must
  /// give the same results. Of a finished run, files are restored that `before` lacks.
  /// @param before lists intact files only
  void resume(io::JournalContent before);

 private:
  void guarded(void (Run::*work)());
  void replay_and_dig();
  void dig();
  void begin_recording();
  std::vector<Step> next_batch();
  bool ends_batch(const Step& now) const;
  bool all_came_to(const Step& now) const;
  void after(const Step& now);
  void finish();
  std::string safe(const std::string& before_going_on = "");

  RunConfig config_;
  io::Scenario scenario_;
  RunFolder& folder_;
  ResumePoint start_;
  SiteState& site_;
  Schedule schedule_;
  std::optional<Step> step_;  ///< the next one
  Recorder recorder_;
  RunOutputs outputs_;
  Progress progress_;
  io::JournalContent before_;  ///< of a continued run
  double time_s_;              ///< time that the motion has reached
  bool stopped_ = false;
};

/// Is all of a run's recording on disk up to this number of updates, or does it have none?
bool recording_is_whole(const io::Scenario& scenario, const io::JournalContent& journal,
                        std::uint64_t updates);

/// Reads and checks the scenario of a run.
/// @throw io::InputError
io::Scenario read_to_dig(const RunOptions& options);

/// Does such a run write a file of this name beside its journal?
bool writes(const io::Scenario& scenario, const RunOptions& options, const std::string& name);

/// Adds a warning for each bucket that is small beside the voxels.
void warn_of_voxels(io::Scenario& scenario);
/// Adds a warning for each machine that begins below the present ground.
void warn_of_underground(io::Scenario& scenario, const Ground& ground);

/// Calls `f(threads)` with this number of threads; 0: one per core.
template <typename F>
void with_threads(int threads, F f) {
  if (threads <= 0) threads = tbb::info::default_concurrency();
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                  static_cast<std::size_t>(threads));
  tbb::task_arena arena(threads);
  arena.execute([&] { f(threads); });
}

}  // namespace soilvdb::tools
