// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Scans of a session: recorded and gone on with, cloned, and in the mass balance.
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cmath>
#include <filesystem>
#include <functional>
#include <random>

#include "soilvdb/io/urdf.h"
#include "tests/session/session_fixture.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::test {
namespace session_scan_test {

/// Stands above the dig, or beside it.
Sensor above(double x = -1) {
  return {.name = "above", .pose = {{x, 0, 6}, {0, 1, 0, 0}}, .range_sigma_m = 0.01};
}
const Sensor kAbove = above();

/// Rays of a grid to the ground of a session that stands `deeper` than it is.
std::vector<Vec3> seen(Session& session, double deeper, std::uint64_t seed,
                       const Sensor& sensor = kAbove) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> noise(0, 0.01);
  std::vector<Vec3> ways;
  for (int i = 0; i < 90; ++i)
    for (int j = 0; j < 60; ++j) ways.emplace_back(0.012 * (i - 45), 0.012 * (j - 30), -1);
  std::vector<double> ranges(ways.size());
  session.cast(std::span(&sensor.pose.position, 1), ways, ranges).check();
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < ways.size(); ++i)
    if (std::isfinite(ranges[i]))
      points.push_back(sensor.pose.position + (ranges[i] + noise(random)) * ways[i].normalized() -
                       Vec3(0, 0, deeper));
  return points;
}

/// Of a session or a site. @param record of the correction, of a site
template <typename S, typename... Record>
Survey applied(S& site, Record*... record) {
  Survey survey;
  const auto step = site.apply_scans(survey, record...);
  EXPECT_TRUE(step.ok()) << step.why;
  return survey;
}
template <typename S, typename... Record>
Survey scanned(S& site, const Sensor& sensor, std::span<const Vec3> points, Record*... record) {
  const auto step = site.scan(sensor, points);
  EXPECT_TRUE(step.ok()) << step.why;
  return applied(site, record...);
}

std::vector<Vec3> level_points(double x) {
  std::vector<Vec3> points;
  for (int i = 0; i < 400; ++i) points.emplace_back(x + 0.1 * (i % 20), 0.1 * (i / 20), 0);
  return points;
}

// What is believed to the last millimetre changes volumes.
TEST(SessionScan, ASensorThatMovesAsIfItsPosesWereExactIsWarnedOfOnce) {
  Session session({.voxel_size_m = 0.1, .terrain = io::PlaneTerrain{}, .machines = {}});
  const auto warnings_of = [&](Session& site, const std::string& name, double x, double sigma_m,
                               double turn = 0) {
    Sensor sensor = above(x);
    sensor.name = name;
    sensor.pose_shift_sigma_m = sigma_m;
    sensor.pose.rotation = sensor.pose.rotation * Eigen::AngleAxisd(turn, Vec3::UnitZ());
    EXPECT_TRUE(site.scan(sensor, level_points(x)).ok());
    return site.take_warnings();
  };
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(warnings_of(session, "mast", 0, 0).empty()) << "stays";
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(warnings_of(session, "cab", i, 0.01).empty()) << "known";
  EXPECT_TRUE(warnings_of(session, "other mast", 2, 0).empty()) << "another";
  EXPECT_TRUE(session.scan(above(), {}).ok());
  Session clone = session.clone();
  for (Session* each : {&session, &clone}) {
    const std::vector<std::string> told = warnings_of(*each, "mast", 0.001, 0);
    ASSERT_EQ(told.size(), 1u);
    EXPECT_THAT(told[0], ::testing::HasSubstr("sensor 'mast' has moved"));
    EXPECT_THAT(told[0], ::testing::HasSubstr("pose_shift_sigma"));
    EXPECT_TRUE(warnings_of(*each, "mast", 0.5, 0).empty()) << "once";
    EXPECT_EQ(warnings_of(*each, "other mast", 2, 0, 0.01).size(), 1u) << "a turn";
  }
}

/// Works and looks in turn.
void work(Session& session, const std::vector<MachineState>& all, std::uint64_t seed) {
  for (std::size_t i = 0; i < all.size(); ++i) {
    const StepResult step = session.update(all[i]);
    ASSERT_TRUE(step.ok()) << step.why;
    if (i % 12 != 5) continue;
    const Sensor sensor = above(-1.0 + 3.0 * static_cast<double>(i / 12 % 3));
    std::vector<Vec3> points = seen(session, i % 24 == 5 ? 0.04 : -0.3, seed + i, sensor);
    points.emplace_back(-30 - static_cast<double>(i), 30, -1);  // dust, where nobody else looks
    scanned(session, sensor, points);
  }
}

using SessionScans = Sessions;

TEST_P(SessionScans, GoOnFromWhereTheyWereRecorded) {
  expect_same_if_stopped(site(), 2, [](Session& session, int round) {
    work(session, round == 0 ? part(states(), 0, 0.6) : part(states(), 0.6, 1),
         static_cast<std::uint64_t>(round));
  });
}

// What is not recorded, because no ray came, may not show in what comes later.
TEST_P(SessionScans, WithoutRaysTellNothing) {
  const auto nothing = [](Session& session) {
    scanned(session, kAbove, {});
    Sensor refused = kAbove;
    refused.range_sigma_m = 0.5;
    const std::vector<Vec3> points = {{0, 0, 0}};
    EXPECT_FALSE(session.scan(refused, points).ok());
  };
  Session with(site()), without(site());
  applied(with);  // before any
  const std::vector<Vec3> far = {{1e5, 0, 0}};
  EXPECT_FALSE(with.scan(kAbove, far).ok());
  for (double at = 0; at < 0.99; at += 0.1) {
    work(with, part(states(), at, at + 0.1), 1);
    work(without, part(states(), at, at + 0.1), 1);
    if (at > 0.15) nothing(with);
  }
  EXPECT_EQ(with.save(), without.save());
}

// An empty scan tells from when on it is known which machine dug, and which sensors there are.
TEST_P(SessionScans, ThatAreEmptyAreRecordedIfTheirSensorIsNew) {
  expect_same_if_stopped(site(), 1, [](Session& session, int) {
    scanned(session, kAbove, {});
    feed(session, part(states(), 0, 0.3));
  });
}

TEST_P(SessionScans, OfAMovingSensorGoOnFromWhereTheyWereRecorded) {
  expect_same_if_stopped(site(), 2, [](Session& session, int round) {
    for (const double at : {0.0, 0.2}) {
      feed(session, part(states(), 0.5 * round + at, 0.5 * round + at + 0.2));
      Sensor sensor = above(-1 + 5 * at);
      sensor.pose_shift_sigma_m = 0.02;
      sensor.pose_turn_sigma_rad = 0.005;
      Sensor there = sensor;
      there.pose.position += Vec3(0.01, -0.02, 0.015);
      std::vector<Vec3> points = seen(session, 0, static_cast<std::uint64_t>(round), there);
      for (Vec3& point : points) point -= there.pose.position - sensor.pose.position;
      EXPECT_GT(scanned(session, sensor, points).rays.used, 0);
    }
  });
}

// A snapshot may have scans in it that a correction after it has used.
TEST_P(SessionScans, GoOnFromSnapshotsBetweenScansAndTheirCorrection) {
  expect_same_if_stopped(site(), 1, [](Session& session, int) {
    work(session, part(states(), 0, 0.3), 1);
    for (std::uint64_t n = 0; n < 3; ++n)
      ASSERT_TRUE(session.scan(kAbove, seen(session, 0.3, n)).ok());
    for (double at = 0.3; at < 0.49; at += 0.05) {
      session.flush();  // while one snapshot is written there is no other
      feed(session, part(states(), at, at + 0.05));
    }
    EXPECT_GT(applied(session).rays.through, 0);
  });
}

// A correction may be made before a machine comes, and after.
TEST_P(SessionScans, GoOnWhenMachinesCome) {
  expect_same_if_stopped(site(), 5, [](Session& session, int round) {
    if (round % 2 == 1)
      session.change_list(
          "machines",
          fmt::format(R"({{"add": {{"name": "m{}", "bucket": {{"width": 1, "height": 0.8}},
                          "known": {{"lip": {}}}}}}})",
                      round, 0.01 * round));
    work(session, part(states(), 0.2 * round, 0.2 * (round + 1)), 1);
  });
}

// States that are taken back leave what scans told before them.
TEST_P(SessionScans, GoOnAfterStatesWereTakenBack) {
  const TempFolder temp;
  const Recording recording{.folder = temp / "site", .snapshot_every_s = 4};
  std::vector<MachineState> others;
  for (const MachineState& state : part(states(), 0.5, 0.6))
    if (state.machine == 1) others.push_back(state);
  Session never(site());
  work(never, part(states(), 0, 0.5), 1);
  feed(never, others);
  std::optional<Session> session(site());
  session->record(recording);
  work(*session, part(states(), 0, 0.5), 1);
  feed(*session, part(states(), 0.5, 0.6));
  take_back(*session, Session(site()), recording, *part(states(), 0, 0.5).back().time_s);
  ASSERT_EQ(session->save(), never.save());
  for (const double from : {0.6, 0.75}) {
    for (Session* each : {&never, &*session}) work(*each, part(states(), from, from + 0.15), 1);
    ASSERT_EQ(session->save(), never.save());
    session.reset();
    session.emplace(site());
    session->record(recording);
    ASSERT_EQ(session->save(), never.save());
  }
}

// A correction tells and costs what its scans saw, not what was ever scanned.
TEST(SiteScans, AreRecordedByWhatTheySaw) {
  Site site(std::make_shared<Ground>(0.1, Vec3::Zero(), make_plane(0, {0, 0})),
            {{{"digger", digger()}}});
  std::vector<std::size_t> sizes;
  for (int round = 0; round < 2; ++round)
    for (int n = 0; n < 12; ++n) {
      std::vector<Vec3> points;
      for (int x = -30; x < 30; ++x)
        for (int y = -30; y < 30; ++y) points.emplace_back(12.0 * n + 0.1 * x, 0.1 * y, 0.02);
      Sensor sensor = above(12.0 * n);
      sensor.name = round == 0 ? "m" : "a";  // which hang 2 cm lower than told
      std::string record;
      scanned(site, sensor, points, &record);
      sizes.push_back(record.size());
    }
  for (const std::size_t size : sizes) EXPECT_LT(size, sizes[0] * 3 / 2);
}

// A copy of a site takes its corrections, also where ground has changed of which both knew.
TEST(SiteScans, AreRepeatedByACopy) {
  Site site(std::make_shared<Ground>(0.1, Vec3::Zero(), make_plane(0, {0, 0})),
            {{{"plate", Bucket{6, 0.6, {}, 0.8}}}});
  const auto apply = [](Site& to, double x, std::string* record = nullptr) {
    std::mt19937_64 random(static_cast<std::uint64_t>(x));
    std::normal_distribution<double> noise(-0.02, 0.02);
    std::vector<Vec3> points;
    for (int i = -30; i < 30; ++i)
      for (int j = -30; j < 30; ++j) points.emplace_back(x + 0.1 * i, 0.1 * j, noise(random));
    return scanned(to, above(x), points, record);
  };
  apply(site, 0);
  Site copy(site);
  for (Site* each : {&site, &copy})
    for (const double x : {-3.0, 3.0})
      ASSERT_TRUE(each->update({.machine = 0, .pose = {{x, 0, -0.05}, {1, 0, 0, 0}}}).ok());
  std::string record;
  apply(site, 1, &record);
  copy.repeat_survey(record);
  const Survey one = apply(site, 12), other = apply(copy, 12);
  EXPECT_EQ(one.sigma_m3, other.sigma_m3);
  EXPECT_EQ(one.lip_errors_m[0].mean, other.lip_errors_m[0].mean);
  EXPECT_EQ(one.lip_errors_m[0].sigma, other.lip_errors_m[0].sigma);
}

// What a scan tells of a lip corrects what that lip dug elsewhere, and was seen before by a sensor
// that could not tell its own error from the lip's: also in parts, and on ground that was scanned.
class LipsKnownBetter : public ::testing::TestWithParam<std::tuple<bool, double>> {};

TEST_P(LipsKnownBetter, CorrectEarlierGround) {
  constexpr double kSide_m = 2, kDepth_m = 0.3;
  const bool in_parts = std::get<0>(GetParam());
  const double error_m = std::get<1>(GetParam());
  Site site(std::make_shared<Ground>(0.05, Vec3::Zero(), make_plane(0, {0, 0})),
            {{{"plate", Bucket{kSide_m, 0.6, {}, 0.8}, {}, 0.02}}});
  double time_s = 0;
  const std::vector<double> places = {0, 20};
  const auto apply = [&](const Sensor& sensor, const std::vector<Vec3>& points) {
    const Survey survey = scanned(site, sensor, points);
    return survey.removed_m3 - survey.added_m3;
  };
  const int parts = in_parts ? 4 : 1;
  if (in_parts) {
    std::vector<Vec3> points;
    for (double x = -2; x < 4; x += 0.03)
      for (double y = -3; y < 3; y += 0.03) points.emplace_back(x, y, 0);
    EXPECT_EQ(apply(above(1), points), 0);
  }
  for (const double place : places) {
    ASSERT_TRUE(
        site.place({.machine = 0, .time_s = ++time_s, .pose = {{place, 0, 1}, {1, 0, 0, 0}}}).ok());
    for (const double x : {0.0, kSide_m})
      ASSERT_TRUE(site.update({.machine = 0,
                               .time_s = ++time_s,
                               .pose = {{place + x, 0, -kDepth_m}, {1, 0, 0, 0}}})
                      .ok());
    ASSERT_TRUE(
        site.update(
                {.machine = 0, .time_s = ++time_s, .pose = {{place + kSide_m, 0, 1}, {1, 0, 0, 0}}})
            .ok());
  }
  const auto scan = [&](double place, double mount_sigma_m, bool sees_natural) {
    Sensor sensor = above(place + 1);
    sensor.name = std::to_string(place);
    sensor.mount_height_sigma_m = mount_sigma_m;
    sensor.mount_tilt_sigma_rad = sensor.mount_scale_sigma = 1e-5;
    double net_m3 = 0;
    for (int part = 0; part < parts; ++part) {
      std::vector<Vec3> points;
      for (double y = -0.85; y < 0.9; y += 0.02)
        for (double x = 0.2 + 1.6 * part / parts; x < 0.2 + 1.6 * (part + 1) / parts; x += 0.02) {
          points.emplace_back(place + x, y, -kDepth_m - error_m);
          if (sees_natural) points.emplace_back(place + x, y + 3, 0);
        }
      net_m3 += apply(sensor, points);
    }
    return net_m3;
  };
  const double all_m3 = 1.6 * 1.75 * error_m;
  const double first = scan(places[0], 0.05, false);
  EXPECT_LT(first, all_m3 / 3);
  const double both = first + scan(places[1], 0.001, true);
  EXPECT_GT(both, 1.6 * all_m3);  // a tenth or so is what floors err by themselves
  EXPECT_LT(both, 2.05 * kSide_m * kSide_m * error_m);  // columns beside seen ones come with them
  EXPECT_NEAR(site.lip_errors_m()[0].mean, error_m, 0.003);
}

INSTANTIATE_TEST_SUITE_P(Parts, LipsKnownBetter,
                         ::testing::Combine(::testing::Bool(), ::testing::Values(0.01, 0.03)));

/// Columns of 10 cm from -1.5 m to 1.5 m along each axis, and what a sensor sees of them.
std::vector<Vec3> square(const std::function<double(const Vec2&)>& height_m) {
  std::vector<Vec3> points;
  for (double x = -1.525; x < 1.45; x += 0.05)
    for (double y = -1.525; y < 1.45; y += 0.05) points.emplace_back(x, y, height_m({x, y}));
  return points;
}
SurveyHeights level(double height_m, int reach = 25) {
  const int side = 2 * reach;
  return {{-reach, -reach},
          {side, side},
          std::vector<std::int32_t>(static_cast<std::size_t>(side) * static_cast<std::size_t>(side),
                                    static_cast<std::int32_t>(std::lround(640 * height_m)))};
}

// What a survey lowered, the only machine did not dig, whether it was scanned before or not.
class ScansOfSurveys : public ::testing::TestWithParam<bool> {
 protected:
  ScansOfSurveys()
      : site(std::make_shared<Ground>(0.1, Vec3::Zero(), make_plane(0, {0, 0})),
             {{{"plate", Bucket{0.5, 0.6, {}, 0.8}, {}, kLipSigma_m}}}) {
    if (GetParam()) apply(square([](const Vec2&) { return 0.0; }));
  }

  Survey apply(const std::vector<Vec3>& points, double mount_sigma_m = 0.01) {
    Sensor sensor = above(0);
    sensor.name = std::to_string(mount_sigma_m);
    sensor.mount_height_sigma_m = mount_sigma_m;
    sensor.mount_tilt_sigma_rad = sensor.mount_scale_sigma = 1e-5;
    return scanned(site, sensor, points);
  }
  void survey(const SurveyHeights& heights) {
    SurveyVolumes volumes;
    ASSERT_TRUE(site.survey(heights, volumes).ok());
    EXPECT_GT(volumes.changed, 0);
  }
  /// Along x, 5 columns wide, from -1 to 1 m.
  void dig(double height_m) {
    for (const double x : {-1.0, 1.0})
      ASSERT_TRUE(
          site.update({.machine = 0, .time_s = ++time_s_, .pose = {{x, 0, height_m}, {1, 0, 0, 0}}})
              .ok());
  }
  static bool is_dug(const Vec2& at) { return std::abs(at.x()) < 0.9 && std::abs(at.y()) < 0.25; }

  static constexpr double kLipSigma_m = 0.02;
  Site site;

 private:
  double time_s_ = 0;
};

TEST_P(ScansOfSurveys, TellNothingOfALip) {
  constexpr double kError_m = 0.04;
  const double before = GetParam() ? site.lip_errors_m()[0].sigma : kLipSigma_m;
  survey(level(-0.3));
  const std::vector<Vec2> at = {{0.5, 0.5}};
  double sigma_m = 0;
  site.sigmas(at, {&sigma_m, 1});
  EXPECT_NEAR(sigma_m, 0.01, 1e-9);  // as of the terrain, not that of what a machine dug
  // Which hangs together over squares of 2 m.
  const double volume_m3 =
      site.volume_sigma_m3({Vec2(-1.5, -1.5), Vec2(1.5, -1.5), Vec2(1.5, 1.5), Vec2(-1.5, 1.5)});
  EXPECT_NEAR(volume_m3, 0.01 * 3 * 3 / 2, 0.015);
  Site copy(site);
  const Survey made = apply(square([](const Vec2&) { return -0.3 - kError_m; }));
  std::swap(copy, site);
  apply(square([](const Vec2&) { return -0.3 - kError_m; }));
  EXPECT_TRUE(copy.progress() == site.progress());
  EXPECT_EQ(made.lip_errors_m[0].mean, 0);
  EXPECT_EQ(made.lip_errors_m[0].sigma, before);
  EXPECT_NEAR(made.removed_m3, 3 * 3 * kError_m, 0.02 * 3 * 3 * kError_m);
  EXPECT_EQ(made.added_m3, 0);
}

// Also within the squares of columns that both changed.
TEST_P(ScansOfSurveys, TellTheLipOfWhatWasDugSince) {
  constexpr double kError_m = 0.03, kOfSurvey_m = 0.05;
  survey(level(-0.3));
  dig(-0.5);
  const auto truth = [](const Vec2& at) {
    return is_dug(at) ? -0.5 - kError_m : -0.3 + kOfSurvey_m;
  };
  std::vector<Vec3> points = square(truth);
  std::erase_if(points, [](const Vec3& p) {  // walls, which are none of either
    return std::abs(std::abs(p.y()) - 0.25) < 0.15 || std::abs(p.x()) > 0.8;
  });
  for (double x = -1; x < 1; x += 0.02)  // of the terrain, from which the mount is known
    for (double y = 3; y < 4; y += 0.02) points.emplace_back(x, y, 0);
  const Survey made = apply(points, 0.001);
  EXPECT_NEAR(made.lip_errors_m[0].mean, kError_m, 0.004);
  EXPECT_LT(made.lip_errors_m[0].sigma, kLipSigma_m / 2);
}

// The last survey of a column counts, also in part of another's.
TEST_P(ScansOfSurveys, TellNothingOfALipBySurveysOverSurveys) {
  const double before = GetParam() ? site.lip_errors_m()[0].sigma : kLipSigma_m;
  dig(-0.2);
  survey(level(-0.3));
  survey(level(-0.5, 7));
  const Survey made = apply(square([](const Vec2& at) {
    return at.x() > -0.75 && at.x() < 0.65 && at.y() > -0.75 && at.y() < 0.65 ? -0.52 : -0.28;
  }));
  EXPECT_EQ(made.lip_errors_m[0].mean, 0);
  EXPECT_EQ(made.lip_errors_m[0].sigma, before);
}

INSTANTIATE_TEST_SUITE_P(ScannedBefore, ScansOfSurveys, ::testing::Bool());

TEST_P(SessionScans, GoOnWithSurveysBetween) {
  const auto act = [](Session& session, int round) {
    SurveyVolumes volumes;
    const double from = 0.2 * round;
    feed(session, part(states(), from, from + 0.05));
    ASSERT_TRUE(session.survey(level(-0.05 * (1 + round)), volumes).ok());
    feed(session, part(states(), from + 0.05, from + 0.1));
    if (round > 0) work(session, part(states(), from + 0.1, from + 0.2), 1);
  };
  expect_same_if_stopped(site(), 4, [&](Session& session, int round) {
    Session clone = session.clone(), restored(site());
    restored.restore(session.save());
    for (Session* each : {&session, &clone, &restored}) act(*each, round);
    ASSERT_EQ(clone.save(), session.save());
    ASSERT_EQ(restored.save(), session.save());
    const std::vector<Estimate> lips = session.lip_errors_m();  // scans told something of one
    if (round == 3) {
      EXPECT_LT(std::min(lips[0].sigma, lips[1].sigma), 0.02);
    }
  });
}

TEST(SiteScans, SayThatAMachineIsMissing) {
  Ground ground(0.1, Vec3::Zero(), make_plane(0, {0, 0}));
  std::string saved;
  GroundScans(ground, {digger(), digger()}, {0.02, 0.02}).save(saved);
  std::string_view in = saved;
  GroundScans of_one(ground, {digger()}, {0.02});
  EXPECT_THAT([&] { of_one.load(in); },
              testing::ThrowsMessage<std::invalid_argument>(testing::HasSubstr(
                  "is of 2 machines, and the site has 1; with scans machines stay")));
}

TEST(SiteScans, OfAnotherFormatAreRefused) {
  Ground ground(0.1, Vec3::Zero(), make_plane(0, {0, 0}));
  std::string saved;
  GroundScans scans(ground, {digger()}, {0.02});
  scans.save(saved);
  --saved[0];
  std::string_view in = saved;
  EXPECT_THAT([&] { scans.load(in); },
              testing::ThrowsMessage<std::invalid_argument>(
                  testing::StrEq("the state of the scans is of another version of soilvdb")));
}

/// A digger with a cab and a boom of boxes, on a plane; its bucket is far above.
Site with_boom(bool has_shapes, const TempFolder& temp) {
  const auto shape = [&](const char* origin, const char* size) {
    return has_shapes ? fmt::format(
                            "<collision><origin xyz=\"{}\" rpy=\"0 0.5 0\"/><geometry><box "
                            "size=\"{}\"/></geometry></collision>",
                            origin, size)
                      : std::string();
  };
  const auto file = temp.write(
      "m.urdf", "<robot name=\"m\"><link name=\"cab\">" + shape("0 0 1.2", "2 2 2") +
                    "</link><link name=\"boom\">" + shape("2.5 0 0", "4 0.4 0.6") +
                    "</link><link name=\"end\"/><joint name=\"lift\" type=\"continuous\"><parent "
                    "link=\"cab\"/><child link=\"boom\"/><origin xyz=\"1 0 1.5\"/><axis xyz=\"0 -1 "
                    "0\"/></joint><joint name=\"far\" type=\"fixed\"><parent link=\"boom\"/><child "
                    "link=\"end\"/><origin xyz=\"0 0 40\"/></joint></robot>");
  return Site(std::make_shared<Ground>(0.1, Vec3::Zero(), make_plane(0, {0, 0})),
              {{{"digger", digger(), io::read_chain(file, "end")}}});
}

/// How far a place is outside a turned box, along that axis of the box where it is farthest.
double outside(const Vec3& place, const Vec3& middle, double pitch, const Vec3& size) {
  const double x = place.x() - middle.x(), z = place.z() - middle.z();
  const Vec3 own(std::cos(pitch) * x - std::sin(pitch) * z, place.y() - middle.y(),
                 std::sin(pitch) * x + std::cos(pitch) * z);
  return (own.cwiseAbs() - size / 2).maxCoeff();
}

// A camera sees the boom before the ground: rays that end on it, or within 12 cm of it, are
// dropped. Those that end on the ground behind it are not: it was not there.
TEST(ScansOfAMachine, TakeItsLinksForNoGround) {
  const TempFolder temp;
  const double lift = 0.4;
  // The boom's box: 2.5 m along the boom from its joint, pitched by 0.5 on top of the lift's -0.4.
  const auto from_boom = [&](const Vec3& place) {
    const Vec3 middle(1 + 2.5 * std::cos(lift), 0, 1.5 + 2.5 * std::sin(lift));
    return outside(place, middle, 0.5 - lift, {4, 0.4, 0.6});
  };
  const auto from_links = [&](const Vec3& place) {
    return std::min(from_boom(place), outside(place, {0, 0, 1.2}, 0.5, {2, 2, 2}));
  };
  const Sensor camera{.name = "mast", .pose = {{3, -4, 5}, {1, 0, 0, 0}}, .range_sigma_m = 0.01};
  std::vector<Vec3> seen, ground;
  std::int64_t on_links = 0;
  for (double x = -2; x < 7; x += 0.1) {
    for (double y = -3; y < 4; y += 0.1) {
      const Vec3 way = Vec3(x, y, 0) - camera.pose.position;
      double t = 0;
      while (t < 1 && from_links(camera.pose.position + t * way) > 0) t += 1e-3;
      seen.push_back(camera.pose.position + std::min(t, 1.0) * way);
      ground.emplace_back(x, y, 0);
      on_links += t < 1 ? 1 : 0;
    }
  }
  for (const bool has_shapes : {true, false}) {
    Site site = with_boom(has_shapes, temp);
    const std::vector<double> joints = {lift};
    ASSERT_TRUE(site.update({.machine = 0, .joints = joints}).ok());
    for (const std::vector<Vec3>* points : {&ground, &seen}) {
      std::int64_t met = 0, unsure = 0;
      for (const Vec3& point : *points) {
        const double off = from_links(point) - 0.12;
        met += off < -1e-3 ? 1 : 0;
        unsure += std::abs(off) <= 1e-3 ? 1 : 0;
      }
      for (int i = 0; i < 10; ++i) ASSERT_TRUE(site.scan(camera, *points).ok());
      const Survey survey = applied(site);
      if (!has_shapes) continue;
      EXPECT_TRUE(site.ground().chunks().empty());
      EXPECT_GE(survey.rays.masked, 10 * met);
      EXPECT_LE(survey.rays.masked, 10 * (met + unsure));
      EXPECT_EQ(survey.rays.used + survey.rays.masked, 10 * std::ssize(*points));
      if (points == &seen) {
        EXPECT_GE(met, on_links);
      } else {
        EXPECT_LT(2 * met, on_links);
      }
    }
    EXPECT_EQ(site.ground().chunks().empty(), has_shapes);
    if (!has_shapes) continue;
    // As the boom was when the machine's pose alone was told, nobody knows.
    ASSERT_TRUE(site.update({.machine = 0, .pose = {{0, 0, 40}, {1, 0, 0, 0}}}).ok());
    EXPECT_EQ(scanned(site, camera, seen).rays.masked, 0);
  }
}

// A sensor on the cab is in the box about it, and yet sees the ground.
TEST(ScansOfAMachine, MayBeginOnIt) {
  const TempFolder temp;
  Site site = with_boom(true, temp);
  const std::vector<double> joints = {0.4};
  ASSERT_TRUE(site.update({.machine = 0, .joints = joints}).ok());
  const Sensor on_cab{.name = "cab", .pose = {{0, 0, 2.2}, {1, 0, 0, 0}}, .range_sigma_m = 0.01};
  std::vector<Vec3> ground, housing;
  for (int i = 0; i < 400; ++i) {
    ground.emplace_back(-2 - 0.01 * i, 1.5 - 0.01 * i, 0);  // behind it: no boom
    housing.emplace_back(0.1, 0.001 * i, 2.0);
  }
  ASSERT_TRUE(site.scan(on_cab, ground).ok());
  const Survey survey = scanned(site, on_cab, housing);
  EXPECT_EQ(survey.rays.used, 400);
  EXPECT_EQ(survey.rays.masked, 400);
  EXPECT_TRUE(site.ground().chunks().empty());
}

TEST_P(SessionScans, AreBookedAndLeaveLoads) {
  Session session(site());
  work(session, part(states(), 0, 0.5), 1);
  const Ledger before = session.ledger(0);
  const double change_m3 = session.change_m3();
  for (std::uint64_t n = 0; n < 5; ++n)  // six rays a column must agree
    ASSERT_TRUE(session.scan(kAbove, seen(session, -0.5, 9 + n)).ok());
  const Survey survey = applied(session);
  EXPECT_GT(survey.added_m3, 1);
  EXPECT_EQ(session.ledger(0).load, before.load);
  EXPECT_EQ(session.ledger(0).cut(), before.cut());
  EXPECT_NEAR(session.change_m3() - change_m3, survey.added_m3 - survey.removed_m3, 1e-9);
  if (GetParam()) {
    EXPECT_EQ(residual(session), 0);
  }
  work(session, part(states(), 0.5, 1), 3);
  ASSERT_TRUE(session.come_to_rest().ok());
  if (GetParam()) {
    EXPECT_EQ(residual(session), 0);
  }
}

TEST_P(SessionScans, OfClonesAndRestoredStatesGoOnAlike) {
  Session session(site());
  work(session, part(states(), 0, 0.4), 1);
  std::vector<Vec3> points = seen(session, 0.04, 5);
  points.emplace_back(-50, 0, -2);                 // where nobody has looked yet
  ASSERT_TRUE(session.scan(kAbove, points).ok());  // and not applied
  Session clone = session.clone(), restored(site());
  restored.restore(session.save());
  EXPECT_EQ(clone.save(), session.save());
  EXPECT_EQ(restored.save(), session.save());
  for (Session* each : {&session, &clone, &restored}) {
    applied(*each);
    work(*each, part(states(), 0.4, 0.8), 2);
  }
  EXPECT_EQ(clone.save(), session.save());
  EXPECT_EQ(restored.save(), session.save());
}

TEST_P(SessionScans, NeverReadBytesOfAnotherState) {
  Session session(site());
  work(session, part(states(), 0, 0.3), 1);
  const std::string good = session.save();
  std::mt19937_64 random(3);
  for (int i = 0; i < 60; ++i) {
    std::string bad = good;
    if (i % 2 == 0)
      bad.resize(random() % bad.size());
    else
      for (int k = 0; k < 4; ++k)
        bad[random() % bad.size()] ^= static_cast<char>(1 << random() % 8);
    Session other(site());
    try {
      other.restore(bad);
    } catch (const std::invalid_argument&) {
      EXPECT_EQ(other.save(), Session(site()).save());
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Soil, SessionScans, ::testing::Bool(),
                         [](const auto& of) { return of.param ? "Moves" : "IsRigid"; });

}  // namespace session_scan_test
}  // namespace soilvdb::test
