// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Laws of pouring, on ground as rough as the numbers of a random generator make it. With the
// environment variable SOILVDB_TABLE set, prints what was measured.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <limits>
#include <random>

#include "core/constants.h"
#include "core/settle/front.h"
#include "tests/support/pour_fixture.h"

namespace soilvdb::test {
namespace pour_laws_test {

constexpr double kPi = std::numbers::pi;
constexpr int kColumns = 96;
constexpr double kQuantum_m3 = 0.02;
constexpr double kExact = 1e-9;     ///< of the volume poured
constexpr double kRounding = 1e-6;  ///< of heights whose order of sums differs, columns' sides
constexpr double kOverReposeP99_deg = 1.5;
/// On rough ground, where a pile runs down the fall line as it grows and meets other ways down,
/// more soil may come to rest elsewhere: on so many of the columns that it raises, columns' sides.
constexpr double kElsewhere = 1e-4, kElsewhereMost = 0.5;

enum class Relief { kWaves, kTerraces, kTrenches };

/// Sixteen waves of 0.3 to 3 m, made into terraces of 0.3 m or cut by trenches 0.8 m deep.
Columns rough(std::uint64_t seed, double rms_slope, Relief relief) {
  std::mt19937_64 random(seed);
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53;
  };
  struct Wave {
    double kx, ky, phase, height;
  };
  std::vector<Wave> waves(16);
  for (Wave& w : waves) {
    const double k = 2 * kPi / uniform(0.3, 3), way = uniform(0, 2 * kPi);
    w = {k * std::cos(way), k * std::sin(way), uniform(0, 2 * kPi), 1 / k};
  }
  const double across = uniform(0, kPi), shift = uniform(0, 1.5);
  return columns_of(kColumns * kSide_m, kColumns * kSide_m, kSide_m, [&](double x, double y) {
    double h = 0;
    for (const Wave& w : waves) h += w.height * std::cos(w.kx * x + w.ky * y + w.phase);
    h *= rms_slope / std::sqrt(8.0);
    const double terrace = 0.3 * std::floor(h / 0.3);
    if (relief == Relief::kTerraces) h = terrace + 0.2 * (h - terrace);
    const double along = x * std::cos(across) + y * std::sin(across) + shift + 100;
    if (relief == Relief::kTrenches && std::fmod(along, 1.5) < 0.6) h -= 0.8;
    return h;
  });
}

/// The same ground seen in one of eight ways: turned and mirrored.
struct View {
  int way, columns;

  int of(int column) const {
    int x = column / columns, y = column % columns;
    if ((way & 4) != 0) std::swap(x, y);
    if ((way & 1) != 0) x = columns - 1 - x;
    if ((way & 2) != 0) y = columns - 1 - y;
    return x * columns + y;
  }
  Vec2 of(const Vec2& at, double side_m) const {
    Vec2 p = (way & 4) != 0 ? Vec2(at.y(), at.x()) : at;
    if ((way & 1) != 0) p.x() = columns * side_m - p.x();
    if ((way & 2) != 0) p.y() = columns * side_m - p.y();
    return p;
  }
};

struct Terrain {
  std::string name;
  Columns ground;
  Vec2 sources[2];
};

std::vector<Terrain> terrains() {
  std::vector<Terrain> all;
  std::uint64_t seed = 1;
  for (const double slope : {0.4, 0.8, 1.4})
    for (const Relief relief : {Relief::kWaves, Relief::kTerraces, Relief::kTrenches})
      for (int n = 0; n < 10; ++n, ++seed)
        all.push_back(
            {fmt::format("slope {} relief {} seed {}", slope, static_cast<int>(relief), seed),
             rough(seed, slope, relief),
             {Vec2(1.9 + 0.013 * n, 2.11), Vec2(2.9, 2.63 - 0.017 * n)}});
  return all;
}

/// By how much soil on a column stands steeper than repose over its neighbours, degrees. Where the
/// ground below it does, soil may lie up to the edge, half a column on.
double over_repose_deg(const Columns& before, const Columns& after, int column) {
  const int x = column / after.ny, y = column % after.ny;
  const double here = after.at(column), ground = before.at(column);
  double most = 0;
  for (int i = -1; i <= 1; ++i)
    for (int j = -1; j <= 1; ++j) {
      if ((i == 0 && j == 0) || !after.open(x + i, y + j)) continue;
      // Nothing slides between two columns that are higher.
      if (i != 0 && j != 0 && after.at(after.index(x + i, y)) > here &&
          after.at(after.index(x, y + j)) > here)
        continue;
      const double far = std::sqrt(i * i + j * j) * after.side_m;
      double allowed = after.at(after.index(x + i, y + j)) + kPourSlope * far;
      if (ground > allowed) allowed = ground + kPourSlope * far / 2;
      if (here > allowed) most = std::max(most, std::atan(kPourSlope + (here - allowed) / far));
    }
  return most > 0 ? (most - std::atan(kPourSlope)) * 180 / kPi : 0;
}

TEST(PourLaws, OnRoughGroundAllThatWasPouredLiesAndLiesAtRest) {
  Pourer pourer;
  std::vector<double> over;
  for (const Terrain& t : terrains()) {
    SCOPED_TRACE(t.name);
    Columns ground = t.ground;
    for (int n = 0; n < 20; ++n) {
      const Columns before = ground;
      const Deposit deposit = pourer.pour(ground, t.sources[n % 2], kQuantum_m3, kPourSlope);
      ASSERT_EQ(deposit.left_m3, 0);
      ASSERT_NEAR(volume_between(before, ground), kQuantum_m3, kExact * kQuantum_m3);
      double booked = 0;
      for (const Cone& cone : deposit.cones) booked += cone.volume_m3;
      ASSERT_NEAR(booked, kQuantum_m3, kExact * kQuantum_m3);
      for (std::size_t i = 0; i < ground.height_m.size(); ++i)
        ASSERT_GE(ground.height_m[i], before.height_m[i]);
    }
    for (int i = 0; i < kColumns * kColumns; ++i)
      if (ground.at(i) > t.ground.at(i)) over.push_back(over_repose_deg(t.ground, ground, i));
  }
  ASSERT_GT(over.size(), 30000u);
  std::sort(over.begin(), over.end());
  const double p99 = over[over.size() * 99 / 100];
  print("over repose on {} columns: p99 {:.3f}, p99.9 {:.3f}, most {:.1f} degrees\n", over.size(),
        p99, over[over.size() * 999 / 1000], over.back());
  EXPECT_LT(p99, kOverReposeP99_deg);
}

TEST(PourLaws, MoreSoilNeverLiesLower) {
  Pourer pourer;
  long columns = 0, lower = 0;
  double most = 0;
  for (const Terrain& t : terrains()) {
    Columns last = t.ground;
    for (int n = 1; n <= 20; ++n) {
      Columns more = t.ground;
      pourer.pour(more, t.sources[0], n * kQuantum_m3, kPourSlope);
      for (int i = 0; i < kColumns * kColumns; ++i) {
        const double by = (last.at(i) - more.at(i)) / kSide_m;
        columns += more.at(i) > t.ground.at(i);
        lower += by > kLevelTolerance;  // levels nearer than that are one
        most = std::max(most, by);
      }
      last = more;
    }
  }
  print("more soil lies lower on {} of {} columns, by at most {:.3f} sides\n", lower, columns,
        most);
  EXPECT_LE(static_cast<double>(lower), kElsewhere * static_cast<double>(columns));
  EXPECT_LE(most, kElsewhereMost);
}

// Where two ways lead down to one place and only one was seen to be full.
TEST(PourLaws, SoilBelowNeverLiesHigherThanWhatItRanDownFrom) {
  Pourer pourer;
  Columns less = rough(33, 0.8, Relief::kWaves), more = less;
  pourer.pour(less, Vec2(1.926, 2.1), 0.34, kPourSlope);
  pourer.pour(more, Vec2(1.926, 2.1), 0.35, kPourSlope);
  for (int i = 0; i < kColumns * kColumns; ++i)
    ASSERT_GE(more.at(i), less.at(i) - kRounding * 100 * kSide_m);
}

TEST(PourLaws, TurnedAndMirroredGroundTakesSoilTheSameWay) {
  Pourer pourer;
  for (const Terrain& t : terrains()) {
    SCOPED_TRACE(t.name);
    Columns ground = t.ground;
    pourer.pour(ground, t.sources[0], 0.4, kPourSlope);
    for (int way = 1; way < 8; ++way) {
      const View view{way, kColumns};
      Columns turned = t.ground;
      for (int i = 0; i < kColumns * kColumns; ++i) turned.at(view.of(i)) = t.ground.at(i);
      turned.firm_m = turned.height_m;
      pourer.pour(turned, view.of(t.sources[0], kSide_m), 0.4, kPourSlope);
      double most = 0;
      for (int i = 0; i < kColumns * kColumns; ++i)
        most = std::max(most, std::abs(turned.at(view.of(i)) - ground.at(i)));
      ASSERT_LE(most, kRounding * kSide_m) << "way " << way;
    }
  }
}

TEST(PourLaws, TheSameBitsWithAUsedPourerAndAFreshOne) {
  Pourer used;
  for (const Terrain& t : terrains()) {
    SCOPED_TRACE(t.name);
    Columns a = t.ground, b = t.ground, c = t.ground;
    used.pour(a, t.sources[0], 0.1, kPourSlope);
    used.pour(b, t.sources[0], 0.1, kPourSlope);
    Pourer().pour(c, t.sources[0], 0.1, kPourSlope);
    ASSERT_EQ(a.height_m, b.height_m);
    ASSERT_EQ(a.height_m, c.height_m);
  }
}

TEST(PourLaws, AGridsEdgeIsAWall) {
  Pourer pourer;
  for (int nx = 1; nx <= 4; ++nx)
    for (int ny = 1; ny <= 7; ++ny)
      for (int i = 0; i < nx * ny; ++i) {
        Columns ground(nx, ny, kSide_m);
        for (int n = 0; n < nx * ny; ++n) ground.at(n) = kSide_m * ((n * 7) % 5);
        const Columns before = ground;
        const Deposit deposit = pourer.pour(ground, middle_m(ground, i), 0.01, kPourSlope);
        ASSERT_EQ(deposit.left_m3, 0);
        ASSERT_NEAR(volume_between(before, ground), 0.01, kExact * 0.01);
      }
}

TEST(PourLaws, SoilThatFallsOnNoOpenColumnIsLeft) {
  Pourer pourer;
  Columns ground(20, 20, kSide_m);
  ground.rigid.assign(400, 0);
  ground.rigid[static_cast<std::size_t>(ground.index(10, 10))] = 1;
  for (const Vec2& at : {Vec2(-0.01, 0.5), Vec2(0.5, 1.01), Vec2(1e9, 0.5), Vec2(0.52, 0.52)}) {
    EXPECT_EQ(pourer.pour(ground, at, 0.1, kPourSlope).left_m3, 0.1);
    EXPECT_EQ(ground.height_m, Columns(20, 20, kSide_m).height_m);
  }
  EXPECT_EQ(pourer.pour(ground, Vec2(0.5, 0.4), 0, kPourSlope).cones.size(), 0u);
}

TEST(PourLaws, RigidColumnsStayAsTheyAre) {
  Pourer pourer;
  Columns ground(60, 60, kSide_m);
  ground.rigid.assign(3600, 0);
  for (int i = 0; i < 3600; i += 7) ground.rigid[static_cast<std::size_t>(i)] = 1;
  ground.rigid[static_cast<std::size_t>(ground.index(30, 30))] = 0;
  pourer.pour(ground, Vec2(1.52, 1.52), 0.2, kPourSlope);
  EXPECT_NEAR(volume_between(Columns(60, 60, kSide_m), ground), 0.2, kExact);
  for (std::size_t i = 0; i < 3600; ++i)
    if (ground.rigid[i] != 0) {
      ASSERT_EQ(ground.height_m[i], 0);
    }
}

/// The same columns, none of them read yet and without heights. @param known outlives them
struct UnreadColumns {
  explicit UnreadColumns(const Columns& known)
      : columns(known.nx, known.ny, known.side_m, std::numeric_limits<double>::quiet_NaN()) {
    columns.firm_m = columns.height_m;
    columns.rigid.assign(columns.height_m.size(), Columns::kUnread);
    columns.read = [this, &known](int column) {
      const auto n = static_cast<std::size_t>(column);
      columns.height_m[n] = known.height_m[n];
      columns.firm_m[n] = known.firm_m[n];
      columns.rigid[n] = known.rigid[n];
      ++reads;
    };
  }
  UnreadColumns(const UnreadColumns&) = delete;
  UnreadColumns& operator=(const UnreadColumns&) = delete;

  Columns columns;
  std::size_t reads = 0;
};

TEST(PourLaws, ColumnsThatAreReadWhenSoilComesToThemGiveTheSameBits) {
  std::mt19937_64 random(11);
  std::uniform_real_distribution<double> share(0, 1);
  Pourer pourer;
  int ran = 0;
  for (std::uint64_t seed = 0; seed < 48; ++seed) {
    Columns known = rough(seed, 0.6 * share(random), static_cast<Relief>(seed % 3));
    const Vec2 tilt = Vec2(2 * share(random) - 1, 2 * share(random) - 1) * 1.5 * kPourSlope;
    for (int n = 0; n < known.nx * known.ny; ++n) {
      known.at(n) += tilt.dot(middle_m(known, n));
      known.firm_m[static_cast<std::size_t>(n)] = known.at(n) - 0.05 * share(random);
      known.rigid.push_back(share(random) < 0.02 ? 1 : 0);
    }
    const Columns before = known;
    UnreadColumns unread(before);
    Columns& lazy = unread.columns;
    for (int pour = 0; pour < 3; ++pour) {
      const Vec2 along = pour == 1 ? Vec2(0.4, 0.3 * share(random)) : Vec2(0, 0);
      const Vec2 at = (kColumns * kSide_m - 0.5) * Vec2(share(random), share(random));
      const bool leaves = share(random) < 0.5;
      const Pourer::Foot foot = pourer.foot(known, at, kPourSlope);
      const Pourer::Foot lazy_foot = pourer.foot(lazy, at, kPourSlope);
      ASSERT_EQ(foot.at_m, lazy_foot.at_m);
      ASSERT_EQ(foot.at_border, lazy_foot.at_border);
      ran += foot.at_m != at;
      const Deposit eager = pourer.pour(known, at, kQuantum_m3, kPourSlope, leaves, along);
      const Deposit deposit = pourer.pour(lazy, at, kQuantum_m3, kPourSlope, leaves, along);
      ASSERT_EQ(deposit.left_m3, eager.left_m3);
      ASSERT_EQ(deposit.exit_m, eager.exit_m);
      ASSERT_EQ(deposit.cones.size(), eager.cones.size());
      for (std::size_t i = 0; i < eager.cones.size(); ++i) {
        const auto& a = deposit.cones[i].columns;
        const auto& b = eager.cones[i].columns;
        ASSERT_EQ(a.size(), b.size());
        for (std::size_t n = 0; n < b.size(); ++n) {
          ASSERT_EQ(a[n].column, b[n].column);
          ASSERT_EQ(a[n].before_m, b[n].before_m);
          ASSERT_EQ(a[n].after_m, b[n].after_m);
          ASSERT_EQ(a[n].from_m, b[n].from_m);
        }
      }
    }
    for (std::size_t n = 0; n < lazy.height_m.size(); ++n) {
      if (lazy.rigid[n] == Columns::kUnread) {
        ASSERT_EQ(known.height_m[n], before.height_m[n]);
      } else {
        ASSERT_EQ(lazy.height_m[n], known.height_m[n]);
      }
    }
  }
  EXPECT_GT(ran, 20);
}

TEST(PourLaws, OfALargePlaneThatIsTooSteepOnlyTheWayDownIsRead) {
  constexpr int kLarge = 400;
  Pourer pourer;
  for (int i = 0; i < 24; ++i) {
    const double turn = 2 * kPi * (i + 0.3) / 24, slope = kPourSlope * (1.15 + 0.03 * i);
    const Vec2 up(slope * std::cos(turn), slope * std::sin(turn));
    const auto plane = [&](double x, double y) { return up.dot(Vec2(x, y)); };
    Columns known = columns_of(kLarge * kSide_m, kLarge * kSide_m, kSide_m, plane);
    known.rigid.assign(known.height_m.size(), 0);
    UnreadColumns unread(known);
    const Vec2 from = middle_m(known, known.index(kLarge / 2, kLarge / 2));
    const Pourer::Foot foot = pourer.foot(unread.columns, from, kPourSlope);
    EXPECT_TRUE(foot.at_border);
    const double columns = (foot.at_m - from).lpNorm<1>() / kSide_m;
    EXPECT_GT(columns, kLarge / 2 - 10);
    // Those that the way goes through, and those beside them.
    EXPECT_LT(static_cast<double>(unread.reads), 5 * columns + 20) << i;
  }
}

/// What soil reaches whose top is at a level. @param at in columns
Front front_of(const Columns& ground, const Vec2& at, double level_m) {
  FrontFinder finder;
  Front front;
  finder.look_at(ground, kPourSlope);
  const int column = ground.index(static_cast<int>(at.x()), static_cast<int>(at.y()));
  finder.fill({at, column}, level_m, kInfinity, front);
  return front;
}

TEST(PourLaws, OverABanksCornerTheWayIsStraightIfSoilIsAboveItsEdges) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> share(0, 1);
  constexpr int kCorner = 20;
  int over = 0, round = 0;
  for (int scene = 0; scene < 64; ++scene) {
    SCOPED_TRACE(scene);
    // From the edges of its corner the bank rises too steeply for soil to lie on it.
    const double edge = 4 + share(random), rise = 3 + share(random);
    const Columns ground = columns_of(2, 2, kSide_m, [&](double x, double y) {
      const Vec2 in = Vec2(x, y) / kSide_m - Vec2::Constant(kCorner);
      return in.minCoeff() > 0 ? kSide_m * (edge + rise * (in.sum() - 0.5)) : 0;
    });
    const Vec2 from = Vec2(-1 - 6 * share(random), 1 + 6 * share(random));  // from the corner
    const bool is_above = scene % 2 == 0;
    const double level = is_above ? edge + 0.2 + kPourSlope * (from.norm() + 1)
                                  : edge - 0.2 + kPourSlope * from.norm();
    const Front front = front_of(ground, Vec2::Constant(kCorner) + from, kSide_m * level);
    for (const Front::Part& part : front.parts) {
      const Vec2 to = middle_m(ground, part.column) / kSide_m - Vec2::Constant(kCorner);
      const Vec2 way = to - from;
      ASSERT_GE(part.distance, way.norm() - kRounding);
      if (to.x() < 0 || to.y() > 0) continue;
      // Where it comes over the corner's column and where it leaves it, less than a column away.
      const double in = from.y() - from.x() / way.x() * way.y();
      const double out = from.x() - from.y() / way.y() * way.x();
      if (std::min(in, out) < 0.1 || std::max(in, out) > 0.7) continue;
      if (is_above) {
        EXPECT_NEAR(part.distance, way.norm(), kRounding);
      } else {
        EXPECT_GT(part.distance, way.norm() + kRounding);
      }
      ++(is_above ? over : round);
    }
  }
  EXPECT_GT(over, 50);
  EXPECT_GT(round, 50);
}

TEST(PourLaws, NoWayOverALipIsShorterThanThatWhereSoilIsAboveIt) {
  std::mt19937_64 random(6);
  std::uniform_real_distribution<double> share(0, 1);
  constexpr int kLip = 24;
  int straight = 0, bent = 0;
  for (int scene = 0; scene < 64; ++scene) {
    SCOPED_TRACE(scene);
    // Ground rises to the lip, so that soil that covers a column may end before the lip.
    const double rise = kPourSlope * (0.3 + 0.65 * share(random));
    const Columns ground = columns_of(3, 2.4, kSide_m, [&](double, double y) {
      const double before = kLip * kSide_m - y;
      return before > 0 ? -rise * before : -2;
    });
    const double ahead = 1 + 8 * share(random), reach = ahead * (1 + 0.7 * share(random));
    const double half = std::sqrt(reach * reach - ahead * ahead);
    const Vec2 source(30 + share(random), kLip - ahead);
    const Front front = front_of(ground, source, kPourSlope * kSide_m * reach);
    for (const Front::Part& part : front.parts) {
      const Vec2 way = middle_m(ground, part.column) / kSide_m - source;
      if (way.y() < ahead) continue;
      const Vec2 end(std::copysign(half, way.x()), ahead);
      const bool is_straight = std::abs(way.x()) * ahead < half * way.y();
      ASSERT_GE(part.distance, (is_straight ? way.norm() : reach + (way - end).norm()) - kRounding);
      ++(is_straight ? straight : bent);
    }
  }
  EXPECT_GT(straight, 10000);
  EXPECT_GT(bent, 10000);
}

TEST(PourLaws, LevelsHoldTheVolumeAlsoWhereTheyAreThatOfAColumn) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> height(430, 431);
  for (int trial = 0; trial < 20'000; ++trial) {
    Front front;
    for (int i = 0, n = 2 + trial % 30; i < n; ++i) {
      front.parts.push_back({i, 0, 0, height(random)});
      front.keys += front.parts.back().key;
    }
    // The level is a column's, to rounding: does that one hold nothing, or isn't it there?
    const double key = front.parts.front().key;
    double volume = 0;
    for (const Front::Part& part : front.parts) volume += std::max(0.0, key - part.key);
    if (volume == 0) continue;
    const double level = front.level_of(volume);
    ASSERT_NEAR(level, key, 1e-10);
  }
}

}  // namespace pour_laws_test
}  // namespace soilvdb::test
