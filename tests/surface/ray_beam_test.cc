// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Whatever a beam says of its rays holds for the walk of each, to the last bit.
#include "core/lattice/ray_beam.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <random>
#include <vector>

namespace soilvdb::test {
namespace {

constexpr std::size_t kBeamRays = 16;
constexpr int kRandomBeams = 40000, kMostSteps = 60;

struct BeamBox {
  Coord2 low, high;

  Vec2 begin() const { return low.cast<double>(); }
  Vec2 end() const { return (high + Coord2::Ones()).cast<double>(); }
};

/// What happened, so that a test that looked at nothing fails.
struct BeamCounts {
  int broad = 0, missed = 0, started = 0, left = 0, fell = 0, fell_partly = 0, stayed = 0,
      handed = 0, parted = 0;
};

std::array<Span, 3> spans_of(const std::vector<Vec3>& along) {
  std::array<Span, 3> spans;
  for (const Vec3& ray : along)
    for (std::size_t a = 0; a < 3; ++a) spans[a].extend(ray[static_cast<int>(a)]);
  return spans;
}

bool is_same_place(const RayWalk& a, const RayWalk& b) {
  return a.x() == b.x() && a.y() == b.y() && a.t() == b.t();
}

/// A beam, and beside it the walks of its rays, each as if there were no beam.
class WatchedBeam {
 public:
  WatchedBeam(const Vec3& begin, const std::vector<Vec3>& along, const BeamBox& box)
      : begin_(begin), along_(along), box_(box), beam_(begin, spans_of(along)) {
    for (const Vec3& ray : along) walks_.emplace_back(begin, ray);
    is_one_ = std::all_of(along.begin(), along.end(), [&](auto& ray) { return ray == along[0]; });
  }

  void walk(std::mt19937_64& random, BeamCounts& counts) {
    const bool is_narrow = beam_.is_narrow();
    ASSERT_EQ(is_narrow, may_be_narrow());
    if (!is_narrow) {
      ++counts.broad;
      return;
    }
    bool goes_on = false;
    ASSERT_NO_FATAL_FAILURE(start(counts, goes_on));
    for (int n = 0; goes_on && n < kMostSteps; ++n)
      ASSERT_NO_FATAL_FAILURE(step(random, counts, goes_on));
  }

 private:
  /// Do all go one way along each axis, and so fast that RayWalk doesn't take them for upright?
  bool may_be_narrow() const {
    const auto all = [&](const auto& holds) {
      return std::all_of(along_.begin(), along_.end(), holds);
    };
    constexpr double kLeast = RayWalk::kLeastPlan;
    for (int a = 0; a < 2; ++a) {
      if (!all([&](const Vec3& ray) { return ray[a] >= kLeast; }) &&
          !all([&](const Vec3& ray) { return ray[a] <= -kLeast; }))
        return false;
    }
    return all([&](const Vec3& ray) { return ray.z() <= -kLeast; }) &&
           begin_.cwiseAbs().maxCoeff() < RayWalk::kFarthest;
  }
  /// One ray is no beam: nothing is unsure of it.
  bool holds(const Span& span, double value) const {
    return is_one_ ? span.low == value && span.high == value
                   : span.low <= value && value <= span.high;
  }
  void check_places() const {
    int level = 0;
    while (level < kRayLevels && !beam_.is_in_one(level)) ++level;
    ASSERT_TRUE(!is_one_ || level == 0);
    for (const RayWalk& walk : walks_) {
      ASSERT_TRUE(holds(beam_.t(), walk.t())) << walk.t() - beam_.t().low;
      if (!beam_.is_in_one(level)) continue;
      ASSERT_EQ((walk.x() ^ beam_.x()) >> level, 0) << walk.x() << ' ' << beam_.x();
      ASSERT_EQ((walk.y() ^ beam_.y()) >> level, 0) << walk.y() << ' ' << beam_.y();
    }
  }
  void start(BeamCounts& counts, bool& goes_on) {
    Span from;
    beam_.clip(box_.begin(), box_.end(), from, to_);
    for (std::size_t n = 0; n < walks_.size(); ++n) {
      double walk_from = 0, walk_to = RayWalk::kNever;
      const bool meets = walks_[n].clip(box_.begin(), box_.end(), walk_from, walk_to);
      ASSERT_TRUE(holds(from, walk_from)) << walk_from - from.low;
      ASSERT_TRUE(holds(to_, walk_to)) << walk_to - to_.low;
      ASSERT_FALSE(from.low > to_.high && meets);
      ASSERT_TRUE(from.high > to_.low || meets);
      walks_[n].start(walk_from, box_.low, box_.high);
    }
    goes_on = from.high <= to_.low;
    ++(goes_on ? counts.started : counts.missed);
    if (!goes_on) return;
    beam_.start(from, box_.low, box_.high);
    check_places();
  }
  void step(std::mt19937_64& random, BeamCounts& counts, bool& goes_on) {
    goes_on = false;
    int least = 0;
    while (least <= kRayLevels && !beam_.is_in_one(least)) ++least;
    if (least > kRayLevels) {
      ++counts.parted;
      return;
    }
    const int level = std::uniform_int_distribution(least, kRayLevels)(random);
    const Span over_x = beam_.border(0, level), over_y = beam_.border(1, level);
    const Span out = min(over_x, over_y), end = max(beam_.t(), out);
    const Span lowest = beam_.lowest(end);
    for (const RayWalk& walk : walks_) {
      const double own = walk.end(level);
      ASSERT_TRUE(holds(end, own)) << own - end.low;
      ASSERT_TRUE(holds(lowest, walk.lowest(own))) << walk.lowest(own) - lowest.low;
    }
    if (end.high >= to_.low) return;
    const RayPlace here = {beam_.x(), beam_.y(), level, beam_.t().low};
    const bool is_over_x = over_x.high <= over_y.low, is_over_y = over_y.high < over_x.low;
    ASSERT_TRUE(!is_one_ || is_over_x || is_over_y);
    goes_on = true;
    if (random() % 2 == 0) {
      ASSERT_NO_FATAL_FAILURE(fall(random, here, end, counts));
    } else if (is_over_x || is_over_y) {
      ++counts.left;
      // Where all are before its borders, they leave the square wherever in it they started.
      const bool hands = beam_.t().high <= out.low;
      beam_.leave(is_over_x ? 0 : 1, level, end);
      for (std::size_t n = 0; n < walks_.size(); ++n) {
        RayWalk from_here = walk_from(here, n);
        from_here.leave(level, from_here.end(level));
        walks_[n].leave(level, walks_[n].end(level));
        ASSERT_TRUE(!hands || is_same_place(from_here, walks_[n]));
      }
      counts.handed += hands;
    }
    ASSERT_TRUE(beam_.is_in_one(level));
    check_places();
  }
  void fall(std::mt19937_64& random, const RayPlace& here, const Span& end, BeamCounts& counts) {
    const Span height = some_height(random, end), before = beam_.t();
    const int level = here.level;
    const bool is_sure = beam_.fall_to(height, level);
    bool some_fell = false, all_fell = true;
    for (std::size_t n = 0; n < walks_.size(); ++n) {
      const std::uint64_t kind = random() % 3;
      const double own = kind == 0   ? height.low
                         : kind == 1 ? height.high
                                     : (height.low + height.high) / 2;
      const double t = walks_[n].t();
      walks_[n].fall_to(own, level);
      const bool fell = walks_[n].t() > t;
      some_fell |= fell;
      all_fell &= fell;
      if (!is_sure) continue;
      RayWalk from_here = walk_from(here, n);
      // From there too it would look at smaller squares, and not leave this one.
      ASSERT_LE(from_here.lowest(from_here.end(level)), height.low);
      from_here.fall_to(own, level);
      ASSERT_TRUE(is_same_place(from_here, walks_[n]));
    }
    ASSERT_TRUE(!is_sure || all_fell);
    is_one_ = is_one_ && height.low == height.high;
    ASSERT_TRUE(!is_one_ || is_sure == all_fell);
    counts.fell += is_sure;
    counts.handed += is_sure;
    counts.stayed += beam_.t().low == before.low && beam_.t().high == before.high;
    counts.fell_partly += some_fell && !all_fell;
  }
  /// To which all come down in the square that they leave at `end`: mostly near where they are.
  Span some_height(std::mt19937_64& random, const Span& end) const {
    std::uniform_real_distribution<double> part(0, 1);
    const std::array<double, 4> places = {beam_.t().low, beam_.t().high, end.low,
                                          std::lerp(beam_.t().low, end.high, part(random))};
    const double at = begin_.z() + places[random() % 4] * along_[random() % along_.size()].z();
    Span height = {at, at};
    switch (random() % 5) {
      case 0:
        height.high += part(random) * (begin_.z() - at);
        break;
      case 1:
        height.high = std::nextafter(at, RayWalk::kNever);
        break;
      case 2:
        if (random() % 4 == 0) height.high = RayWalk::kNever;
        break;
    }
    const double least = beam_.lowest(end).high;
    return {std::max(height.low, least), std::max(height.high, least)};
  }
  RayWalk walk_from(const RayPlace& place, std::size_t ray) const {
    RayWalk walk(begin_, along_[ray]);
    walk.start(place, box_.high);
    return walk;
  }

  const Vec3& begin_;
  const std::vector<Vec3>& along_;
  const BeamBox& box_;
  RayBeam beam_;
  std::vector<RayWalk> walks_;
  Span to_;
  bool is_one_;
};

/// Down, in any direction in plan or along an axis; by turns slow and fast.
Vec3 some_direction(std::mt19937_64& random) {
  std::uniform_real_distribution<double> any(-1, 1), exponent(-4, 1);
  Vec3 along(any(random), any(random), -std::pow(10, exponent(random)));
  switch (random() % 8) {
    case 0:
      along[random() % 2 == 0 ? 0 : 1] *= 1e-6;
      break;
    case 1:
      along[random() % 2 == 0 ? 0 : 1] = 0;
      break;
    case 2:  // along a diagonal, through corners of cells
      along.y() = random() % 2 == 0 ? along.x() : -along.x();
      break;
    case 3:
      along.head<2>() *= 1e-3;
      break;
  }
  return along * 3;
}

std::vector<Vec3> some_directions(std::mt19937_64& random) {
  constexpr double kSpreads[] = {0, 0, 1e-16, 1e-12, 1e-6, 1e-4, 1e-2, 0.1, 0.5};
  const double spread = kSpreads[random() % std::size(kSpreads)];
  std::uniform_real_distribution<double> any(-1, 1);
  const Vec3 middle = some_direction(random);
  std::vector<Vec3> along(kBeamRays, middle);
  for (Vec3& ray : along)
    for (int a = 0; a < 3; ++a) ray[a] += any(random) * spread * std::abs(middle[a]);
  // Rays of an image differ by as much along each axis, so that some are upright or rise.
  if (random() % 8 == 0)
    for (Vec3& ray : along)
      for (int a = 0; a < 3; ++a) ray[a] += any(random) * spread;
  return along;
}

/// In a box or beside it; by turns on lines between cells.
Vec3 some_begin(std::mt19937_64& random) {
  std::uniform_real_distribution<double> inside(-70, 90), around(-250, 250), high(0.1, 40);
  auto& plan = random() % 2 == 0 ? inside : around;
  Vec3 begin(plan(random), plan(random), high(random));
  for (int a = 0; a < 3; ++a)
    if (random() % 3 == 0) begin[a] = std::floor(begin[a]);
  return begin;
}

TEST(RayBeam, HoldsTheWalkOfEachRay) {
  std::mt19937_64 random(1);
  std::uniform_int_distribution low(-150, -1), high(0, 150);
  BeamCounts counts;
  for (int n = 0; n < kRandomBeams; ++n) {
    SCOPED_TRACE(n);
    const BeamBox box = {{low(random), low(random)}, {high(random), high(random)}};
    const Vec3 begin = some_begin(random);
    const std::vector<Vec3> along = some_directions(random);
    WatchedBeam beam(begin, along, box);
    ASSERT_NO_FATAL_FAILURE(beam.walk(random, counts));
  }
  EXPECT_GT(counts.broad, kRandomBeams / 20);
  EXPECT_GT(counts.missed, kRandomBeams / 20);
  EXPECT_GT(counts.started, kRandomBeams / 3);
  EXPECT_GT(counts.parted, kRandomBeams / 200);
  EXPECT_GT(counts.left, kRandomBeams);
  EXPECT_GT(counts.fell, kRandomBeams / 2);
  EXPECT_GT(counts.fell_partly, kRandomBeams / 4);
  EXPECT_GT(counts.stayed, kRandomBeams / 4);
  EXPECT_GT(counts.handed, kRandomBeams);
}

/// Comes down by one from (0.5, 0.5, 10) each time it goes on by three cells along x.
RayBeam sloping_beam() {
  RayBeam beam({0.5, 0.5, 10}, spans_of({{3, 0.25, -1}}));
  beam.start({0, 0}, {0, 0}, {63, 63});
  return beam;
}

TEST(RayBeam, DoesNotReachBackBehindWhereAllAre) {
  RayBeam beam = sloping_beam();
  ASSERT_TRUE(beam.fall_to({5, 5}, kRayLevels));
  ASSERT_EQ(beam.x(), 15);
  EXPECT_FALSE(beam.fall_to({4.9, 9}, kRayLevels));
  EXPECT_EQ(beam.t().low, 5);
  EXPECT_DOUBLE_EQ(beam.t().high, 5.1);
  EXPECT_EQ(beam.x(), 15);
  EXPECT_TRUE(beam.is_in_one(0));
}

TEST(RayBeam, StaysInOneCellWhereNoneFalls) {
  RayBeam beam = sloping_beam();
  ASSERT_TRUE(beam.fall_to({5, 5}, kRayLevels));
  EXPECT_FALSE(beam.fall_to({6, 9}, kRayLevels));
  EXPECT_EQ(beam.t().low, 5);
  EXPECT_EQ(beam.t().high, 5);
  EXPECT_EQ(beam.x(), 15);
  EXPECT_TRUE(beam.is_in_one(0));
}

TEST(RayBeam, SlowRaysAreNotNarrow) {
  for (int a = 0; a < 3; ++a) {
    for (const double sign : {-1.0, 1.0}) {
      Vec3 along(1, 1, -1);
      along[a] = sign * RayWalk::kLeastPlan;
      EXPECT_EQ(RayBeam(Vec3::Zero(), spans_of({along})).is_narrow(), a < 2 || sign < 0);
      along[a] /= 2;
      EXPECT_FALSE(RayBeam(Vec3::Zero(), spans_of({along})).is_narrow());
    }
  }
}

TEST(RayBeam, FarBeginsAreNotNarrow) {
  const auto along = spans_of({{1, 1, -1}});
  for (int a = 0; a < 3; ++a) {
    Vec3 begin = Vec3::Zero();
    begin[a] = -RayWalk::kFarthest / 2;
    EXPECT_TRUE(RayBeam(begin, along).is_narrow());
    begin[a] *= 2;
    EXPECT_FALSE(RayBeam(begin, along).is_narrow());
  }
}

}  // namespace
}  // namespace soilvdb::test
