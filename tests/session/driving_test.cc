// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A machine that drives: the base of its joints is part of its states.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <deque>
#include <optional>
#include <random>
#include <string>

#include "tests/session/session_fixture.h"
#include "tests/support/temp_folder.h"
#include "tools/run/session_undo.h"

namespace soilvdb::test {
namespace driving_test {

/// A cab that swings and an arm that reaches down.
Chain arm() {
  Chain chain;
  chain.world_from_root = {{-6, 0.5, 0.4}, from_rpy(0, 0, 0.2)};
  Joint swing{"swing", Joint::Type::kContinuous, {{0, 0, 1}, {1, 0, 0, 0}}, Vec3::UnitZ()};
  Joint lift{"lift", Joint::Type::kPrismatic, {{2, 0, -1}, {1, 0, 0, 0}}, Vec3::UnitZ(), -3, 3};
  chain.joints = {swing, lift};
  chain.link_from_bucket = {{0.3, 0, 0.1}, from_rpy(0, 0.1, 0)};
  return chain;
}

/// The same on joints that carry it along x, y and z and turn it about z.
Chain carried_arm() {
  Chain chain = arm();
  chain.world_from_root = {};
  std::vector<Joint> joints;
  for (int k = 0; k < 3; ++k)
    joints.push_back(
        {std::string("drive_") + "xyz" [k], Joint::Type::kPrismatic, {}, Vec3::Unit(k)});
  joints.push_back({"turn", Joint::Type::kContinuous, {}, Vec3::UnitZ()});
  joints.insert(joints.end(), chain.joints.begin(), chain.joints.end());
  chain.joints = joints;
  return chain;
}

SessionSite site_with(const Chain& chain, Earthmoving earthmoving = {}) {
  SessionSite all = site_of(std::move(earthmoving));
  all.machines[0].chain = chain;
  return all;
}

struct Driven {
  double time_s = 0;
  Vec3 position = Vec3::Zero();
  double yaw = 0;
  std::vector<double> joints;

  Pose base() const { return {position, from_rpy(0, 0, yaw)}; }
  std::vector<double> carried() const {
    return {position.x(), position.y(), position.z(), yaw, joints[0], joints[1]};
  }
};

/// A drive over the site, the bucket in the ground for most of it.
std::vector<Driven> drive(std::uint64_t seed, int count = 40) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> any(-1, 1);
  std::vector<Driven> all;
  Driven at{0, {-7, any(random), 0}, 0.3 * any(random), {0, 0}};
  for (int i = 0; i < count; ++i) {
    at.time_s += 0.25 + 0.1 * any(random);
    at.yaw += 0.1 * any(random);
    at.position += Vec3(0.25, 0.1 * any(random), 0);
    at.position.z() = 0.2 + 0.05 * at.position.x();
    at.joints[0] += 0.1 * any(random);
    at.joints[1] = (i % 20 < 14 ? -0.2 : 0.9) + 0.05 * any(random);
    all.push_back(at);
  }
  return all;
}

MachineState state_of(const Driven& at, bool with_base = true) {
  return {.machine = 0,
          .time_s = at.time_s,
          .joints = at.joints,
          .base = with_base ? std::optional(at.base()) : std::nullopt};
}

constexpr double kRounding = 1e-9;  // m and rad

TEST(DrivingChain, IsTheChainThatStandsThere) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> any(-3, 3);
  for (int i = 0; i < 200; ++i) {
    Chain chain = arm();
    std::vector<double> joints = {any(random), any(random)}, values = joints;
    const Pose base{
        {5e5 + any(random), any(random), any(random)},
        Eigen::Quaterniond(any(random), any(random), any(random), any(random)).normalized()};
    Chain::add_base(values, base);
    const Pose driven = chain.world_from_bucket(values);
    chain.world_from_root = base;
    const Pose stands = chain.world_from_bucket(joints);
    EXPECT_LT((driven.position - stands.position).norm(), kRounding);
    EXPECT_LT(driven.rotation.angularDistance(stands.rotation), 1e-7);
    const Vec3 force(1, 2, 3), moment(-1, 0.5, 2);
    const auto a = chain.joint_loads(values, force, moment);
    const auto b = chain.joint_loads(joints, force, moment);
    for (std::size_t k = 0; k < b.size(); ++k) EXPECT_NEAR(a[k], b[k], 1e-8);
  }
}

TEST(DrivingChain, MovesBetweenRowsAsOneOnJointsThatCarryIt) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    std::vector<double> times_s, driven, carried;
    for (const Driven& at : drive(seed)) {
      times_s.push_back(at.time_s);
      driven.insert(driven.end(), at.joints.begin(), at.joints.end());
      Chain::add_base(driven, at.base());
      const std::vector<double> row = at.carried();
      carried.insert(carried.end(), row.begin(), row.end());
    }
    const Motion a(times_s, driven, arm()), b(times_s, carried, carried_arm());
    for (double time_s = times_s.front(); time_s < times_s.back(); time_s += 0.0137) {
      const Pose at = a.pose(time_s), other = b.pose(time_s);
      EXPECT_LT((at.position - other.position).norm(), kRounding);
      EXPECT_LT((at.rotation.toRotationMatrix() - other.rotation.toRotationMatrix()).norm(),
                kRounding);
    }
  }
}

/// Joints make up for it at the bucket, which stands.
TEST(DrivingChain, StaysWhereItDrivesWhenRowsAreThinned) {
  Chain chain;
  chain.joints = {{"turn", Joint::Type::kContinuous, {}, Vec3::UnitZ()},
                  {"slide", Joint::Type::kPrismatic, {}, Vec3::UnitX(), -9, 9}};
  std::vector<double> times_s, values;
  for (int i = 0; i <= 200; ++i) {
    const double way_m = std::sin(0.05 * i), yaw = i > 100 ? 0.02 * (i - 100) : 0;
    times_s.push_back(0.1 * i);
    values.insert(values.end(), {-yaw, 3 + way_m});
    Chain::add_base(values, {{-way_m, 0, 0}, from_rpy(0, 0, yaw)});
  }
  const Motion motion(times_s, values, chain);
  constexpr double kTolerance_m = 0.01;
  Bucket bucket;
  bucket.width_m = 1.2;
  bucket.height_m = 0.9;
  const Motion thinned = motion.simplified(bucket, kTolerance_m);
  EXPECT_LT(thinned.times_s().size(), 100u);
  for (const double time_s : times_s) {
    const Pose is = chain.base_of(motion.joint_values(time_s)),
               would_be = chain.base_of(thinned.joint_values(time_s));
    EXPECT_LT((is.position - would_be.position).norm(), 1.001 * kTolerance_m) << time_s;
    EXPECT_LT(is.rotation.angularDistance(would_be.rotation), kTolerance_m) << time_s;
  }
}

TEST(DrivingChain, ThatTurnsWhileItsCabTurnsBackIsFollowedAllTheWay) {
  // In one row the base turns nearly half a turn, and the cab twice as far the other way.
  Chain chain = arm();
  std::vector<double> values = {0, 0};
  Chain::add_base(values, {});
  const double half = 3.1;
  values.insert(values.end(), {-2 * half, 0});
  const auto turned = row_of({Vec3::Zero(), from_rpy(0, 0, half)});
  values.insert(values.end(), turned.begin(), turned.end());
  const Motion motion({0, 1}, values, chain);
  double way_rad = 0;
  const std::vector<Pose> path = motion.trace(0, 1, digger(), 0.01, 10);
  for (std::size_t i = 1; i < path.size(); ++i)
    way_rad += path[i].rotation.angularDistance(path[i - 1].rotation);
  EXPECT_NEAR(way_rad, half, 1e-3);
}

class Driving : public Sessions {
 protected:
  static Session session() { return Session(with(arm())); }
  static SessionSite with(const Chain& chain) {
    return site_with(chain, GetParam() ? moving() : Earthmoving{});
  }
};

TEST_P(Driving, DigsAsItsBucketFedByPoses) {
  for (const std::uint64_t seed : {1, 2}) {
    Session driven = session(), posed = session();
    for (const Driven& at : drive(seed)) {
      MachineState state = state_of(at), pose{.machine = 0};
      state.time_s.reset();  // the bucket moves straight
      Chain there = arm();
      there.world_from_root = at.base();
      there.world_from_root.rotation.normalize();
      pose.pose = there.world_from_bucket(at.joints);
      ASSERT_TRUE(driven.update(state).ok());
      ASSERT_TRUE(posed.update(pose).ok());
    }
    EXPECT_GT(driven.ledger(0).cut_m3(), 0.5);
    EXPECT_EQ(driven.ledger(0).cut(), posed.ledger(0).cut());
    EXPECT_EQ(driven.ground_hash(), posed.ground_hash());
  }
}

// Of rigid soil: what slides may tell one rounding from another.
TEST(DrivingChain, DigsAsOneOnJointsThatCarryIt) {
  Session driven(site_with(arm())), carried(site_with(carried_arm()));
  for (const Driven& at : drive(3)) {
    const std::vector<double> joints = at.carried();
    ASSERT_TRUE(driven.update(state_of(at)).ok());
    ASSERT_TRUE(carried.update({.machine = 0, .time_s = at.time_s, .joints = joints}).ok());
  }
  EXPECT_GT(driven.ledger(0).cut_m3(), 0.5);
  // Samples at the rim of the cut may be rounded to either side of it.
  EXPECT_NEAR(driven.ledger(0).cut_m3(), carried.ledger(0).cut_m3(), 1e-4);
  EXPECT_NEAR(driven.change_m3(), carried.change_m3(), 1e-4);
}

TEST_P(Driving, StandsWhereItDroveUntilToldOtherwise) {
  Session told = session(), held = session();
  std::deque<Driven> all;
  for (Driven at : drive(4)) {
    const bool moves = all.size() % 5 == 0;
    if (!moves) {
      at.position = all.back().position;
      at.yaw = all.back().yaw;
    }
    all.push_back(at);
    ASSERT_TRUE(told.update(state_of(at)).ok());
    ASSERT_TRUE(held.update(state_of(at, moves)).ok());
    EXPECT_EQ(held.base(0).position, at.position);
  }
  EXPECT_EQ(told.save(), held.save());
  // In a batch, too, and where it is placed.
  Driven at = all.back();
  std::vector<MachineState> batch = {state_of(at), state_of(at, false)};
  batch[0].base->position.x() += 0.1;
  ASSERT_TRUE(held.update(batch).ok());
  EXPECT_EQ(held.base(0).position, batch[0].base->position);
  Driven lifted = at;
  lifted.joints[1] = 2;
  ASSERT_TRUE(held.place(state_of(lifted, false)).ok());
  EXPECT_EQ(held.base(0).position, batch[0].base->position);
  EXPECT_EQ(held.pose(0, lifted.joints).position, held.last(0)->pose.position);
  // A pose does not tell where the base is.
  ASSERT_TRUE(held.update({.machine = 0, .pose = held.last(0)->pose}).ok());
  EXPECT_EQ(held.base(0).position, arm().world_from_root.position);
}

TEST_P(Driving, GoesOnFromItsRecordingAndFromWhatWasTakenBack) {
  std::mt19937_64 random(5);
  const std::vector<Driven> all = drive(5, 60);
  const auto feed_driven = [&](Session& session, std::size_t from, std::size_t to) {
    std::mt19937_64 choice(from);
    for (std::size_t i = from; i < to; ++i) {
      // Its base is not known at first, and then given now and then.
      const bool with_base = i > 5 && (i == 6 || choice() % 3 == 0);
      if (choice() % 4 == 0 && i + 1 < to) {
        const MachineState two[] = {state_of(all[i], with_base), state_of(all[i + 1], i > 5)};
        ASSERT_TRUE(session.update(two).ok());
        ++i;
        continue;
      }
      MachineState state = state_of(all[i], with_base);
      if (choice() % 6 == 0) state.time_s.reset();
      const StepResult step = session.update(state);
      ASSERT_TRUE(step.ok()) << step.why;
    }
  };
  for (const bool snapshots : {false, true}) {
    const TempFolder temp;
    Recording recording{.folder = temp / "site"};
    if (snapshots) recording.snapshot_every_s = 2;
    Session never = session();
    std::optional<Session> recorded = session();
    recorded->record(recording);
    for (const std::size_t from : {0u, 3u, 10u, 30u}) {
      const std::size_t to = from == 0 ? 3 : from == 3 ? 10 : 2 * from - 10;
      feed_driven(never, from, to);
      feed_driven(*recorded, from, to);
      recorded.reset();
      recorded.emplace(session());
      recorded->record(recording);
      ASSERT_EQ(recorded->save(), never.save()) << from;
      EXPECT_EQ(recorded->ground_hash(), never.ground_hash());
      Session copy = session();
      copy.restore(never.save());
      EXPECT_EQ(copy.save(), never.save());
      if (from != 10) continue;
      // What it did next is taken back: it stands again where it stood before.
      feed_driven(*recorded, to, to + 5);
      take_back(*recorded, session(), recording, never.last(0)->time_s.value());
      ASSERT_EQ(recorded->save(), never.save());
      feed_driven(never, to, to + 10);
      feed_driven(*recorded, to, to + 10);
      ASSERT_EQ(recorded->save(), never.save());
    }
  }
}

TEST_P(Driving, RefusesBasesThatCantBeAndStaysAsItWas) {
  Session here = session();
  const std::vector<Driven> all = drive(6, 3);
  ASSERT_TRUE(here.update(state_of(all[0])).ok());
  const std::string before = here.save();
  const auto why = [&](const auto& change) {
    MachineState state = state_of(all[1]);
    change(state);
    const StepResult step = here.update(state);
    EXPECT_EQ(step.status, Status::kBadState);
    EXPECT_EQ(here.save(), before);
    return step.why;
  };
  EXPECT_EQ(why([](auto& s) { s.base->position.y() = kNaN; }).substr(0, 43),
            "machine 'digger': base: the position is (-6");
  EXPECT_EQ(
      why([](auto& s) { s.base->rotation.coeffs() *= 2; }),
      "machine 'digger': base: the rotation is a quaternion of length 2; it must be of length "
      "1");
  EXPECT_NE(why([](auto& s) {
              s.base->position.x() += 150;
            }).find("machine 'digger': its base would move 150"),
            std::string::npos);
  EXPECT_NE(why([](auto& s) {
              s.base->position.x() += 60;
            }).find("s since the state before; no machine does more than 50 m/s"),
            std::string::npos);
  EXPECT_NE(why([](auto& s) { s.base->rotation = from_rpy(0, 0, 3.1); }).find("the base turns "),
            std::string::npos);
  EXPECT_EQ(why([](auto& s) { s.joints = {}; }),
            "machine 'digger': a base goes with joints; a pose is that of the bucket");
  MachineState other = state_of(all[1]);
  other.machine = 1;
  EXPECT_EQ(here.update(other).why, "machine 'plate' has no joints; give it a pose");
  EXPECT_THROW(here.base(1), std::invalid_argument);
  here.set_limits(false);
  MachineState far = state_of(all[1]);
  far.base->position.x() += 150;
  EXPECT_TRUE(here.update(far).ok());
}

INSTANTIATE_TEST_SUITE_P(Soil, Driving, ::testing::Bool(),
                         [](const auto& given) { return given.param ? "Moving" : "Rigid"; });

}  // namespace driving_test
}  // namespace soilvdb::test
