// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The work of a run: the update loop, its journal, and the files it leaves. The same whether it
// begins or goes on.
#pragma once

#include <tbb/global_control.h>
#include <tbb/info.h>
#include <tbb/task_arena.h>

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "io/journal/report.h"
#include "soilvdb/io/journal.h"
#include "soilvdb/io/scenario.h"
#include "soilvdb/io/site.h"
#include "tools/run/progress.h"
#include "tools/run/run_config.h"
#include "tools/run/run_folder.h"
#include "tools/run/run_mcap.h"
#include "tools/run/schedule.h"
#include "tools/run/site_state.h"
#include "tools/run/snapshot_schedule.h"
#include "tools/run/snapshot_writer.h"

namespace soilvdb::tools {

/// What a run begins or goes on with.
struct Start {
  std::unique_ptr<SiteState> state;
  std::uint64_t updates = 0;  ///< that it has seen
  std::string snapshot = {};  ///< name of the one that it was read from, and what that goes on from
  std::optional<io::SnapshotParent> parent = {};
};

/// One run, from checked input to its last file.
class Run {
 public:
  using Clock = std::chrono::steady_clock;

  /// @param folder outlives the run
  /// @param begin when the command was given
  /// @throw io::InputError if there is nothing to dig before a bad row
  Run(RunConfig config, io::Scenario scenario, RunFolder& folder, Start start, int threads,
      Clock::time_point begin);

  /// Digs from the beginning of the motion to its end, to a bad row, or to a signal.
  /// @throw io::InputError if the first update finds the input wrong; then nothing is written
  /// @throw std::runtime_error telling what is safe.
  void run();

  /// The same from where a journal ends: what it holds is not dug again where `start` has seen it,
  /// and must come out the same where it hasn't. Of a run that is finished the files are made again
  /// that are missing from `before`.
  /// @param before its files are those that are good
  void resume(const io::JournalContent& before);

 private:
  /// Sums of the steps of a machine's update.
  struct UnderWay {
    std::int64_t ns = 0, cut_samples = 0, spilled = 0, slid = 0;
  };

  void guarded(void (Run::*work)());
  void replay_and_dig();
  void replay(io::JournalReader& reader);
  std::vector<Update> move_on(std::span<const Step> batch, std::span<const Move> moves);
  void come_to_rest();
  std::runtime_error differs(std::uint64_t count, const io::JournalUpdate& update,
                             const UpdateDiffers& why) const;
  void dig();
  void begin_journal();
  void book(const io::JournalUpdate& update);
  std::vector<Step> next_batch(const std::function<bool()>& take);
  const std::string& name_of(std::size_t mover) const;
  bool all_came_to(const Step& now) const;
  void after(const Step& now);
  void begin_recording();
  void record_load(const io::JournalUpdate& update, const UnderWay& sum);
  bool ground_would_be_due(double time_s) const;
  std::vector<Coord3> take_changed(std::vector<Coord3>& taken);
  void go_on_with_snapshots();
  void write_periodic(const std::string& name);
  io::SnapshotInfo snapshot_info() const;
  const io::JournalFile* intact(const std::string& name) const;
  template <typename F>
  void write_final(const std::string& name, F write);
  void finish();
  void write_mesh();
  void write_raster();
  void summarise();
  void warn_of_soil();
  std::string safe(const std::string& before_going_on = "");

  Clock::time_point begin_;
  RunConfig config_;
  io::Scenario scenario_;
  RunFolder& folder_;
  Start start_;
  SiteState& state_;
  Tracker& tracker_;
  Schedule schedule_;
  std::optional<Step> step_;  ///< the next one
  SnapshotSchedule snapshots_;
  std::optional<io::JournalContent> before_;  ///< of a run that is gone on with
  std::optional<io::JournalWriter> journal_;  ///< from the first update on
  SnapshotWriter writer_;
  std::optional<io::UpdatesCsv> csv_;
  std::optional<RunMcap> mcap_;
  std::vector<Coord3> for_snapshot_, for_mcap_;  ///< chunks that changed since the last
  std::vector<std::int64_t> cut_samples_;        ///< of each machine so far, for that
  io::Summary summary_;
  Progress progress_;
  std::vector<UnderWay> under_way_;      // of each machine and pour
  std::vector<std::int64_t> most_load_;  // that each has held
  double time_s_ = 0;                    ///< how far the motion has come
  bool stopped_ = false;
};

/// Has the run whose journal this is left all of its recording, as far as so many updates, or none
/// to leave?
bool recording_is_whole(const io::Scenario& scenario, const io::JournalContent& journal,
                        std::int64_t updates);

/// The scenario a run is to dig, read and checked.
/// @throw io::InputError
io::Scenario read_to_dig(const RunOptions& options);

/// Is it the name of a file that such a run writes beside its journal?
bool writes(const io::Scenario& scenario, const RunOptions& options, const std::string& name);

/// Adds to its warnings where machines begin below the ground as it is then.
void warn_of_underground(io::Scenario& scenario, const Soil& soil);

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
