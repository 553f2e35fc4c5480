// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Numerical stability: strokes in number and of kinds that a site never sees; figures, not verdicts
// alone. tests/cut/stability_test.cc asserts the same on short forms.
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <numbers>
#include <optional>

#include "bench/report.h"
#include "bench/strokes.h"

namespace soilvdb::bench {
namespace {

/// Time per call over a run of many: means of a hundred parts of it.
class Creep {
 public:
  explicit Creep(std::size_t calls = kParts) : part_(std::max<std::size_t>(calls / kParts, 1)) {}
  void add(double us) {
    if (n_++ % part_ == 0) parts_us_.push_back(0);
    parts_us_.back() += us / static_cast<double>(part_);
  }
  std::size_t part() const { return part_; }
  const std::vector<double>& parts_us() const { return parts_us_; }
  /// Medians, so that what else the machine does weighs little; 0 if there was nothing to time.
  double first_tenth_us() const { return median(0); }
  double last_tenth_us() const { return median(parts_us_.size() - kParts / 10); }

 private:
  static constexpr std::size_t kParts = 100;
  double median(std::size_t begin) const {
    if (parts_us_.size() < kParts) return 0;
    const auto from = parts_us_.begin() + static_cast<std::ptrdiff_t>(begin);
    std::vector<double> tenth(from, from + kParts / 10);
    return quantile(tenth, 0.5);
  }
  std::size_t part_, n_ = 0;
  std::vector<double> parts_us_;
};

/// One ground and one bucket.
struct Site {
  Ground ground;
  Tracker tracker;
  Creep creep;
  Site(double voxel_m, const Vec3& origin, std::unique_ptr<InitialTerrain> terrain)
      : ground(voxel_m, origin, std::move(terrain)), tracker(ground, {small_bucket()}) {}
  explicit Site(const Drag& drag) : Site(drag.voxel_m, drag.origin(), drag.terrain()) {}
  void timed(const Pose& pose) {
    const Stopwatch watch;
    tracker.update(0, pose);
    creep.add(watch.us());
  }
  double cut_m3() const { return tracker.total().cut_m3(); }
};

Pose lifted(Pose pose) {
  pose.position.z() += 2;
  return pose;
}

class Stability {
 public:
  explicit Stability(const Options& options)
      : quick_(options.quick),
        goals_(options.out),
        csv_(options.out / "stability.csv",
             "what,case,relative_error,uncertainty,not_finite,grown_cells,residual_m3,first_us,"
             "last_us,memory_bytes"),
        creep_csv_(options.out / "creep.csv", "strokes,us_per_stroke"),
        drags_csv_(options.out / "drags.csv", "drag,relative_error"),
        progress_(std::in_place, kTenths + 6) {}

  void run() {
    random_strokes();
    counted_strokes();
    same_stroke();
    grazing();
    tiny_motions();
    jump();
    everywhere();
  }

  void print() {
    progress_.reset();
    for (const std::string& line : lines_) fmt::print("{}\n", line);
    goals_.add({"distances that are not finite or beyond the band",
                static_cast<double>(not_finite_), "", 0.0});
    goals_.add({"cells with soil that was not there", static_cast<double>(grown_), "", 0.0});
    goals_.add({"largest residual of the ledger", residual_m3_, "m3", 0.0});
    goals_.add({"slowest last tenth over first tenth", creep_, "x", 1.2});
    goals_.print();
  }

 private:
  static constexpr int kTenths = 10;

  /// Deeper and deeper, so that there is soil to dig to the last.
  void random_strokes() {
    const std::size_t strokes = quick_ ? 500 : 1000000;
    const double deepening_m = 1e-5;
    Site site(0.1, Vec3::Zero(), make_plane(0, {0.1, -0.05}));
    site.creep = Creep(strokes);
    RandomStrokes random(1);
    for (std::size_t i = 0; i < strokes; ++i) {
      if (i % (strokes / kTenths) == 0) progress_->step(fmt::format("random strokes, {} done", i));
      site.timed(random.next(deepening_m * static_cast<double>(i)));
    }
    for (std::size_t i = 0; i < site.creep.parts_us().size(); ++i) {
      creep_csv_.row(
          fmt::format("{},{:.4g}", (i + 1) * site.creep.part(), site.creep.parts_us()[i]));
    }
    report("random strokes", fmt::format("{}", strokes), site, std::nullopt);
  }

  /// Volumes against an independent count.
  void counted_strokes() {
    progress_->step("random strokes and turns against a count");
    const int strokes = quick_ ? 10 : 300;
    RandomStrokes random(1);
    std::vector<Pose> wander, turns;
    for (int i = 0; i <= strokes; ++i) wander.push_back(random.next(0));
    counted(fmt::format("{} random strokes", strokes), wander);
    const Drag drag;
    const int rows = quick_ ? 2 : 30;
    for (int i = 0; i <= rows; ++i) {
      Pose pose = drag.pose(static_cast<double>(i) / rows);
      const Eigen::AngleAxisd over(std::numbers::pi, Vec3::Unit(i / 2 % 3));
      if (i % 2 == 1) pose.rotation = pose.rotation * over;
      turns.push_back(pose);
    }
    counted(fmt::format("180 degrees, {} rows", rows), turns);
    Figure worst{"worst |error| against a count, 5 cm voxels", 100 * worst_counted_, "%"};
    if (!quick_) worst.at_most = 0.4;  // a quick count is too rough
    worst.note = fmt::format("+- {:.2f} % is the count's", 100 * count_uncertainty_);
    goals_.add(worst);
  }

  void counted(const std::string& which, const std::vector<Pose>& path) {
    Site site(0.05, Vec3::Zero(), make_plane(0, {0.1, -0.05}));
    for (const Pose& pose : path) site.tracker.update(0, pose);
    const Count count =
        count_swept(small_bucket(), path, site.ground.terrain(), quick_ ? 0.06 : 0.03);
    const double error = site.cut_m3() / count.m3 - 1;
    const double uncertainty = 3 * count.sigma_m3 / count.m3;
    worst_counted_ = std::max(worst_counted_, std::abs(error));
    count_uncertainty_ = std::max(count_uncertainty_, uncertainty);
    report("against a count", which, site, error, uncertainty);
  }

  void same_stroke() {
    progress_->step("the same stroke");
    const int times = quick_ ? 20 : 10000;
    const Drag drag;
    Site site(drag);
    site.creep = Creep(static_cast<std::size_t>(times - 1));
    double after_first = 0;
    for (int n = 0; n < times; ++n) {
      const Stopwatch watch;
      site.tracker.update(0, lifted(drag.pose(0)));
      for (int i = 0; i <= 10; ++i) site.tracker.update(0, drag.pose(i / 10.0));
      site.tracker.update(0, lifted(drag.pose(1)));
      if (n == 0) after_first = site.cut_m3();
      if (n > 0) site.creep.add(watch.us());
    }
    const double more = site.cut_m3() / after_first - 1;
    report("the same stroke", fmt::format("{} times", times), site, more);
    goals_.add({"the same stroke again and again: cut after the first", 100 * more, "%", 0.0});
  }

  /// The lip on the surface, on voxel planes and half-way between, over ground cut there before.
  void grazing() {
    progress_->step("grazing cuts");
    for (const double lip_voxels : {0.0, 1e-7, 0.5, 1.0, 2.0}) {
      Drag drag;
      drag.offset = Vec3::Zero();
      drag.yaw_rad = 0;
      Site site(drag);
      for (const int deep : {1, 1, 3}) {
        drag.depth_m = deep * lip_voxels * drag.voxel_m;
        for (int i = 0; i <= 50; ++i) site.tracker.update(0, drag.pose(i / 50.0));
        // Lifted in its own plane, the mouth sweeps nothing.
        site.tracker.update(0, lifted(drag.pose(1)));
        site.tracker.update(0, lifted(drag.pose(0)));
      }
      report("grazing", fmt::format("lip {:g} voxels deep", lip_voxels), site,
             (site.cut_m3() - drag.exact_m3()) / Drag().exact_m3());
    }
  }

  void tiny_motions() {
    progress_->step("tiny motions");
    const int times = quick_ ? 100 : 100000;
    const Drag drag;
    const auto run = [&](const char* which, double exact_m3, auto pose_of) {
      Site site(drag);
      site.creep = Creep(static_cast<std::size_t>(times));
      site.tracker.update(0, drag.pose(0));
      for (int i = 1; i <= times; ++i) site.timed(pose_of(i));
      report(which, fmt::format("{} times", times), site,
             (site.cut_m3() - exact_m3) / drag.exact_m3());
    };
    run("standing", 0, [&](int) { return drag.pose(0); });
    run("1e-9 m to and fro", 0.6 * drag.depth_m * 1e-9,
        [&](int i) { return drag.pose(1e-9 * (i % 2)); });
    run("1e-9 rad to and fro", 0, [&](int i) {
      Pose pose = drag.pose(0);
      pose.rotation = pose.rotation * Eigen::AngleAxisd(1e-9 * (i % 2), Vec3::UnitY());
      return pose;
    });
    const double step_m = 0.1 / times;
    run("10 cm in tiny steps", 0.1 * drag.exact_m3(), [&](int i) { return drag.pose(step_m * i); });
  }

  void jump() {
    progress_->step("a jump");
    const Drag drag;
    Site site(drag);
    site.tracker.update(0, drag.pose(0));
    site.tracker.update(0, drag.pose(100));
    report("a row that jumps 100 m", "in the ground", site,
           site.cut_m3() / (100 * drag.exact_m3()) - 1);
  }

  void everywhere() {
    progress_->step("voxel sizes, coordinates, slopes, scales");
    for (const double voxel : {0.001, 0.0025, 0.01, 0.025, 0.05, 0.1, 1.0}) {
      if (quick_ && voxel < 0.05) continue;
      Drag d;
      d.voxel_m = voxel;
      if (voxel == 1.0) d.scale = 20;
      error(fmt::format("voxels of {:g} m", voxel), d);
    }
    for (const double at : {0.0, 5e5, 5e6, 1.3e7}) {
      Drag d;
      d.offset = {at + 0.37, at / 10 + 0.11, 0.013};
      error(fmt::format("coordinates of {:g} m", at), d);
    }
    for (const double degrees : {0, 15, 30, 45, 60, 75, 85}) {
      Drag d;
      d.slope_rad = degrees * std::numbers::pi / 180;
      error(fmt::format("slope of {:g} degrees", degrees), d);
    }
    for (const double scale : {0.05, 1.0, 50.0}) {
      Drag d;
      d.scale = scale;
      d.voxel_m *= scale;
      d.offset *= scale;
      error(fmt::format("all times {:g}", scale), d);
    }
    goals_.add({"worst |error| of one drag: voxel <= 2.5 cm, coordinates, slopes, scales",
                100 * worst_drag_, "%", 0.1});
  }

  void report(const std::string& what, const std::string& which, Site& site,
              std::optional<double> error, double uncertainty = 0) {
    const Health h = health(site.ground, site.tracker);
    not_finite_ += h.not_finite;
    grown_ += h.grown;
    residual_m3_ = std::max(residual_m3_, std::abs(h.residual_m3));
    const double first = site.creep.first_tenth_us(), last = site.creep.last_tenth_us();
    if (first > 0) creep_ = std::max(creep_, last / first);
    csv_.row(fmt::format("\"{}\",\"{}\",{},{:.3g},{},{},{:.3g},{:.4g},{:.4g},{:.0f}", what, which,
                         error ? fmt::format("{:.6g}", *error) : "", uncertainty, h.not_finite,
                         h.grown, h.residual_m3, first, last, h.memory_bytes));
    std::string line = fmt::format("{:<24}{:<26}", what, which);
    line += error ? fmt::format("error {:+9.2e}", *error) : fmt::format("{:15}", "");
    line += uncertainty > 0 ? fmt::format(" +- {:.0e}", uncertainty) : fmt::format("{:9}", "");
    line += fmt::format("  bad distances {}  new soil {}  residual {:.0e} m3  {:5.1f} MB",
                        h.not_finite, h.grown, h.residual_m3, h.memory_bytes / 1e6);
    if (first > 0) line += fmt::format("  {:.2f} us first, {:.2f} us last tenth", first, last);
    lines_.push_back(line);
  }

  void error(const std::string& what, const Drag& drag) {
    const double e = drag.cut_m3() / drag.exact_m3() - 1;
    if (drag.voxel_m <= 0.025 * drag.scale) worst_drag_ = std::max(worst_drag_, std::abs(e));
    drags_csv_.row(fmt::format("{},{:.6g}", what, e));
    lines_.push_back(fmt::format("{:<24}{:<26}error {:+9.2e}", "a drag", what, e));
  }

  bool quick_;
  Goals goals_;
  Csv csv_, creep_csv_, drags_csv_;
  std::optional<Progress> progress_;
  std::vector<std::string> lines_;
  std::uint64_t not_finite_ = 0, grown_ = 0;
  double residual_m3_ = 0, creep_ = 0, worst_drag_ = 0, worst_counted_ = 0, count_uncertainty_ = 0;
};

}  // namespace
}  // namespace soilvdb::bench

int main(int argc, char** argv) try {
  using namespace soilvdb::bench;
  const Options options = parse(argc, argv, "stability");
  fmt::print("{}\n", machine());
  Stability stability(options);
  stability.run();
  stability.print();
} catch (const std::exception& e) {
  fmt::print(stderr, "bench stability: {}\n", e.what());
  return 1;
}
