// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Memory over a hundred thousand updates that cut but reach no new ground: it stays as it is.
#include <gtest/gtest.h>
#include <malloc.h>

#include <algorithm>
#include <array>
#include <limits>
#include <map>
#include <set>
#include <utility>

#include "soilvdb/change_follower.h"
#include "soilvdb/ground_copy.h"
#include "soilvdb/io/site.h"
#include "soilvdb/mesher.h"
#include "soilvdb/tracker.h"

namespace soilvdb::test {
namespace heap_growth_test {

constexpr int kUpdates = 100'000;
constexpr int kPassUpdates = 40;  // of each machine, over two metres
constexpr double kVoxel = 0.05;
constexpr double kGrowth = 0.02;

/// Three machines side by side that take a thin slice off the same ground in every pass, from 0.20
/// m to 0.22 m below its surface: within one layer of chunks, walls as high as before.
struct Levelling {
  Ground ground{kVoxel, Vec3::Zero(), io::open_base(io::PlaneTerrain{}).surface};
  Tracker tracker{ground, std::vector<Bucket>(3, bucket())};
  int updates = 0;

  static Bucket bucket() {
    Bucket bucket;
    bucket.width_m = 1;
    bucket.height_m = 1;
    return bucket;
  }
  /// Every machine makes a pass, then they go back through the air.
  void pass() {
    const double depth_m = 0.20 + 0.02 * updates / kUpdates;
    for (int i = 0; i < kPassUpdates; ++i) {
      std::array<Move, 3> moves;
      for (std::size_t m = 0; m < moves.size(); ++m) {
        moves[m].machine = m;
        const bool back = i + 1 == kPassUpdates;
        moves[m].to.position = {back ? 0 : 2.0 * i / kPassUpdates, 1.1 * double(m),
                                back ? 0.5 : -depth_m};
      }
      tracker.update(moves);
      updates += 3;
    }
  }
};

std::size_t allocated_bytes() { return mallinfo2().uordblks; }

/// Levels to the end. @return by which share memory grew over the second half
template <typename AfterPass, typename Settle>
double growth(Levelling& dig, AfterPass&& after_pass, Settle&& settle) {
  const auto level_until = [&](int updates) {
    while (dig.updates < updates) {
      dig.pass();
      after_pass();
    }
    settle();
    // Threads keep the memory of the block they meshed last, and blocks differ in size: the least
    // after passes that end with the same one.
    double least = std::numeric_limits<double>::infinity();
    for (int i = 0; i < 4; ++i) {
      dig.pass();
      after_pass();
      settle();
      least = std::min(least, double(allocated_bytes()));
    }
    return least;
  };
  const double half = level_until(kUpdates / 2), end = level_until(kUpdates);
  EXPECT_GT(dig.tracker.total().cut_m3(), 1.0) << "it was dug";
  return end / half - 1;
}

TEST(Heap, IsFlatWhenNobodyAsksWhatChanged) {
  Levelling dig;
  EXPECT_LT(growth(
                dig, [] {}, [] {}),
            kGrowth);
}

TEST(Heap, IsFlatWithACopyThatIsMeshedBesideUpdates) {
  Levelling dig;
  Ground copy(kVoxel, Vec3::Zero(), io::open_base(io::PlaneTerrain{}).surface);
  CachedMesher mesher(copy);
  std::set<Coord3, Before> wanted;
  std::map<Coord3, Mesh, Before> patches;
  int jobs = 0;
  GroundCopy ground_copy(copy);
  ChangeFollower changes(dig.ground);
  const auto mesh_wanted = [&] {
    ground_copy.run([&, blocks = std::exchange(wanted, {})] {
      for (const Coord3& block : blocks) patches[block] = mesher.block(block);
      ++jobs;
    });
  };
  const auto after_pass = [&] {
    const std::vector<Coord3> changed = changes.take();
    ground_copy.post(dig.ground, changed);
    for (const Coord3& block : blocks_touched(changed)) wanted.insert(block);
    if (ground_copy.done()) mesh_wanted();
  };
  const auto settle = [&] {
    mesh_wanted();
    ground_copy.finish();
  };
  EXPECT_LT(growth(dig, after_pass, settle), kGrowth);
  EXPECT_GT(jobs, 10);
  EXPECT_FALSE(patches.empty());
}

}  // namespace heap_growth_test
}  // namespace soilvdb::test
