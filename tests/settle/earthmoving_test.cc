// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Soil that is dug, carried, spilled and poured on a site: where it comes to lie, and that none is
// made or lost.
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <random>

#include "tests/support/counted_plane.h"
#include "tests/support/earthmoving_fixture.h"

namespace soilvdb::test {
namespace earthmoving_test {

constexpr double kDegree = std::numbers::pi / 180;
/// Heights of columns that soil came to by other ways may differ by so much, voxels: two samples.
constexpr double kCount = 2.0 / 64;
/// Of the bank of grounds(), Pa: it stands, cuts of some voxels fail, any does.
constexpr std::optional<double> kCohesions[] = {{}, 1000, 0};

/// Height of the highest soil.
double surface_top(const Ground& ground) {
  const GroundWindow window(ground, {-64, -64}, 128, 128);
  double top = -1e9;
  for (int x = 0; x < 128; ++x)
    for (int y = 0; y < 128; ++y) top = std::max(top, window.at(x, y).top);
  return (top + 0.5) * ground.voxel_size_m();
}

TEST(Earthmoving, APourIsACone) {
  for (const double h : {0.1, 0.05}) {
    Ground ground(h, Vec3::Zero(), make_plane(0, {0, 0}));
    Tracker tracker(ground, {}, loam_with_pours({{"truck", {0.013, -0.021, 3}, 0, 2, 1.0}}));
    tracker.pour(0, 2);
    EXPECT_EQ(residual(tracker), 0);
    const double volume = 1.0, radius = std::cbrt(3 * volume / (std::numbers::pi * kSlope));
    EXPECT_NEAR(ground.change_m3(), volume, ground.sample_m3());
    const int half = static_cast<int>(2 / h);
    const GroundWindow window(ground, {-half, -half}, 2 * half + 1, 2 * half + 1);
    double sum = 0, most = 0;
    int n = 0;
    for (int x = -half; x <= half; ++x) {
      for (int y = -half; y <= half; ++y) {
        const double d = std::hypot(x * h - 0.013, y * h + 0.021);
        if (d > 1.1 * radius) continue;
        const double off =
            window.at(x + half, y + half).top - std::max(0.0, kSlope * (radius - d)) / h;
        sum += off * off;
        most = std::max(most, std::abs(off));
        ++n;
      }
    }
    EXPECT_LE(std::sqrt(sum / n), 0.05);  // of a voxel
    EXPECT_LE(most, 0.25);                // in the middle, where a column is below the apex
  }
}

// Soil that nothing holds goes far: not all the ground around its way is read.
TEST(Earthmoving, OfGroundALittleTooSteepOnlyThatUnderTheSoilIsRead) {
  for (const double turn : {0.0, 0.7, 2.5, 4.0}) {
    const Vec2 up = 1.03 * kSlope * Vec2(std::cos(turn), std::sin(turn));
    const auto plane = std::make_shared<CountedPlane>(0, up);
    Ground ground(0.05, Vec3::Zero(), plane);
    Tracker tracker(ground, {}, loam_with_pours({{"a", {0.013, -0.021, 1}, 0, 0, 0.02}}));
    tracker.pour(0, 0);
    EXPECT_EQ(residual(tracker), 0);
    EXPECT_GT(plane->asked, 100) << turn;
    EXPECT_LT(plane->asked, 2500) << turn;
  }
}

TEST(Earthmoving, MakesAndLosesNothingWhateverIsDone) {
  for (std::size_t g = 0; g < 3; ++g) {
    Work work(terrains()[g], 7, 0.2, kCohesions[g]);
    for (int i = 0; i < 280; ++i) {
      work.step();
      ASSERT_EQ(residual(work.tracker), 0) << i;
    }
    EXPECT_GT(work.tracker.total().captured, 5000);
    EXPECT_GT(work.tracker.total().dumped, 0);
    EXPECT_GT(work.tracker.mass_balance().slid, 0);
  }
}

/// A column in a valley lies below two neighbours, each of which may drop by all of repose to it
/// without the other: there a plane through both halves is so much steeper.
const double kValley = std::atan((1 + std::numbers::sqrt2) / 2 * kSlope) - kRepose;

TEST(Earthmoving, LeavesLooseSoilNoSteeperThanReposeAfterAnyWork) {
  for (const auto& terrain : terrains()) {
    for (const std::uint64_t seed : {8u, 18u}) {
      Work work(terrain, seed);
      for (int i = 1; i <= 300; ++i) {
        work.step();
        if (i % 100 != 0) continue;
        Work still(work);
        for (std::size_t m = 0; m < 4; ++m)
          still.tracker.update(m, {{0, 0, 9}, still.at[m].rotation});
        still.tracker.come_to_rest();
        const std::vector<double> over = over_repose(all_of(still.ground));
        if (over.size() < 100) continue;
        const auto steep = over.end() - std::upper_bound(over.begin(), over.end(), 3 * kDegree);
        // Goal: 1.5 degrees. Up to 1.8 were found, where little is loose.
        EXPECT_LE(over[over.size() * 99 / 100], 2 * kDegree) << over.size();
        // Goal: none. One in a thousand lies in a valley at times.
        EXPECT_LE(steep, std::max<std::ptrdiff_t>(1, std::ssize(over) / 1000));
        EXPECT_LE(over.back(), kValley + kDegree);
        // Goal: 0. Found: up to 1.8 % of what is loose, where cells below heaps were cut in part.
        EXPECT_LE(pockets(still.ground), loose_samples(still.ground) / 40);
      }
    }
  }
}

TEST(Earthmoving, StaysOnceItCameToRest) {
  for (std::size_t g = 0; g < 3; ++g) {
    Work work(terrains()[g], 9, 0.1, kCohesions[g]);
    for (int i = 1; i <= 100; ++i) {
      work.step();
      if (i % 20 != 0) continue;
      work.tracker.come_to_rest();
      const std::uint64_t hash = work.ground.state_hash();
      work.tracker.come_to_rest();
      EXPECT_EQ(work.ground.state_hash(), hash) << i;
    }
  }
}

TEST(Earthmoving, GoesOnFromItsStateBitForBit) {
  Work work(terrains()[2], 10, 0.1, 300);
  for (int i = 0; i < 100; ++i) work.step();
  const std::unique_ptr<Ground> copy = copy_of(work.ground);
  ASSERT_EQ(copy->state_hash(), work.ground.state_hash());
  Tracker other(*copy, Work::buckets(), Work::site(300));
  other.restore(work.tracker.state());
  EXPECT_EQ(residual(other), 0);
  std::mt19937_64 random(3);
  for (int i = 0; i < 50; ++i) {
    const double x = static_cast<double>(random() % 40) / 10 - 2;
    const Pose to{{x, -x / 2, static_cast<double>(random() % 10) / 10 - 0.4},
                  from_rpy(0, static_cast<double>(random() % 20) / 10 - 1, 0.1 * i)};
    const std::size_t machine = random() % 4;
    for (Tracker* tracker : {&work.tracker, &other}) {
      tracker->update(machine, to);
      if (i % 10 == 0) tracker->pour(i % 3, 40 + i);
    }
    ASSERT_EQ(copy->state_hash(), work.ground.state_hash());
    ASSERT_EQ(other.state(), work.tracker.state());
    ASSERT_EQ(residual(other), 0);
  }
}

TEST(Earthmoving, IsTheSameOnAnyNumberOfThreads) {
  std::uint64_t hash = 0;
  for (const std::size_t threads : {1u, 2u, 4u}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    Work work(terrains()[1], 11, 0.1, 300);
    for (int i = 0; i < 90; ++i) work.step();
    if (hash == 0) hash = work.ground.state_hash();
    EXPECT_EQ(work.ground.state_hash(), hash);
  }
}

TEST(Earthmoving, APourIsTheSameInOneCallOrMany) {
  std::uint64_t hashes[2];
  for (const int calls : {1, 97}) {
    Ground ground(0.1, Vec3::Zero(), terrains()[2]);
    Tracker tracker(ground, {}, loam_with_pours({{"a", {0.5, 0.2, 4}, 3, 20, 4}}));
    for (int i = 1; i <= calls; ++i) tracker.pour(0, 20.0 * i / calls);
    hashes[calls > 1] = ground.state_hash();
  }
  EXPECT_EQ(hashes[0], hashes[1]);
}

TEST(Earthmoving, MoreSoilNeverLowersTheGround) {
  for (const auto& terrain : terrains()) {
    Ground ground(0.1, Vec3::Zero(), terrain);
    std::vector<Pour> pours;
    std::mt19937_64 random(12);
    for (int i = 0; i < 40; ++i) {
      const auto at = [&] { return static_cast<double>(random() % 300) / 100 - 1.5; };
      pours.push_back({"p", {at(), at(), 5}, 0, 0, 0.02 * static_cast<double>(random() % 10 + 1)});
    }
    Tracker tracker(ground, {}, loam_with_pours(pours));
    for (std::size_t i = 0; i < pours.size(); ++i) {
      const GroundWindow before(ground, {-48, -48}, 96, 96);
      tracker.pour(i, 1);
      const GroundWindow after(ground, {-48, -48}, 96, 96);
      // Untouched ground isn't counted until soil comes to lie on it.
      for (int x = 0; x < 96; ++x)
        for (int y = 0; y < 96; ++y)
          if (after.at(x, y).known && before.at(x, y).top > before.at(x, y).bank) {
            ASSERT_GE(after.at(x, y).top, before.at(x, y).top - kCount);
          }
    }
  }
}

/// The work of one cycle, turned by quarter turns about the origin.
std::pair<GroundWindow, double> turned(int quarters) {
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(quarters * std::numbers::pi / 2, Vec3::UnitZ()));
  Ground ground(0.05, Vec3(0.025, 0.025, 0), make_plane(0, {0, 0}));
  Tracker tracker(ground, {digger()}, loam());
  for (const Pose& pose : cycle({-3, 0, 0}, 0.3, 90))
    tracker.update(0, {turn * pose.position, turn * pose.rotation});
  tracker.come_to_rest();
  return {GroundWindow(ground, {-128, -128}, 256, 256), tracker.total().cut_m3()};
}

TEST(Earthmoving, TurnsWithTheScene) {
  const auto [straight, cut] = turned(0);
  const auto [aside, cut_aside] = turned(1);
  EXPECT_NEAR(cut_aside, cut, 0.005 * cut);
  double off = 0;
  for (int x = 0; x < 256; ++x)
    for (int y = 0; y < 256; ++y) off += std::abs(aside.at(255 - y, x).top - straight.at(x, y).top);
  // Goal: 0.02. One station's spill that noise sends another way moves the rest of a heap's flank.
  EXPECT_LE(off * 0.05 * 0.05 * 0.05, 0.06 * cut);
}

TEST(Earthmoving, HardlyDependsOnHowManyUpdatesThereAre) {
  const std::vector<Pose> path = cycle({-3, 0, 0}, 0.3, 90);
  std::vector<double> times;
  for (std::size_t i = 0; i < path.size(); ++i) times.push_back(0.1 * static_cast<double>(i));
  const Motion motion(times, path);
  constexpr double kVoxel = 0.05;
  struct Run {
    Ground ground{kVoxel, Vec3::Zero(), make_plane(0, {0, 0})};
    double most_m3 = 0;
  } runs[2];
  const int updates[] = {30, 5000};
  for (int r = 0; r < 2; ++r) {
    Tracker tracker(runs[r].ground, {digger()}, loam());
    for (int i = 0; i < updates[r]; ++i) {
      const double span = motion.end_s() / updates[r];
      const double end_s = i + 1 == updates[r] ? motion.end_s() : (i + 1) * span;
      tracker.update(0, motion, i * span, end_s);
      if (std::abs(end_s - 0.8 * motion.end_s()) < span / 2)
        runs[r].most_m3 = tracker.total().bucket_m3();
    }
    tracker.come_to_rest();
    EXPECT_EQ(residual(tracker), 0);
  }
  EXPECT_GT(runs[0].most_m3, 0.5);
  EXPECT_NEAR(runs[0].most_m3, runs[1].most_m3, 0.005 * runs[0].most_m3);
  const GroundWindow a(runs[0].ground, {-128, -128}, 256, 256),
      b(runs[1].ground, {-128, -128}, 256, 256);
  double off = 0, moved = 0;
  for (int x = 0; x < 256; ++x) {
    for (int y = 0; y < 256; ++y) {
      off += std::abs(a.at(x, y).top - b.at(x, y).top);
      moved += std::abs(a.at(x, y).top);
    }
  }
  EXPECT_LE(off, 0.02 * moved);
}

TEST(Earthmoving, LooseSoilDoesntSwellAgain) {
  Ground ground(0.05, Vec3::Zero(), make_plane(0, {0, 0}));
  Tracker tracker(ground, {digger()}, loam_with_pours({{"heap", {0, 0, 5}, 0, 0, 12}}));
  tracker.pour(0, 0);
  std::int64_t loads = 0;
  for (int i = 0; i <= 100; ++i) {
    const std::int64_t ground_mass = tracker.mass_balance().ground, cut = tracker.total().cut();
    tracker.update(0, Pose{{-3 + 0.03 * i, 0, 0.15 + 0.01 * i}, from_rpy(0, -0.01 * i, 0)});
    // All that is cut is of the heap, and counts once.
    const MassUnits units = tracker.mass_balance().units;
    const MassBalance balance = tracker.mass_balance();
    EXPECT_EQ(balance.ground + tracker.total().load + balance.pending, balance.poured);
    EXPECT_LE(ground_mass - balance.ground, (tracker.total().cut() - cut) * units.loose);
    loads = std::max(loads, tracker.total().load);
  }
  EXPECT_GT(loads, 0);
  EXPECT_LE(loads, tracker.total().captured * tracker.mass_balance().units.loose);
}

TEST(Earthmoving, AHeapThatIsDugIntoHasNoRoof) {
  constexpr double kVoxel = 0.05;
  Earthmoving earthmoving = loam();
  earthmoving.pours.push_back({"truck", {0, 0, 5}, 0, 0, 6.0});
  Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
  Bucket bucket = digger();
  Tracker tracker(ground, {bucket}, earthmoving);
  tracker.pour(0, 0);
  const double high = surface_top(ground);
  EXPECT_GT(high, 1.3);
  // Through the foot of the heap, far below its top.
  for (int i = 0; i <= 200; ++i) tracker.update(0, Pose{{-3 + 3.0 * i / 200, 0, 0.05}});
  for (int i = 0; i <= 100; ++i) tracker.update(0, Pose{{-3.0 * i / 100, 0, 0.05}});
  tracker.come_to_rest();
  EXPECT_EQ(residual(tracker), 0);
  EXPECT_LT(surface_top(ground), high - 0.2);
  const GroundWindow window(ground, {-64, -64}, 128, 128);
  EXPECT_FALSE(window.has_hanging());
}

}  // namespace earthmoving_test
}  // namespace soilvdb::test
