// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The files of a run: snapshots on the way, the rest at the end.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cstdio>

#include "io/file/atomic_file.h"
#include "soilvdb/io/checksum.h"
#include "soilvdb/io/mesh_file.h"
#include "soilvdb/io/picture.h"
#include "soilvdb/io/snapshot.h"
#include "soilvdb/mesher.h"
#include "tools/run/books.h"
#include "tools/run/outputs.h"
#include "tools/run/run.h"
#include "tools/run/text.h"

namespace soilvdb::tools {
/// A file of now that the journal before knows and that is good, or null.
const io::JournalFile* Run::intact(const std::string& name) const {
  if (!before_) return nullptr;
  const auto count = static_cast<std::uint64_t>(summary_.updates.count());
  for (const io::JournalFile& file : before_->files)
    if (file.name == name && file.updates == count) return &file;
  return nullptr;
}

io::SnapshotInfo Run::snapshot_info() const {
  io::SnapshotInfo info = state_.snapshot_info(time_s_);
  info.scenario = scenario_.name;
  return info;
}

/// Those of the run before that lead to where the ground is.
void Run::go_on_with_snapshots() {
  std::vector<io::JournalFile> files;
  for (const io::JournalFile& file : before_->files) {
    const bool seen = file.updates < start_.updates || file.name == start_.snapshot;
    if (seen && is_periodic(file.name)) files.push_back(file);
  }
  if (start_.updates > 0) tracker_.take_changed();  // no recording, then
  writer_.go_on(std::move(files), start_.parent);
  folder_.remove(before_->removed);
  writer_.delete_old(*journal_);
}

/// A snapshot on the way, unless it is there already.
void Run::write_periodic(const std::string& name) {
  const auto count = static_cast<std::uint64_t>(summary_.updates.count());
  const io::JournalFile* there = intact(name);
  if (count >= start_.updates && name != start_.snapshot) {
    const io::JournalFile file = there ? *there : io::JournalFile{name, count};
    const std::vector<Coord3> changed =
        scenario_.incremental_snapshots ? take_changed(for_snapshot_) : std::vector<Coord3>();
    writer_.write(file, there != nullptr, changed, state_.site, snapshot_info(), *journal_);
  } else if (there) {
    folder_.done(name);
  }
}

/// Calls `write(path)` for a file that is written once, at the end, unless it is there already.
template <typename F>
void Run::write_final(const std::string& name, F write) {
  if (!intact(name)) {
    const std::filesystem::path file = folder_.path() / name;
    write(file);
    const io::FileDigest digest = io::file_digest(file);
    journal_->add(io::JournalFile{name, static_cast<std::uint64_t>(summary_.updates.count()),
                                  digest.size, digest.crc});
  }
  folder_.done(name);
}

/// Everything that is written once, at the end.
void Run::finish() {
  writer_.finish();
  journal_->flush();  // what is written over here is outdated by it
  const Soil& soil = *state_.site.soil;
  write_final(kUpdatesName, [&](const auto&) { csv_->close(); });
  csv_.reset();
  if (mcap_)
    write_final(kMcapName, [&](const auto&) { mcap_->close(time_s_, take_changed(for_mcap_)); });
  else if (scenario_.mcap)
    folder_.done(kMcapName);
  mcap_.reset();
  if (config_.options.snapshots)
    write_final(kFinalName,
                [&](const auto& file) { io::write_snapshot(file, state_.site, snapshot_info()); });
  const bool mesh = config_.options.mesh && scenario_.mesh;
  if (soil.chunks().empty()) {
    say(fmt::format(
        "warning: {}{}",
        scenario_.machines.empty() ? "no soil came to lie on the ground" : "no bucket met any soil",
        mesh || scenario_.raster_cell_m ? "; there is no ground to make meshes or rasters of"
                                        : ""));
  } else {
    if (mesh)
      write_final("soil_final." + *scenario_.mesh, [&](const auto& file) {
        io::write_mesh(file, mesh_all(soil), soil.origin(), state_.site.crs_wkt);
      });
    if (scenario_.raster_cell_m)
      write_final("soil_final.tif", [&](const auto& file) {
        write_surface_raster(file, soil, io::footprint(soil, false), *scenario_.raster_cell_m,
                             state_.site.crs_wkt);
      });
  }
  summarise();
  summary_.files = folder_.files();
  summary_.files.insert(summary_.files.end(), {kJournalName, kSummaryName});
  journal_->flush();
  summary_.acknowledged_updates = journal_->acknowledged().updates;
  summary_.acknowledged_s = journal_->acknowledged().time_s;
  summary_.total_s = std::chrono::duration<double>(Clock::now() - begin_).count();
  write_final(kSummaryName,
              [&](const auto& file) { io::write_atomically(file, io::to_json(summary_)); });
  if (!stopped_ && !(before_ && before_->ended)) journal_->add(io::JournalEnd{});
  journal_->flush();
}

void Run::summarise() {
  Books books{*state_.site.soil,        scenario_.soil,     tracker_.total(), tracker_.site(), {},
              config_.change_before_m3, config_.mass_before};
  for (std::size_t i = 0; i < scenario_.machines.size(); ++i) {
    const io::MachineInput& machine = scenario_.machines[i];
    books.machines.push_back(
        {machine.name, machine.bucket, tracker_.ledger(i), machine.motion.bad_rows().count});
  }
  put_books(books, summary_);
  if (scenario_.soil) warn_of_soil();
}

/// What is on disk, for messages: "safe in out/dig: soil_1.vdb, soil_2.vdb, journal; `soilvdb
/// resume out/dig` goes on from 2.5 s".
std::string Run::safe(const std::string& before_going_on) {
  if (!journal_) return "nothing of this run is on disk";
  try {
    writer_.finish();
  } catch (const std::exception&) {  // why we are asked, or as bad
  }
  try {
    journal_->flush();
  } catch (const std::exception&) {  // the disk that is full may be why we are asked
  }
  const io::JournalExtent reached = journal_->acknowledged();
  std::vector<std::string> files = folder_.files();
  files.push_back(kJournalName);
  const std::string folder = folder_.path().string();
  return fmt::format("safe in {}: {}; {}`soilvdb resume {}` goes on from {} s", folder,
                     fmt::join(files, ", "), before_going_on, folder, time_text(reached.time_s));
}

}  // namespace soilvdb::tools
