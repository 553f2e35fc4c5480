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
constexpr std::uint64_t kMapEvery = 2;  // of those

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
      mcap->blocks(time_s, changed);
      if (last || ++writes % kMapEvery == 0) mcap->elevation(time_s);
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
  std::uint64_t writes = 0;
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

void LiveMcap::write(GroundService& service, bool last) {
  written_ = Clock::now();
  writer_->busy = true;
  service.run([writer = writer_, time_s = now_s(), last, loads = std::exchange(loads_, {}),
               changed = std::vector<Coord3>(changed_.begin(), changed_.end())] {
    writer->write(time_s, changed, loads, last);
    writer->busy = false;
  });
  changed_.clear();
}

void LiveMcap::tick(std::span<const Coord3> changed, GroundService& service) {
  changed_.insert(changed.begin(), changed.end());
  if (site_.fed() == 0) return;
  note_loads();
  if (writer_->busy || Clock::now() - written_ < kEvery) return;
  if (!changed_.empty() || !loads_.empty()) write(service, /*last=*/false);
}

void LiveMcap::finish(GroundService& service) {
  if (site_.fed() > 0) write(service, /*last=*/true);
}

}  // namespace soilvdb::tools
