// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Random programs of calls come to the bits of one that only moves; wild states are refused.
// harmless.
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <random>

#include "soilvdb/io/checksum.h"
#include "soilvdb/session.h"
#include "tests/support/earthmoving_fixture.h"

namespace soilvdb::test {
namespace session_attack_test {

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

SessionSite site_of(bool moving) {
  SessionSite site{.voxel_size_m = 0.1,
                   .terrain = io::PlaneTerrain{0.2, {0.05, 0}},
                   .machines = {{"digger", digger()}, {"plate", Bucket{1.0, 0.6, {}, 0.8}}}};
  if (!moving) return site;
  site.earthmoving = loam_with_pours({{"truck", {2, 2, 4}, 5, 40, 2}});
  site.earthmoving.pours.push_back({"beside it", {2.6, 2, 4}, 6, 30, 1});
  site.earthmoving.hoppers.push_back({"bin", {Vec2(-1, 2.5), Vec2(3, 5.5)}, 0.5, 0, 30});
  return site;
}

class Chance {
 public:
  explicit Chance(std::uint64_t seed) : bits_(seed) {}
  int below(int n) { return static_cast<int>(bits_() % static_cast<unsigned>(n)); }
  double between(double low, double high) {
    return low + (high - low) * static_cast<double>(bits_() >> 11) * 0x1p-53;
  }
  Pose pose() {
    return {{between(-3, 3), between(-3, 3), between(-0.4, 1)},
            Eigen::Quaterniond(
                Eigen::AngleAxisd(between(-3, 3), Vec3::UnitZ()) *
                Eigen::AngleAxisd(below(3) == 0 ? between(-1.5, 1.5) : 0.3, Vec3::UnitY()))};
  }
  std::uint64_t bits() { return bits_(); }

 private:
  std::mt19937_64 bits_;
};

std::string all_of(const Session& session) {
  std::string text = session.save() + std::to_string(session.ground_hash());
  for (std::size_t i = 0; i < session.machines().size(); ++i)
    text += std::to_string(session.ledger(i).cut()) + " " + std::to_string(session.ledger(i).load);
  const MassBalance balance = session.mass_balance();
  for (const std::int64_t n :
       {balance.ground, balance.pending, balance.poured, balance.hauled, balance.slid})
    text += " " + std::to_string(n);
  return text;
}

class SessionAttack : public ::testing::TestWithParam<bool> {};
INSTANTIATE_TEST_SUITE_P(Ground, SessionAttack, ::testing::Bool(), [](const auto& given) {
  return given.param ? "ThatMoves" : "ThatIsRigid";
});

/// Looks, goes on as a copy or from a state, and is asked for what can't be: nothing of that shows.
void meddle(Session& session, Chance& chance, std::vector<Session>& kept, double time_s) {
  std::vector<double> heights(50);
  std::vector<Vec2> xy;
  while (xy.size() < heights.size()) xy.emplace_back(chance.between(-4, 4), chance.between(-4, 4));
  const MachineState bad[] = {
      {.machine = 0, .time_s = time_s, .pose = chance.pose()},
      {.machine = 0, .time_s = time_s, .pose = {{kNaN, 0, 0}, {1, 0, 0, 0}}}};
  switch (chance.below(8)) {
    case 0:
      session.heights(xy, heights).check();
      break;
    case 1:
      session.changed_patches();
      break;
    case 2:  // the copy goes on, and who was copied goes first or last
      kept.push_back(std::move(session));
      session = kept.back().clone();
      if (chance.below(2) == 0)
        kept.erase(kept.begin() + chance.below(static_cast<int>(kept.size())));
      break;
    case 3:  // others dig what is shared
      kept.push_back(session.clone());
      for (Session& other : kept) other.update({.machine = 1, .pose = chance.pose()});
      break;
    case 4:
      session.restore(session.save());
      break;
    case 5: {  // elsewhere, and back
      const std::string state = session.save();
      session.update({.machine = 0, .pose = chance.pose()});
      session.restore(state);
      break;
    }
    case 6:
      EXPECT_FALSE(session.update(bad[1]).ok());
      EXPECT_EQ(session.update(bad).bad, 1u);
      break;
    default:
      session.mesh();
  }
}

TEST_P(SessionAttack, WhoMeddlesComesToTheSameBits) {
  for (std::uint64_t seed = 1; seed <= (GetParam() ? 2 : 6); ++seed) {
    Chance chance(seed), other(seed + 1000);
    const tbb::global_control threads(tbb::global_control::max_allowed_parallelism, 1 + seed % 3);
    Session plain(site_of(GetParam())), meddled(site_of(GetParam()));
    for (Session* session : {&plain, &meddled}) session->set_limits(false);  // its states jump
    std::vector<Session> kept;
    double time_s = 0;
    for (int step = 0; step < 20; ++step) {
      std::vector<MachineState> states;
      for (int i = chance.below(4); i >= 0; --i) {
        MachineState state{.machine = static_cast<std::size_t>(chance.below(2)),
                           .pose = chance.pose()};
        if (chance.below(4) > 0) state.time_s = time_s += chance.between(0, 1);
        states.push_back(state);
      }
      for (const MachineState& state : states) ASSERT_TRUE(plain.update(state).ok());
      if (other.below(2) == 0) {
        const BatchResult batch = meddled.update(states);
        ASSERT_TRUE(batch.ok()) << batch.why;
      } else {
        for (const MachineState& state : states) ASSERT_TRUE(meddled.update(state).ok());
      }
      meddle(meddled, other, kept, time_s);
      if (chance.below(6) == 0) {
        ASSERT_EQ(plain.pour(time_s).ok(), meddled.pour(time_s).ok());
      }
      if (chance.below(9) == 0) {
        plain.come_to_rest();
        meddled.come_to_rest();
      }
      while (kept.size() > 3) kept.erase(kept.begin());
      ASSERT_EQ(all_of(plain) == all_of(meddled), true) << "seed " << seed << ", step " << step;
    }
    EXPECT_GT(plain.total().cut_m3(), 0.3);
  }
}

/// A state with these bytes at a place behind its checksum, which is right.
std::string with(std::string state, std::size_t at, std::string_view bytes) {
  constexpr std::size_t kBody = 13 + 4 + 8;
  std::memcpy(&state[at], bytes.data(), bytes.size());
  const std::uint64_t checksum = io::crc64(std::string_view(state).substr(kBody));
  std::memcpy(&state[kBody - 8], &checksum, 8);
  return state;
}

template <typename T>
std::string_view bytes_of(const T& value) {
  return {reinterpret_cast<const char*>(&value), sizeof(value)};
}

TEST(SessionsThatCantBe, SitesOfNothingAndOfNonsense) {
  SessionSite site = site_of(true);
  site.machines.clear();
  Session empty(site);
  EXPECT_TRUE(empty.update(std::span<const MachineState>{}).ok());
  EXPECT_FALSE(empty.update(MachineState{}).ok());
  EXPECT_TRUE(empty.pour(60).ok());
  EXPECT_GT(empty.change_m3(), 2.9);
  double heights[2];
  empty.heights(std::vector<Vec2>{{0, -3e12}, {0, 5e9}}, heights).check();
  for (const double height : heights) EXPECT_DOUBLE_EQ(height, 0.2) << "where nobody dug";
  const auto refusal = [](const auto& change) {
    SessionSite bad = site_of(true);
    change(bad);
    try {
      const Session session(bad);
    } catch (const std::invalid_argument& e) {
      return std::string(e.what());
    }
    return std::string("taken");
  };
  for (const double value : {kNaN, kInf}) {
    EXPECT_EQ(refusal([&](auto& s) {
                s.terrain = io::PlaneTerrain{value, {0, 0}};
              }),
              "the plane's height and slope must be finite");
    EXPECT_EQ(refusal([&](auto& s) {
                s.terrain = io::PlaneTerrain{0, {0, value}};
              }),
              "the plane's height and slope must be finite");
  }
  EXPECT_EQ(refusal([](auto& s) { s.earthmoving.pours[0].at_m.x() = 1e300; }),
            "pour 'truck': its place is not on this site");
  EXPECT_EQ(refusal([](auto& s) { s.earthmoving.pours[0].volume_m3 = 1e300; }),
            "pour 'truck': its volume is more than can be counted");
  EXPECT_EQ(refusal([](auto& s) {
              s.earthmoving.pours[0].begin_s = -1e308;
              s.earthmoving.pours[0].end_s = 1e308;
            }),
            "pour 'truck': its time must be finite");
  EXPECT_EQ(refusal([](auto& s) { s.earthmoving.soil->swell = 1e300; }),
            "swell is 1e+300; it must be loose over bank volume less 1, a share from 0 to 3");
}

TEST_P(SessionAttack, WildStatesAreRefusedOrCanBeGoneOnFrom) {
  Session session(site_of(GetParam()));
  Chance chance(5);
  Pose last[2];
  for (int i = 0; i < 4; ++i) {
    const auto machine = static_cast<std::size_t>(i % 2);
    last[machine] = chance.pose();
    ASSERT_TRUE(
        session.update({.machine = machine, .time_s = i * 1.0, .pose = last[machine]}).ok());
  }
  const std::string state = session.save();
  int refused = 0, taken = 0;
  const auto attack = [&](std::size_t at, std::string_view bytes, bool goes_on) {
    if (at + bytes.size() > state.size()) return;
    Session victim = session.clone();
    try {
      victim.restore(with(state, at, bytes));
    } catch (const std::invalid_argument&) {
      ASSERT_EQ(victim.save(), state) << at;
      ++refused;
      return;
    }
    ++taken;
    const std::string now = victim.save();
    victim.restore(now);
    ASSERT_EQ(victim.save(), now) << at;
    std::vector<double> heights(1);
    victim.heights(std::vector<Vec2>{{0, 0}}, heights).check();
    if (!goes_on) return;
    for (const std::size_t machine : {0, 1}) {
      const StepResult step =
          victim.update({.machine = machine, .time_s = 100, .pose = chance.pose()});
      ASSERT_TRUE(step.ok() || step.status == Status::kBadState) << at << " " << step.why;
    }
    ASSERT_TRUE(victim.come_to_rest().ok()) << at;
  };
  const std::size_t head = 25, numbers = std::min<std::size_t>(state.size(), 1400);
  // Each place where the state has a number of where the machines are.
  for (const Pose& pose : last) {
    for (const double number : {pose.position.x(), pose.position.z(), pose.rotation.y()}) {
      std::size_t at = head;
      while ((at = state.find(bytes_of(number), at)) != std::string::npos) {
        for (const double value : {kNaN, kInf, -1e300}) attack(at, bytes_of(value), true);
        at += 8;
      }
    }
  }
  for (std::size_t at = head; at + 8 < numbers; at += 7)
    attack(at, bytes_of(static_cast<std::uint8_t>(chance.bits())), false);
  for (int i = 0; i < 100; ++i) {
    const std::uint64_t word = chance.below(2) == 0 ? chance.bits() : ~std::uint64_t{0};
    attack(head + static_cast<std::size_t>(chance.bits() % (state.size() - head)),
           bytes_of(word).substr(0, static_cast<std::size_t>(1 + chance.below(8))), false);
  }
  EXPECT_GT(refused, 50);
  EXPECT_GT(taken, 5);
}

}  // namespace session_attack_test
}  // namespace soilvdb::test
