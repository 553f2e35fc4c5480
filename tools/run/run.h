// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A run: motions that a site is moved along, what records it, and the files that it leaves. The
// same whether it begins or goes on.
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

/// One run, from checked input to its last file.
class Run {
 public:
  using Clock = RunOutputs::Clock;

  /// @param folder outlives the run
  /// @param begin when the command was given
  /// @throw io::InputError if there is nothing to dig before a bad row
  Run(RunConfig config, io::Scenario scenario, RunFolder& folder, ResumePoint start, int threads,
      Clock::time_point begin);

  /// Digs from the beginning of the motion to its end, to a bad row, or to a signal.
  /// @throw io::InputError if the first update finds the input wrong; then nothing is written
  /// @throw std::runtime_error telling what is safe.
  void run();

  /// The same from where a journal ends: what it holds is not dug again where `start` has seen it,
  /// and must come out the same where it hasn't. Of a run that is finished the files are made again
  /// that are missing from `before`.
  /// @param before its files are those that are good
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
  io::JournalContent before_;  ///< of a run that is gone on with
  double time_s_;              ///< how far the motion has come
  bool stopped_ = false;
};

/// Has the run whose journal this is left all of its recording, as far as so many updates, or none
/// to leave?
bool recording_is_whole(const io::Scenario& scenario, const io::JournalContent& journal,
                        std::uint64_t updates);

/// The scenario a run is to dig, read and checked.
/// @throw io::InputError
io::Scenario read_to_dig(const RunOptions& options);

/// Is it the name of a file that such a run writes beside its journal?
bool writes(const io::Scenario& scenario, const RunOptions& options, const std::string& name);

/// Adds to its warnings where machines begin below the ground as it is then.
void warn_of_underground(io::Scenario& scenario, const Ground& ground);

/// Calls `f(threads)` where it has so many threads to run on; 0: one per core.
template <typename F>
void with_threads(int threads, F f) {
  if (threads <= 0) threads = tbb::info::default_concurrency();
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                  static_cast<std::size_t>(threads));
  tbb::task_arena arena(threads);
  arena.execute([&] { f(threads); });
}

}  // namespace soilvdb::tools
