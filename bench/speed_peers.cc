// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "bench/digs.h"
#include "bench/speed.h"

namespace soilvdb::bench {
namespace {

struct Score {
  double error = 0;  ///< root mean square
  double us = 0;     ///< geometric mean per update
  int failures = 0;
};

/// Over the families and all placements, each dug three times: the median time.
Score score(const MakeEngine& make, const std::vector<std::string>& families, double voxel_m,
            int updates, std::size_t placements) {
  Score total;
  double n = 0;
  for (const std::string& family : families) {
    for (std::size_t p = 0; p < placements; ++p) {
      const test::Dig dig = test::make_dig(family, test::placements()[p]);
      std::array<Run, 3> runs;
      for (Run& r : runs) {
        r = run(make, dig, voxel_m, updates, 60);
        if (!r.complete) throw EngineFailed(family + " took more than a minute");
      }
      std::sort(runs.begin(), runs.end(),
                [](const Run& a, const Run& b) { return a.us_per_update < b.us_per_update; });
      const Run& r = runs[1];
      total.error += r.error * r.error;
      total.us += std::log(r.us_per_update);
      total.failures += r.failures;
      ++n;
    }
  }
  total.error = std::sqrt(total.error / n);
  total.us = std::exp(total.us / n);
  return total;
}

class Peers {
 public:
  Peers(const Options& options, Goals& goals)
      : goals_(goals),
        placements_(options.quick ? 1 : 4),
        csv_(options.out / "peers.csv",
             "peer,voxel_m,us_per_update,error,soilvdb_voxel_m,soilvdb_us,soilvdb_error,ratio") {}

  /// Against soilvdb at the coarsest voxels at which it errs no more.
  void at_error(const std::string& name, const MakeEngine& make, double voxel_m, int updates,
                const std::vector<std::string>& families, double goal) {
    const Score theirs = score(make, families, voxel_m, updates, placements_);
    double voxel = 0;
    Score ours;
    for (const double v : {0.2, 0.15, 0.1, 0.075, 0.05, 0.035, 0.025, 0.0175, 0.0125}) {
      voxel = v;
      ours = score(make_soilvdb, families, v, updates, placements_);
      if (ours.error <= theirs.error) break;
    }
    add(name, voxel_m, theirs, voxel, ours, goal);
  }

  /// On a site of 100 m, a few updates: time only.
  void on_site(const std::string& name, const MakeEngine& make, double side_m, int updates,
               double goal) {
    constexpr double kVoxel_m = 0.05;
    constexpr int kOfWhole = 100;
    const test::Dig dig = test::make_dig("drag", {});
    Task task = task_of(dig, kVoxel_m);
    const Vec3 half(side_m / 2, side_m / 2, 1);
    task.site = Eigen::AlignedBox3d(task.reach.center() - half, task.reach.center() + half);
    task.site.max().z() = task.reach.max().z();
    const double begin = dig.motion.begin_s(), length = dig.motion.end_s() - begin;
    const auto us_of = [&](const MakeEngine& engine, int n) {
      const auto e = engine(task);
      std::vector<double> us;
      for (int i = 0; i < n; ++i) {
        const int at = kOfWhole / 2 + i;  // well in the ground
        const Step step{begin + length * at / kOfWhole, begin + length * (at + 1) / kOfWhole};
        if (i == 0) e->advance({begin, step.t0});
        e->prepare(step);
        const Stopwatch watch;
        e->advance(step);
        us.push_back(watch.us());
      }
      double sum = 0;
      for (const double u : us) sum += u;
      return sum / n;
    };
    Score theirs, ours;
    theirs.us = us_of(
        [&make](const Task& t) {
          auto e = make(t);
          e->prepare({t.motion->begin_s(), t.motion->begin_s()});
          return e;
        },
        updates);
    ours.us = us_of(make_soilvdb, 40);
    theirs.error = ours.error = std::nan("");
    add(fmt::format("{}, site of {:g} m", name, side_m), kVoxel_m, theirs, kVoxel_m, ours, goal);
  }

 private:
  void add(const std::string& name, double voxel_m, const Score& theirs, double our_voxel_m,
           const Score& ours, double goal) {
    const double ratio = theirs.us / ours.us;
    csv_.row(fmt::format("\"{}\",{},{:.6g},{:.4g},{},{:.6g},{:.4g},{:.4g}", name, voxel_m,
                         theirs.us, theirs.error, our_voxel_m, ours.us, ours.error, ratio));
    std::string note = fmt::format("{:.0f} us at {:g} cm; soilvdb {:.1f} us at {:g} cm", theirs.us,
                                   100 * voxel_m, ours.us, 100 * our_voxel_m);
    if (!std::isnan(theirs.error)) {
      note += fmt::format("; errors {:.2f} % and {:.3f} %", 100 * theirs.error, 100 * ours.error);
    }
    if (theirs.failures > 0) note += fmt::format("; {} steps failed", theirs.failures);
    goals_.add({"times faster than " + name, ratio, "x", {}, goal, note});
  }

  Goals& goals_;
  std::size_t placements_;
  Csv csv_;
};

}  // namespace

void measure_peers(const Options& options, Goals& goals) {
  Peers peers(options, goals);
  const double side = options.quick ? 10 : 100;
  peers.on_site("openvdb_stock (cut and volume)", make_openvdb_stock, side, options.quick ? 2 : 3,
                5000);
  peers.on_site("openvdb_csg (cut alone, tool ready)", make_openvdb_csg, side, 10, 30);
  peers.at_error(
      "the paper's method on its grid of 100^3",
      [](const Task& t) { return make_paper_cube(t, 100); }, 0.01, 50, {"half_sine"}, 200);
}

}  // namespace soilvdb::bench
