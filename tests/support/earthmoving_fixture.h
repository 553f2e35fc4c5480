// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Sites whose soil moves, and what must hold on them whatever happens.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <memory>
#include <optional>
#include <random>
#include <vector>

#include "core/ground/ground_writer.h"
#include "soilvdb/capacity.h"
#include "soilvdb/tracker.h"
#include "tests/support/ground_window.h"

namespace soilvdb::test {

inline constexpr double kRepose = 0.61;
inline const double kSlope = std::tan(kRepose);

inline Earthmoving loam(double swell = 0.25) {
  Earthmoving all;
  all.soil = SoilProperties{kRepose, swell, 1800, {}, {}};
  return all;
}

inline Earthmoving loam_with_pours(std::vector<Pour> pours) {
  Earthmoving all = loam();
  all.pours = std::move(pours);
  return all;
}

/// An excavator's bucket of 0.9 m^3 or so.
inline Bucket digger() {
  return {
      1.2, 0.9, {{0, 0}, {-0.45, -0.1}, {-0.85, 0.15}, {-0.95, 0.55}, {-0.7, 0.9}, {0, 0.9}}, {}};
}

/// What came and what is there, units of mass: 0 if none was made or lost.
inline std::int64_t residual(const Tracker& tracker) {
  const MassBalance balance = tracker.mass_balance();
  return balance.ground + tracker.total().load + balance.pending + balance.hauled - balance.poured;
}

/// A raster whose height is made up; NaN: none there.
class MadeUpPosts final : public HeightSource {
 public:
  MadeUpPosts(const HeightGrid& grid, double (*z)(double, double)) : grid_(grid), z_(z) {}
  void read(int x0, int y0, int nx, int ny, float* out) const override {
    for (int y = y0; y < y0 + ny; ++y) {
      for (int x = x0; x < x0 + nx; ++x)
        *out++ = static_cast<float>(
            z_(grid_.first.x() + x * grid_.spacing.x(), grid_.first.y() + y * grid_.spacing.y()));
    }
  }

 private:
  HeightGrid grid_;
  double (*z_)(double, double);
};

inline std::shared_ptr<const InitialTerrain> raster(const HeightGrid& grid,
                                                    double (*z)(double, double)) {
  return make_height_field(grid, std::make_shared<MadeUpPosts>(grid, z));
}

/// The same ground again.
inline std::unique_ptr<Ground> copy_of(const Ground& ground) {
  auto copy =
      std::make_unique<Ground>(ground.voxel_size_m(), ground.origin(), ground.shared_terrain());
  for (const Chunk* chunk : ground.chunks()) GroundWriter(*copy).copy_from(ground, chunk->origin);
  return copy;
}

/// Columns around all chunks that changed.
inline GroundWindow all_of(const Ground& ground) {
  Eigen::AlignedBox2i box;
  for (const Chunk* chunk : ground.chunks()) {
    box.extend(Coord2(chunk->origin.head<2>() - Coord2(8, 8)));
    box.extend(Coord2(chunk->origin.head<2>() + Coord2(16, 16)));
  }
  if (box.isEmpty()) box.extend(Coord2(0, 0));
  return {ground, box.min(), box.sizes().x() + 1, box.sizes().y() + 1};
}

/// How much steeper than repose loose soil is, rad, sorted: by central differences where all nine
/// columns around hold more than half a voxel of it.
inline std::vector<double> over_repose(const GroundWindow& window) {
  std::vector<double> over;
  const auto thick = [&](int x, int y) {
    const GroundWindow::Column& c = window.at(x, y);
    return c.known && c.top - c.bank > 0.5;
  };
  for (int x = 1; x + 1 < window.nx(); ++x) {
    for (int y = 1; y + 1 < window.ny(); ++y) {
      bool all = true;
      for (int i = -1; i <= 1; ++i)
        for (int j = -1; j <= 1; ++j) all = all && thick(x + i, y + j);
      if (!all) continue;
      const double a = (window.at(x + 1, y).top - window.at(x - 1, y).top) / 2;
      const double b = (window.at(x, y + 1).top - window.at(x, y - 1).top) / 2;
      over.push_back(std::max(0.0, std::atan(std::hypot(a, b)) - kRepose));
    }
  }
  std::sort(over.begin(), over.end());
  return over;
}

/// Samples of air below the topmost full cell where loose soil lies: it came to rest on nothing.
inline std::int64_t pockets(const Ground& ground) {
  std::int64_t air = 0;
  for (const Chunk* chunk : ground.chunks()) {
    if (chunk->soil_count == 0) continue;
    SampleWords words, loose;
    ground.read_samples(chunk->origin, words);
    ground.read_loose(chunk->origin, loose);
    for (int c = 0; c < 64; ++c) {
      // Air below a cell full of soil that is all loose, in one chunk.
      bool below = false;
      for (int k = 7; k >= 0; --k) {
        const auto n = static_cast<std::size_t>(c * 8 + k);
        below |= loose[n] == kAllSoil;
        if (below) air += 64 - std::popcount(words[n]);
      }
    }
  }
  return air;
}

inline std::int64_t loose_samples(const Ground& ground) {
  std::int64_t sum = 0;
  for (const Chunk* chunk : ground.chunks()) sum += chunk->loose_count;
  return sum;
}

/// A dig along x in a trench `depth` deep, curled up at its end.
inline std::vector<Pose> drag(const Vec3& from, double length, double depth, int steps) {
  std::vector<Pose> path;
  for (int i = 0; i <= steps; ++i) {
    const double s = static_cast<double>(i) / steps, curl = std::max(0.0, (s - 0.7) / 0.3);
    const double down = std::min(1.0, s / 0.15);
    path.push_back({from + Vec3(length * std::min(s / 0.85, 1.0), 0,
                                0.3 - (0.3 + depth) * down + 1.5 * std::max(0.0, (s - 0.8) / 0.2)),
                    from_rpy(0, 0.35 - 1.9 * curl, 0)});
  }
  return path;
}

/// A dig, a swing aside and a tip there.
inline std::vector<Pose> cycle(const Vec3& from, double depth, int steps, double aside = 4) {
  std::vector<Pose> path = drag(from, 4, depth, steps);
  const Pose full = path.back();
  for (int i = 1; i <= steps / 3; ++i)
    path.push_back(
        {full.position + Vec3(0, aside * 3 * i / steps, 1.0 * 3 * i / steps), full.rotation});
  const Vec3 over = path.back().position;
  for (int i = 0; i <= steps / 3; ++i)
    path.push_back({over, from_rpy(0, -1.55 + 3.0 * 3 * i / steps, 0)});
  return path;
}

/// Anything a site may be asked for, at random, on ground that ends.
class Work {
 public:
  Work(std::shared_ptr<const InitialTerrain> base, std::uint64_t seed, double voxel_size_m = 0.1,
       std::optional<double> cohesion_pa = {})
      : owned(std::make_unique<Ground>(voxel_size_m, Vec3::Zero(), std::move(base))),
        random(seed),
        tracker(ground, buckets(), site(cohesion_pa)) {}
  /// To be gone on with apart from the other.
  Work(const Work& other)
      : owned(other.ground.clone()),
        random(other.random),
        tracker(ground, other.tracker),
        at(other.at),
        time_s(other.time_s) {}

  static std::vector<Bucket> buckets() {
    Bucket dumping = digger(), plate{1.0, 0.6, {}, 0.8}, spoon = digger();
    dumping.dump_angle_rad = 1.0;
    spoon.width_m = 0.15;
    return {digger(), dumping, plate, spoon};
  }
  static Earthmoving site(std::optional<double> cohesion_pa) {
    Earthmoving all = loam_with_pours({{"a", {1, 1, 4}, 0, 100, 3},
                                       {"b", {-2, 1.5, 4}, 0, 100, 1},
                                       {"c", {3.9, 0, 4}, 20, 20, 0.5}});
    all.soil->cohesion_pa = cohesion_pa;
    all.hoppers.push_back({"hopper", {Vec2(-3, -3), Vec2(-1.5, -2)}, 0.5});
    return all;
  }
  double unit() { return std::uniform_real_distribution<double>(0, 1)(random); }
  void step() {
    const std::size_t machine = random() % 4;
    const std::uint64_t kind = random() % 24;
    try {
      if (kind == 0) {
        time_s += 1;
        tracker.pour(random() % 3, time_s);
      } else if (kind == 1) {
        tracker.come_to_rest();
      } else if (kind < 6) {  // tips where it is
        tracker.update(machine, {at[machine].position, from_rpy(0, 1.6 * unit(), 3 * unit())});
      } else {
        Pose& to = at[machine];
        to.position += Vec3(1.6 * unit() - 0.8, 1.6 * unit() - 0.8, 0.8 * unit() - 0.4);
        to.position = to.position.cwiseMax(Vec3(-4, -3, -0.6)).cwiseMin(Vec3(4, 3, 1.5));
        to.rotation = from_rpy(0.2 * unit(), 2 * unit() - 1.4, 6 * unit());
        tracker.update(machine, to);
      }
    } catch (const NoGroundError&) {
      at[machine].position = {-2, 0, 1.5};
      tracker.update(machine, at[machine]);
    }
  }

  std::unique_ptr<Ground> owned;
  Ground& ground = *owned;
  std::mt19937_64 random;
  Tracker tracker;
  std::vector<Pose> at{4, Pose{{0, 0, 2}}};
  double time_s = 0;
};

inline std::vector<std::shared_ptr<const InitialTerrain>> terrains() {
  const HeightGrid grid{23, 21, {-6.03, -5.02}, {0.5, 0.5}};
  return {make_plane(0, {0, 0}), make_plane(0.1, {0.25, -0.15}),
          raster(grid, [](double x, double y) { return 0.2 * std::sin(x) + 0.1 * y; })};
}

}  // namespace soilvdb::test
