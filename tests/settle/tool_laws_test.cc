// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What holds of the soil around a tool, whatever the tool, the soil and the way: it comes to rest,
// a wall holds it, a lip tips a ridge, and no heading is better than another.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <numeric>
#include <utility>
#include <vector>

#include "core/settle/obstacle.h"
#include "soilvdb/capacity.h"
#include "tests/support/capacity_fixture.h"
#include "tests/support/sanitized.h"
#include "tests/support/tool_scenes.h"
#include "tests/support/turned_scenes.h"

namespace soilvdb::test {
namespace tool_laws_test {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

// ---- Random scenes ----

/// Of each law.
std::uint64_t scenes() { return kLong ? 40 : 6; }
/// Fine voxels take several times as long.
double voxel_m(std::uint64_t scene) { return scene % 3 == 2 ? 0.05 : 0.1; }

/// Flat, a slope, or gentle waves; each with both voxels.
std::shared_ptr<const InitialTerrain> terrain(Random& random, std::uint64_t scene) {
  const double fall = random(0, 0.2), way = random(-std::numbers::pi, std::numbers::pi);
  switch ((scene + scene / 3) % 3) {
    case 0:
      return make_plane(0, {0, 0});
    case 1:
      return make_plane(0, fall * Vec2(std::cos(way), std::sin(way)));
    default:
      return terrains()[2];
  }
}

struct Site : ToolSite {
  using ToolSite::ToolSite;

  /// What must hold of soil that came to rest, and that it stays. @param taken as Faults'
  /// @return columns with loose soil
  std::size_t expect_rest(const Eigen::AlignedBox2i& taken = {}) {
    tracker.come_to_rest();
    const std::size_t columns = expect_no_faults(taken);
    const std::uint64_t hash = ground.state_hash();
    tracker.come_to_rest();
    EXPECT_EQ(ground.state_hash(), hash) << "it wasn't at rest";
    return columns;
  }
  std::size_t expect_no_faults(const Eigen::AlignedBox2i& taken) {
    EXPECT_EQ(residual(tracker), 0);
    const GroundWindow window = all_of(ground);
    const Faults faults(window, repose_rad(), taken);
    EXPECT_LE(faults.over_rad(0.99), 1.5 * kDegree);
    EXPECT_LE(faults.over_rad(1), 3 * kDegree);
    EXPECT_EQ(faults.needles(), 0);
    EXPECT_EQ(faults.slits(), 0);
    EXPECT_EQ(faults.hanging(), 0);
    return faults.loose_columns();
  }
  /// Cells under the bucket, and those from which a slope would be measured into it.
  Eigen::AlignedBox2i taken(const Pose& at) const {
    Eigen::AlignedBox2i cells;
    for (const Vec3& p : extremes(bucket)) {
      for (const double side : {-0.5, 0.5}) {
        const Vec3 corner(p.x(), side * bucket.width_m, p.z());
        const Vec2 cell = ground.index_from_world(at * corner).head<2>();
        cells.extend(Coord2(cell.array().round().matrix().cast<int>()));
      }
    }
    const Coord2 margin = Coord2::Constant(kFar + 1);
    return {cells.min() - margin, cells.max() + margin};
  }
};

double heading(Random& random) { return random(-std::numbers::pi, std::numbers::pi); }

Vec3 noise(Random& random, double most) {
  return {random(-most, most), random(-most, most), random(-most, most)};
}

// ---- Soil comes to rest ----

TEST(ToolLaws, SoilComesToRestAfterADrag) {
  std::size_t columns = 0;
  for (std::uint64_t seed = 0; seed < scenes(); ++seed) {
    SCOPED_TRACE(seed);
    Random random(1000 + seed);
    const double width_m = random(0.6, 2.5), depth_m = random(0.1, 0.5);
    const double length_m = random(2.5, 4), yaw = heading(random);
    const auto base = terrain(random, seed);
    Site site(voxel_m(seed), base, digger(width_m), random_soil(random));
    std::vector<Pose> path = drag({-length_m / 2, 0, 0}, length_m, depth_m, 60);
    add_way(path, {path.back().position + Vec3(0, 0, 2.5), path.back().rotation}, 5);
    site.go(yaw, path);
    columns += site.expect_rest();
  }
  EXPECT_GT(columns, 100 * scenes());
}

TEST(ToolLaws, SoilComesToRestAboveACutToe) {
  std::size_t columns = 0;
  for (std::uint64_t seed = 0; seed < scenes(); ++seed) {
    SCOPED_TRACE(seed);
    Random random(1100 + seed);
    // Lower than the heap at times: then soil comes down over it.
    const double width_m = random(0.6, 2.5), height_m = random(0.4, 1.2);
    const double depth_m = random(0.1, 0.3), heap_m3 = random(1.5, 4), yaw = heading(random);
    const auto base = terrain(random, seed);
    Earthmoving all = random_soil(random);
    all.pours = {{"heap", {0, 0, 6}, 0, 0, heap_m3}};
    Site site(voxel_m(seed), base, blade(width_m, height_m), all);
    site.tracker.pour(0, 0);
    const double radius_m = std::cbrt(3 * heap_m3 / (std::numbers::pi * site.slope()));
    const double aside_m = random(-0.5, 0.5) * radius_m, reach_m = random(0.4, 1);
    std::vector<Pose> path = {{Vec3(-radius_m - 0.6, aside_m, 0.3)}};
    add_way(path, {Vec3(-radius_m - 0.1, aside_m, -depth_m)}, 8);
    add_way(path, {Vec3(reach_m - radius_m, aside_m, -depth_m)}, 30);
    add_way(path, {Vec3(reach_m - radius_m, aside_m, 3)}, 10);
    site.go(yaw, path);
    columns += site.expect_rest();
  }
  EXPECT_GT(columns, 300 * scenes());
}

TEST(ToolLaws, SoilStrewnOnTheWayComesToRest) {
  std::size_t columns = 0;
  for (std::uint64_t seed = 0; seed < scenes(); ++seed) {
    SCOPED_TRACE(seed);
    Random random(1200 + seed);
    const double width_m = random(0.6, 2.5), depth_m = random(0.25, 0.5), yaw = heading(random);
    const auto base = terrain(random, seed);
    Site site(voxel_m(seed), base, digger(width_m), random_soil(random));
    std::vector<Pose> path = drag({-2, -1.6, 0}, 4, depth_m, 50);
    // What is behind the curled bucket's lip is 0.95 m below it.
    const Eigen::Quaterniond full = path.back().rotation;
    add_way(path, {Vec3(2, -1.6, 2.2), full}, 2);
    add_way(path, {Vec3(-1.5, 1.6, 2.2), full}, 4);
    add_way(path, {Vec3(-1.5, 1.6, 1.4), full}, 2);
    site.go(yaw, path);
    ASSERT_GT(site.load_m3(), 0.1 * width_m);
    path.erase(path.begin(), path.end() - 1);
    for (int i = 1; i <= 30; ++i) {
      const double s = i / 30.0;
      path.push_back({Vec3(-1.5 + 3 * s, 1.6, 1.4), from_rpy(0, -1.55 + 2.95 * s, 0)});
    }
    add_way(path, {Vec3(1.5, 1.6, 3), path.back().rotation}, 4);
    path.erase(path.begin());
    site.go(yaw, path);
    EXPECT_LT(site.load_m3(), 0.02 * width_m);
    columns += site.expect_rest();
  }
  EXPECT_GT(columns, 300 * scenes());
}

/// README's first dig, and any like it: a bucket in the air holds nothing up.
TEST(ToolLaws, NothingHangsBelowABucketThatCurledOutOfItsCut) {
  for (std::uint64_t seed = 0; seed < 3 * scenes(); ++seed) {
    SCOPED_TRACE(seed);
    Random random(1900 + seed);
    const double height_m = random(0.4, 0.8);
    const Bucket bucket{random(0.4, 1.2),
                        height_m,
                        {{0, 0}, {-random(0.3, 0.7), random(0, 0.4)}, {0, height_m}},
                        {}};
    const double depth_m = random(0.1, 0.35), length_m = random(0.8, 2), fall = random(-0.2, 0.2);
    const double yaw = heading(random), curl = random(0.3, 1.2), above_m = random(0.02, 0.3);
    Site site(seed % 2 == 0 ? 0.05 : 0.025,
              make_plane(0, fall * Vec2(std::cos(yaw), std::sin(yaw))), bucket,
              random_soil(random));
    Pose out{Vec3(length_m + 0.5, 0, 0), pitched(-curl)};
    double lowest_m = 0;  // of the bucket above the ground
    for (const Vec3& p : extremes(bucket)) {
      const Vec3 at = out * p;
      lowest_m = std::min(lowest_m, at.z() - fall * (at.x() - out.position.x()));
    }
    out.position.z() = above_m - lowest_m;
    std::vector<Pose> path = {{Vec3(-0.4, 0, 0.1), pitched(0.3)}};
    add_way(path, {Vec3(0, 0, -depth_m), pitched(0.1)}, 25);
    add_way(path, {Vec3(length_m, 0, -depth_m), pitched(0)}, 50);
    add_way(path, out, 25);
    site.go(yaw, path);
    const Pose above = site.placed(yaw, out);
    site.expect_rest(site.taken(above));
    // Soil that it spilled may reach up to it.
    const Obstacle tool(bucket, above, site.ground);
    const GroundWindow window = all_of(site.ground);
    int hanging = 0;
    for (int x = 0; x < window.nx(); ++x) {
      for (int y = 0; y < window.ny(); ++y) {
        const GroundColumn& c = window.at(x, y);
        const Coord2 cell = window.first() + Coord2(x, y);
        const double below = c.top - static_cast<double>(c.hangs) / 64;
        hanging += c.hangs > 0 && !tool.blocks(cell.x(), cell.y(), below, 0);
      }
    }
    EXPECT_EQ(hanging, 0);
  }
}

/// A digger that is dragged, stands in the ground and trembles.
struct Tremble {
  double width_m, depth_m, length_m, tremble_m, yaw;
  explicit Tremble(Random& random)
      : width_m(random(0.6, 2.5)),
        depth_m(random(0.1, 0.5)),
        length_m(random(2.5, 4)),
        tremble_m(random(0.001, 0.003)),
        yaw(heading(random)) {}
  std::vector<Pose> path(int steps) const {
    return drag({-length_m / 2, 0, 0}, length_m, depth_m, steps);
  }
};

TEST(ToolLaws, SoilComesToRestAroundATrembler) {
  std::size_t columns = 0;
  for (std::uint64_t seed = 0; seed < scenes(); ++seed) {
    SCOPED_TRACE(seed);
    Random random(1300 + seed);
    const Tremble drawn(random);
    const auto base = terrain(random, seed);
    Site site(voxel_m(seed), base, digger(drawn.width_m), random_soil(random));
    std::vector<Pose> path = drawn.path(60);
    path.resize(40);  // it isn't curled yet
    site.go(drawn.yaw, path);
    const Pose stands = site.placed(drawn.yaw, path.back());
    Pose at = stands;
    for (int i = 0; i < 50; ++i) {
      at.position = stands.position + noise(random, drawn.tremble_m);
      site.tracker.update(0, at);
    }
    columns += site.expect_rest(site.taken(at));
    for (int i = 1; i <= 10; ++i)  // and what leant on it, once it has gone
      site.tracker.update(0, {at.position + Vec3(0, 0, 0.3 * i), at.rotation});
    columns += site.expect_rest();
  }
  EXPECT_GT(columns, 100 * scenes());
}

// As sensors see a machine that stands.
TEST(ToolLaws, SoilBesideATremblerRestsAfterSomeTenthsOfASecond) {
  constexpr double kStands_s = 0.3;
  std::size_t columns = 0;
  for (std::uint64_t seed = 0; seed < scenes(); ++seed) {
    SCOPED_TRACE(seed);
    Random random(1350 + seed);
    const Tremble drawn(random);
    const auto base = terrain(random, seed);
    Earthmoving all = random_soil(random);
    all.pours = {{"heap", {0, 0, 6}, 0, 0, random(1.5, 3)}};  // through which it is cut
    Site site(voxel_m(seed), base, digger(drawn.width_m), all);
    site.tracker.pour(0, 0);
    std::vector<Pose> rows;
    for (const Pose& pose : drawn.path(300)) rows.push_back(site.placed(drawn.yaw, pose));
    rows.resize(200);
    const auto pass = [&](double begin_s, std::size_t from, double rows_hz) {
      std::vector<double> times_s;
      for (std::size_t i = from; i < rows.size(); ++i)
        times_s.push_back(begin_s + static_cast<double>(i - from) / rows_hz);
      const std::vector<Pose> part(rows.begin() + static_cast<std::ptrdiff_t>(from), rows.end());
      const Motion motion(times_s, part);
      for (double at_s = begin_s; at_s < motion.end_s();) {
        const double to_s = std::min(motion.end_s(), at_s + random(0.001, 0.05));
        site.tracker.update(0, motion, at_s, to_s);
        at_s = to_s;
      }
    };
    constexpr double kDigs_hz = 100, kDug_s = 1000;
    pass(kDug_s, 0, kDigs_hz);
    const Pose stands = rows.back();
    const std::size_t dug = rows.size() - 1;
    const int rows_more = seed % 3 == 0 ? 3 : 30;
    for (int i = 0; i < rows_more; ++i)
      rows.push_back({stands.position + noise(random, drawn.tremble_m), stands.rotation});
    // Its clock may have been set back.
    pass(seed % 2 == 0 ? kDug_s + static_cast<double>(dug) / kDigs_hz : 0, dug,
         rows_more / kStands_s);
    columns += site.expect_no_faults(site.taken(rows.back()));
    const MassBalance balance = site.tracker.mass_balance();
    EXPECT_LT(balance.units.loose_samples(balance.pending) * site.ground.sample_m3(), 0.005)
        << "in the air";
  }
  EXPECT_GT(columns, 100 * scenes());
}

/// What soil does later goes neither by how often a site was asked nor by when.
TEST(ToolLaws, ComingToRestWhereAllIsAtRestChangesNothingLater) {
  for (std::uint64_t seed = 0; seed < scenes(); ++seed) {
    SCOPED_TRACE(seed);
    Random random(1800 + seed);
    const double width_m = random(0.6, 2.5), depth_m = random(0.2, 0.5), yaw = heading(random);
    const Earthmoving all = random_soil(random);
    const int asked_at = static_cast<int>(random(5, 35));
    std::vector<Pose> path = {{Vec3(-8, 0, 1), pitched(0.3)}};
    add_way(path, {Vec3(-2, 0, 1), pitched(0.3)}, 40);
    for (const Pose& pose : drag({-2, 0, 0}, 3, depth_m, 50)) path.push_back(pose);
    std::uint64_t hashes[2];
    for (const bool asks : {false, true}) {
      Site site(voxel_m(seed), make_plane(0, {0, 0}), digger(width_m), all);
      for (int i = 0; i < std::ssize(path); ++i) {
        site.go(yaw, {path[static_cast<std::size_t>(i)]});
        if (asks && i == asked_at) site.tracker.come_to_rest();
      }
      hashes[asks] = site.ground.state_hash();
      EXPECT_GT(site.loose_m3(), 0.05);
    }
    EXPECT_EQ(hashes[0], hashes[1]);
  }
}

// ---- A wall holds ----

TEST(ToolLaws, AWallHoldsTheSoilBeforeIt) {
  constexpr double kYaws[] = {0, 30, 90, 137, 180, 211, 270, 333};
  constexpr double kDepth = 0.1, kWay = 3;
  for (std::uint64_t seed = 0; seed < scenes() + 2; ++seed) {
    SCOPED_TRACE(seed);
    Random random(1400 + seed);
    const double width_m = random(2, 4), height_m = random(1.5, 2.5);
    const double yaw = kYaws[seed % 8] * kDegree, h = voxel_m(seed);
    Site site(h, make_plane(0, {0, 0}), blade(width_m, height_m), random_soil(random));
    std::vector<Pose> path = {{Vec3(-0.6, 0, 0.2)}};
    add_way(path, {Vec3(0, 0, -kDepth)}, 10);
    add_way(path, {Vec3(kWay, 0, -kDepth)}, 40);
    site.go(yaw, path);
    site.tracker.come_to_rest();
    EXPECT_EQ(residual(site.tracker), 0);

    // Slices of two columns, for in one that is aslant to them some have none near the wall.
    const double middle_m = 0.3 * width_m;
    std::vector<double> crest_m(static_cast<std::size_t>(2 * middle_m / (2 * h)), -kDepth);
    double behind = 0, deepest = 0;
    each_column(site.ground, yaw, [&](const Vec2& at, const GroundColumn& column) {
      // Round its ends soil comes some way, and so it does where it came into the ground.
      if (at.x() > 0.5 && at.x() < kWay - kBladeDepth - 3 * h &&
          std::abs(at.y()) < width_m / 2 - 0.6) {
        behind += loose_depth(column);
        deepest = std::max(deepest, loose_depth(column));
      }
      const auto slice = static_cast<std::ptrdiff_t>(std::floor((at.y() + middle_m) / (2 * h)));
      if (at.x() < kWay || at.x() > kWay + 2 || slice < 0 || slice >= std::ssize(crest_m)) return;
      double& crest = crest_m[static_cast<std::size_t>(slice)];
      crest = std::max(crest, h * column.top);
    });
    const auto [low, high] = std::minmax_element(crest_m.begin(), crest_m.end());
    ASSERT_GT(*high, 0.2);
    ASSERT_LT(*high, height_m - kDepth) << "it comes over the wall";
    EXPECT_LT(behind * h * h * h, 0.005 * site.loose_m3());
    EXPECT_LT(deepest, 1);
    EXPECT_LE(*high - *low, 0.15);
    const double mean_m =
        std::accumulate(crest_m.begin(), crest_m.end(), 0.0) / static_cast<double>(crest_m.size());
    const double ridge_m =
        pushed_height_m(width_m, kDepth, kWay, site.slope(), 1 + site.all.soil->swell);
    // Columns beside the crest are lower than it. Soil that does not run round the ends makes it
    // higher.
    EXPECT_GT(mean_m, 0.85 * ridge_m);
    EXPECT_LT(mean_m, 1.03 * ridge_m);
  }
}

/// Across the way, where all of the side is as far ahead: which of its ends rounding puts first
/// says nothing.
TEST(ToolLaws, SoilPushedAsideLiesAlongTheSideThatPushes) {
  constexpr double kAstray_m = 1e-9;
  for (std::uint64_t seed = 0; seed < scenes(); ++seed) {
    SCOPED_TRACE(seed);
    Random random(1800 + seed);
    const double width_m = random(0.6, 2), depth_m = random(0.2, 0.4), way_m = random(1, 2);
    const double yaw = heading(random), aside = seed % 2 == 0 ? 1 : -1;
    const Earthmoving all = random_soil(random);
    const auto play = [&](double astray_m) {
      auto site =
          std::make_unique<Site>(voxel_m(seed), make_plane(0, {0, 0}), digger(width_m), all);
      std::vector<Pose> path = {{Vec3(0, 0, 1)}};
      add_way(path, {Vec3(0, 0, -depth_m)}, 10);
      add_way(path, {Vec3(astray_m, aside * way_m, -depth_m)}, 20);
      site->go(yaw, path);
      EXPECT_EQ(residual(site->tracker), 0);
      return site;
    };
    const auto forward = play(kAstray_m), back = play(-kAstray_m);
    const GroundWindow one = all_of(forward->ground), other = all_of(back->ground);
    ASSERT_EQ(one.first(), other.first());
    double square = 0;
    int columns = 0;
    for (int x = 0; x < one.nx(); ++x) {
      for (int y = 0; y < one.ny(); ++y) {
        const double off = one.at(x, y).top - other.at(x, y).top;
        if (std::abs(one.at(x, y).top) < 0.1) continue;
        square += off * off;
        ++columns;
      }
    }
    EXPECT_LT(std::sqrt(square / columns), 0.1);  // of a voxel

    Eigen::AlignedBox3d box;
    for (const Vec3& p : extremes(digger(width_m))) box.extend(p);
    double depth = 0, moment = 0;
    each_column(forward->ground, yaw, [&](const Vec2& at, const GroundColumn& column) {
      if (aside * at.y() < way_m + width_m / 2) return;  // what it pushed as it came down
      depth += loose_depth(column);
      moment += at.x() * loose_depth(column);
    });
    ASSERT_GT(depth, 0);
    EXPECT_NEAR(moment / depth, box.center().x(), 0.1 * box.sizes().x());
  }
}

// ---- A lip tips a ridge ----

TEST(ToolLaws, ALevelLipTipsARidge) {
  constexpr double kYaws[] = {0, 30, 90, 137, 211};
  for (std::uint64_t seed = 0; seed < scenes(); ++seed) {
    SCOPED_TRACE(seed);
    Random random(1500 + seed);
    const double width_m = random(1.5, 3), yaw = kYaws[seed % 5] * kDegree, h = voxel_m(seed);
    Site site(h, make_plane(0, {0, 0}), digger(width_m), random_soil(random));
    std::vector<Pose> path = drag({-3, 0, 0}, 4, 0.5, 50);
    const Eigen::Quaterniond full = path.back().rotation;
    const Vec3 lip(1, 8, 2);
    add_way(path, {Vec3(1, 0, 2), full}, 2);
    add_way(path, {lip, full}, 2);
    // About its lip: all that falls does so from there.
    for (int i = 1; i <= 40; ++i) path.push_back({lip, from_rpy(0, -1.55 + 3.0 * i / 40, 0)});
    site.go(yaw, path);
    site.tracker.come_to_rest();
    EXPECT_EQ(residual(site.tracker), 0);

    const auto there = [&](const Vec2& at) {
      return std::abs(at.x() - lip.x()) < 3 && std::abs(at.y() - lip.y()) < width_m / 2 + 3;
    };
    double cells = 0, top = 0, crest_x = 0;
    each_column(site.ground, yaw, [&](const Vec2& at, const GroundColumn& column) {
      if (!there(at)) return;
      cells += loose_depth(column);
      if (column.top <= top) return;
      top = column.top;
      crest_x = at.x();
    });
    double first = std::numeric_limits<double>::infinity(), last = -first;
    each_column(site.ground, yaw, [&](const Vec2& at, const GroundColumn& column) {
      if (!there(at) || std::abs(at.x() - crest_x) > 0.75 * h || loose_depth(column) <= 0.5) return;
      first = std::min(first, at.y());
      last = std::max(last, at.y());
    });
    const double volume_m3 = cells * h * h * h, k = site.slope();
    ASSERT_GT(volume_m3, 0.3 * width_m);
    const double a = ridge_height_m(volume_m3, width_m, k);
    // The mean height of a column in the middle of which the crest is.
    EXPECT_NEAR(h * top, a - k * h / 4, 0.1 * a);
    // It ends where the soil is half a cell deep, half a column beyond the last middle.
    const double length_m = width_m + 2 * (a - h / 2) / k;
    EXPECT_NEAR(last - first + h, length_m, 0.1 * length_m);
  }
}

// ---- No heading is better ----

Outcome play(const Cycles& cycles, const Turn& turn) {
  Outcome outcome = outcome_of(cycles, turn);
  EXPECT_EQ(outcome.residual, 0);
  return outcome;
}

void expect_loads(const Outcome& turned, const Outcome& straight, double share) {
  ASSERT_EQ(turned.loads_m3.size(), 2u);
  for (const std::size_t i : {0u, 1u}) {
    ASSERT_GT(straight.loads_m3[i], 0.1);
    EXPECT_NEAR(turned.loads_m3[i], straight.loads_m3[i], share * straight.loads_m3[i]) << i;
  }
}

/// Calls `f(scene, straight)` with scenes of two cycles and what became of them.
template <typename F>
void each_scene(const F& f) {
  for (std::uint64_t seed = 0; seed < (kLong ? 12 : 2); ++seed) {
    SCOPED_TRACE(seed);
    Random random(1600 + seed);
    const Cycles cycles(random, voxel_m(seed));
    f(cycles, play(cycles, {}));
  }
}

TEST(ToolLaws, QuarterTurnsAndMirrorsChangeNothing) {
  each_scene([](const Cycles& cycles, const Outcome& straight) {
    // Middles of cells come to middles of cells.
    for (const auto& [quarters, mirrored] :
         {std::pair(1, false), {2, false}, {3, false}, {0, true}}) {
      SCOPED_TRACE(::testing::Message() << 90 * quarters << (mirrored ? " mirrored" : ""));
      const Turn turn{quarters * std::numbers::pi / 2, mirrored};
      const Outcome turned = play(cycles, turn);
      // Goals: 0.5 % and 0.1 voxel. Samples don't turn with the scene, so counts differ, and where
      // soil is at the brink of sliding that moves a part of a heap's flank.
      expect_loads(turned, straight, 0.01);
      const Apart apart = heights_apart(straight, turned, turn);
      ASSERT_GT(apart.columns, 500);
      EXPECT_LE(apart.rms, 0.3);  // of a voxel
    }
  });
}

TEST(ToolLaws, AHeadingAslantToTheColumnsChangesLittle) {
  each_scene([](const Cycles& cycles, const Outcome& straight) {
    const Outcome turned = play(cycles, {30 * kDegree});
    expect_loads(turned, straight, 0.01);
    EXPECT_NEAR(turned.loose_m3, straight.loose_m3, 0.01 * straight.loose_m3);
    EXPECT_NEAR(turned.highest(), straight.highest(), 0.3);
  });
}

// ---- Load ----

TEST(ToolLaws, ABucketThatStandsHoldsNoMoreThanItCan) {
  int full = 0;
  for (std::uint64_t seed = 0; seed < scenes() + 2; ++seed) {
    SCOPED_TRACE(seed);
    Random random(1700 + seed);
    const Bucket bucket = seed % 2 == 0 ? digger(random(0.6, 2.5)) : random.bucket();
    Site site(voxel_m(seed), make_plane(0, {0, 0}), bucket, random_soil(random));
    const auto capacity = Capacity::of(bucket);
    ASSERT_TRUE(capacity);
    // As the settler has it, for C libraries differ in the last bits.
    const double slope = static_cast<float>(site.slope());
    Pose at;
    for (int i = 0; i < 24; ++i) {
      SCOPED_TRACE(i);
      if (i % 8 == 0) {  // it is filled
        const double y = 0.4 * i;
        at = {Vec3(3.2, y, 5), pitched(-1.3)};
        site.go(0, {{Vec3(0, y, 1), pitched(-0.3)},
                    {Vec3(0, y, -1.2), pitched(-0.3)},
                    {Vec3(3, y, -1.2), pitched(-0.3)},
                    {Vec3(3.2, y, -1), pitched(-1.3)},
                    at});
      } else if (i % 8 == 7) {
        at.rotation = random.machines_attitude();
      } else {
        const Vec3 turn = noise(random, 0.25);
        at.rotation = (at.rotation * from_rpy(turn.x(), turn.y(), turn.z())).normalized();
      }
      at.position = Vec3(3.2, -4, 5) + noise(random, 0.5);
      site.tracker.update(0, at);
      const Update update = site.tracker.update(0, at);
      const double most_m3 = capacity->at(at.rotation, slope).volume_m3;
      EXPECT_EQ(update.bucket_m3, site.load_m3());
      EXPECT_LE(update.bucket_m3, most_m3 + 1e-9);
      full += most_m3 > 0.01 && update.bucket_m3 > 0.99 * most_m3;
      ASSERT_EQ(residual(site.tracker), 0);
    }
  }
  EXPECT_GT(full, 15) << "of buckets that can't hold more";
}

}  // namespace
}  // namespace tool_laws_test
}  // namespace soilvdb::test
