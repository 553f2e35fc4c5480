// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/live_mcap.h"

#include <fmt/format.h>

#include <algorithm>
#include <exception>
#include <limits>
#include <optional>
#include <utility>

#include "soilvdb/resistance.h"
#include "tools/run/ros_messages.h"
#include "tools/run/run_folder.h"
#include "tools/run/text.h"

namespace soilvdb::tools {
namespace {

namespace fs = std::filesystem;

/// Chunks per job, so that other chunks and loads do not wait.
constexpr std::size_t kMostChunks = 32;

fs::path free_name(const fs::path& folder) {
  const fs::path first = folder / kMcapName;
  fs::path file = first;
  for (int i = 1; fs::exists(file); ++i)
    file = folder / fmt::format("{}_{}{}", first.stem().string(), i, first.extension().string());
  return file;
}

}  // namespace

LiveMcap::LiveMcap(const fs::path& folder, LiveSite& site, const Ground& copy, bool forces)
    : site_(site),
      forces_(forces),
      folder_(folder),
      copy_(copy),
      crs_wkt_(site.session().site().crs_wkt) {
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  for (const SiteMachine& machine : site.session().machines()) {
    noted_.push_back({kNaN, noted_.size(), {kNaN, kNaN, {}}});
    machines_.push_back(machine.name);
  }
}

/// The time of a message: the site's latest, or else the time since the recording began.
double LiveMcap::now_s() const {
  if (const std::optional<double> time_s = site_.time_s()) return *time_s;
  return std::chrono::duration<double>(Clock::now() - begin_).count();
}

void LiveMcap::note_loads() {
  const Session& session = site_.session();
  for (LoadAt& noted : noted_) {
    const std::size_t i = noted.machine;
    const std::optional<MachineState> last = session.last(i);
    if (!last) continue;
    LoadAt now{last->time_s ? *last->time_s : now_s(),
               i,
               {session.ledger(i).bucket_m3(), session.ledger(i).cut_m3(), {}}};
    if (session.earthmoving().soil) now.load.bucket_kg = session.bucket_kg(i);
    const bool same = now.load.bucket_m3 == noted.load.bucket_m3 &&
                      now.load.cut_m3 == noted.load.cut_m3 &&
                      (now.time_s == noted.time_s || !last->time_s);
    if (same) continue;
    noted = now;
    news_.loads.push_back(now);
  }
}

void LiveMcap::note_force(std::size_t machine) {
  Session& session = site_.session();
  if (session.machines()[machine].bucket.shape) return;  // it has no blade
  try {
    const std::array<double, 6> force = wrench_numbers(session.resistance(machine).total());
    const MachineState last = *session.last(machine);
    news_.forces.push_back({last.time_s ? *last.time_s : now_s(), machine, last.pose, force});
  } catch (const std::exception& e) {  // the state was taken nevertheless
    say(fmt::format("warning: a force isn't recorded: {}", e.what()));
  }
}

void LiveMcap::tick(std::span<const Coord3> changed, GroundCopy& beside) {
  news_.changed.insert(news_.changed.end(), changed.begin(), changed.end());
  if (site_.fed() == 0) return;
  note_loads();
  if (!busy_) hand_over(beside, /*last=*/false);
}

void LiveMcap::finish(GroundCopy& beside) {
  if (site_.fed() > 0) hand_over(beside, /*last=*/true);
}

void LiveMcap::hand_over(GroundCopy& beside, bool last) {
  busy_ = true;
  news_.time_s = now_s();
  news_.last = last;
  beside.run([this, news = std::exchange(news_, {})] {
    record(news);
    busy_ = false;
  });
}

void LiveMcap::record(const News& news) {
  if (failed_) return;
  try {
    if (!mcap_)
      mcap_.emplace(free_name(folder_), copy_, crs_wkt_, machines_, news.time_s,
                    /*end_s=*/std::nullopt, forces_);
    mcap_->changed(news.changed);
    for (const LoadAt& at : news.loads) mcap_->load(at.time_s, at.machine, at.load);
    for (const ForceAt& at : news.forces)
      mcap_->wrench(at.time_s, at.machine, at.world_from_bucket, at.force);
    // Machines' times may stand still, or go back after a wrong clock.
    const double clock_s = std::chrono::duration<double>(Clock::now() - begin_).count();
    if (!mcap_->due(clock_s) && !behind_ && !news.last) return;
    mcap_->flush();  // before slow work
    if (news.last) return mcap_->close(news.time_s);
    behind_ = mcap_->ground(news.time_s, kMostChunks);
    mcap_->flush();
  } catch (const std::exception& e) {
    failed_ = true;
    say(fmt::format("warning: {}; the site goes on without this recording", e.what()));
  }
}

}  // namespace soilvdb::tools
