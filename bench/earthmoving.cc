// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Soil that moves: how round and how steep a cone is, how well mass closes, what it costs, and that
// the time step doesn't matter. Cones also by rules between neighbours, as others have them.
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <numbers>
#include <random>

#include "bench/report.h"
#include "bench/site.h"
#include "core/settle/ground_window.h"
#include "soilvdb/capacity.h"
#include "soilvdb/tracker.h"

namespace soilvdb::bench {
namespace {

constexpr double kRepose = 35 * std::numbers::pi / 180;
const double kSlope = std::tan(kRepose);
constexpr double kDegree = std::numbers::pi / 180;
constexpr int kDirections = 48;

Earthmoving loam(std::vector<Pour> pours = {}) {
  return {SoilProperties{kRepose, 0.25, 1800, {}, {}}, std::move(pours), {}};
}

Bucket digger() {
  Bucket bucket = excavator_bucket();
  const double h = bucket.height_m;
  bucket.profile = {
      {0, 0}, {-0.5 * h, -0.1 * h}, {-0.95 * h, 0.2 * h}, {-1.05 * h, 0.6 * h}, {-0.75 * h, h},
      {0, h}};
  return bucket;
}

/// Heights of columns over a square about (0, 0), cells.
struct Heights {
  int half;
  std::vector<double> z;
  double at(double x, double y) const {  // bilinear
    const int i = static_cast<int>(std::floor(x)), j = static_cast<int>(std::floor(y));
    const double u = x - i, v = y - j;
    return (1 - u) * ((1 - v) * cell(i, j) + v * cell(i, j + 1)) +
           u * ((1 - v) * cell(i + 1, j) + v * cell(i + 1, j + 1));
  }
  double cell(int x, int y) const {
    return z[static_cast<std::size_t>((x + half) * (2 * half + 1) + y + half)];
  }
};

Heights heights(const Soil& soil, int half) {
  const GroundWindow window(soil, {-half, -half}, 2 * half + 1, 2 * half + 1);
  Heights all{half, {}};
  for (int x = 0; x < window.nx(); ++x)
    for (int y = 0; y < window.ny(); ++y) all.z.push_back(window.at(x, y).top + 0.5);
  return all;
}

/// What a rule between neighbouring columns makes of soil that comes in small parts at one column:
/// each gives the lowest neighbour half of what is too steep between them, until nothing is.
Heights relaxed(int half, double volume, int neighbours) {
  Heights all{half, std::vector<double>(static_cast<std::size_t>((2 * half + 1) * (2 * half + 1)))};
  const auto at = [&](int x, int y) -> double& {
    return all.z[static_cast<std::size_t>((x + half) * (2 * half + 1) + y + half)];
  };
  constexpr int kWays[8][2] = {{1, 0}, {0, 1},  {-1, 0},  {0, -1},
                               {1, 1}, {-1, 1}, {-1, -1}, {1, -1}};
  constexpr int kParts = 200;
  for (int part = 0; part < kParts; ++part) {
    at(0, 0) += volume / kParts;
    for (bool moved = true; moved;) {
      moved = false;
      for (int x = -half + 1; x < half; ++x) {
        for (int y = -half + 1; y < half; ++y) {
          double most = 1e-3;
          int way = -1;
          for (int n = 0; n < neighbours; ++n) {
            const double far = n < 4 ? 1 : std::numbers::sqrt2;
            const double excess = at(x, y) - at(x + kWays[n][0], y + kWays[n][1]) - kSlope * far;
            if (excess > most) most = excess, way = n;
          }
          if (way < 0) continue;
          at(x, y) -= most / 2;
          at(x + kWays[way][0], y + kWays[way][1]) += most / 2;
          moved = true;
        }
      }
    }
  }
  return all;
}

/// Mean slope down a direction, between a quarter and nine tenths of the radius.
double slope_deg(const Heights& h, double radius, double turn) {
  const double r0 = 0.25 * radius, r1 = 0.9 * radius, c = std::cos(turn), s = std::sin(turn);
  return std::atan((h.at(r0 * c, r0 * s) - h.at(r1 * c, r1 * s)) / (r1 - r0)) / kDegree;
}

double worst_slope_deg(const Heights& h, double radius) {
  double worst = 0;
  for (int i = 0; i < kDirections; ++i)
    worst = std::max(worst, std::abs(slope_deg(h, radius, 2 * std::numbers::pi * i / kDirections) -
                                     kRepose / kDegree));
  return worst;
}

/// Radius at which a heap is a third of a cone's height, in a direction.
double outline(const Heights& h, double radius, double turn) {
  const double level = kSlope * radius / 3;
  double r = 0;
  while (r < h.half - 2 && h.at(r * std::cos(turn), r * std::sin(turn)) > level) r += 0.01;
  return r;
}

std::int64_t residual(const Tracker& tracker) {
  const SiteLedger site = tracker.site();
  return site.ground + tracker.total().load + site.in_flight + site.hauled - site.poured;
}

void cones(const Options& options, Goals& goals) {
  Csv csv(options.out / "cones.csv",
          "radius_voxels,slope_error_deg,height_rms_voxels,height_p99_voxels,residual_samples,us");
  for (const double radius : {6.0, 8.0, 12.0, 18.0, 24.0}) {
    constexpr double kVoxel = 0.05;
    const double volume = std::numbers::pi * kSlope * std::pow(radius * kVoxel, 3) / 3;
    Soil soil(kVoxel, Vec3::Zero(), make_plane(-kVoxel / 2, {0, 0}));
    Tracker tracker(soil, {}, loam({{"pour", {0, 0, 5}, 0, 0, volume}}));
    const Update update = tracker.pour(0, 0);
    const Heights h = heights(soil, static_cast<int>(radius) + 6);
    std::vector<double> off;
    double squares = 0;
    for (int x = -h.half; x <= h.half; ++x) {
      for (int y = -h.half; y <= h.half; ++y) {
        const double d = std::hypot(x, y);
        if (d > 1.1 * radius) continue;
        off.push_back(std::abs(h.cell(x, y) - std::max(0.0, kSlope * (radius - d))));
        squares += off.back() * off.back();
      }
    }
    const double rms = std::sqrt(squares / static_cast<double>(off.size()));
    const double p99 = quantile(off, 0.99), worst = worst_slope_deg(h, radius);
    const double lost = soil.change_m3() / soil.sample_m3() - std::floor(volume / soil.sample_m3());
    csv.row(
        fmt::format("{},{:.4f},{:.4f},{:.4f},{},{:.1f}", radius, worst, rms, p99, lost, update.us));
    const std::string name = fmt::format("cone of {} voxels", radius);
    goals.add({name + ", slope in its worst direction", worst, "deg", radius < 12 ? 0.6 : 0.3});
    goals.add({name + ", heights rms", rms, "voxel", 0.25});
    goals.add({name + ", heights p99", p99, "voxel", 0.5});
    goals.add({name + ", samples more or less than poured", std::abs(lost), "", 0.0});
    if (radius != 24) continue;
    // The same volume by others' rules, and all their outlines.
    Csv outlines(options.out / "outlines.csv", "turn_deg,circle,soilvdb,four,eight");
    const double cells = volume / (kVoxel * kVoxel * kVoxel);
    const Heights four = relaxed(40, cells, 4), eight = relaxed(40, cells, 8);
    goals.add({"the same by four neighbours", worst_slope_deg(four, radius), "deg"});
    goals.add({"the same by eight neighbours", worst_slope_deg(eight, radius), "deg"});
    for (int i = 0; i <= 4 * kDirections; ++i) {
      const double turn = 2 * std::numbers::pi * i / (4 * kDirections);
      outlines.row(fmt::format("{},{},{},{},{}", turn / kDegree, radius * 2 / 3,
                               outline(h, radius, turn), outline(four, radius, turn),
                               outline(eight, radius, turn)));
    }
  }
}

/// A time, the median of a few.
template <typename F>
double median_ms(int times, const F& f) {
  std::vector<double> ms;
  for (int i = 0; i < times; ++i) ms.push_back(f() / 1e3);
  return quantile(ms, 0.5);
}

void pours(const Options& options, Goals& goals) {
  const auto pour_us = [](double voxel_m, double volume_m3) {
    Soil soil(voxel_m, Vec3::Zero(), make_plane(0.013, {0, 0}));
    Tracker tracker(soil, {}, loam({{"pour", {0.01, 0.02, 5}, 0, 0, volume_m3}}));
    return tracker.pour(0, 0).us;
  };
  const int times = options.quick ? 5 : 51;
  goals.add({"pour of 1 m3 at 5 cm on flat ground",
             median_ms(times, [&] { return pour_us(0.05, 1); }), "ms", 1.5});
  goals.add({"pour of 0.02 m3 at 2.5 cm on flat ground",
             median_ms(times, [&] { return pour_us(0.025, 0.02); }), "ms", 0.3});
}

/// One cycle of an excavator: it digs, curls, lifts, swings and tips onto a heap. In s of 15.
Motion cycle(int n) {
  std::vector<double> times;
  std::vector<Pose> poses;
  const auto add = [&](double s, double x, double y, double z, double pitch) {
    times.push_back(15 * n + s);
    poses.push_back({{x, y, z}, from_rpy(0, pitch, 0)});
  };
  const double y = 1.5 * (n % 3), deep = -0.35 * (n / 3 + 1);
  add(0, -3, y, 0.8, 0.35);
  add(2, -3, y, deep, 0.35);
  add(4.5, -0.8, y, deep, 0.2);
  add(6.5, 0.2, y, deep + 0.5, -1.3);
  add(8, 0, y, 2.2, -1.55);
  add(11, -1, 6, 2.2, -1.55);
  add(13, -1, 6, 2.2, 1.3);
  add(14.9, -3, y, 1.5, 0.35);
  return {times, poses};
}

struct Work {
  double load_m3 = 0, us_p99 = 0, us_max = 0;
  std::int64_t residual = 0;
  Heights ground{0, {}};
};

Work dig_cycles(double voxel_m, int cycles, int updates, std::shared_ptr<const BaseSurface> base) {
  Soil soil(voxel_m, Vec3::Zero(), std::move(base));
  Tracker tracker(soil, {digger()}, loam());
  std::vector<double> us;
  Work work;
  for (int n = 0; n < cycles; ++n) {
    const Motion motion = cycle(n);
    const double begin = motion.begin_s(), length = motion.end_s() - begin;
    for (int i = 0; i < updates; ++i) {
      const Update update = tracker.update(0, motion, begin + length * i / updates,
                                           begin + length * (i + 1) / updates);
      us.push_back(update.us);
      if (n == 0 && i == updates * 2 / 3) work.load_m3 = update.bucket_m3;  // as it swings
    }
    work.residual |= residual(tracker);
  }
  tracker.come_to_rest();
  work.residual |= residual(tracker);
  work.us_max = *std::max_element(us.begin(), us.end());
  work.us_p99 = quantile(us, 0.99);
  work.ground = heights(soil, static_cast<int>(9 / voxel_m));
  return work;
}

void cycles(const Options& options, Goals& goals) {
  const int n = options.quick ? 2 : 6;
  const auto plane = [] { return make_plane(0, {0, 0}); };
  const Work fine = dig_cycles(0.05, n, 1500, plane());
  goals.add({"an excavator's cycle at 100 Hz, 5 cm: p99 update", fine.us_p99 / 1e3, "ms", 5});
  goals.add({"the same, slowest update", fine.us_max / 1e3, "ms", 15});
  goals.add({"mass residual", static_cast<double>(std::abs(fine.residual)), "units", 0.0});
  const double heaped = Capacity::of(digger())->heaped_m3();
  goals.add({"load as it swings over heaped capacity, less 1", 100 * (fine.load_m3 / heaped - 1),
             "%", 0.5, -5.0});

  const Work coarse = dig_cycles(0.05, n, 30, plane()), many = dig_cycles(0.05, n, 5000, plane());
  double moved = 0, differ = 0;
  for (std::size_t i = 0; i < many.ground.z.size(); ++i) {
    moved += std::abs(many.ground.z[i] - 0.5);
    differ += std::abs(many.ground.z[i] - coarse.ground.z[i]);
  }
  goals.add({"load in 30 updates against 5000", 100 * std::abs(coarse.load_m3 / many.load_m3 - 1),
             "%", 0.5});
  goals.add({"heights in 30 updates against 5000, of what moved", 100 * differ / moved, "%", 2});

  const Work small = dig_cycles(0.05, 1, 1500, make_hills(20)),
             large = dig_cycles(0.05, 1, 1500, make_hills(10'000));
  goals.add(
      {"p99 update on a site of 10 km over one of 20 m", large.us_p99 / small.us_p99, "", 1.1});
}

/// A bucket that wanders about at random, digs, tips over a hopper and beside it, under pours.
void mass(const Options& options, Goals& goals) {
  const int operations = options.quick ? 5'000 : 1'000'000;
  std::mt19937_64 random(1);
  const auto draw = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53;
  };
  std::vector<Pour> pours;
  for (int i = 0; i < operations / 50; ++i)
    pours.push_back({"", {draw(-4, 4), draw(-4, 4), 4}, 0, 0, draw(0.001, 0.1)});
  Earthmoving earthmoving = loam(std::move(pours));
  earthmoving.hoppers.push_back({"truck", {Vec2(-5, -1), Vec2(-3, 1)}, 1.2});
  Soil soil(0.1, Vec3::Zero(), make_plane(0, {0.1, 0.05}));
  Tracker tracker(soil, {digger()}, earthmoving);
  std::int64_t worst = 0;
  Vec3 at(0, 0, 1), rpy(0, 0, 0);
  for (int i = 0; i < operations; ++i) {
    if (i % 50 == 0) {
      tracker.pour(static_cast<std::size_t>(i / 50), 0);
    } else {
      for (int a = 0; a < 3; ++a) at[a] += draw(-0.2, 0.2);
      at = at.cwiseMax(Vec3(-4, -4, -0.8)).cwiseMin(Vec3(4, 4, 2));
      rpy.y() = std::clamp(rpy.y() + draw(-0.3, 0.3), -1.6, 1.6);
      rpy.z() += draw(-0.2, 0.2);
      tracker.update(0, Pose{at, from_rpy(rpy.x(), rpy.y(), rpy.z())});
    }
    worst = std::max(worst, std::abs(residual(tracker)));
  }
  goals.add({fmt::format("mass residual over {} random operations", operations),
             static_cast<double>(worst), "units", 0.0});
}

void run(const Options& options) {
  Goals goals(options.out);
  Progress progress(4);
  cones(options, goals);
  progress.step("cones");
  pours(options, goals);
  progress.step("pours");
  cycles(options, goals);
  progress.step("cycles");
  mass(options, goals);
  progress.step("mass");
  goals.print();
}

}  // namespace
}  // namespace soilvdb::bench

int main(int argc, char** argv) {
  try {
    soilvdb::bench::run(soilvdb::bench::parse(argc, argv, "earthmoving"));
    return 0;
  } catch (const std::exception& e) {
    fmt::print(stderr, "bench_earthmoving: {}\n", e.what());
    return 1;
  }
}
