// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A run's files besides its journal and periodic snapshots, and its report.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "io/journal/report.h"
#include "soilvdb/change_follower.h"
#include "soilvdb/io/journal.h"
#include "soilvdb/io/scenario.h"
#include "tools/run/recorder.h"
#include "tools/run/run_config.h"
#include "tools/run/run_folder.h"
#include "tools/run/site_state.h"
#include "tools/run/soil_mcap.h"

namespace soilvdb::tools {

/// All constructor arguments must outlive it.
class RunOutputs {
 public:
  using Clock = std::chrono::steady_clock;
  /// The time range of the run.
  struct Span {
    double begin_s = 0, end_s = 0;
  };

  /// @param records_ground is the run's first ground known? An MCAP begins with it
  /// @param begin when the command began
  /// @throw std::runtime_error if a file can't be written, as the other members do
  RunOutputs(const RunConfig& config, const io::Scenario& scenario, RunFolder& folder,
             SiteState& site, Span span, bool records_ground, int threads, Clock::time_point begin);

  void add(const io::JournalUpdate& update);
  /// Number of added updates.
  std::int64_t updates() const { return summary_.updates.count(); }

  /// Would the ground be recorded at this time, if all machines have reached it?
  bool would_be_due(double time_s) const { return mcap_ && mcap_->would_be_due(time_s); }
  /// Records the ground if that is due.
  void look(double time_s);

  /// Writes the final files.
  /// @param known files that are intact already
  /// @param time_s time that the run reached
  /// @param stopped before its end
  void finish(Recorder& recorder, std::span<const io::JournalFile> known, double time_s,
              bool stopped);
  /// Removes partial files.
  void drop();
  const io::Summary& summary() const { return summary_; }

 private:
  /// Sums over the steps of an update.
  struct PartialUpdate {
    std::int64_t ns = 0, cut_samples = 0, spilled = 0, slid = 0;
  };
  template <typename F>
  void write(const std::string& name, F write_to);
  void record_load(const io::JournalUpdate& update, const PartialUpdate& sum);
  const std::string& name_of(std::size_t mover) const;
  void write_ground(double time_s);
  void summarise(bool stopped);
  void warn_of_soil(bool stopped) const;

  const RunConfig& config_;
  const io::Scenario& scenario_;
  RunFolder& folder_;
  SiteState& site_;
  const Clock::time_point begin_;
  std::optional<io::UpdatesCsv> csv_;
  std::optional<SoilMcap> mcap_;
  std::optional<ChangeFollower> changes_;  // since the last record of the ground
  std::vector<std::int64_t> cut_samples_;  // by machine, for the MCAP
  std::vector<PartialUpdate> under_way_;   // by machine and pour
  std::vector<std::int64_t> most_load_;    // by machine
  io::Summary summary_;
  Recorder* recorder_ = nullptr;            // from finish() on
  std::span<const io::JournalFile> known_;  // from finish() on
};

}  // namespace soilvdb::tools
