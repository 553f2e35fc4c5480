// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Many machines at once, and going on from a saved state: the same bits as one after another.
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <limits>

#include "core/ground/ground_writer.h"
#include "tests/support/dig_runner.h"

namespace soilvdb::test {
namespace tracker_test {

constexpr double kVoxel = 0.05;

Pose at(double x, double y, double z, double pitch = 0) {
  return {{x, y, z}, from_rpy(0, pitch, 0)};
}

/// Six machines: four apart from each other, two that dig the same place.
std::vector<Move> moves_of_six(int from, int to) {
  std::vector<Move> moves;
  for (int i = from; i < to; ++i) {
    for (std::size_t m = 0; m < 6; ++m) {
      Move move;
      move.machine = m;
      const double place = 10.0 * static_cast<double>(m < 4 ? m : 4);
      move.to = at(place + 0.03 * i + 0.5 * static_cast<double>(m == 5),
                   0.1 * static_cast<double>(m), 0.1 - 0.25 * std::sin(0.05 * i), 0.01 * i);
      moves.push_back(move);
    }
  }
  return moves;
}

TEST(Tracker, MovesOfManyMachinesAtOnceGiveTheBitsOfOneAfterAnother) {
  constexpr int kSteps = 100;
  const std::vector<Bucket> buckets(6, Bucket{0.6, 0.4, {}, {}});
  const auto terrain = [] { return make_plane(0, {0.05, -0.02}); };
  Ground in_order(kVoxel, Vec3::Zero(), terrain());
  Tracker one(in_order, buckets);
  std::vector<Update> expected;
  for (const Move& move : moves_of_six(0, kSteps))
    expected.push_back(one.update(move.machine, move.to));
  EXPECT_GT(one.total().captured, 0);
  for (const std::size_t threads : {1u, 2u, 4u, 8u}) {
    const tbb::global_control control(tbb::global_control::max_allowed_parallelism, threads);
    for (const int batch : {1, 7, kSteps}) {
      Ground ground(kVoxel, Vec3::Zero(), terrain());
      Tracker tracker(ground, buckets);
      std::size_t n = 0;
      for (int i = 0; i < kSteps; i += batch) {
        for (const Update& u : tracker.update(moves_of_six(i, std::min(i + batch, kSteps)))) {
          EXPECT_EQ(u.cut_m3, expected[n].cut_m3) << n;
          EXPECT_EQ(u.bucket_m3, expected[n].bucket_m3) << n;
          ++n;
        }
      }
      EXPECT_EQ(ground.state_hash(), in_order.state_hash()) << threads << " threads, " << batch;
    }
  }
}

TEST(Tracker, GoesOnFromItsStateBitForBit) {
  for (const bool body : {false, true}) {
    Dig dig = make_dig("drag_curl_retreat", placements()[2]);
    if (body) dig.bucket.profile = {{0, 0}, {-0.4, 0.1}, {-0.4, 0.4}, {0, 0.5}};
    const double end = dig.motion.end_s();
    constexpr int kUpdates = 60;
    for (const int stop : {0, 7, 31, 59}) {
      Ground ground(kVoxel, dig.origin, dig.terrain), copy(kVoxel, dig.origin, dig.terrain);
      Tracker tracker(ground, {dig.bucket}), later(copy, {dig.bucket});
      const auto dig_on = [&](Tracker& t, int i) {
        t.update(0, dig.motion, end * i / kUpdates, end * (i + 1) / kUpdates);
      };
      for (int i = 0; i < stop; ++i) dig_on(tracker, i);
      for (const Chunk* chunk : ground.chunks()) GroundWriter(copy).put(ground.copy(*chunk));
      later.restore(tracker.state());
      for (int i = stop; i < kUpdates; ++i) {
        dig_on(tracker, i);
        dig_on(later, i);
      }
      EXPECT_EQ(copy.state_hash(), ground.state_hash()) << "stopped after " << stop;
      EXPECT_EQ(later.total().captured, tracker.total().captured);
      EXPECT_EQ(later.total().displaced, tracker.total().displaced);
    }
  }
}

TEST(Tracker, RefusesWhatIsNoPoseAndStaysAsItWas) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInf = std::numeric_limits<double>::infinity();
  std::vector<Pose> bad;
  for (const double v : {kNan, kInf, -kInf, 1e308, -1e308, 1e10, kVoxel * (1 << 23)}) {
    for (int axis = 0; axis < 3; ++axis) {
      bad.push_back(at(1, 0, -0.2));
      bad.back().position[axis] = v;
    }
  }
  for (const double v : {kNan, kInf, 1e308, 0.0, 0.9}) {
    bad.push_back(at(1, 0, -0.2));
    bad.back().rotation = Eigen::Quaterniond(v, 0, 0, 0);
  }
  for (const std::size_t machines : {1u, 2u}) {
    {
      Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
      Tracker tracker(ground, std::vector<Bucket>(machines, Bucket{0.6, 0.4, {}, {}}));
      for (int i = 0; i < 20; ++i) tracker.update(0, at(0.05 * i, 0, -0.2));
      const std::string state = tracker.state();
      const std::uint64_t hash = ground.state_hash();
      const auto refuses = [&](auto update) {
        EXPECT_THROW(update(), std::invalid_argument);
        EXPECT_EQ(tracker.state(), state);
        EXPECT_EQ(ground.state_hash(), hash);
      };
      for (const Pose& pose : bad) {
        refuses([&] { tracker.update(0, pose); });
        const Move good{0, at(1.2, 0, -0.2)}, then_bad{machines - 1, pose};
        refuses([&] { tracker.update(std::vector<Move>{good, then_bad}); });
        if (!is_valid(pose)) {
          EXPECT_THROW(Motion({0, 1}, std::vector<Pose>{at(0, 0, 0), pose}), std::invalid_argument);
          continue;
        }
        // Between its ends, too.
        const Motion motion({0, 1, 2}, std::vector<Pose>{at(0.95, 0, -0.2), pose, at(1, 0, -0.2)});
        for (const double end : {1.0, 1.5, 2.0})
          refuses([&] { tracker.update(0, motion, 0, end); });
      }
      const Motion motion({0, 1}, std::vector<Pose>{at(0.95, 0, -0.2), at(1, 0, -0.2)});
      for (const auto& times :
           {std::pair(kNan, 1.0), std::pair(0.0, kNan), std::pair(0.0, kInf), std::pair(1.0, 0.0)})
        refuses([&] { tracker.update(0, motion, times.first, times.second); });
      refuses([&] { tracker.update(machines, at(0, 0, 0)); });
      refuses([&] { tracker.update(std::vector<Move>{{machines, at(0, 0, 0)}}); });
      EXPECT_NO_THROW(tracker.update(0, motion, 0, 1));
    }
  }
}

TEST(Tracker, RefusesAStateThatIsNotItsOwn) {
  Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
  Tracker one(ground, {Bucket{0.6, 0.4, {}, {}}}), other(ground, {Bucket{0.7, 0.4, {}, {}}});
  one.update(0, at(0, 0, -0.2));
  one.update(0, at(1, 0, -0.2));
  const std::string state = one.state();
  EXPECT_THROW(other.restore(state), std::invalid_argument);
  EXPECT_THROW(one.restore(state + "x"), std::invalid_argument);
  for (std::size_t size = 0; size < state.size(); size += 7)
    EXPECT_THROW(one.restore(std::string_view(state).substr(0, size)), std::invalid_argument);
  EXPECT_NO_THROW(one.restore(state));
}

}  // namespace tracker_test
}  // namespace soilvdb::test
