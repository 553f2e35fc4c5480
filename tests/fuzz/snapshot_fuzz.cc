// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Snapshots. By the first byte: the rest is a whole file; or what stands between the samples and a
// checksum that is right; or samples; or a tracker's state, of soil that moves or doesn't.
#include <tbb/global_control.h>

#include <memory>

#include "io/snapshot/snapshot_format.h"
#include "io/snapshot/snapshot_samples.h"
#include "soilvdb/io/snapshot.h"
#include "soilvdb/tracker.h"
#include "tests/fuzz/fuzz.h"

using namespace soilvdb;

namespace {

constexpr std::uint8_t kMovingSoil = 'M';

Bucket bucket() {
  Bucket bucket;
  bucket.width_m = 0.4;
  bucket.height_m = 0.3;
  return bucket;
}

/// A site with a small cut.
struct Site {
  io::Site site;
  std::unique_ptr<Tracker> tracker;

  Site() {
    io::Base base = io::open_base(io::PlaneTerrain{});
    site = {std::make_unique<Ground>(0.1, Vec3::Zero(), base.surface), base.reference, "",
            base.bounds};
    tracker = std::make_unique<Tracker>(*site.ground, std::vector{bucket()});
    for (const double x : {0.0, 0.3, 0.5}) {
      Pose pose;
      pose.position = {x, 0, -0.1};
      tracker->update(0, pose);
    }
  }
};

/// Reads a snapshot of the site with `tail` between the samples and a checksum that is right.
void read_with_tail(const test::TempFolder& folder, const std::string& tail) {
  static const Site site;
  static const std::string vdb = [&] {
    const std::string bytes =
        io::snapshot_bytes(folder / "seed.vdb", site.site, {"seed", 1.0, 0, 0, 0, 0, ""});
    return bytes.substr(0, bytes.size() - io::kTrailerSize);
  }();
  const std::string bytes = vdb + tail;
  const auto file = folder.write("soil.vdb", bytes + io::trailer(bytes));
  const io::Site read = io::read_snapshot(file);
  fuzz::require(read.ground->state_hash() == site.site.ground->state_hash(),
                "the ground is what was written");
}

void restore_samples(const std::string& bytes) {
  Ground ground(0.1, Vec3::Zero(), make_plane(0, {0, 0}));
  try {
    io::restore_samples(bytes, ground);
  } catch (const std::exception& no_samples) {
    fuzz::check_message(no_samples);
  }
}

/// As tests/fuzz/make_corpus.py has them.
Earthmoving earthmoving() {
  Earthmoving all;
  all.soil = SoilProperties{0.61, 0.25, 1800, {}, {}};
  all.pours = {{"truck", {0.5, 0.5, 1}, 0, 1.5, 0.05}, {"tip", {1, 0, 1}, 1, 1, 0.02}};
  all.hoppers = {{"bed", {Vec2(2, -1), Vec2(3, 1)}, 0.5}};
  return all;
}

void restore(const std::string& state, const Earthmoving& earthmoving) {
  Site site;
  Bucket body = bucket();
  if (earthmoving.soil) body.profile = {{0, 0}, {-0.2, 0.05}, {0, 0.3}};
  Tracker tracker(*site.site.ground, {body}, earthmoving);
  try {
    tracker.restore(state);
  } catch (const std::invalid_argument& no_state) {
    fuzz::check_message(no_state);
    return;
  }
  const std::string now = tracker.state();
  tracker.restore(now);
  fuzz::require(tracker.state() == now, "the state is what was restored");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const test::TempFolder folder;
  // One thread: two count what they pass in another order each time.
  static const tbb::global_control alone(tbb::global_control::max_allowed_parallelism, 1);
  if (size == 0) return 0;
  const std::string rest(fuzz::text(data + 1, size - 1));
  fuzz::expect_read_or_refused([&] {
    if (data[0] % 4 == 0) io::read_snapshot(folder.write("soil.vdb", rest));
    if (data[0] % 4 == 1) read_with_tail(folder, rest);
    if (data[0] == kMovingSoil) return restore(rest, earthmoving());
    if (data[0] % 4 == 2) restore(rest, {});
    if (data[0] % 4 == 3) restore_samples(rest);
  });
  return 0;
}
