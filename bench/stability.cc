// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Numerical stability: strokes in number and of kinds that a site never sees; figures, not verdicts
// alone. tests/stability_test.cc asserts the same on short forms.
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <numbers>

#include "bench/report.h"
#include "bench/strokes.h"

namespace soilvdb::bench {
namespace {

/// Times of the first and the last tenth of many calls.
class Creep {
 public:
  explicit Creep(std::size_t calls) : tenth_(std::max<std::size_t>(1, calls / 10)), calls_(calls) {}
  void add(double us) {
    if (n_ < tenth_) first_ += us;
    if (n_ >= calls_ - tenth_) last_ += us;
    ++n_;
  }
  double first_us() const { return first_ / static_cast<double>(tenth_); }
  double last_us() const { return last_ / static_cast<double>(tenth_); }

 private:
  std::size_t tenth_, calls_, n_ = 0;
  double first_ = 0, last_ = 0;
};

class Stability {
 public:
  explicit Stability(const Options& options)
      : quick_(options.quick),
        goals_(options.out),
        csv_(options.out / "stability.csv",
             "what,case,relative_error,not_finite,grown_cells,residual_m3,first_us,last_us,"
             "memory_bytes"),
        drags_(options.out / "drags.csv", "drag,relative_error") {}

  void random_strokes() {
    const std::size_t strokes = quick_ ? 2000 : 1000000;
    Soil soil(0.05, Vec3::Zero(), make_plane(0, {0.1, -0.05}));
    Tracker tracker(soil, {small_bucket()});
    Random random(1);
    Creep creep(strokes);
    for (std::size_t i = 0; i < strokes; ++i) {
      const Pose pose = random_pose(random);
      const Stopwatch watch;
      tracker.update(0, pose);
      creep.add(watch.us());
    }
    tracker.flush();
    report("random strokes", fmt::format("{}", strokes), 0, soil, tracker, creep);
  }

  void same_stroke() {
    const int times = quick_ ? 200 : 10000;
    Drag drag;
    drag.yaw_rad = 0.3;
    Soil soil(drag.voxel_m, drag.origin(), drag.ground());
    Tracker tracker(soil, {small_bucket()});
    Creep creep(static_cast<std::size_t>(times - 2));
    double after_first = 0;
    for (int n = 0; n < times; ++n) {
      Pose above = drag.pose(0);
      above.position.z() += 2;
      const Stopwatch watch;
      tracker.update(0, above);
      for (int i = 0; i <= 10; ++i) tracker.update(0, drag.pose(i / 10.0));
      above = drag.pose(1);
      above.position.z() += 2;
      tracker.update(0, above);
      if (n == 0) after_first = tracker.total().cut_m3();
      if (n > 1) creep.add(watch.us());
    }
    tracker.flush();
    const double more = tracker.total().cut_m3() / after_first - 1;
    report("the same stroke", fmt::format("{}", times), more, soil, tracker, creep);
    goals_.add({"the same stroke again and again: cut after the first", more, "", 0.0});
  }

  void grazing() {
    // The lip on the surface, on voxel planes and half-way between, over ground cut there before.
    for (const double lip_voxels : {0.0, 0.5, 1.0, 2.0, 1e-7}) {
      Drag drag;
      Soil soil(drag.voxel_m, drag.origin(), drag.ground());
      Tracker tracker(soil, {small_bucket()});
      const double depth = lip_voxels * drag.voxel_m;
      for (int pass = 0; pass < 3; ++pass) {
        for (int i = 0; i <= 50; ++i) {
          Pose pose = drag.pose(i / 50.0);
          pose.position.z() = (pass == 2 ? 3 : 1) * -depth;
          tracker.update(0, pose);
        }
        Pose above = drag.pose(1);
        above.position.z() = 2;
        tracker.update(0, above);
        above.position.x() -= 1;
        tracker.update(0, above);
      }
      tracker.flush();
      // Lifting out at the end sweeps nothing more of the ground: the mouth moves in its own plane.
      const double lost = tracker.total().cut_m3() - 0.6 * 3 * depth;
      report("grazing", fmt::format("lip {:g} voxels deep", lip_voxels), lost / drag.exact_m3(),
             soil, tracker, Creep(1));
    }
  }

  void tiny_motions() {
    Drag drag;
    Soil soil(drag.voxel_m, drag.origin(), drag.ground());
    Tracker tracker(soil, {small_bucket()});
    const int times = quick_ ? 1000 : 100000;
    Creep creep(static_cast<std::size_t>(times));
    tracker.update(0, drag.pose(0));
    for (int i = 0; i < times; ++i) {
      Pose pose = drag.pose(0);
      if (i % 3 == 1) pose.position.x() += 1e-9 * (i % 7);
      if (i % 3 == 2) pose.rotation = pose.rotation * Eigen::AngleAxisd(1e-9, Vec3::UnitY());
      const Stopwatch watch;
      tracker.update(0, pose);
      creep.add(watch.us());
    }
    tracker.flush();
    report("standing, 1e-9 m, 1e-9 rad", fmt::format("{}", times),
           tracker.total().cut_m3() / drag.exact_m3(), soil, tracker, creep);
  }

  void flips_and_jumps() {
    {
      Drag drag;
      Soil soil(drag.voxel_m, drag.origin(), drag.ground());
      Tracker tracker(soil, {small_bucket()});
      for (int i = 0; i <= 100; ++i) {
        Pose pose = drag.pose(i / 100.0);
        if (i % 2 == 1) {
          pose.rotation = pose.rotation * Eigen::AngleAxisd(std::numbers::pi, Vec3::Unit(i % 3));
        }
        tracker.update(0, pose);
      }
      tracker.flush();
      report("180 degrees from row to row", "100 rows", 0, soil, tracker, Creep(1));
    }
    Drag drag;
    drag.scale = 1;
    Soil soil(drag.voxel_m, drag.origin(), drag.ground());
    Tracker tracker(soil, {small_bucket()});
    tracker.update(0, drag.pose(0));
    Pose far = drag.pose(0);
    far.position.x() += 100;
    const Stopwatch watch;
    tracker.update(0, far);
    Creep creep(1);
    creep.add(watch.us());
    tracker.flush();
    report("a row that jumps 100 m", "in the ground",
           tracker.total().cut_m3() / (100 * 0.6 * 0.2) - 1, soil, tracker, creep);
  }

  void everywhere() {
    Drag drag;
    drag.yaw_rad = 0.3;
    for (const double voxel : {0.001, 0.0025, 0.01, 0.025, 0.05, 0.1, 1.0}) {
      if (quick_ && voxel < 0.005) continue;
      Drag d = drag;
      d.voxel_m = voxel;
      if (voxel == 1.0) d.scale = 20;
      error("voxel size", fmt::format("{:g} m", voxel), d);
    }
    for (const double at : {0.0, 5e5, 5e6, 1.3e7}) {
      Drag d = drag;
      d.offset = {at + 0.37, at / 10 + 0.11, 0.013};
      error("coordinates", fmt::format("{:g} m", at), d);
    }
    for (const double degrees : {0, 15, 30, 45, 60, 75, 85}) {
      Drag d = drag;
      d.slope_rad = degrees * std::numbers::pi / 180;
      error("slope", fmt::format("{:g} degrees", degrees), d);
    }
    for (const double scale : {0.05, 1.0, 50.0}) {
      Drag d = drag;
      d.scale = scale;
      d.voxel_m *= scale;
      error("scale", fmt::format("{:g}", scale), d);
    }
    goals_.add({"worst |error| of one drag: voxel <= 2.5 cm, coordinates, slopes, scales",
                100 * worst_, "%", 0.1});
  }

  void print() {
    goals_.add({"values of phi that are not finite or beyond the band",
                static_cast<double>(not_finite_), "", 0.0});
    goals_.add({"cells with soil that was not there", static_cast<double>(grown_), "", 0.0});
    goals_.add({"largest residual of the ledger", residual_m3_, "m3", 0.0});
    goals_.add({"slowest last tenth over first tenth", creep_, "x", 1.2});
    goals_.print();
  }

 private:
  void report(const char* what, const std::string& which, double error, const Soil& soil,
              const Tracker& tracker, const Creep& creep) {
    const Health h = health(soil, tracker);
    not_finite_ += h.not_finite;
    grown_ += h.grown;
    residual_m3_ = std::max(residual_m3_, std::abs(h.residual_m3));
    const double first = creep.first_us(), last = creep.last_us();
    if (first > 0 && last > 0) creep_ = std::max(creep_, last / first);
    csv_.row(fmt::format("{},{},{:.6g},{},{},{:.3g},{:.4g},{:.4g},{:.0f}", what, which, error,
                         h.not_finite, h.grown, h.residual_m3, first, last, h.memory_bytes));
    fmt::print("{:<30}{:<22} error {:+9.2e}  phi {}  new soil {}  residual {:.1e} m3", what, which,
               error, h.not_finite, h.grown, h.residual_m3);
    if (first > 0) fmt::print("  {:.2f} us first, {:.2f} us last tenth", first, last);
    fmt::print("  {:.1f} MB\n", h.memory_bytes / 1e6);
  }

  void error(const char* what, const std::string& which, const Drag& drag) {
    const double e = drag.cut_m3() / drag.exact_m3() - 1;
    if (drag.voxel_m <= 0.025 * drag.scale) worst_ = std::max(worst_, std::abs(e));
    drags_.row(fmt::format("{} {},{:.6g}", what, which, e));
    fmt::print("{:<30}{:<22} error {:+9.2e}\n", what, which, e);
  }

  bool quick_;
  Goals goals_;
  Csv csv_, drags_;
  std::uint64_t not_finite_ = 0, grown_ = 0;
  double residual_m3_ = 0, creep_ = 0, worst_ = 0;
};

}  // namespace
}  // namespace soilvdb::bench

int main(int argc, char** argv) try {
  using namespace soilvdb::bench;
  const Options options = parse(argc, argv, "stability");
  fmt::print("{}\n", machine());
  Stability stability(options);
  {
    Progress progress(6);
    progress.step("random strokes");
    stability.random_strokes();
    progress.step("the same stroke");
    stability.same_stroke();
    progress.step("grazing cuts");
    stability.grazing();
    progress.step("tiny motions");
    stability.tiny_motions();
    progress.step("flips and jumps");
    stability.flips_and_jumps();
    progress.step("voxel sizes, coordinates, slopes, scales");
    stability.everywhere();
  }
  stability.print();
} catch (const std::exception& e) {
  fmt::print(stderr, "bench stability: {}\n", e.what());
  return 1;
}
