// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Looks of a loop: they do not throw, and get no memory where they were before.
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "tests/session/session_fixture.h"
#include "tests/support/allocations.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::test {
namespace session_look_test {

using testing::Each;
using testing::HasSubstr;
using testing::IsNan;
using testing::Not;

constexpr int kSide = 16, kCells = kSide * kSide;

MapAround around(std::size_t machine = 0) {
  return {.machine = machine, .cell_m = 0.2, .nx = kSide, .ny = kSide};
}

/// How maps of a session or of many are asked for.
template <typename T = double>
std::vector<T> map_of(Session& session, const MapPlace& place, MapLayer layer = MapLayer::kHeight) {
  std::vector<T> out(kCells);
  session.height_map(place, layer, std::span<T>(out)).check();
  return out;
}

static_assert(noexcept(std::declval<Session&>().heights({}, {})) && noexcept(
    std::declval<Session&>().height_map(
        std::declval<const MapPlace&>(), MapLayer::kHeight,
        std::span<
            float>())) && noexcept(std::declval<Session&>()
                                       .cast({}, {},
                                             {})) && noexcept(height_maps({}, {}, MapLayer::kHeight,
                                                                          std::span<double>())));

TEST(SessionLook, ALoopThatLooksInEachStepGetsNoMemoryForIt) {
#ifndef SOILVDB_COUNTS_ALLOCATIONS
  GTEST_SKIP() << "allocations are not counted";
#endif
  for (const Earthmoving& soil : {Earthmoving(), moving()}) {
    Session session(site_of(soil)), blind(site_of(soil));
    std::vector<float> map(kCells);
    std::vector<Vec2> places(50);
    std::vector<double> z(places.size());
    std::size_t looks = 0;
    const auto look = [&](const MachineState& state) {
      for (std::size_t n = 0; n < places.size(); ++n)
        places[n] = state.pose.position.head<2>() + Vec2(0.07 * static_cast<double>(n) - 2, 0.3);
      const LookResult by_map =
          session.height_map(around(state.machine), MapLayer::kHeight, std::span<float>(map));
      const LookResult by_place = session.heights(places, z);
      const LookResult below = session.heights(places, z, state.pose.position.z());
      return by_map.ok() && by_place.ok() && below.ok();
    };
    for (const MachineState& state : states()) {
      ASSERT_TRUE(session.update(state).ok() && blind.update(state).ok());
      if (looks == 0) session.prepare_looks({Vec2(-12, -12), Vec2(12, 12)}).check();
      if (looks < 2) look(state);
      const std::size_t before = allocations;
      const bool all = look(state);
      ASSERT_EQ(allocations, before) << looks;
      ASSERT_TRUE(all);
      ++looks;
    }
    EXPECT_GT(std::abs(session.change_m3()), 0.1);
    EXPECT_EQ(session.save(), blind.save()) << "looks change nothing";
    EXPECT_EQ(map_of<float>(session, around(1)), map_of<float>(blind, around(1)));
  }
}

TEST(SessionLook, FaultsAreToldAndLeaveNaN) {
  Session session(site_of());
  std::vector<double> out(kCells, 5), few(3, 5);
  const std::span<double> all(out);
  const auto told = [&](const LookResult& made, const char* why) {
    EXPECT_EQ(made.fault, LookResult::Fault::kBadRequest);
    EXPECT_THAT(made.why, HasSubstr(why));
    EXPECT_THAT(out, Each(IsNan())) << why;
    std::fill(out.begin(), out.end(), 5);
  };
  const auto look = [&](const MapPlace& place) {
    return session.height_map(place, MapLayer::kHeight, all);
  };
  told(look(around(1)), "machine 'plate' has no place before its first state");
  told(look(around(2)), "there is no machine 2");
  told(look(MapGrid{{0, 0}, -1, kSide, kSide}), "a map's cells must be");
  told(look(MapGrid{{kNaN, 0}, 0.1, kSide, kSide}), "must be numbers");
  told(session.height_map(MapGrid{{0, 0}, 0.1, kSide, kSide}, MapLayer::kDesign, all), "design");
  told(session.height_map(MapGrid{{0, 0}, 0.1, kSide, kSide}, MapLayer::kHeight, all, kNaN),
       "a ceiling must be a number");
  const std::vector<Vec2> places(kCells + 1, Vec2::Zero());
  told(session.heights(places, out), "room for as many heights");
  const Vec3 eye(0, 0, 3);
  told(session.cast({&eye, 1}, std::vector<Vec3>(kCells, Vec3::Zero()), out), "ray 0");
  EXPECT_FALSE(session.prepare_looks({Vec2(0, 0), Vec2(1e4, 1e4)}).ok());
}

TEST(SessionLook, MapsOfManySessionsAreThoseOfEach) {
  std::vector<Session> sessions;
  for (int n = 0; n < 5; ++n) {
    sessions.emplace_back(site_of(n % 2 == 0 ? Earthmoving() : moving()));
    if (n != 3) feed(sessions.back(), part(states(), 0, 0.15 * (n + 1)));
  }
  std::vector<Session*> all;
  for (Session& session : sessions) all.push_back(&session);
  std::vector<double> maps(5 * kCells);
  const auto map = [&](std::size_t n) {
    return std::vector<double>(maps.begin() + static_cast<std::ptrdiff_t>(n) * kCells,
                               maps.begin() + static_cast<std::ptrdiff_t>(n + 1) * kCells);
  };
  const auto look = [&](const std::vector<MapPlace>& places, MapLayer layer = MapLayer::kHeight) {
    return height_maps(std::span<Session* const>(all), places, layer, std::span<double>(maps));
  };
  look({around()}).check();
  for (const std::size_t n : {0, 1, 2, 4}) EXPECT_EQ(map(n), map_of(sessions[n], around()));
  EXPECT_THAT(map(3), Each(IsNan())) << "its machine has no place yet";

  std::vector<MapPlace> places;
  for (int n = 0; n < 5; ++n) places.push_back(MapGrid{{0.3 * n - 2, 0.1}, 0.15, kSide, kSide});
  look(places, MapLayer::kDug).check();
  for (std::size_t n = 0; n < 5; ++n)
    EXPECT_EQ(map(n), map_of(sessions[n], places[n], MapLayer::kDug));

  // Those that can't be made are NaN alone, and the first is told.
  std::get<MapGrid>(places[4]).cell_m = std::get<MapGrid>(places[1]).first_m.x() = kNaN;
  const LookResult made = look(places, MapLayer::kDug);
  EXPECT_EQ(made.fault, LookResult::Fault::kBadRequest);
  EXPECT_THAT(made.why, HasSubstr("site 1: "));
  for (const std::size_t n : {1, 4}) EXPECT_THAT(map(n), Each(IsNan()));
  for (const std::size_t n : {0, 2, 3})
    EXPECT_EQ(map(n), map_of(sessions[n], places[n], MapLayer::kDug));
  EXPECT_THAT(look({around(7)}).why, HasSubstr("site 0: there is no machine 7"));
  MapAround bad = around();
  bad.cell_m = 0;
  EXPECT_THAT(look({bad}).why, HasSubstr("a map's cells must be"));
  all = {all[3]};
  maps.resize(kCells);
  EXPECT_THAT(look({bad}).why, HasSubstr("site 0: a map's cells must be"))
      << "without a place, too";

  EXPECT_THAT(look({around(), around()}).why, HasSubstr("a place for each session"));
  all = {&sessions[0], &sessions[0]};
  EXPECT_THAT(look({around()}).why, HasSubstr("there twice"));
  all = {&sessions[0], &sessions[1]};
  maps.resize(2 * kCells + 1);
  EXPECT_THAT(look({around()}).why, HasSubstr("room for as many cells"));
  EXPECT_THAT(maps, Each(IsNan()));
  all.clear();
  EXPECT_TRUE(height_maps<float>({}, std::vector<MapPlace>{around()}, MapLayer::kHeight, {}).ok());
}

/// A plane that may be anywhere is looked at anywhere, and work begins where the first state is.
TEST(SessionLook, APlaneIsLookedAtWhereItIsAskedFor) {
  const Vec3 utm(5e5, 5.4e6, 0);
  SessionSite plane = site_of();
  plane.terrain = io::PlaneTerrain{300 - 0.05 * utm.x(), {0.05, 0}};
  const MapGrid there{utm.head<2>(), 0.1, kSide, kSide};
  Session looked(plane), unlooked(plane);
  for (const double z : map_of(looked, MapGrid{{0, 0}, 0.1, kSide, kSide}))
    EXPECT_NEAR(z, 300 - 0.05 * utm.x(), 0.1);
  const std::vector<double> map = map_of(looked, there);
  for (int j = 0; j < kSide; ++j)
    EXPECT_NEAR(map[static_cast<std::size_t>(j)], 300 + 0.005 * j, 0.01);
  map_of(looked, MapGrid{{-4e6, 1e6}, 0.1, kSide, kSide});
  for (Session* session : {&looked, &unlooked})
    for (const double x : {0.0, 1.0})
      ASSERT_TRUE(session->update({.machine = 0, .pose = {utm + Vec3(x, 0, 299.8)}}).ok());
  EXPECT_EQ(looked.save(), unlooked.save());
  EXPECT_LT(looked.change_m3(), -0.05);
  EXPECT_EQ(map_of(looked, there), map_of(unlooked, there));
  // Now it is there, or where it was said to be.
  std::vector<double> out(kCells);
  const MapGrid far{{0, 0}, 0.1, kSide, kSide};
  EXPECT_THAT(looked.height_map(far, MapLayer::kHeight, std::span<double>(out)).why,
              HasSubstr("m of the site's origin, which is at ("));
  EXPECT_THAT(out, Each(IsNan()));
  plane.near_m = Vec3(0, 0, 0);
  Session near(plane);
  EXPECT_FALSE(near.height_map(there, MapLayer::kHeight, std::span<double>(out)).ok());
  // A recording says where it is.
  const TempFolder folder;
  plane.near_m = {};
  Session recorded(plane);
  recorded.record({.folder = folder / "a"});
  EXPECT_FALSE(recorded.height_map(there, MapLayer::kHeight, std::span<double>(out)).ok());
  EXPECT_TRUE(recorded.height_map(far, MapLayer::kHeight, std::span<double>(out)).ok());
  EXPECT_THAT(out, Each(Not(IsNan())));
}

}  // namespace session_look_test
}  // namespace soilvdb::test
