// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Earthmoving where it is most likely to fail: at edges of all kinds, too much, too little, in the
// way.
#include <gtest/gtest.h>

#include <bit>
#include <ctime>
#include <limits>
#include <numbers>

#include "core/lattice/chunk_math.h"
#include "tests/support/earthmoving_fixture.h"
#include "tests/support/sanitized.h"

namespace soilvdb::test {
namespace earthmoving_attack_test {

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kVoxel = 0.1;
// Of this process's own time: others may keep it waiting.
constexpr std::clock_t kSoon = test::cpu_s(5);

struct Site {
  Ground ground;
  Tracker tracker;
  Site(std::shared_ptr<const InitialTerrain> base, std::vector<Bucket> buckets, Earthmoving all,
       const Vec3& origin = Vec3::Zero())
      : ground(kVoxel, origin, std::move(base)),
        tracker(ground, std::move(buckets), std::move(all)) {}
};

/// What must hold of anything poured, on ground no steeper than repose.
/// @param steep most that a column may be over repose
void expect_poured(const char* what, std::shared_ptr<const InitialTerrain> base,
                   const std::vector<Pour>& pours, double steep = 3 * kDegree,
                   const Vec3& origin = Vec3::Zero()) {
  SCOPED_TRACE(what);
  Site site(std::move(base), {}, loam_with_pours(pours), origin);
  double samples = 0;
  const std::clock_t begin = std::clock();
  for (std::size_t i = 0; i < pours.size(); ++i) {
    site.tracker.pour(i, 100);
    samples += pours[i].volume_m3 / site.ground.sample_m3();
  }
  EXPECT_LT(std::clock() - begin, kSoon);
  EXPECT_EQ(residual(site.tracker), 0);
  EXPECT_NEAR(static_cast<double>(loose_samples(site.ground)), samples, 1);
  EXPECT_EQ(pockets(site.ground), 0);
  const std::vector<double> over = over_repose(all_of(site.ground));
  EXPECT_LE(over.empty() ? 0 : over.back(), steep);
}

double flat(double, double) { return 0; }
const HeightGrid kGrid{9, 9, {-4, -4}, {1, 1}};

TEST(EarthmovingAttack, PoursOfAnySizeAnywhere) {
  const auto plane = [](double z, const Vec2& slope) {
    return std::shared_ptr<const InitialTerrain>(make_plane(z, slope));
  };
  const auto pour = [](const Vec3& at, double volume_m3) { return Pour{"a", at, 0, 0, volume_m3}; };
  expect_poured("slope", plane(0, {0.5, 0.2}), {pour({0, 0, 2}, 1)});
  expect_poured("slope of repose", plane(0, {0.6, 0.35}), {pour({0, 0, 2}, 1)});
  expect_poured("less than a sample", plane(0, {0, 0}), {pour({0, 0, 2}, 1e-6)});
  expect_poured("samples made of two", plane(0, {0, 0}),
                {pour({0, 0, 2}, 1e-5), pour({1, 0, 2}, 1e-5)});
  expect_poured("huge", plane(0, {0, 0}), {pour({0, 0, 2}, 1000)});
  expect_poured("huge on a slope", plane(0, {0.3, 0}), {pour({0, 0, 2}, 300)});
  expect_poured("UTM", plane(300, {0, 0}), {pour({455003.3, 5412002.1, 303}, 1)}, 3 * kDegree,
                {455000.03, 5412000.07, 300.02});
  expect_poured("far from the origin", plane(300, {0, 0}), {pour({455003.3, 5412002.1, 303}, 1)});
  expect_poured("from below the ground", plane(0, {0, 0}), {pour({0, 0, -5}, 1)});
  expect_poured("a raster's edge", raster(kGrid, flat), {pour({4, 0, 2}, 1)});
  expect_poured("a raster's corner", raster(kGrid, flat), {pour({4, 4, 2}, 1)});
  expect_poured("beside a raster", raster(kGrid, flat), {pour({5, 0, 2}, 1)});
  expect_poured("a full raster", raster(kGrid, flat), {pour({0, 0, 2}, 200)});
  expect_poured("a hole",
                raster(kGrid,
                       [](double x, double y) {
                         return x == 1 && y == 1 ? std::numeric_limits<double>::quiet_NaN()
                                                 : 0.1 * x;
                       }),
                {pour({1, 1, 2}, 1)});
  expect_poured(
      "waves",
      raster({41, 41, {-10, -10}, {0.5, 0.5}},
             [](double x, double y) { return 0.7 * std::sin(2 * x) * std::cos(1.7 * y); }),
      {pour({0.3, 0.2, 2}, 5), pour({2, 0.2, 2}, 5)});
  // Goal: 3 degrees; columns at the cliff's foot that it fills in part are steeper.
  expect_poured("a cliff",
                raster({101, 41, {-10, -10}, {0.2, 0.5}},
                       [](double x, double) { return x < 0.1 ? 2.0 : 0.0; }),
                {pour({-0.5, 0.2, 2}, 5)}, 7 * kDegree);
}

/// Samples that a box of the plan lost or got, each counted.
std::int64_t changed_samples(const Ground& ground, const Eigen::AlignedBox2d& box_m) {
  std::int64_t changed = 0;
  for (const Chunk* chunk : ground.chunks()) {
    SampleWords now, before;
    ground.read_samples(chunk->origin, now);
    ground.read_base(chunk->origin, before);
    for (std::size_t n = 0; n < now.size(); ++n) {
      const Vec3 at = ground.world_from_index(
          (chunk->origin + numbered_voxel(static_cast<int>(n))).cast<double>());
      if (box_m.contains(at.head<2>())) changed += std::popcount(now[n] ^ before[n]);
    }
  }
  return changed;
}

/// 80 m long, then level ground.
template <int kPercent>
double long_slope(double x, double) {
  return -0.01 * kPercent * std::clamp(x, -80.0, 0.0);
}

TEST(EarthmovingAttack, SoilRunsDownALongSteepSlopeToItsFoot) {
  // From hardly steeper than repose, which is 0.7, to much steeper.
  for (const auto& slope : {&long_slope<80>, &long_slope<90>, &long_slope<130>}) {
    Site site(raster({601, 41, {-100, -10}, {0.2, 0.5}}, slope), {},
              loam_with_pours({{"a", {-75.03, 0.02, 110}, 0, 0, 0.5}}));
    SCOPED_TRACE(slope(-1, 0));
    const std::clock_t begin = std::clock();
    site.tracker.pour(0, 0);
    EXPECT_LT(std::clock() - begin, kSoon);
    EXPECT_EQ(residual(site.tracker), 0);
    EXPECT_NEAR(site.ground.change_m3(), 0.5, 1e-3);
    // Columns hold a film on their steps.
    EXPECT_LT(changed_samples(site.ground, {Vec2(-80, -9), Vec2(-2, 9)}), 32000 / 8);
  }
}

TEST(EarthmovingAttack, SoilThatRunsDownWithoutAnEndIsLostOffTheSite) {
  Site site(make_plane(0, {0.9, 0.1}), {}, loam_with_pours({{"a", {0, 0, 1}, 0, 0, 1}}));
  const std::clock_t begin = std::clock();
  site.tracker.pour(0, 0);
  site.tracker.come_to_rest();
  EXPECT_LT(std::clock() - begin, kSoon);
  EXPECT_EQ(residual(site.tracker), 0);
  EXPECT_EQ(site.ground.change_m3(), 0);
}

TEST(EarthmovingAttack, NothingComesToLieWhereThereIsNoGround) {
  Site site(raster({9, 9, {-4.02, -4.03}, {1, 1}}, flat), {},
            loam_with_pours({{"a", {3.97, 3.95, 2}, 0, 0, 2}}));
  site.tracker.pour(0, 0);
  for (const Chunk* chunk : site.ground.chunks()) {
    SampleWords loose;
    site.ground.read_loose(chunk->origin, loose);
    for (std::size_t n = 0; n < loose.size(); ++n) {
      const Coord3 cell = chunk->origin + numbered_voxel(static_cast<int>(n));
      const CellPoints& points = sample_points(cell);
      for (std::size_t i = 0; i < 64; ++i) {
        if ((loose[n] >> i & 1) == 0) continue;
        const Vec3 at = site.ground.world_from_index(cell.cast<double>() +
                                                     Vec3(points.x[i], points.y[i], points.z[i]) -
                                                     Vec3::Constant(0.5));
        ASSERT_TRUE(site.ground.terrain().height(at.x(), at.y()));
        ASSERT_GT(at.z(), -1e-3);
      }
    }
  }
}

TEST(EarthmovingAttack, AHopperTakesWhatFallsIntoItAndNothingBeside) {
  Earthmoving all = loam_with_pours({{"in", {1, 0, 3}, 0, 0, 0.5},
                                     {"beside", {1.001, 0, 3}, 0, 0, 0.5},
                                     {"below its rim", {0.5, 0, 1}, 0, 0, 0.5},
                                     {"too late", {0.5, 0, 3}, 20, 20, 0.5}});
  all.hoppers.push_back({"hopper", {Vec2(0, -1), Vec2(1, 1)}, 2, 0, 10});
  Site site(make_plane(0, {0, 0}), {}, all);
  site.tracker.pour(0, 0);
  EXPECT_EQ(loose_samples(site.ground), 0);
  EXPECT_GT(site.tracker.mass_balance().hauled, 0);
  const std::int64_t hauled = site.tracker.mass_balance().hauled;
  for (std::size_t i = 1; i < 4; ++i) {
    site.tracker.pour(i, 20);
    EXPECT_EQ(site.tracker.mass_balance().hauled, hauled);
    EXPECT_EQ(loose_samples(site.ground), static_cast<std::int64_t>(i) * 32000);
    EXPECT_EQ(residual(site.tracker), 0);
  }
}

TEST(EarthmovingAttack, AHopperThatGoesWhileSoilFallsTakesItsShare) {
  std::int64_t hauled[2];
  for (const int calls : {1, 10}) {
    Earthmoving all = loam_with_pours({{"a", {0, 0, 3}, 0, 2, 4}});
    all.hoppers.push_back({"hopper", {Vec2(-1, -1), Vec2(1, 1)}, 2, 0, 1});
    Site site(make_plane(0, {0, 0}), {}, all);
    for (int i = 1; i <= calls; ++i) site.tracker.pour(0, 2.0 * i / calls);
    EXPECT_EQ(residual(site.tracker), 0);
    hauled[calls > 1] = site.tracker.mass_balance().hauled;
    EXPECT_NEAR(static_cast<double>(hauled[calls > 1]) /
                    static_cast<double>(site.tracker.mass_balance().poured),
                0.5, 0.06);
  }
  EXPECT_EQ(hauled[0], hauled[1]);
}

/// On the slope Front::level_of() went to and fro for ever between two counts of parts.
TEST(EarthmovingAttack, BucketsOfAllKindsComeThroughHeapsAndGround) {
  Bucket tiny = digger(), dumping = digger();
  tiny.width_m = 0.01;
  dumping.dump_angle_rad = 1.0;
  const Bucket plate{1.0, 0.6, {}, 0.8};
  for (const Bucket& bucket : {digger(), dumping, tiny, plate}) {
    for (const double slope : {0.0, 0.3}) {
      Site site(make_plane(0, {0, slope}), {bucket},
                loam_with_pours({{"heap", {0, 0, 5}, 0, 0, 4}, {"on it", {0, 2, 5}, 0, 0, 2}}));
      site.tracker.update(0, Pose{{-2, 0, -0.8}});  // it starts in the ground
      site.tracker.pour(0, 0);
      for (int round = 0; round < 2; ++round) {
        for (const Pose& pose : cycle({-3, 0, 0}, 0.6, 60, 1)) {  // it is tipped over the heap
          const Update update = site.tracker.update(0, pose);
          EXPECT_LT(update.us, 5e6);
          ASSERT_EQ(residual(site.tracker), 0);
        }
        site.tracker.pour(1, 0);
      }
      site.tracker.update(0, Pose{{0, 0, 9}, from_rpy(0, 1.5, 0)});
      site.tracker.come_to_rest();
      EXPECT_EQ(residual(site.tracker), 0);
      EXPECT_LT(site.tracker.total().bucket_m3(), 0.01);
      EXPECT_GT(site.tracker.total().cut_m3(), 0.01);
    }
  }
}

Earthmoving cohesive(double cohesion_pa) {
  Earthmoving all = loam();
  all.soil->cohesion_pa = cohesion_pa;
  return all;
}

TEST(EarthmovingAttack, ASteepSlopeStandsUntilItsFootIsDug) {
  // 2 m high, steeper than friction holds it; a cut of 0.22 m is critical for the cohesion.
  Site site(raster({401, 41, {-40, -10}, {0.2, 0.5}},
                   [](double x, double) { return x < 0   ? 2.0
                                                 : x < 1 ? 2 - 2 * x
                                                         : 0.0; }),
            {Bucket{2.0, 4.0, {}, {}}}, cohesive(500));
  const auto pass = [&](double x) {
    for (const Vec3& to : {Vec3(x, -3, 3), Vec3(x, -3, -0.15), Vec3(x, 3, -0.15), Vec3(x, 3, 3)})
      site.tracker.update(0, {to, from_rpy(0, 0, std::numbers::pi / 2)});
    site.tracker.come_to_rest();
    EXPECT_EQ(residual(site.tracker), 0);
  };
  const Eigen::AlignedBox2d slope(Vec2(-8, -4), Vec2(0.9, 4));
  pass(2.3);  // to 1.3
  EXPECT_EQ(changed_samples(site.ground, slope), 0);
  pass(2);  // to its foot
  EXPECT_GT(changed_samples(site.ground, slope), 1000);
}

/// A bench in front of a bank. Its sides and its front are cliffs, as the bank's front is.
struct Bench {
  double deep_m, half_m, long_m, yaw_rad;
  Vec2 of_world(const Vec2& at) const { return Eigen::Rotation2Dd(-yaw_rad) * at; }
  Vec2 to_world(const Vec2& at) const { return Eigen::Rotation2Dd(yaw_rad) * at; }
} bench;

double bench_height(double x, double y) {
  const Vec2 at = bench.of_world({x, y});
  const bool below =
      at.x() > bench.long_m + 1e-6 || (at.x() > 1e-6 && std::abs(at.y()) > bench.half_m + 1e-6);
  return below ? -bench.deep_m : 0.0;
}

TEST(EarthmovingAttack, AFaceThatFailsBesideACliffLeavesTheCliffStanding) {
  constexpr double kSide = 0.1;
  for (const unsigned seed : {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 36}) {
    SCOPED_TRACE(seed);
    std::mt19937_64 random(seed);
    const auto any = [&](double low, double high) {
      return std::uniform_real_distribution<double>(low, high)(random);
    };
    const double friction_rad = any(10, 38) * kDegree, density = any(1400, 2000);
    const double critical_m = any(1, 2.5);
    bench.deep_m = any(3, 12);
    bench.half_m = any(1, 3.5);
    bench.long_m = any(1.5, 3);
    bench.yaw_rad = seed % 2 == 0 ? any(-3.1, 3.1) : 0;
    const Vec3 shift(any(0, kSide), any(0, kSide),
                     0);  // of the voxels' sides and the cliffs' edges
    const double cut_m = kSide * (std::ceil(critical_m / kSide) + seed % 3);
    Earthmoving soft = cohesive(critical_m * density * 9.80665 / 4 / std::cos(friction_rad) *
                                (1 - std::sin(friction_rad)));
    soft.soil->friction_rad = friction_rad;
    soft.soil->density_kg_m3 = density;
    Ground ground(kSide, Vec3::Constant(kSide / 2) + shift,
                  raster({481, 481, {-12, -12}, {0.05, 0.05}}, bench_height));
    Tracker tracker(ground, {Bucket{bench.long_m, 4.0, {}, {}}}, soft);
    const GroundWindow before(ground, {-112, -112}, 224, 224);
    const double end_m = bench.half_m + 2;
    for (const auto& [y, z] :
         {std::pair(-end_m, 4.0), {-end_m, -cut_m}, {end_m, -cut_m}, {end_m, 4.0}}) {
      const Vec2 at = bench.to_world({bench.long_m / 2, y});
      tracker.update(0,
                     {{at.x(), at.y(), z}, from_rpy(0, 0, bench.yaw_rad + std::numbers::pi / 2)});
    }
    tracker.come_to_rest();
    EXPECT_EQ(residual(tracker), 0);
    const GroundWindow after(ground, {-112, -112}, 224, 224);
    double fell = 0;
    for (int x = 0; x < after.nx(); ++x) {
      for (int y = 0; y < after.ny(); ++y) {
        const Vec3 at =
            ground.world_from_index(Vec3(after.first().x() + x, after.first().y() + y, 0));
        const Vec2 in = bench.of_world(at.head<2>());
        const bool dug = in.x() > -0.15 && in.x() < bench.long_m + 0.15 &&
                         std::abs(in.y()) < bench.half_m + 0.15;
        if (after.at(x, y).known && !dug)
          fell += std::max(0.0, before.at(x, y).bank - after.at(x, y).bank);
      }
    }
    const double wedge_m3 =
        cut_m * cut_m * bench.half_m / std::tan((std::numbers::pi / 2 + friction_rad) / 2);
    EXPECT_GT(fell * kSide * kSide * kSide, 0.4 * wedge_m3);
    EXPECT_LT(fell * kSide * kSide * kSide, 1.6 * wedge_m3);
  }
}

TEST(EarthmovingAttack, NothingFailsThroughTheTerrainsEdge) {
  // A wedge would be 1.5 m wide, but the ground ends 0.8 m behind the wall; steeper ones hold.
  Site site(raster({41, 41, {-3.2, -10}, {0.5, 0.5}}, flat), {Bucket{12.0, 8.0, {}, {}}},
            cohesive(6000));
  for (const Vec3& to : {Vec3(-2.4, 0, 1), Vec3(-2.4, 0, -2.8), Vec3(4, 0, -2.8), Vec3(4, 0, 1)})
    site.tracker.update(0, {to});
  site.tracker.come_to_rest();
  EXPECT_EQ(residual(site.tracker), 0);
  EXPECT_GT(site.tracker.mass_balance().slid, 0);  // the other wall
  EXPECT_EQ(changed_samples(site.ground, {Vec2(-3.2, -3), Vec2(-2.5, 3)}), 0);
}

/// Goal: soil poured onto a bucket that stands on the ground lies beside it, so nothing is higher
/// than 1.5 voxels below. Tracker::pour() doesn't ask where buckets are: it lies up to 5.2 high
/// there.
TEST(EarthmovingAttack, NoSoilComesToLieInABucketsPlace) {
  Site site(make_plane(0, {0, 0}), {digger()}, loam_with_pours({{"a", {-0.4, 0, 5}, 0, 0, 0.3}}));
  site.tracker.update(0, Pose{{0, 0, 0.1}});
  site.tracker.pour(0, 0);
  site.tracker.come_to_rest();
  const GroundWindow window(site.ground, {-6, -4}, 4, 9);
  for (int x = 0; x < 4; ++x)
    for (int y = 0; y < 9; ++y) EXPECT_LE(window.at(x, y).top, 5.3);
}

}  // namespace earthmoving_attack_test
}  // namespace soilvdb::test
