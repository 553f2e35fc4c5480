// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Where soil comes to rest with a bucket, a hollow or the terrain's end beside it.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <random>
#include <vector>

#include "core/ground/ground_writer.h"
#include "core/settle/column_samples.h"
#include "core/settle/obstacle.h"
#include "core/settle/settler.h"
#include "io/snapshot/swap_file.h"
#include "tests/support/earthmoving_fixture.h"
#include "tests/support/temp_folder.h"
#include "tests/support/tool_scenes.h"

namespace soilvdb::test {
namespace soil_at_rest_test {

constexpr double kVoxel = 0.1;
constexpr double kDegree = std::numbers::pi / 180;

/// Calls f(cell, rim) for the columns of a square around the origin.
template <typename F>
void each_column(int half, const F& f) {
  for (int x = -half; x <= half; ++x)
    for (int y = -half; y <= half; ++y) f(Coord2(x, y), std::max(std::abs(x), std::abs(y)) == half);
}

struct Site {
  Ground ground;
  Tracker tracker;
  Site(std::shared_ptr<const InitialTerrain> base, std::vector<Bucket> buckets, Earthmoving all)
      : ground(kVoxel, Vec3::Zero(), std::move(base)),
        tracker(ground, std::move(buckets), std::move(all)) {}

  double highest_m() const {
    const GroundWindow window = all_of(ground);
    double most = -std::numeric_limits<double>::infinity();
    for (int x = 0; x < window.nx(); ++x)
      for (int y = 0; y < window.ny(); ++y) most = std::max(most, window.at(x, y).top);
    return kVoxel * most;
  }
  double steepest() const {
    const std::vector<double> over = over_repose(all_of(ground));
    return over.empty() ? 0 : over.back();
  }
};

/// What a bank lets fall must not slide in one update: that one would be late.
TEST(SoilAtRest, ABankThatFailsSlidesOverManyUpdates) {
  Earthmoving soft = loam();
  soft.soil->cohesion_pa = 500;
  for (const double long_m : {3.0, 4.0, 5.0}) {
    SCOPED_TRACE(long_m);
    Site site(make_plane(0, {0, 0}), {digger()}, soft);
    for (const double deep : {0.5, 1.0, 1.5, 2.0})
      for (const Pose& pose : drag({-3, 0, 0}, long_m, deep, 60)) site.tracker.update(0, pose);
    const std::int64_t held = site.tracker.ledger(0).load;
    std::vector<double> slid;
    for (int i = 1; i <= 200; ++i)
      slid.push_back(site.tracker.update(0, {{1, 0, 0.02 * i}, from_rpy(0, -1.55, 0)}).slid_m3);
    site.tracker.come_to_rest();
    const double all = std::accumulate(slid.begin(), slid.end(), 0.0);
    EXPECT_GT(all, 1) << "its walls fail";
    EXPECT_LT(*std::max_element(slid.begin(), slid.end()), 0.7 * all);
    EXPECT_LT(site.steepest(), 3 * kDegree);
    EXPECT_EQ(residual(site.tracker), 0);
    EXPECT_LE(site.tracker.ledger(0).load, held);
  }
}

/// A full bucket, its lip so high above level ground 6 m beside its trench, level.
void fill_and_carry(Tracker& tracker, double lip_m) {
  for (const Pose& pose : drag({-3, 0, 0}, 4, 0.5, 60)) tracker.update(0, pose);
  for (const Vec3& to : {Vec3(1, 6, 2), Vec3(1, 6, lip_m)})
    tracker.update(0, {to, from_rpy(0, -1.55, 0)});
  ASSERT_GT(tracker.ledger(0).bucket_m3(), 0.5);
}

TEST(SoilAtRest, ALoadTippedRightAboveTheGroundLiesAroundTheBucket) {
  for (const double lip_m : {0.0, 0.2, 0.5, 0.9}) {
    SCOPED_TRACE(lip_m);
    Site site(make_plane(0, {0, 0}), {digger()}, loam());
    fill_and_carry(site.tracker, lip_m);
    for (int i = 1; i <= 20; ++i) {
      site.tracker.update(0, {{1, 6, lip_m}, from_rpy(0, -1.55 + 3.0 * i / 20, 0)});
      // Whatever leaves a bucket falls, so nothing comes to lie above where that has been.
      ASSERT_LT(site.highest_m(), lip_m + 1.2);
      ASSERT_EQ(residual(site.tracker), 0);
    }
    ASSERT_LT(site.tracker.ledger(0).bucket_m3(), 0.1);
    for (int i = 1; i <= 10; ++i)  // and away: what leant on the bucket comes down by itself
      site.tracker.update(0, {{1, 6, lip_m + 0.5 * i}, from_rpy(0, 1.45, 0)});
    EXPECT_LT(site.steepest(), 3 * kDegree);
    EXPECT_LT(site.highest_m(), 0.9);
    EXPECT_EQ(residual(site.tracker), 0);
  }
}

TEST(SoilAtRest, ADumpedLoadThatLeansOnTheBucketComesDownOnceThatHasGone) {
  Bucket bucket = digger();
  bucket.dump_angle_rad = 0.3;
  Site site(make_plane(0, {0, 0}), {bucket}, loam());
  fill_and_carry(site.tracker, 0.4);
  site.tracker.update(0, {{1, 6, 0.4}, from_rpy(0, 0.5, 0)});
  ASSERT_GT(site.tracker.total().dumped_m3(), 0.5);
  for (int i = 1; i <= 10; ++i)
    site.tracker.update(0, {{1, 6, 0.4 + 0.5 * i}, from_rpy(0, 0.5, 0)});
  EXPECT_LT(site.steepest(), 3 * kDegree);
  EXPECT_EQ(residual(site.tracker), 0);
}

TEST(SoilAtRest, StandstillsDontDependOnUpdates) {
  // It digs, stands still in the ground, and goes on; it never turns.
  const Eigen::Quaterniond level = from_rpy(0, 0.35, 0);
  const Motion motion({0, 1, 2, 3, 4, 5, 6}, {{{-3, 0, 0.4}, level},
                                              {{-2, 0, -0.5}, level},
                                              {{-1, 0, -0.5}, level},
                                              {{-1, 0, -0.5}, level},
                                              {{-1, 0, -0.5}, level},
                                              {{1, 0, -0.5}, level},
                                              {{1.5, 0, 1.5}, level}});
  const auto dig = [&](int updates) {
    Site site(make_plane(0, {0, 0}), {digger()}, loam());
    for (int i = 0; i < updates; ++i)
      site.tracker.update(0, motion, 6.0 * i / updates, 6.0 * (i + 1) / updates);
    EXPECT_GT(site.tracker.mass_balance().slid, 0);
    return std::pair(site.ground.state_hash(), site.tracker.ledger(0).load);
  };
  const auto once = dig(1);
  for (const int updates : {2, 3, 4, 6, 7, 12, 100}) EXPECT_EQ(dig(updates), once) << updates;
}

void settle(Settler& settler, const Eigen::AlignedBox3d& around_m) {
  TileSet may_slide;
  settler.settle(around_m, true, may_slide);
}

/// Loose soil over a gap, in columns of level ground.
struct Roof {
  Ground ground{kVoxel, Vec3::Zero(), make_plane(-kVoxel / 2, {0, 0})};
  Settler settler{ground, *loam().soil, {}};

  Roof(int gap, int thickness) {
    std::vector<ColumnEdit> heap, below;
    each_column(6, [&](const Coord2& cell, bool) {
      const int high = gap + thickness;
      heap.push_back({.cell = cell, .low = 0, .high = high - 1, .samples = 64 * high});
      below.push_back({.cell = cell, .low = 0, .high = gap - 1, .samples = 64 * gap});
    });
    add_samples(ground, heap, kSlope);
    remove_loose(ground, below, kSlope);
  }
  std::int64_t at_height(int z) const {
    std::int64_t samples = 0;
    for (const Chunk* chunk : ground.chunks()) {
      SampleWords loose;
      ground.read_loose(chunk->origin, loose);
      for (std::size_t n = 0; n < loose.size(); ++n)
        if (chunk->origin.z() + static_cast<int>(n & 7) == z) samples += std::popcount(loose[n]);
    }
    return samples;
  }
};

TEST(SoilAtRest, ALooseRoofFallsWhetherItIsThickerOrThinnerThanTheGap) {
  for (const auto& [gap, thickness] : {std::pair(2, 5), {5, 2}, {1, 7}, {3, 3}}) {
    Roof roof(gap, thickness);
    const std::int64_t samples = loose_samples(roof.ground);
    ASSERT_EQ(roof.at_height(0), 0);
    settle(roof.settler, {Vec3(-1, -1, -0.5), Vec3(1, 1, 1.5)});
    EXPECT_EQ(loose_samples(roof.ground), samples) << gap << ' ' << thickness;
    EXPECT_EQ(roof.settler.totals().pending, 0);
    EXPECT_EQ(pockets(roof.ground), 0);
    EXPECT_GT(roof.at_height(0), 13 * 13 * 64 - 1);
  }
}

TEST(SoilAtRest, ALooseRoofBesideWhatIsSettledFallsAsFarAsItIsLookedAt) {
  Roof roof(2, 5);
  const std::int64_t samples = loose_samples(roof.ground);
  // So far beside the roof that no overhang is looked for there, but what slides is.
  settle(roof.settler, {Vec3(1.15, -0.1, -0.5), Vec3(1.2, 0.1, 0.5)});
  EXPECT_EQ(loose_samples(roof.ground), samples);
  EXPECT_EQ(roof.settler.totals().pending, 0);
  const GroundWindow window(roof.ground, {4, -3}, 3, 7);
  for (int x = 0; x < window.nx(); ++x)
    for (int y = 0; y < window.ny(); ++y) EXPECT_EQ(window.at(x, y).hangs, 0);
  EXPECT_GT(roof.at_height(0), 0);
}

TEST(SoilAtRest, SoilThatACutLeftStandingInAPartOfItsColumnFallsWithinIt) {
  Ground ground(kVoxel, Vec3::Zero(), make_plane(-kVoxel / 2, {0, 0}));
  // Half of a column's cells, six high, and nothing beside it.
  SampleWords half{};
  for (int z = 0; z < 6; ++z) {
    const CellPoints& points = sample_points({0, 0, z});
    for (int i = 0; i < 64; ++i)
      if (points.x[i] < 0.5f) half[static_cast<std::size_t>(z)] |= std::uint64_t{1} << i;
  }
  GroundWriter(ground).add({0, 0, 0}, half, GroundWriter::Kind::kLoose);
  std::vector<ColumnEdit> around;
  for (int x = -1; x <= 1; ++x)
    for (int y = -1; y <= 1; ++y)
      if (x != 0 || y != 0)
        around.push_back({.cell = {x, y}, .low = 0, .high = 8, .samples = 64 * 3});
  add_samples(ground, around, kSlope);
  Settler settler(ground, *loam().soil, {});
  const std::int64_t samples = loose_samples(ground);
  ASSERT_GT(GroundWindow(ground, {0, 0}, 1, 1).at(0, 0).surface, 5);
  TileSet may_slide;
  may_slide.add(Coord2(0, 0));
  settler.settle({}, false, may_slide);
  EXPECT_EQ(loose_samples(ground), samples);
  const GroundColumn column = GroundWindow(ground, {0, 0}, 1, 1).at(0, 0);
  EXPECT_LE(column.surface - column.top, 2);
  EXPECT_TRUE(may_slide.empty());
}

TEST(SoilAtRest, ALipHalfOverATruckGivesItHalf) {
  Ground ground(0.05, Vec3::Zero(), make_plane(0, {0, 0}));
  Hopper bed{"bed", {Vec2(-2, 0.1), Vec2(2, 5)}, 1};
  Settler settler(ground, *loam().soil, {bed});
  const std::int64_t mass = 40000 * settler.units().loose + 7;
  settler.drop({Vec3(0, -0.5, 2), Vec3(0.1, 0.7, 2)}, Vec2::Zero(), mass,
               std::numeric_limits<double>::quiet_NaN());
  const SettleTotals& totals = settler.totals();
  EXPECT_NEAR(static_cast<double>(totals.hauled), 0.5 * static_cast<double>(mass), 1);
  EXPECT_EQ(totals.hauled + totals.pending + loose_samples(ground) * settler.units().loose, mass);
}

TEST(SoilAtRest, ALineOfSoilOnASlopeThatIsTooSteepRunsDownItNotOverItsCrest) {
  // Flat, then up by 1.2 from x = 0 to the crest at x = 3, then gently down.
  Ground ground(kVoxel, Vec3::Zero(),
                raster({41, 33, {-4, -4}, {0.25, 0.25}}, [](double x, double) {
                  return 1.2 * std::clamp(x, 0.0, 3.0) - 0.3 * std::max(0.0, x - 3);
                }));
  Settler settler(ground, *loam().soil, {});
  settler.drop({Vec3(1.8, -0.6, 5), Vec3(1.8, 0.6, 5)}, Vec2(1, 0), 20000 * settler.units().loose,
               std::numeric_limits<double>::quiet_NaN());
  const GroundWindow window = all_of(ground);
  for (int x = 0; x < window.nx(); ++x)
    for (int y = 0; y < window.ny(); ++y)
      if (loose_depth(window.at(x, y)) > 0) {
        EXPECT_LT(kVoxel * (window.first().x() + x), 1.8 + kVoxel) << y;
      }
  EXPECT_EQ(loose_samples(ground), 20000);
}

TEST(SoilAtRest, ALineOfSoilOverAToolLiesAheadOfItHoweverLongThatIs) {
  for (const double length_m : {0.5, 2.0, 5.0}) {
    Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
    const Obstacle tool(box(1.2, 0.5, length_m), {{0, 0, -0.2}, {}}, ground);
    Settler settler(ground, *loam().soil, {});
    settler.set_walls({&tool});
    const double at_m = 0.2 - length_m;
    settler.drop({Vec3(at_m, -0.6, 5), Vec3(at_m, 0.6, 5)}, Vec2(1, 0),
                 2000 * settler.units().loose, std::numeric_limits<double>::quiet_NaN());
    const GroundWindow window = all_of(ground);
    for (int x = 0; x < window.nx(); ++x)
      for (int y = 0; y < window.ny(); ++y) {
        if (loose_depth(window.at(x, y)) == 0) continue;
        EXPECT_GE(window.first().x() + x, -1) << length_m;
        EXPECT_LE(std::abs(kVoxel * (window.first().y() + y)), 1.2) << length_m;
      }
    EXPECT_EQ(loose_samples(ground), 2000);
  }
}

TEST(SoilAtRest, AnotherMachinesBucketIsAWall) {
  // Without it the heap would reach 1 m behind where it stands.
  Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
  const Bucket wall{4, 2, {{0, 0}, {-0.15, 0.7}, {-0.15, 1.4}, {0, 2}}, {}};
  Tracker tracker(ground, {wall, digger()}, loam_with_pours({{"heap", {1.0, 0, 5}, 0, 0, 6}}));
  tracker.update(0, {{0, 0, -0.3}, Eigen::Quaterniond::Identity()});
  tracker.update(0, {{0, 0, -0.3}, Eigen::Quaterniond::Identity()});
  tracker.pour(0, 1);
  // Undercuts the heap's far toe, so that it moves.
  for (const Pose& pose : drag({-1, 3, 0}, 4, 0.3, 30)) tracker.update(1, pose);
  tracker.come_to_rest();
  const auto behind = [&] {
    double loose = 0;
    const GroundWindow window = all_of(ground);
    for (int x = 0; x < window.nx(); ++x)
      for (int y = 0; y < window.ny(); ++y) {
        const Coord2 cell = window.first() + Coord2(x, y);
        if (cell.x() < -4 && std::abs(cell.y()) < 10)
          loose += window.at(x, y).top - window.at(x, y).bank;
      }
    return loose;
  };
  EXPECT_EQ(behind(), 0);
  EXPECT_EQ(residual(tracker), 0);
}

/// Soil that stands in a bucket's body, cells: its deepest, where a column is wholly under the
/// body.
double deepest_within(const Ground& ground, const Bucket& bucket, const Pose& at) {
  const double h = ground.voxel_size_m();
  const GroundWindow window = all_of(ground);
  double deepest = 0;
  for (int x = 0; x < window.nx(); ++x)
    for (int y = 0; y < window.ny(); ++y) {
      const Coord2 cell = window.first() + Coord2(x, y);
      const Vec3 in = at.rotation.inverse() * (h * Vec3(cell.x(), cell.y(), 0) - at.position);
      if (std::abs(in.y()) > bucket.width_m / 2 - h) continue;
      // The lower side of its outline, which begins at the lip and goes backwards.
      for (std::size_t i = 0; i + 1 < bucket.profile.size(); ++i) {
        const Vec2 from = bucket.profile[i], to = bucket.profile[i + 1];
        if (to.x() >= from.x() || in.x() > from.x() - h || in.x() < to.x() + h) continue;
        const double share = (in.x() - from.x()) / (to.x() - from.x());
        const double low = at.position.z() + from.y() + share * (to.y() - from.y());
        deepest = std::max(deepest, window.at(x, y).top - low / h);
      }
    }
  return deepest;
}

TEST(SoilAtRest, SoilPouredOntoABucketInTheAirStaysOutOfIt) {
  std::mt19937 random(911);
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution(low, high)(random);
  };
  for (int scene = 0; scene < 12; ++scene) {
    const double length = between(0.6, 1.2), height = between(0.6, 1.2), sag = between(0, 0.2);
    const Bucket bucket{
        between(0.9, 1.5),
        height,
        {{0, 0}, {-length / 2, -sag}, {-length, sag}, {-length, height}, {0, height}},
        {}};
    const Eigen::Quaterniond rotation = from_rpy(0, 0, between(-3, 3));
    const Pose at{{between(-1, 1), between(-1, 1), sag + between(0.02, 0.5)}, rotation};
    const double behind = between(-length, 0), beside = between(-0.5, 0.5);
    const Vec3 above = at * Vec3(behind, beside, 5);
    const double voxel = scene % 3 == 0 ? 0.05 : 0.1;
    Ground ground(voxel, Vec3::Zero(), make_plane(0, {between(-0.1, 0.1), between(-0.1, 0.1)}));
    const double low = *ground.terrain().height(at.position.x(), at.position.y());
    const Pose here{at.position + low * Vec3::UnitZ(), rotation};
    Tracker tracker(ground, {digger(), bucket},
                    loam_with_pours({{"tip", above, 0, 10, between(0.5, 3)}}));
    tracker.update(1, {here.position + 2 * Vec3::UnitZ(), rotation});
    tracker.update(1, here);
    const double step_s = between(0.1, 5);
    for (double time_s = step_s; time_s < 10 + step_s; time_s += step_s) tracker.pour(0, time_s);
    EXPECT_LE(deepest_within(ground, bucket, here), 1.5) << scene;
    EXPECT_EQ(residual(tracker), 0);
  }
}

/// A bucket with a level floor, from 1 m behind the lip to it.
Bucket box() { return {1.2, 1, {{0, 0}, {-1, 0}, {-1, 1}, {0, 1}}, {}}; }

TEST(SoilAtRest, ABucketKeepsPilesOutThatGrowToItFromBeside) {
  struct Case {
    double behind_m, until_s, volume_m3;
  };
  for (const Case& c : {Case{0.55, 0, 3}, Case{2, 10, 20}}) {
    Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
    Tracker tracker(
        ground, {digger(), box()},
        loam_with_pours({{"heap", {-1 - c.behind_m, 0, 5}, 0, c.until_s, c.volume_m3}}));
    const Pose here{{0, 0, 0.35}, Eigen::Quaterniond::Identity()};
    tracker.update(1, {{0, 0, 2}, here.rotation});
    tracker.update(1, here);
    tracker.pour(0, c.until_s);
    EXPECT_LE(deepest_within(ground, box(), here), 1.5) << c.volume_m3;
  }
}

TEST(SoilAtRest, ABucketIsAWallUpToWhatHalfAConeRises) {
  const Earthmoving all = loam_with_pours({{"heap", {-0.5, 0, 5}, 0, 0, 1}});
  const double slope = std::tan(all.soil->repose_rad), volume_m3 = 2;
  const double rise_m = slope * std::cbrt(3 * volume_m3 / (std::numbers::pi * slope));
  for (const double share : {0.98, 1.02}) {
    Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
    Tracker tracker(ground, {box()}, all);
    for (const double z : {3.0, share * rise_m})
      tracker.update(0, {{0, 0, z}, Eigen::Quaterniond::Identity()});
    tracker.pour(0, 1);
    const GroundWindow window = all_of(ground);
    const Coord2 middle = Coord2(-5, 0) - window.first();
    const double top = kVoxel * window.at(middle.x(), middle.y()).top;
    EXPECT_EQ(top > 0.5 * kVoxel, share > 1) << top;
  }
}

/// The first byte of a tracker's state, which begins with its machine's, that a pour changes.
std::ptrdiff_t first_changed(double apart_m) {
  Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
  Tracker tracker(ground, {digger()}, loam_with_pours({{"heap", {0, apart_m, 5}, 0, 10, 2}}));
  for (const double z : {1.0, 0.5}) tracker.update(0, {{0, 0, z}, Eigen::Quaterniond::Identity()});
  const std::string before = tracker.state();
  tracker.pour(0, 10);
  const std::string after = tracker.state();
  return std::mismatch(before.begin(), before.end(), after.begin(), after.end()).first -
         before.begin();
}

TEST(SoilAtRest, APourElsewhereIsNothingToABucketInTheAir) {
  EXPECT_LT(first_changed(0.5), first_changed(8));
}

/// Columns that a bucket with its mouth down takes, on ground that falls away to one of its sides.
int blocked(double yaw) {
  const Eigen::Vector2d fall = Eigen::Rotation2Dd(yaw) * Vec2(0, -0.9);
  Ground ground(kVoxel, Vec3::Zero(), make_plane(0, fall));
  const Bucket box{1.6, 1.2, {{0, 0}, {-1, 0}, {-1, 1.2}, {0, 1.2}}, {}};
  // Its back is up; soil comes in below the edge that is over the lower ground.
  const Pose at{{0, 0, 0.05}, from_rpy(0, std::numbers::pi / 2, yaw)};
  const Vec3 middle = at * Vec3(0, 0, 0.6);
  const Pose centred{at.position - Vec3(middle.x(), middle.y(), 0), at.rotation};
  GroundColumns columns(ground);
  const Obstacle obstacle(box, centred, ground);
  const Obstacle* const obstacles[] = {&obstacle};
  BlockedColumns blocks(columns, obstacles);
  int count = 0;
  for (int x = -16; x <= 16; ++x)
    for (int y = -16; y <= 16; ++y) count += blocks(Coord2(x, y));
  return count;
}

TEST(SoilAtRest, ABucketTakesAsManyColumnsWhicheverSideSoilComesFrom) {
  constexpr int kRim = 2 * (17 + 13), kAll = 17 * 13;
  for (int quarter = 0; quarter < 4; ++quarter) {
    const int count = blocked(quarter * std::numbers::pi / 2);
    EXPECT_GT(count, kRim / 3) << quarter;
    EXPECT_LT(count, 3 * kAll / 4) << quarter << ": what is open to the lower side isn't its";
  }
}

TEST(SoilAtRest, BankThatHangsOnNothingFallsHoweverDeepTheHollow) {
  for (const int depth : {3, 20, 150}) {
    Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
    Settler settler(ground, *loam().soil, {});
    std::vector<ColumnEdit> hollow, slot;
    each_column(6, [&](const Coord2& cell, bool rim) {
      hollow.push_back(ColumnEdit::all(cell, -4 - depth, -5));
      if (rim) slot.push_back(ColumnEdit::all(cell, -4, 0));
    });
    remove_top(ground, hollow, kSlope);
    const auto box = [](double low) {
      return Eigen::AlignedBox3d(Vec3(-0.7, -0.7, low), Vec3(0.7, 0.7, 0));
    };
    settle(settler, box(-0.4 - kVoxel * depth));
    EXPECT_EQ(settler.totals().failed_samples, 0) << "it hangs on the ground around";
    remove_top(ground, slot, kSlope);
    settle(settler, box(-0.4));
    const GroundWindow window(ground, {-5, -5}, 11, 11);
    // It lies on the hollow's floor, swollen, or slid into the slot.
    const double most = -4.5 - depth + 5 * 1.25 + 0.1;
    for (int x = 0; x < 11; ++x)
      for (int y = 0; y < 11; ++y) EXPECT_LT(window.at(x, y).top, most) << depth;
    EXPECT_GT(loose_samples(ground), 11 * 11 * 4 * 64);
  }
}

TEST(SoilAtRest, BankThatHangsOnTheGroundOfOneSideStaysWhicheverThatIs) {
  for (const auto& [dx, dy] : {std::pair(-1, 0), {1, 0}, {0, -1}, {0, 1}}) {
    Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
    Settler settler(ground, *loam().soil, {});
    std::vector<ColumnEdit> cut;
    each_column(4, [&, side = Coord2(dx, dy)](const Coord2& cell, bool rim) {
      // On one side there is no slot, and the ground is as it was.
      if (cell.dot(side) != 4) cut.push_back(ColumnEdit::all(cell, -8, rim ? 0 : -5));
    });
    remove_top(ground, cut, kSlope);
    const std::uint64_t before = ground.state_hash();
    settle(settler, {Vec3(-0.5, -0.5, -0.8), Vec3(0.5, 0.5, 0)});
    EXPECT_EQ(settler.totals().failed_samples, 0) << dx << ' ' << dy;
    EXPECT_EQ(ground.state_hash(), before) << dx << ' ' << dy;
  }
}

TEST(SoilAtRest, BankThatHangsOnNothingFallsFromTheColdStoreToo) {
  const test::TempFolder folder;
  std::vector<std::uint64_t> hashes;
  for (const bool swapped : {false, true}) {
    Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
    Settler settler(ground, *loam().soil, {});
    std::vector<ColumnEdit> cut;
    each_column(6, [&](const Coord2& cell, bool rim) {
      cut.push_back(ColumnEdit::all(cell, -7, rim ? 0 : -4));
    });
    remove_top(ground, cut, kSlope);
    if (swapped) {
      ground.set_memory_limit(1, std::make_shared<io::SwapFile>(folder.path()));
      EXPECT_THROW(ground.evict(), std::runtime_error);
      for (const Chunk* chunk : ground.chunks()) ASSERT_NE(chunk->swap_record, 0);
    }
    settle(settler, {Vec3(-0.6, -0.6, -0.7), Vec3(0.6, 0.6, 0)});
    EXPECT_GT(settler.totals().failed_samples, 0);
    hashes.push_back(ground.state_hash());
  }
  EXPECT_EQ(hashes[0], hashes[1]);
}

TEST(SoilAtRest, ALayerOfOneVoxelThatHangsOnNothingFallsWhereverInAChunkItIs) {
  for (int z = -9; z <= -1; ++z) {
    Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
    Settler settler(ground, *loam().soil, {});
    std::vector<ColumnEdit> above, below;
    each_column(6, [&](const Coord2& cell, bool rim) {
      if (!rim) above.push_back(ColumnEdit::all(cell, z + 1, 0));
      below.push_back(ColumnEdit::all(cell, -30, rim ? 0 : z - 1));
    });
    remove_top(ground, below, kSlope);
    remove_top(ground, above, kSlope);
    const double low_m = kVoxel * z;
    settle(settler, {Vec3(-0.6, -0.6, low_m), Vec3(0.6, 0.6, low_m)});
    EXPECT_GE(settler.totals().failed_samples, 11 * 11 * 64) << z;
    const GroundWindow window(ground, {-5, -5}, 11, 11);
    for (int x = 0; x < 11; ++x)
      for (int y = 0; y < 11; ++y) EXPECT_LT(window.at(x, y).top, -28) << z;
  }
}

TEST(SoilAtRest, WhatFallsBeyondTheTerrainDoesntComeDownElsewhere) {
  Site site(raster({9, 9, {-4, -4}, {1, 1}}, [](double, double) { return 0.0; }), {},
            loam_with_pours({{"beyond", {80, 0, 2}, 0, 0, 1}, {"on it", {0, 0, 2}, 0, 0, 1}}));
  site.tracker.pour(0, 0);
  EXPECT_EQ(residual(site.tracker), 0);
  EXPECT_EQ(loose_samples(site.ground), 0);
  EXPECT_EQ(site.tracker.mass_balance().lost_off_terrain, site.tracker.mass_balance().poured);
  const std::string state = site.tracker.state();
  site.tracker.pour(1, 0);
  EXPECT_EQ(residual(site.tracker), 0);
  EXPECT_NEAR(static_cast<double>(loose_samples(site.ground)), 1 / site.ground.sample_m3(), 1);
  Ground other(kVoxel, Vec3::Zero(), site.ground.shared_terrain());
  Tracker restored(
      other, {}, loam_with_pours({{"beyond", {80, 0, 2}, 0, 0, 1}, {"on it", {0, 0, 2}, 0, 0, 1}}));
  restored.restore(state);
  EXPECT_EQ(restored.mass_balance().lost_off_terrain, restored.mass_balance().poured);
}

}  // namespace soil_at_rest_test
}  // namespace soilvdb::test
