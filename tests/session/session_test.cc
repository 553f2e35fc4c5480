// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A session does what a run does, refuses what can't be without a trace, and goes on from states.
#include "soilvdb/session.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <array>
#include <limits>

#include "soilvdb/io/scenario.h"
#include "soilvdb/surface_height.h"
#include "tests/session/session_fixture.h"
#include "tests/support/program.h"
#include "tests/support/raster_fixture.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::test {
namespace session_test {

// Those of the other files of this program as well.
INSTANTIATE_TEST_SUITE_P(Ground, Sessions, ::testing::Bool(), [](const auto& given) {
  return given.param ? "ThatMoves" : "ThatIsRigid";
});

/// A machine's states as one motion.
Motion motion_of(std::size_t machine) {
  std::vector<double> times_s;
  std::vector<Pose> poses;
  for (const MachineState& state : states()) {
    if (state.machine != machine) continue;
    times_s.push_back(*state.time_s);
    poses.push_back(state.pose);
  }
  return {times_s, poses};
}

TEST_P(Sessions, DoWhatATrackerDoesAlongMotions) {
  Session session(site());
  Ground ground(0.1, session.origin(), make_plane(0.2, {0.05, 0}));
  Tracker tracker(ground, {digger(), Bucket{1.0, 0.6, {}, 0.8}}, site().earthmoving);
  const Motion motions[] = {motion_of(0), motion_of(1)};
  double last_s[] = {motions[0].begin_s(), motions[1].begin_s()};
  // What of two pours comes down before a time, in the order of time.
  double poured_s = 0;
  const auto pour_before = [&](double time_s) {
    for (; GetParam() && poured_s < time_s; poured_s += 1.0 / 64) {
      tracker.pour(0, poured_s);
      tracker.pour(1, poured_s);
    }
  };
  for (const MachineState& state : states()) {
    pour_before(*state.time_s);
    double& from_s = last_s[state.machine];
    const Update wanted =
        tracker.update(state.machine, motions[state.machine], from_s, *state.time_s);
    from_s = *state.time_s;
    const StepResult step = session.update(state);
    ASSERT_TRUE(step.ok()) << step.why;
    ASSERT_EQ(step.update.cut_m3, wanted.cut_m3);
    ASSERT_EQ(step.update.bucket_m3, wanted.bucket_m3);
    ASSERT_EQ(step.update.spilled_m3, wanted.spilled_m3);
  }
  EXPECT_EQ(session.ground_hash(), ground.state_hash());
  EXPECT_GT(session.total().cut_m3(), 0.5);
  if (!GetParam()) return;
  EXPECT_GT(session.mass_balance().poured, 0);
  EXPECT_GT(session.mass_balance().hauled, 0);
  EXPECT_LT(session.mass_balance().hauled, session.total().spilled) << "the bin had gone";
  EXPECT_TRUE(session.come_to_rest().ok());
  tracker.come_to_rest(states().back().time_s);
  EXPECT_EQ(session.ground_hash(), ground.state_hash());
  EXPECT_NEAR(session.bucket_kg(0), session.ledger(0).bucket_m3() / 1.25 * 1800, 1e-6);
}

TEST(SessionPours, UpToATimeIncludeWhatFallsThenAndAMachineGoesBeforeIt) {
  const auto poured = [](const auto& bring) {
    Session session(site_of(moving()));
    EXPECT_TRUE(bring(session).ok());
    return session.mass_balance().poured;
  };
  const double end_s = 40;
  const auto all = poured([](Session& session) { return session.pour(1e3); });
  EXPECT_EQ(poured([&](Session& session) { return session.pour(end_s); }), all);
  const auto before = poured([&](Session& session) { return session.pour(end_s - 1e-9); });
  EXPECT_LT(before, all);
  EXPECT_EQ(
      poured([&](Session& session) {
        return session.update({.machine = 0, .time_s = end_s, .pose = {{9, 9, 9}, {1, 0, 0, 0}}});
      }),
      before);
}

TEST_P(Sessions, MoveABatchAsOneByOneOnAnyThreads) {
  Session single(site());
  feed(single, states());
  for (const std::size_t threads : {1, 2, 4}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    Session batch(site());
    const std::vector<MachineState> all = states();
    for (std::size_t from = 0; from < all.size(); from += 6) {
      const auto some = std::span(all).subspan(from, std::min<std::size_t>(6, all.size() - from));
      const BatchResult result = batch.update(some);
      ASSERT_TRUE(result.ok()) << result.why;
      ASSERT_EQ(result.updates.size(), some.size());
    }
    EXPECT_EQ(batch.save(), single.save());
  }
}

TEST_P(Sessions, RefuseWhatCantBeWithoutATrace) {
  Session session(site());
  feed(session, part(states(), 0, 0.5));
  const std::string before = session.save();
  const MachineState last = part(states(), 0, 0.5).back();
  const double joints[] = {0.1, 0.2};
  const auto with = [&](const auto& change) {
    MachineState state = last;
    change(state);
    return state;
  };
  const std::vector<std::pair<MachineState, std::string>> bad = {
      {with([](auto& s) { s.machine = 7; }), "there is no machine 7; there are 2, numbered from 0"},
      {with([](auto& s) { s.time_s = 1; }), "machine 'plate': time goes back from"},
      {with([](auto& s) { s.time_s = std::numeric_limits<double>::infinity(); }),
       "machine 'plate': the time must be finite"},
      {with([](auto& s) {
         s.pose.position = {kNaN, 2, 3};
       }),
       "machine 'plate': the position is (nan, 2, 3) m; it must be finite"},
      {with([](auto& s) { s.pose.rotation.coeffs() *= 2; }),
       "machine 'plate': the rotation is a quaternion of length 2; it must be of length 1"},
      {with([](auto& s) {
         s.pose.position = {0, 1e10, 0};
       }),
       "machine 'plate': the position is (0, 1e+10, 0) m; it must be within 1e+09 m of (0, 0, 0)"},
      {with([](auto& s) {
         s.pose.position = {0, 1e8, 0};
       }),
       "machine 'plate': would move 1e+08 m in one state; are these metres? Consecutive"},
      {with([](auto& s) {
         s.pose.position.x() += 20;
         *s.time_s += 0.1;
       }),
       "machine 'plate': the bucket moves 20 m in 0.1 s since the state before; no machine does"},
      {with([&](auto& s) { s.joints = joints; }), "machine 'plate' has no joints; give it a pose"}};
  for (const auto& [state, why] : bad) {
    const StepResult step = session.update(state);
    EXPECT_EQ(step.status, Status::kBadState);
    EXPECT_EQ(step.why.substr(0, why.size()), why);
    const MachineState good = part(states(), 0.5, 0.6).front();
    const MachineState batch[] = {good, state};
    const BatchResult result = session.update(batch);
    EXPECT_EQ(result.status, Status::kBadState);
    EXPECT_EQ(result.bad, 1u);
    EXPECT_TRUE(result.updates.empty());
    EXPECT_EQ(session.save(), before) << why;
  }
  feed(session, part(states(), 0.5, 1));
  Session whole(site());
  feed(whole, states());
  EXPECT_EQ(session.save(), whole.save());
}

TEST_P(Sessions, LeaveTheGroundAsItWasWhereTheTerrainEnds) {
  // The ground ends at x = 6: a stroke that goes beyond isn't begun.
  const test::TempFolder folder;
  SessionSite edge = site();
  io::write_geotiff(folder / "flat.tif", {17, 13, {-10, -6}, {1, 1}},
                    {{"z", std::vector<float>(17 * 13, 0.2f)}}, "");
  edge.terrain = io::RasterTerrain{folder / "flat.tif"};
  edge.earthmoving.pours.clear();
  Session session(edge);
  feed(session, {{.machine = 0, .pose = {{0, 0, 1}, {1, 0, 0, 0}}},
                 {.machine = 0, .pose = {{1, 0, -0.3}, {1, 0, 0, 0}}}});
  const std::string before = session.save();
  const MachineState beyond{.machine = 0, .pose = {{9, 0, -0.3}, {1, 0, 0, 0}}};
  const StepResult step = session.update(beyond);
  EXPECT_EQ(step.status, Status::kNoGround);
  EXPECT_EQ(step.why.substr(0, 53), "machine 'digger': the bucket reaches ground without a");
  const MachineState near{.machine = 0, .pose = {{3, 0, -0.3}, {1, 0, 0, 0}}};
  const MachineState both[] = {near, beyond};
  const BatchResult result = session.update(both);
  EXPECT_EQ(result.status, Status::kNoGround);
  EXPECT_EQ(result.bad, 1u);
  EXPECT_EQ(session.save(), before);
  EXPECT_TRUE(session.update(near).ok());
}

TEST_P(Sessions, GoOnFromAStateOrAsACloneToTheSameBits) {
  Session whole(site());
  feed(whole, states());
  for (const double share : {0.1, 0.45, 0.6, 0.9}) {
    Session first(site());
    feed(first, part(states(), 0, share));
    Session second(site()), copy = first.clone();
    feed(second, part(states(), 0, 0.3));  // it has been elsewhere
    second.restore(first.save());
    EXPECT_EQ(second.save(), first.save());
    const std::string before = first.save();
    for (Session* session : {&copy, &second}) {
      feed(*session, part(states(), share, 1));
      EXPECT_EQ(session->save(), whole.save()) << share;
    }
    EXPECT_EQ(first.save(), before) << "a copy changed it";
    feed(first, part(states(), share, 1));
    EXPECT_EQ(first.save(), whole.save()) << share;
  }
}

TEST_P(Sessions, TakeNoOtherBytesForAState) {
  Session session(site());
  feed(session, part(states(), 0, 0.5));
  const std::string state = session.save();
  const auto refusal = [&](std::string_view bytes) {
    try {
      session.restore(bytes);
    } catch (const std::invalid_argument& e) {
      EXPECT_EQ(session.save(), state);
      return std::string(e.what());
    }
    return std::string("taken");
  };
  EXPECT_EQ(refusal(""), "not a saved state (expected bytes from save())");
  EXPECT_EQ(refusal("soilvdb what"), "not a saved state (expected bytes from save())");
  for (std::size_t size = 13; size < state.size(); size += 1 + state.size() / 97)
    EXPECT_NE(refusal(std::string_view(state).substr(0, size)), "taken") << size;
  for (std::size_t at = 0; at < state.size(); at += 1 + state.size() / 97) {
    std::string other = state;
    other[at] = static_cast<char>(other[at] ^ 4);
    EXPECT_NE(refusal(other), "taken") << at;
  }
  std::string newer = state;
  newer[13] = 5;
  EXPECT_EQ(refusal(newer), "the state has version 5; this program has 4");
  SessionSite higher = site();
  higher.terrain = io::PlaneTerrain{0.3, {0.05, 0}};
  EXPECT_EQ(refusal(Session(higher).save()), "the state is of another site: plane differs");
  SessionSite alone = site();
  alone.machines.pop_back();
  EXPECT_EQ(refusal(Session(alone).save()), "the state is of another site: machines differs");
  SessionSite swelling = site();
  swelling.earthmoving.soil.emplace().repose_rad = 0.6;
  EXPECT_NE(refusal(Session(swelling).save()).find("soil"), std::string::npos);
  SessionSite sharper = site();
  sharper.machines[1].bucket.dump_angle_rad = 0.7;
  EXPECT_EQ(refusal(Session(sharper).save()),
            "the state is of another site: machine 2: dump_angle_rad differs");
  session.restore(state);
  EXPECT_EQ(session.save(), state);
}

TEST_P(Sessions, TellHeightsOfTheGroundAsItIsNow) {
  Session session(site());
  std::vector<Vec2> xy;
  for (double x = -6; x < 6; x += 0.083)
    for (double y = -6; y < 6; y += 0.137) xy.emplace_back(x, y);
  std::vector<double> before(xy.size()), now(xy.size()), again(xy.size());
  double deepest = 0;
  for (int i = 0; i < 4; ++i) {
    feed(session, part(states(), i / 4.0, (i + 1) / 4.0));
    session.heights(xy, now).check();  // keeps what didn't change
    const Session copy = session.clone();
    const test::TempFolder folder;
    session.write(folder / "now.vdb");
    Session fresh({.voxel_size_m = 0.1, .terrain = io::LevelSetTerrain{folder / "now.vdb"}});
    fresh.heights(xy, again).check();
    EXPECT_EQ(now, again);
    for (std::size_t k = 0; k < xy.size(); ++k)
      deepest = std::min(deepest, now[k] - (0.2 + 0.05 * xy[k].x()));
    if (i < 2) {
      EXPECT_NE(now, before);
    }
    before = now;
  }
  EXPECT_LT(deepest, -0.4);
}

TEST_P(Sessions, PatchesThatChangedMakeTheMesh) {
  Session session(site());
  std::map<Coord3, Mesh, Before> patches;
  const auto take = [&] {
    for (SurfacePatch& patch : session.changed_patches())
      patches[patch.block] = std::move(patch.mesh);
  };
  std::string state;
  for (int i = 0; i < 4; ++i) {
    feed(session, part(states(), i / 4.0, (i + 1) / 4.0));
    take();
    EXPECT_TRUE(session.changed_patches().empty());
    EXPECT_EQ(weld(patches).points.size(), session.mesh().points.size());
    if (i == 1) state = session.save();
  }
  session.restore(state);  // what came since goes
  take();
  EXPECT_EQ(weld(patches).points, session.mesh().points);
  EXPECT_EQ(weld(patches).triangles, session.mesh().triangles);
}

TEST_P(Sessions, StepManyAtOnceAsOneByOne) {
  constexpr std::size_t kMany = 8;
  Session start(site());
  feed(start, part(states(), 0, 0.3));
  const std::vector<MachineState> rest = part(states(), 0.3, 0.6);
  std::vector<Session> many;
  std::vector<Session*> all;
  for (std::size_t i = 0; i < kMany; ++i) many.push_back(start.clone());
  for (Session& session : many) all.push_back(&session);
  const auto state = [&](std::size_t step, std::size_t i) {
    MachineState own = rest[step];
    own.pose.position.z() -= 0.01 * static_cast<double>(i);
    return own;
  };
  for (std::size_t step = 0; step < rest.size(); ++step) {
    std::vector<MachineState> now;
    for (std::size_t i = 0; i < kMany; ++i) now.push_back(state(step, i));
    for (const StepResult& result : update_many(all, now)) ASSERT_TRUE(result.ok()) << result.why;
  }
  for (std::size_t i = 0; i < kMany; ++i) {
    Session alone = start.clone();
    for (std::size_t step = 0; step < rest.size(); ++step) alone.update(state(step, i));
    EXPECT_EQ(alone.save(), many[i].save()) << i;
  }
  const std::vector<MachineState> two = {rest[0], rest[0]};
  const std::vector<Session*> same = {all[0], all[0]};
  EXPECT_EQ(update_many(same, two)[0].why, "a session is there twice");
}

TEST_P(Sessions, PatchesTellWhatWentOverSeveralStatesAndClones) {
  Session session(site());
  const std::string undug = session.save();
  feed(session, part(states(), 0, 0.5));
  const auto blocks = [](Session& of) {
    std::vector<Coord3> all;
    for (const SurfacePatch& patch : of.changed_patches()) all.push_back(patch.block);
    return all;
  };
  std::vector<double> none(1);
  session.heights(std::vector<Vec2>{{0, 0}}, none).check();  // who looks at something else
  Session clone = session.clone();
  const std::vector<Coord3> dug = blocks(session);
  EXPECT_FALSE(dug.empty());
  EXPECT_EQ(blocks(clone), dug);
  session.restore(undug);
  session.restore(undug);  // what went the first time went all the same
  EXPECT_EQ(blocks(session), dug);
}

TEST_P(Sessions, RememberTheTimeOverStatesWithoutOne) {
  Session session(site());
  const auto at = [](double time_s) { return MachineState{.machine = 0, .time_s = time_s}; };
  ASSERT_TRUE(session.update(at(5)).ok());
  ASSERT_TRUE(session.update({.machine = 0}).ok());
  EXPECT_EQ(session.update(at(4)).why, "machine 'digger': time goes back from 5 s to 4 s");
  EXPECT_TRUE(session.update(at(5)).ok());
}

TEST(Session, RefusesWhatCantBeASite) {
  const auto refusal = [](const auto& change) {
    SessionSite site = site_of(moving());
    change(site);
    try {
      const Session session(site);
    } catch (const std::exception& e) {
      return std::string(e.what());
    }
    return std::string("taken");
  };
  EXPECT_EQ(refusal([](auto& s) { s.voxel_size_m = 0; }),
            "the voxel size is 0 m; it must be more than 0");
  EXPECT_EQ(refusal([](auto& s) { s.machines[1].name = "digger"; }),
            "machine 'digger' is there twice; names must differ");
  EXPECT_EQ(refusal([](auto& s) { s.earthmoving.pours[0].volume_m3 = kNaN; }),
            "pour 'truck': its volume must be above 0");
  EXPECT_EQ(refusal([](auto& s) { s.earthmoving.soil.reset(); }),
            "pours and hoppers are for soil that moves; say how it does");
  EXPECT_NE(refusal([](auto& s) { s.machines[0].bucket.width_m = -1; }), "taken");
  EXPECT_NE(refusal([](auto& s) { s.terrain = io::RasterTerrain{"/no.tif"}; }), "taken");
}

using Program = ProgramTest;

TEST_F(Program, ASessionFedAsARunIsComesToTheSameGround) {
  const auto write_scenario = [&](const std::string& soil, const std::string& csv) {
    write_file(folder() / "dig.csv", csv);
    write_file(folder() / "s.yaml", "soilvdb: 1\nvoxel_size: 0.1\nterrain: {plane: {z: 0.04}}\n" +
                                        soil +
                                        "machines:\n- name: digger\n  motion: dig.csv\n"
                                        "  bucket: {width: 1.2, height: 0.9, profile: [[0, 0], "
                                        "[-0.45, -0.1], [-0.95, 0.55], [0, 0.9]]}\n");
    return io::read_scenario(folder() / "s.yaml").machines[0].motion.part(0);
  };
  const auto rough =
      write_scenario("",
                     "time,x,y,z,pitch\n0,-3,0,0.5,0.3\n2,-2.5,0,-0.3,0.3\n4,0,0.1,-0.35,0.2\n"
                     "6,1,0.1,0.6,-1.2\n8,1,4,1.5,-1.4\n9,1,4,1.5,1.0\n");
  std::string csv = "time,x,y,z,qx,qy,qz,qw\n";
  for (int i = 0; i <= 90; ++i) {
    const Pose pose = rough->pose(0.1 * i);
    const Vec3 p = pose.position;
    const Eigen::Vector4d q = pose.rotation.coeffs();
    csv +=
        fmt::format("{},{},{},{},{},{},{},{}\n", 0.1 * i, p[0], p[1], p[2], q[0], q[1], q[2], q[3]);
  }
  for (const char* soil : {"", "soil: {repose_angle: 0.61, swell: 0.25}\n"}) {
    const auto motion = write_scenario(soil, csv);
    good("run s.yaml --out out");
    const nlohmann::json summary = read_json(folder() / "out/summary.json");
    fs::remove_all(folder() / "out");
    Session session = Session::open(folder() / "s.yaml");
    for (std::size_t i = 0; i < motion->times_s().size(); ++i) {
      const StepResult step =
          session.update({.time_s = motion->times_s()[i], .pose = motion->row(i)});
      ASSERT_TRUE(step.ok()) << step.why;
    }
    session.come_to_rest();
    EXPECT_EQ(fmt::format("{:016x}", session.ground_hash()), summary["state_hash"]);
    EXPECT_EQ(session.machine("digger"), 0u);
  }
}

TEST_F(Program, ASessionFedJointsComesToTheGroundOfARunOfThem) {
  write_file(folder() / "arm.urdf", R"(<robot name="arm">
<link name="base"/><link name="boom"/><link name="stick"/><link name="bucket"/>
<joint name="swing" type="revolute"><parent link="base"/><child link="boom"/>
  <origin xyz="0 0 1.2"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="0" velocity="1"/></joint>
<joint name="lift" type="revolute"><parent link="boom"/><child link="stick"/>
  <origin xyz="3 0 0.6"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="0" velocity="1"/></joint>
<joint name="curl" type="revolute"><parent link="stick"/><child link="bucket"/>
  <origin xyz="1.8 0 -1.2" rpy="0 0 3.14159"/><axis xyz="0 1 0"/>
  <limit lower="-2" upper="3" effort="0" velocity="1"/></joint></robot>)");
  std::string csv = "time,swing,lift,curl\n";
  std::vector<std::array<double, 3>> rows;
  for (int i = 0; i <= 24; ++i) {
    rows.push_back({0.02 * i, 0.25 + 0.03 * i, 0.4 - 0.05 * i});
    csv += fmt::format("{},{},{},{}\n", 0.25 * i, rows.back()[0], rows.back()[1], rows.back()[2]);
  }
  write_file(folder() / "arm.csv", csv);
  write_file(folder() / "arm.yaml",
             "soilvdb: 1\nvoxel_size: 0.1\nterrain: {plane: {z: 0.04}}\n"
             "soil: {repose_angle: 0.61, swell: 0.25}\nmachines:\n- name: arm\n  motion: arm.csv\n"
             "  urdf: arm.urdf\n  lip: {link: bucket, xyz: [0.2, 0, -0.6]}\n"
             "  bucket: {width: 0.8, height: 0.6}\n");
  good("run arm.yaml --out out");
  const nlohmann::json summary = read_json(folder() / "out/summary.json");
  fs::remove_all(folder() / "out");
  std::string fed = read_file(folder() / "arm.yaml");
  fed.erase(fed.find("  motion: arm.csv\n"), std::string("  motion: arm.csv\n").size());
  write_file(folder() / "fed.yaml", fed);
  EXPECT_NE(good("info fed.yaml").out.find("none of its own: fed joints or poses"),
            std::string::npos);
  EXPECT_NE(run("run fed.yaml").err.find("'motion'"), std::string::npos);
  Session session = Session::open(folder() / "fed.yaml");
  for (int i = 0; i <= 24; ++i) {
    const StepResult step = session.update(
        {.machine = 0, .time_s = 0.25 * i, .joints = rows[static_cast<std::size_t>(i)]});
    ASSERT_TRUE(step.ok()) << step.why;
    if (i == 12) session.restore(session.save());
  }
  session.come_to_rest();
  EXPECT_GT(session.total().cut_m3(), 0.05);
  EXPECT_EQ(fmt::format("{:016x}", session.ground_hash()), summary["state_hash"]);
  // A machine that has a motion, too, is fed joints all the same.
  const Session with_motion = Session::open(folder() / "arm.yaml");
  EXPECT_EQ(with_motion.pose(0, rows[3]).position, session.pose(0, rows[3]).position);
}

TEST_F(Program, ASessionIsRecordedAsItsScenarioSays) {
  write_file(folder() / "s.yaml",
             "soilvdb: 1\nvoxel_size: 0.1\nterrain: {plane: {z: 0}}\nmachines:\n- name: digger\n"
             "  bucket: {width: 1.2, height: 0.9}\n"
             "output:\n  snapshots: {every: 7, incremental: true, keep: 4}\n"
             "  journal: {sync: 0.25}\n");
  const Session session = Session::open(folder() / "s.yaml");
  const Recording& recording = session.recording();
  EXPECT_EQ(recording.sync_s, 0.25);
  EXPECT_EQ(recording.snapshot_every_s, 7);
  EXPECT_TRUE(recording.incremental);
  EXPECT_EQ(recording.keep, 4u);
}

}  // namespace session_test
}  // namespace soilvdb::test
