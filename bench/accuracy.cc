// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Run time against error: engines x families x voxel sizes x numbers of updates, in one process.
#include <fmt/core.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <map>
#include <optional>
#include <utility>

#include "bench/curves.h"
#include "bench/digs.h"
#include "bench/report.h"

namespace soilvdb::bench {
namespace {

struct Plan {
  std::vector<std::string> families;
  std::vector<std::size_t> placements;  ///< peers only get the last
  std::vector<double> voxels_m;         ///< coarse to fine
  std::vector<int> updates;
  double run_cap_s, engine_cap_s;
};

/// The number of updates that engines are compared at: about 20 Hz over a dig of five seconds.
constexpr int kCommonUpdates = 100;
/// The voxel size at which they are compared over the number of updates.
constexpr double kCommonVoxel_m = 0.025;

Plan plan(bool quick) {
  const auto& all = test::families();
  if (quick) {
    return {{all.begin(), all.begin() + 1}, {1}, {0.1, kCommonVoxel_m},
            {20, kCommonUpdates},           0.2, 1};
  }
  return {all, {0, 1}, {0.2, 0.1, 0.05, 0.025, 0.0125}, {20, 100, 500, 5000}, 10, 200};
}

/// The errors at which their times are compared; the third is the paper's own.
constexpr std::array kErrors = {0.03, 0.01, kPaperError, 0.003, 0.001, 0.0003, 0.0001};

class Accuracy {
 public:
  explicit Accuracy(const Options& options)
      : plan_(plan(options.quick)),
        folder_(options.out),
        csv_(options.out / "accuracy.csv",
             "engine,family,placement,voxel_m,updates,error,uncertainty,us_per_update,failures,"
             "complete") {}

  void measure() {
    std::vector<const Peer*> sound;
    for (const Peer& peer : engines()) {
      const double error = check(peer);
      if (std::abs(error) <= kBroken) {
        sound.push_back(&peer);
      } else {
        fmt::print("{} is left out: {:+.1f} % on a drag in twenty strokes\n", peer.name,
                   100 * error);
      }
      checked_[peer.name] = error;
    }
    std::size_t steps = 0;
    for (const Peer* peer : sound) steps += placements(*peer).size();
    Progress progress(steps * plan_.families.size());
    for (const Peer* peer : sound) {
      for (const std::size_t placement : placements(*peer)) {
        for (const std::string& family : plan_.families) {
          progress.step(fmt::format("{} {}", peer->name, family));
          const test::Dig dig = test::make_dig(family, test::placements()[placement]);
          measure(*peer, dig, placement);
        }
      }
    }
  }

  void write_curves() const {
    Csv csv(folder_ / "curves.csv", "engine,updates,voxel_m,error_rms,us_per_update,digs,failures");
    Csv over(folder_ / "updates.csv", "engine,voxel_m,updates,error_rms,error_mean");
    for (const Peer& peer : engines()) {
      for (const int updates : plan_.updates) {
        const auto digs = digs_done(samples_, peer.name, updates);
        for (const Point& p : curve(samples_, peer.name, updates, digs)) {
          csv.row(fmt::format("{},{},{},{:.6g},{:.6g},{},{}", peer.name, updates, p.voxel_m,
                              p.error, p.us_per_update, p.digs, p.failures));
        }
      }
      for (const double voxel : plan_.voxels_m) {
        for (const int updates : plan_.updates) write_mean(over, peer.name, voxel, updates);
      }
    }
  }

  void print() const {
    print_families();
    print_at_errors();
  }

 private:
  std::vector<std::size_t> placements(const Peer& peer) const {
    if (peer.name == "soilvdb") return plan_.placements;
    return {plan_.placements.back()};
  }

  /// What runs an engine is given of each dig: soilvdb all, peers those that are plotted.
  std::vector<std::pair<int, double>> settings(const Peer& peer) const {
    std::vector<std::pair<int, double>> all;
    for (const double voxel : plan_.voxels_m) all.emplace_back(kCommonUpdates, voxel);
    for (const int updates : plan_.updates) {
      if (updates == kCommonUpdates) continue;
      for (const double voxel : plan_.voxels_m) {
        if (peer.name == "soilvdb" || voxel == kCommonVoxel_m) all.emplace_back(updates, voxel);
      }
    }
    return all;
  }

  /// Dear runs last: where the time runs out, it is those that are missing.
  void measure(const Peer& peer, const test::Dig& dig, std::size_t placement) {
    const Stopwatch spent;
    const double cap_s = plan_.engine_cap_s / static_cast<double>(plan_.families.size());
    std::map<double, double> s_per_update;  // by voxel size
    for (const auto& [updates, voxel] : settings(peer)) {
      Sample s{peer.name, dig.family, static_cast<int>(placement), voxel, updates};
      if (spent.seconds() < cap_s && s_per_update[voxel] * updates < plan_.run_cap_s) {
        try {
          const Run r = run(peer.make, dig, voxel, updates, plan_.run_cap_s);
          s.error = r.error;
          s.us_per_update = r.us_per_update;
          s.failures = r.failures;
          s.complete = r.complete;
          s_per_update[voxel] = 1e-6 * r.us_per_update;
        } catch (const std::exception& e) {
          fmt::print("{} failed on {}: {}\n", peer.name, dig.family, e.what());
        }
      }
      csv_.row(fmt::format("{},{},{},{},{},{},{:.3g},{:.6g},{},{}", s.engine, s.family, s.placement,
                           s.voxel_m, s.updates, s.complete ? fmt::format("{:.6g}", s.error) : "",
                           dig.uncertainty_m3 / dig.exact_m3, s.us_per_update, s.failures,
                           int{s.complete}));
      samples_.push_back(std::move(s));
    }
  }

  /// Over all digs, or not at all: the same digs at every number of updates.
  void write_mean(Csv& csv, const std::string& engine, double voxel, int updates) const {
    double squares = 0, sum = 0, n = 0;
    for (const Sample& s : samples_) {
      if (s.engine != engine || s.voxel_m != voxel || s.updates != updates) continue;
      if (!s.complete) return;
      squares += s.error * s.error;
      sum += s.error;
      ++n;
    }
    if (n == 0) return;
    csv.row(fmt::format("{},{},{},{:.6g},{:.6g}", engine, voxel, updates, std::sqrt(squares / n),
                        sum / n));
  }

  /// soilvdb: the worst error of each family at each voxel size, and the order of convergence.
  void print_families() const {
    fmt::print("\nsoilvdb, worst |error| over placements and numbers of updates, %\n{:<22}",
               "family");
    for (const double voxel : plan_.voxels_m) fmt::print("{:>8g} cm", 100 * voxel);
    fmt::print("{:>18}{:>14}\n", "spread at finest", "us at finest");
    for (const std::string& family : plan_.families) {
      fmt::print("{:<22}", family);
      std::map<int, std::pair<double, double>> ranges;  // by placement, at the finest voxels
      double us = 0;
      for (const double voxel : plan_.voxels_m) {
        double worst = 0;
        for (const Sample& s : samples_) {
          if (s.engine != "soilvdb" || s.family != family || s.voxel_m != voxel || !s.complete)
            continue;
          worst = std::max(worst, std::abs(s.error));
          if (voxel != plan_.voxels_m.back()) continue;
          const auto [it, added] = ranges.try_emplace(s.placement, s.error, s.error);
          it->second = {std::min(it->second.first, s.error), std::max(it->second.second, s.error)};
          if (s.updates == kCommonUpdates) us = std::max(us, s.us_per_update);
        }
        fmt::print("{:>11.4f}", 100 * worst);
      }
      double spread = 0;
      for (const auto& [placement, range] : ranges) {
        spread = std::max(spread, range.second - range.first);
      }
      fmt::print("{:>18.4f}{:>14.1f}\n", 100 * spread, us);
    }
    fmt::print("\nchecked on a drag in twenty thick strokes at 2.5 cm:");
    for (const auto& [name, error] : checked_) fmt::print("  {} {:+.2f} %", name, 100 * error);
    fmt::print("\n");
  }

  /// Who is faster at which error: each engine over the digs that it and soilvdb completed.
  void print_at_errors() const {
    fmt::print(
        "\nTime per update at which an error is reached, us, and how many times soilvdb's that is: "
        "{}"
        "\nupdates per dig, rms over the digs both completed, between voxel sizes by linear"
        "\ninterpolation of log time over log error; <: the coarsest voxels err "
        "less.\n\n{:<14}{:>5}{:>7}",
        kCommonUpdates, "engine", "digs", "failed");
    for (const double error : kErrors) fmt::print("{:>16g} %", 100 * error);
    fmt::print("\n");
    Csv csv(folder_ / "at_error.csv",
            "engine,digs,failed_steps,error,us_per_update,soilvdb_us_per_update,ratio");
    for (const Peer& peer : engines()) {
      const auto digs = digs_done(samples_, peer.name, kCommonUpdates);
      const auto theirs = curve(samples_, peer.name, kCommonUpdates, digs);
      const auto ours = curve(samples_, "soilvdb", kCommonUpdates, digs);
      if (theirs.empty() || ours.empty()) continue;
      int failures = 0;
      for (const Point& p : theirs) failures += p.failures;
      fmt::print("{:<14}{:>5}{:>7}", peer.name, digs.size(), failures);
      for (const double error : kErrors) {
        const auto us = us_at_error(theirs, error), our_us = us_at_error(ours, error);
        const auto number = [](const std::optional<double>& value) {
          return value ? fmt::format("{:.4g}", *value) : "";
        };
        const std::string ratio = us && our_us ? fmt::format("{:.3g}", *us / *our_us) : "";
        std::string cell = "never";
        if (us) {
          cell = (theirs[0].error <= error ? "<" : "") + number(us);
          if (peer.name != "soilvdb") cell += our_us ? " " + ratio + "x" : ", soilvdb never";
        }
        fmt::print("{:>18}", cell);
        csv.row(fmt::format("{},{},{},{},{},{},{}", peer.name, digs.size(), failures, error,
                            number(us), number(our_us), ratio));
      }
      fmt::print("\n");
    }
  }

  Plan plan_;
  std::filesystem::path folder_;
  Csv csv_;
  std::vector<Sample> samples_;
  std::map<std::string, double> checked_;
};

}  // namespace
}  // namespace soilvdb::bench

int main(int argc, char** argv) try {
  using namespace soilvdb::bench;
  const Options options = parse(argc, argv, "accuracy");
  std::optional<tbb::global_control> limit;
  if (options.threads > 0) {
    limit.emplace(tbb::global_control::max_allowed_parallelism, options.threads);
  }
  fmt::print("{}\n", machine());
  Accuracy accuracy(options);
  accuracy.measure();
  accuracy.write_curves();
  accuracy.print();
} catch (const std::exception& e) {
  fmt::print(stderr, "bench accuracy: {}\n", e.what());
  return 1;
}
