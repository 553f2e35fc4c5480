// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Soil that is poured on ground of many shapes against where it must lie, at once and in parts, and
// how long that takes.
#include <fmt/core.h>

#include <algorithm>
#include <utility>

#include "bench/earthmoving.h"
#include "tests/support/pour_scenes.h"

namespace soilvdb::bench {
namespace {

using test::Scene;

constexpr double kFall = 20;     // m, from which soil comes: above all scenes
constexpr double kMoved = 0.01;  // cells that count as raised

/// The ground after a scene's pour in so many parts.
Heights poured(const Scene& scene, int parts) {
  constexpr double kPosts = 4;                    // to a column
  constexpr double kLow_m = -1.2, kHigh_m = 2.4;  // of ground with steps
  const double side = scene.ground.side_m;
  const Vec2 size(scene.ground.nx * side, scene.ground.ny * side), wide(side, side);
  // Columns of voxels are the scene's.
  Ground ground(side, Vec3(side / 2, side / 2, 0),
                scene.steps ? make_plane(0, {0, 0})
                            : posts(scene.shape, {-wide, size + wide}, side / kPosts));
  if (scene.steps)
    carve(ground, {Vec3(0, 0, kLow_m), Vec3(size.x(), size.y(), kHigh_m)}, scene.shape);
  const Vec3 from(scene.source.x(), scene.source.y(), kFall);
  Tracker tracker(ground, {},
                  loam(std::vector<Pour>(static_cast<std::size_t>(parts),
                                         {"part", from, 0, 0, scene.volume_m3 / parts})));
  for (int part = 0; part < parts; ++part) tracker.pour(static_cast<std::size_t>(part), 0);
  return heights(ground, 0, 0, scene.ground.nx, scene.ground.ny);
}

/// How far columns are from others that were raised, or should have been.
std::pair<Off, Off> off_of(const Scene& scene) {
  const Heights once = poured(scene, 1), parts = poured(scene, 50);
  const Columns truth = test::truth_of(scene);
  std::vector<double> from_truth, from_parts;
  for (int i = 0; i < truth.nx * truth.ny; ++i) {
    const auto n = static_cast<std::size_t>(i);
    const double ought = truth.at(i) / truth.side_m, was = scene.ground.at(i) / truth.side_m;
    if (std::max(ought, once.z[n]) - was < kMoved) continue;
    from_truth.push_back(once.z[n] - ought);
    from_parts.push_back(once.z[n] - parts.z[n]);
  }
  return {off(std::move(from_truth)), off(std::move(from_parts))};
}

/// Soil along a line, as a conveyor that travels puts it: at each level as much as the ridge takes
/// there, which at its ends is half a cone more.
void ridge(const Options& options, Goals& goals) {
  constexpr double kVoxel = 0.05, kLength = 2, kHeight = 0.6;
  const int points = 41, levels = options.quick ? 2 : 24;
  std::vector<Pour> pours;
  double all = 0;
  for (int n = 0; n < levels; ++n) {
    const auto volume = [&](double a) {
      return std::pair(a * a / kSlope * kLength / (points - 1),
                       std::numbers::pi * a * a * a / (6 * kSlope * kSlope));
    };
    const auto [line0, end0] = volume(kHeight * n / levels);
    const auto [line1, end1] = volume(kHeight * (n + 1) / levels);
    for (int p = 0; p < points; ++p) {
      const int at = n % 2 == 0 ? p : points - 1 - p;
      const bool end = at == 0 || at == points - 1;
      const double m3 = end ? end1 - end0 + (line1 - line0) / 2 : line1 - line0;
      pours.push_back({"", {kLength * at / (points - 1), 0.01, kFall}, 0, 0, m3});
      all += m3;
    }
  }
  Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
  Tracker tracker(ground, {}, loam(pours));
  for (std::size_t i = 0; i < pours.size(); ++i) tracker.pour(i, 0);
  const int beyond = static_cast<int>(1.2 * kHeight / kSlope / kVoxel);
  const int nx = static_cast<int>(kLength / kVoxel) + 2 * beyond + 1;
  const Heights h = heights(ground, -beyond, -beyond, nx, 2 * beyond + 1);
  std::vector<double> differences;
  for (int x = h.x0; x < h.x0 + h.nx; ++x) {
    for (int y = h.y0; y < h.y0 + h.ny; ++y) {
      const Vec2 at(x * kVoxel, y * kVoxel), foot(std::clamp(at.x(), 0.0, kLength), 0.01);
      const double ought = std::max(0.0, kHeight - kSlope * (at - foot).norm()) / kVoxel;
      if (std::max(ought, h.cell(x, y)) > kMoved) differences.push_back(h.cell(x, y) - ought);
    }
  }
  add(goals, fmt::format("ridge of {} pours along 2 m, {:.2f} m3", pours.size(), all),
      off(std::move(differences)), 0.4, 1);
}

void times(const Options& options, Goals& goals) {
  const auto pour_us = [](double voxel_m, double volume_m3) {
    Ground ground(voxel_m, Vec3::Zero(), make_plane(0.013, {0, 0}));
    Tracker tracker(ground, {}, loam({{"pour", {0.01, 0.02, 5}, 0, 0, volume_m3}}));
    return tracker.pour(0, 0).us;
  };
  const int n = options.quick ? 5 : 51;
  goals.add({"pour of 1 m3 at 5 cm on flat ground", median_ms(n, [&] { return pour_us(0.05, 1); }),
             "ms", 1.5});
  goals.add({"pour of 0.02 m3 at 2.5 cm on flat ground",
             median_ms(n, [&] { return pour_us(0.025, 0.02); }), "ms", 0.3});
}

}  // namespace

void measure_pours(const Options& options, Goals& goals) {
  std::vector<std::pair<std::string, Scene>> scenes;
  scenes.emplace_back("flat", test::flat_scene(24, test::kSide_m, {0.31, 0.17}));
  scenes.emplace_back("incline of 0.3 of repose", test::incline_scene(0.3));
  scenes.emplace_back("incline of 0.8 of repose", test::incline_scene(0.8));
  scenes.emplace_back("beside a wall", test::wall_scene(0.5));
  scenes.emplace_back("beside a ridge", test::beside_scene(true, 1.5));
  scenes.emplace_back("0.5 m from a step of 1 m, 3 m3", test::drop_scene(100, 3));
  for (const double m3 : {0.2, 1.0, 1.5, 3.0})
    scenes.emplace_back(fmt::format("0.5 m from a trench of 1 m x 1.5 m, {} m3", m3),
                        test::drop_scene(1.5, m3));
  Csv csv(options.out / "pours.csv", "scene,rms_voxels,p99_voxels,fifty_rms_voxels");
  const auto measure = [&](const std::string& name, const Scene& scene) {
    const auto both = off_of(scene);
    csv.row(fmt::format("{},{:.4f},{:.4f},{:.5f}", name, both.first.rms, both.first.p99,
                        both.second.rms));
    return both;
  };
  const auto report = [&](const std::string& name, const Off& error, double split) {
    add(goals, name, error, 0.4, 1);
    goals.add({name + ", one pour against fifty, rms", split, "voxel", 0.02});
  };
  for (const auto& [name, scene] : scenes) {
    const auto [error, split] = measure(name, scene);
    report(name, error, split.rms);
  }
  const int grounds = options.quick ? 1 : 20;
  Off worst;
  double worst_split = 0;
  for (int seed = 0; seed < grounds; ++seed) {
    const auto [error, split] = measure(fmt::format("gentle ground {}", seed),
                                        test::gentle_scene(static_cast<std::uint64_t>(seed), 0.7));
    worst = {std::max(worst.rms, error.rms), std::max(worst.p99, error.p99)};
    worst_split = std::max(worst_split, split.rms);
  }
  report(fmt::format("worst of {} random grounds up to 0.9 of repose", grounds), worst,
         worst_split);
  ridge(options, goals);
  times(options, goals);
}

}  // namespace soilvdb::bench
