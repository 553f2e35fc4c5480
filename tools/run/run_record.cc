// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a run records as MCAP while it digs. A run that is gone on with digs its journal again from
// the beginning for that, unless the recording is whole: the ground that it showed is in no
// snapshot.
#include <algorithm>
#include <iterator>
#include <utility>

#include "soilvdb/chunk_range.h"
#include "tools/run/run.h"

namespace soilvdb::tools {

bool recording_is_whole(const io::Scenario& scenario, const io::JournalContent& journal,
                        std::int64_t updates) {
  return !scenario.mcap ||
         std::any_of(journal.files.begin(), journal.files.end(), [&](const io::JournalFile& file) {
           return file.name == kMcapName && static_cast<std::int64_t>(file.updates) == updates;
         });
}

void Run::begin_recording() {
  if (!scenario_.mcap || start_.updates > 0) return;
  mcap_.emplace(folder_.path() / kMcapName, scenario_, state_.site, schedule_.begin_s(),
                schedule_.end_s());
  take_changed(for_mcap_);  // it begins with all that there is
  cut_samples_.resize(scenario_.machines.size());
}

void Run::record_load(const io::JournalUpdate& update, const UnderWay& sum) {
  if (!mcap_ || update.machine >= cut_samples_.size()) return;
  SoilMcap::Load load;
  load.bucket_m3 = state_.loose_m3(update.bucket_samples);
  load.cut_m3 = state_.volume_m3(cut_samples_[update.machine] += sum.cut_samples);
  if (scenario_.soil) load.bucket_kg = state_.kg(update.bucket_samples);
  mcap_->load(update.end_s, update.machine, load);
}

bool Run::ground_would_be_due(double time_s) const {
  return snapshots_.would_be_due(time_s) || (mcap_ && mcap_->would_be_due(time_s));
}

/// What changed for one of those who want to know, all of whom are told.
std::vector<Coord3> Run::take_changed(std::vector<Coord3>& taken) {
  const std::vector<Coord3> changed = tracker_.take_changed();
  const auto add_to = [&](std::vector<Coord3>& all) {
    std::vector<Coord3> sum;
    std::set_union(all.begin(), all.end(), changed.begin(), changed.end(), std::back_inserter(sum),
                   before);
    all = std::move(sum);
  };
  if (scenario_.incremental_snapshots) add_to(for_snapshot_);
  if (mcap_) add_to(for_mcap_);
  return std::exchange(taken, {});
}

}  // namespace soilvdb::tools
