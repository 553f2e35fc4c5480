// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What the body behind the mouth displaces: nothing with a clearance, else what geometry says.
#include <gtest/gtest.h>

#include <cmath>

#include "core/tool/polygon.h"
#include "tests/support/dig_runner.h"
#include "tests/support/families.h"

namespace soilvdb::test {
namespace body_test {

constexpr double kVoxel = 0.025;
constexpr double kWidth = 0.6, kHeight = 0.4;
constexpr double kSigmas = 5;

const std::vector<Vec2> kCleared{{0, 0}, {-0.3, 0.08}, {-0.35, 0.3}, {0, kHeight}};
const std::vector<Vec2> kHeel{{0, 0}, {-0.3, -0.06}, {-0.35, 0.3}, {0, kHeight}};

Bucket bucket(const std::vector<Vec2>& profile) { return {kWidth, kHeight, profile, {}}; }
Pose at(double x, double z, double pitch = 0) { return {{x, 0, z}, from_rpy(0, pitch, 0)}; }

/// Placed off the grid, turned by 33 degrees.
const Pose kWorld{{0.0131, 0.0077, 0}, from_rpy(0, 0, 0.576)};

struct Site {
  Ground ground;
  Tracker tracker;
  explicit Site(const Bucket& b, double h = kVoxel)
      : ground(h, Vec3::Zero(), make_plane(0, {0, 0})), tracker(ground, {b}) {}
  void go(const Pose& pose) { tracker.update(0, kWorld * pose); }
  const Ledger& ledger() const { return tracker.ledger(0); }
  /// Five standard errors of what sampling gets wrong.
  double tolerance_m3() const { return kSigmas * count_error_m3(ground); }
};

const Terrain kFlat{[](const Vec2&) { return 0.0; }, true};
const Vec3 kLines{1, 0, -0.35};

/// The soil that mouth and body pass through, mouth alone and both, for a motion that starts in
/// air.
struct Truth {
  Volume mouth_alone, both;
  Truth(const Bucket& b, const std::function<Pose(double)>& pose,
        const std::vector<double>& kinks) {
    Sweep sweep{{mouth(b)}, pose, kinks};
    mouth_alone = planar_volume(sweep, kFlat, kLines, 4000, 1);
    for (const Blade& face : profile_faces(b)) sweep.blades.push_back(face);
    both = planar_volume(sweep, kFlat, kLines, 4000, 1);
  }
};

/// Straight in, along and out of the ground.
const std::vector<Pose> kDrag{at(-0.8, 0.2), at(-0.4, -0.15), at(0.6, -0.15), at(1.0, 0.2)};

Pose along(const std::vector<Pose>& knots, double t) {
  const double last = static_cast<double>(knots.size() - 1);
  const std::size_t i = std::min(static_cast<std::size_t>(t * last), knots.size() - 2);
  return interpolate(knots[i], knots[i + 1], t * last - static_cast<double>(i));
}

Truth truth_of(const Bucket& b, const std::vector<Pose>& knots) {
  std::vector<double> kinks;
  for (std::size_t i = 0; i < knots.size(); ++i) {
    kinks.push_back(static_cast<double>(i) / static_cast<double>(knots.size() - 1));
  }
  return {b, [knots](double t) { return along(knots, t); }, kinks};
}

TEST(Body, WithAClearanceDisplacesNothing) {
  Site site(bucket(kCleared));
  // The cut's floor rises behind the lip nowhere, and the body is above the lip's path throughout:
  // the way in falls by 0.875, steeper than the body's bottom rises; so start below the surface.
  for (const double x : {0.0, 0.3, 1.0}) site.go(at(x, -0.15));
  const std::int64_t stamped = site.ledger().displaced;
  EXPECT_GT(stamped, 0) << "the body starts in the ground";
  const std::int64_t captured = site.ledger().captured;
  site.go(at(1.6, -0.15));
  EXPECT_GT(site.ledger().captured, captured);
  EXPECT_EQ(site.ledger().displaced, stamped);
}

TEST(Body, ADraggedHeelDisplacesWhatLiesBelowTheLip) {
  Site site(bucket(kHeel));
  for (const Pose& pose : kDrag) site.go(pose);
  const Truth truth = truth_of(bucket(kHeel), kDrag);
  EXPECT_GT(truth.both.m3, 1.1 * truth.mouth_alone.m3);
  EXPECT_NEAR(site.ledger().cut_m3(), truth.both.m3,
              site.tolerance_m3() + truth.both.uncertainty_m3);
}

TEST(Body, DisplacesOnlyWhatTheMouthDidNotReachFirst) {
  // Level, from the air before a vertical face: the mouth leads everywhere, the heel comes after.
  const Bucket b = bucket(kHeel);
  Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
  Tracker tracker(ground, {Bucket{2, 2, {}, {}}, b});
  tracker.update(0, at(-2, -0.8));
  tracker.update(0, at(0, -0.8));  // a pit up to x = 0
  for (const double x : {-0.5, 0.0, 0.4, 0.9}) tracker.update(1, at(x, -0.15));
  const double travel = 0.9;
  const double captured = kWidth * travel * 0.15;
  // The heel's lowest point trails by 0.3 m; before it the bottom rises to the lip.
  const double displaced = kWidth * (0.06 * (travel - 0.3) + 0.06 * 0.3 / 2);
  const double tolerance = kSigmas * count_error_m3(ground);
  EXPECT_NEAR(tracker.ledger(1).captured_m3(), captured, tolerance);
  EXPECT_NEAR(tracker.ledger(1).displaced_m3(), displaced, tolerance);
}

TEST(Body, BackingIntoABankDisplacesIt) {
  // Against the digging direction the back of the body leads; what it took the mouth can't capture,
  // however the way is split.
  for (const int updates : {1, 3, 40}) {
    Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
    Tracker tracker(ground, {Bucket{2, 2, {}, {}}, bucket(kCleared)});
    tracker.update(0, at(2, -0.8));
    tracker.update(0, at(0, -0.8));  // a pit from x = 0 on
    for (int i = 0; i <= updates; ++i) tracker.update(1, at(0.6 - 1.4 * i / updates, -0.35));
    EXPECT_GT(tracker.ledger(1).displaced, 0) << updates;
    EXPECT_EQ(tracker.ledger(1).captured, 0) << "updates: " << updates;
  }
}

TEST(Body, ACurlWithAHeelCutsTheUnionOfMouthAndBody) {
  const Bucket b = bucket(kHeel);
  const std::vector<Pose> knots{at(-0.6, 0.2), at(-0.3, -0.2), at(0.5, -0.22), at(0.8, 0.3, -0.9)};
  Site site(b);
  for (const Pose& pose : knots) site.go(pose);
  const Truth truth = truth_of(b, knots);
  EXPECT_NEAR(site.ledger().cut_m3(), truth.both.m3,
              site.tolerance_m3() + truth.both.uncertainty_m3);
  EXPECT_LE(site.ledger().captured_m3(),
            truth.mouth_alone.m3 + site.tolerance_m3() + truth.mouth_alone.uncertainty_m3);
}

TEST(Body, SwungSidewaysCutsWithItsSides) {
  // Straight along y, the mouth edge-on: only the side of the body cuts, from face to face.
  const Bucket b = bucket(kCleared);
  Ground ground(kVoxel, Vec3::Zero(), make_plane(1, {0, 0}));  // all under ground
  Tracker tracker(ground, {b});
  tracker.update(0, Pose{{0.0131, 0.0077, 0.003}, Eigen::Quaterniond::Identity()});
  double area = 0;  // shoelace
  for (std::size_t i = 0; i < kCleared.size(); ++i) {
    const Vec2 &p = kCleared[i], &q = kCleared[(i + 1) % kCleared.size()];
    area += (q.x() * p.y() - p.x() * q.y()) / 2;
  }
  area = std::abs(area);
  const double tolerance = kSigmas * std::sqrt(2) * count_error_m3(ground);
  EXPECT_NEAR(tracker.ledger(0).displaced_m3(), kWidth * area, tolerance) << "where it starts";
  tracker.update(0, Pose{{0.0131, 1.0077, 0.003}, Eigen::Quaterniond::Identity()});
  EXPECT_EQ(tracker.ledger(0).captured, 0);
  EXPECT_NEAR(tracker.ledger(0).displaced_m3(), (kWidth + 1.0) * area, 2 * tolerance);
}

class ThinPlate : public ::testing::TestWithParam<double> {};

TEST_P(ThinPlate, NeitherLosesNorInventsSoil) {
  // A plate that stands behind the mouth, far thinner than a voxel.
  const double t = GetParam();
  const Bucket b = bucket({{0, 0}, {-t, 0}, {-t, kHeight}, {0, kHeight}});
  const std::vector<Pose> knots{at(-0.8, 0.2), at(-0.4, -0.15), at(0.6, -0.15), at(1.0, 0.2)};
  Site site(b), without(bucket({}));
  for (const Pose& pose : knots) {
    site.go(pose);
    without.go(pose);
  }
  const Truth truth = truth_of(b, knots);
  EXPECT_NEAR(site.ledger().cut_m3(), truth.both.m3,
              site.tolerance_m3() + truth.both.uncertainty_m3);
  // The plate's lower rear edge cuts a strip on the way in, no more; the mouth gets the rest.
  EXPECT_LE(site.ledger().captured, without.ledger().captured);
  EXPECT_GE(site.ledger().captured + site.ledger().displaced, without.ledger().captured);
  EXPECT_LE(std::abs(site.ground.change_m3() + site.ledger().cut_m3()),
            1e-9 * site.ledger().cut_m3());
}

TEST_P(ThinPlate, PressedIntoTheGroundLeavesASlot) {
  const double t = GetParam(), depth = 0.3;
  const Bucket b = bucket({{0, 0}, {-t, 0}, {-t, kHeight}, {0, kHeight}});
  Site site(b);
  site.go(at(0, 0.1));
  site.go(at(0, -depth));
  // Thinner than a voxel, every cell is a border cell: samples of a slot t wide are few.
  const double slot = kWidth * depth * t;
  const double cells = kWidth * depth / (kVoxel * kVoxel) * 2;
  const double sample = std::pow(kVoxel, 3) / 64;
  const double per_cell = 64 * std::min(1.0, t / kVoxel);
  EXPECT_NEAR(site.ledger().cut_m3(), slot, kSigmas * sample * std::sqrt(cells * per_cell));
  EXPECT_EQ(site.ledger().cut_m3(), -site.ground.change_m3());
}

INSTANTIATE_TEST_SUITE_P(OfMillimetres, ThinPlate, ::testing::Values(0.001, 0.002, 0.005),
                         [](const auto& plate) {
                           return std::to_string(static_cast<int>(plate.param * 1000 + 0.5));
                         });

TEST(Body, PlacedInTheGroundTakesItsOwnVolume) {
  const Bucket b = bucket(kCleared);
  const Pose deep = kWorld * Pose{{0, 0, -2}, from_rpy(0.3, 0.7, 0)};
  Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
  Tracker tracker(ground, {b});
  tracker.update(0, deep);
  const double area = (0.3 * 0.3 + 0.35 * (0.4 - 0.08)) / 2;  // half the diagonals' cross product
  const double tolerance = kSigmas * count_error_m3(ground);
  EXPECT_NEAR(tracker.ledger(0).displaced_m3(), kWidth * area, tolerance);
  EXPECT_EQ(tracker.ledger(0).captured, 0);
  EXPECT_EQ(tracker.update(0, deep).cut_m3, 0) << "it is there already";
}

}  // namespace body_test
}  // namespace soilvdb::test
