// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/run_outputs.h"

#include <fmt/format.h>

#include <algorithm>

#include "io/file/atomic_file.h"
#include "io/file/text.h"
#include "soilvdb/io/checksum.h"
#include "soilvdb/io/mesh_file.h"
#include "soilvdb/io/picture.h"
#include "soilvdb/io/snapshot.h"
#include "soilvdb/mesher.h"
#include "tools/run/outputs.h"
#include "tools/run/run_totals.h"
#include "tools/run/text.h"

namespace soilvdb::tools {
namespace {

constexpr double kNsPerUs = 1e3;

double seconds_since(RunOutputs::Clock::time_point begin) {
  return std::chrono::duration<double>(RunOutputs::Clock::now() - begin).count();
}

}  // namespace

RunOutputs::RunOutputs(const RunConfig& config, const io::Scenario& scenario, RunFolder& folder,
                       SiteState& site, Span span, bool records_ground, int threads,
                       Clock::time_point begin)
    : config_(config),
      scenario_(scenario),
      folder_(folder),
      site_(site),
      begin_(begin),
      under_way_(scenario.machines.size() + scenario.pours.size()) {
  csv_.emplace(folder_.path() / kUpdatesName, scenario_.soil.has_value(), scenario_.force);
  if (scenario_.soil) most_load_.resize(under_way_.size());
  summary_.scenario = scenario_.name;
  summary_.voxel_size_m = scenario_.voxel_size_m;
  summary_.threads = threads;
  summary_.open_s = seconds_since(begin_);
  if (!scenario_.mcap || !records_ground) return;
  std::vector<std::string> names;
  for (const io::MachineInput& machine : scenario_.machines) names.push_back(machine.name);
  mcap_.emplace(folder_.path() / kMcapName, *site_.site.ground, site_.site.crs_wkt, names,
                span.begin_s, span.end_s, scenario_.force);
  mcap_->ground(span.begin_s);
  changes_.emplace(*site_.site.ground);
  changes_->take();  // the recording begins with all ground
  cut_samples_.resize(scenario_.machines.size());
}

void RunOutputs::add(const io::JournalUpdate& update) {
  if (update.kind == io::JournalUpdate::Kind::kSurvey) {
    summary_.updates.add(static_cast<double>(update.ns) / kNsPerUs);
    return;
  }
  PartialUpdate& sum = under_way_[update.machine];
  sum.ns += update.ns;
  sum.cut_samples += update.cut_samples;
  sum.spilled += update.spilled;
  sum.slid += update.slid;
  if (!update.ends_update) return;
  const double us = static_cast<double>(sum.ns) / kNsPerUs;
  summary_.updates.add(us);
  std::optional<io::UpdatesCsv::Moved> moved;
  if (scenario_.soil) {
    most_load_[update.machine] = std::max(most_load_[update.machine], update.bucket_samples);
    moved = {site_.kg(update.bucket_samples), site_.loose_m3(sum.spilled),
             site_.loose_m3(sum.slid)};
  }
  record_load(update, sum);
  csv_->add(update.end_s, name_of(update.machine), site_.volume_m3(sum.cut_samples),
            site_.loose_m3(update.bucket_samples), us, moved, update.force);
  sum = {};
}

const std::string& RunOutputs::name_of(std::size_t mover) const {
  const std::size_t machines = scenario_.machines.size();
  return mover < machines ? scenario_.machines[mover].name : scenario_.pours[mover - machines].name;
}

void RunOutputs::record_load(const io::JournalUpdate& update, const PartialUpdate& sum) {
  if (!mcap_ || update.machine >= cut_samples_.size()) return;
  SoilMcap::Load load;
  load.bucket_m3 = site_.loose_m3(update.bucket_samples);
  load.cut_m3 = site_.volume_m3(cut_samples_[update.machine] += sum.cut_samples);
  if (scenario_.soil) load.bucket_kg = site_.kg(update.bucket_samples);
  mcap_->load(update.end_s, update.machine, load);
  if (!update.force) return;
  const std::optional<MachineState> last = site_.last(update.machine);  // batches are single steps
  mcap_->wrench(update.end_s, update.machine, last->pose, *update.force);
}

void RunOutputs::look(double time_s) {
  if (!mcap_ || !mcap_->due(time_s)) return;
  mcap_->changed(changes_->take());
  mcap_->ground(time_s);
}

void RunOutputs::drop() {
  csv_.reset();
  mcap_.reset();
}

/// Calls `write_to(path)` for a final file, unless it is intact already.
template <typename F>
void RunOutputs::write(const std::string& name, F write_to) {
  const auto updates = static_cast<std::uint64_t>(summary_.updates.count());
  const bool there = std::any_of(known_.begin(), known_.end(), [&](const io::JournalFile& file) {
    return file.name == name && file.updates == updates;
  });
  if (!there) {
    const std::filesystem::path file = folder_.path() / name;
    write_to(file);
    const io::FileDigest digest = io::file_digest(file);
    recorder_->journal().add(io::JournalFile{name, updates, digest.size, digest.crc});
  }
  folder_.done(name);
}

void RunOutputs::finish(Recorder& recorder, std::span<const io::JournalFile> known, double time_s,
                        bool stopped) {
  recorder_ = &recorder;
  known_ = known;
  recorder.flush();  // files that are overwritten here become outdated with it
  write(kUpdatesName, [&](const auto&) { csv_->close(); });
  csv_.reset();
  if (mcap_)
    write(kMcapName, [&](const auto&) {
      mcap_->changed(changes_->take());
      mcap_->close(time_s);
    });
  else if (scenario_.mcap)
    folder_.done(kMcapName);
  mcap_.reset();
  write_ground(time_s);
  summarise(stopped);
  summary_.files = folder_.files();
  summary_.files.insert(summary_.files.end(), {kJournalName, kSummaryName});
  recorder.flush();
  summary_.acknowledged_updates = recorder.acknowledged().updates;
  summary_.acknowledged_s = recorder.acknowledged().time_s;
  summary_.total_s = seconds_since(begin_);
  write(kSummaryName, [&](const auto& file) { io::write_atomically(file, io::to_json(summary_)); });
}

void RunOutputs::write_ground(double time_s) {
  const io::Site& site = site_.site;
  if (config_.options.snapshots)
    write(kFinalName, [&](const auto& file) {
      io::SnapshotInfo info = site_.snapshot_info(time_s);
      info.scenario = scenario_.name;
      io::write_snapshot(file, site, info);
    });
  const bool mesh = config_.options.mesh && scenario_.mesh;
  if (site.ground->chunks().empty()) {
    say(fmt::format(
        "warning: {}{}",
        scenario_.machines.empty() ? "no soil came to lie on the ground" : "no bucket met any soil",
        mesh || scenario_.raster_cell_m ? "; there is no ground to make meshes or rasters of"
                                        : ""));
    return;
  }
  if (mesh)
    write("soil_final." + *scenario_.mesh, [&](const auto& file) {
      io::write_mesh(file, mesh_all(*site.ground), site.ground->origin(), site.crs_wkt);
    });
  if (scenario_.raster_cell_m)
    write("soil_final.tif", [&](const auto& file) {
      Sigmas sigmas;
      if (!scenario_.scans.empty()) sigmas = [this](auto... all) { site_.sigmas(all...); };
      write_surface_raster(file, *site.ground, io::footprint(*site.ground, false),
                           *scenario_.raster_cell_m, site.crs_wkt, sigmas);
    });
}

void RunOutputs::summarise(bool stopped) {
  const Tracker& tracker = site_.tracker();
  RunTotals totals{*site_.site.ground,
                   scenario_.soil,
                   tracker.total(),
                   tracker.mass_balance(),
                   {},
                   config_.change_before_m3,
                   config_.mass_before,
                   {}};
  if (!scenario_.scans.empty()) totals.surveyed = tracker.surveyed();
  for (std::size_t i = 0; i < scenario_.machines.size(); ++i) {
    const io::MachineInput& machine = scenario_.machines[i];
    totals.machines.push_back(
        {machine.name, machine.bucket, tracker.ledger(i), machine.motion.bad_rows().count, {}});
    if (const auto lips = site_.lip_errors_m(); !lips.empty())
      totals.machines.back().lip_error_m = lips[i];
  }
  put_totals(totals, summary_);
  if (scenario_.soil) warn_of_soil(stopped);
  for (const std::string& warning : site_.warnings)
    say(fmt::format("warning: {}: {}", scenario_.file.string(), warning));
  if (site_.doubtful_scans > 0)
    say(fmt::format("warning: {}{}", site_.doubt,
                    site_.doubtful_scans > 1
                        ? fmt::format(" So of {} more scans", site_.doubtful_scans - 1)
                        : ""));
}

void RunOutputs::warn_of_soil(bool stopped) const {
  const Tracker& tracker = site_.tracker();
  if (const std::int64_t lost_off_terrain = tracker.mass_balance().lost_off_terrain;
      lost_off_terrain > 0)
    say(fmt::format("warning: {} m³ fell where the terrain has no ground and are lost to the site",
                    number(site_.loose_m3(lost_off_terrain))));
  for (std::size_t i = 0; i < scenario_.machines.size(); ++i) {
    const Ledger& ledger = tracker.ledger(i);
    // A tipped bucket keeps less than that. run warns separately of buckets that never dump.
    const Bucket& bucket = scenario_.machines[i].bucket;
    const bool dumps = !bucket.profile.empty() || bucket.dump_angle_rad;
    if (!stopped && dumps && ledger.load > most_load_[i] / 2)
      say(fmt::format(
          "warning: {} carries its load to the end, {} m³; it was not tipped far enough "
          "to dump that",
          io::printable(scenario_.machines[i].name), number(ledger.bucket_m3())));
  }
}

}  // namespace soilvdb::tools
