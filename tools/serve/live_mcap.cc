// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/live_mcap.h"

#include <fmt/format.h>

#include <atomic>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <utility>

#include "tools/run/run_folder.h"
#include "tools/run/text.h"

namespace soilvdb::tools {
namespace {

namespace fs = std::filesystem;

constexpr std::chrono::milliseconds kEvery{500};
constexpr std::chrono::seconds kMapEvery{1};
/// Chunks whose blocks are written at once: the rest, and loads that come meanwhile, don't wait.
constexpr std::size_t kMostChunks = 32;

fs::path free_name(const fs::path& folder) {
  const fs::path first = folder / kMcapName;
  fs::path file = first;
  for (int i = 1; fs::exists(file); ++i)
    file = folder / fmt::format("{}_{}{}", first.stem().string(), i, first.extension().string());
  return file;
}

SoilMcap::Site site_of(const Session& session) {
  SoilMcap::Site all{session.origin(), session.voxel_size_m(), session.site().crs_wkt};
  for (const SessionMachine& machine : session.machines()) all.machines.push_back(machine.name);
  return all;
}

}  // namespace

struct LiveMcap::Writer {
  void write(double time_s, std::span<const Coord3> changed, std::span<const LoadAt> loads,
             bool last) {
    if (failed) return;
    try {
      if (!mcap) mcap.emplace(free_name(folder), site, copy, time_s);
      for (const LoadAt& at : loads) mcap->load(at.time_s, at.machine, at.load);
      if (!loads.empty()) mcap->flush();  // before what may take its time
      mcap->blocks(time_s, changed);
      if (last || Clock::now() - mapped >= kMapEvery) {
        mcap->elevation(time_s);
        mapped = Clock::now();
      }
      if (last)
        mcap->close();
      else
        mcap->flush();
    } catch (const std::exception& e) {
      failed = true;
      say(fmt::format("warning: {}; the site goes on without", e.what()));
    }
  }

  const fs::path folder;
  const SoilMcap::Site site;
  const Soil& copy;
  std::atomic<bool> busy = false;
  std::optional<GroundMcap> mcap = {};
  Clock::time_point mapped{};
  bool failed = false;
};

LiveMcap::LiveMcap(const fs::path& folder, const LiveSite& site, const Soil& copy)
    : site_(site), writer_(new Writer{folder, site_of(site.session()), copy}) {
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  noted_.assign(site.session().machines().size(), {kNaN, 0, {kNaN, kNaN, {}}});
}

LiveMcap::~LiveMcap() = default;

/// What a message is stamped with: of the site, else since it began.
double LiveMcap::now_s() const {
  if (std::isfinite(site_.time_s())) return site_.time_s();
  return std::chrono::duration<double>(Clock::now() - begin_).count();
}

void LiveMcap::note_loads() {
  const Session& session = site_.session();
  for (std::size_t i = 0; i < noted_.size(); ++i) {
    const std::optional<MachineState> last = session.last(i);
    if (!last) continue;
    LoadAt now{std::isfinite(last->time_s) ? last->time_s : now_s(),
               i,
               {session.ledger(i).bucket_m3(), session.ledger(i).cut_m3(), {}}};
    if (session.earthmoving().soil) now.load.bucket_kg = session.bucket_kg(i);
    LoadAt& before = noted_[i];
    const bool same = now.load.bucket_m3 == before.load.bucket_m3 &&
                      now.load.cut_m3 == before.load.cut_m3 &&
                      (now.time_s == before.time_s || !std::isfinite(last->time_s));
    if (same) continue;
    before = now;
    loads_.push_back(now);
  }
}

/// Some of the chunks that changed, in turn.
std::vector<Coord3> LiveMcap::take_changed(std::size_t most) {
  std::vector<Coord3> some;
  auto next = changed_.upper_bound(last_taken_);
  while (some.size() < most && !changed_.empty()) {
    if (next == changed_.end()) next = changed_.begin();
    some.push_back(*next);
    next = changed_.erase(next);
  }
  if (!some.empty()) last_taken_ = some.back();
  return some;
}

void LiveMcap::write(GroundService& service, bool last) {
  if (written_ == Clock::time_point())  // what there is of an earlier recording
    for (const Chunk* chunk : site_.session().site().soil->chunks()) changed_.insert(chunk->origin);
  written_ = Clock::now();
  writer_->busy = true;
  service.run([writer = writer_, time_s = now_s(), last, loads = std::exchange(loads_, {}),
               changed = take_changed(last ? changed_.size() : kMostChunks)] {
    writer->write(time_s, changed, loads, last);
    writer->busy = false;
  });
}

void LiveMcap::tick(std::span<const Coord3> changed, GroundService& service) {
  changed_.insert(changed.begin(), changed.end());
  if (site_.fed() == 0) return;
  note_loads();
  if (writer_->busy) return;
  const bool behind = changed_.size() > kMostChunks;
  if (!behind && Clock::now() - written_ < kEvery) return;
  if (!changed_.empty() || !loads_.empty()) write(service, /*last=*/false);
}

void LiveMcap::finish(GroundService& service) {
  if (site_.fed() > 0) write(service, /*last=*/true);
}

}  // namespace soilvdb::tools
