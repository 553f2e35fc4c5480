// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The pose of a scan of a moving sensor, fitted to ground that nobody touched: rays are cast from
// the true pose, and told with another one.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <random>
#include <set>

#include "core/ground/ground_writer.h"
#include "core/survey/scan_state.h"
#include "tests/support/earthmoving_fixture.h"

namespace soilvdb::test {
namespace scan_pose_test {

constexpr double kVoxel_m = 0.05;
constexpr double kShift_m = 0.02, kTurn = 0.005;  // prior sigmas

/// By what told poses err: a shift, m, then a turn about the sensor, rad.
struct Off {
  Vec3 shift, turn;
};

Pose moved(const Pose& pose, const Off& off) {
  const double angle = off.turn.norm();
  const Eigen::Quaterniond turn(
      Eigen::AngleAxisd(angle, angle > 0 ? Vec3(off.turn / angle) : Vec3::UnitZ()));
  return {pose.position + off.shift, turn * pose.rotation};
}
Off between(const Pose& from, const Pose& to) {
  const Eigen::AngleAxisd turn(to.rotation * from.rotation.conjugate());
  return {to.position - from.position, turn.angle() * turn.axis()};
}

/// Hills at random, on posts that stand closer than columns.
class Rough final : public HeightSource {
 public:
  explicit Rough(std::uint64_t seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> any(0, 6);
    for (double& phase : phases_) phase = any(random);
  }
  void read(int x0, int y0, int nx, int ny, float* out) const override {
    for (int j = y0; j < y0 + ny; ++j)
      for (int i = x0; i < x0 + nx; ++i) {
        const double x = 0.025 * i, y = 0.025 * j;
        *out++ = static_cast<float>(
            0.05 * x +
            0.03 * std::sin(2.1 * x + 0.7 * y + phases_[0]) * std::sin(1.7 * y + phases_[1]) +
            0.015 * std::sin(4.3 * y - 2 * x + phases_[2]) * std::sin(3.1 * x + phases_[3]));
      }
  }

 private:
  std::array<double, 4> phases_;
};

std::shared_ptr<const InitialTerrain> rough(std::uint64_t seed) {
  return make_height_field({801, 801, {-10, -10}, {0.025, 0.025}}, std::make_shared<Rough>(seed));
}

/// Looks down at ground around it.
Sensor moving(Pose pose = {{0, 0, 3}, {0, 1, 0, 0}}) {
  Sensor sensor{.name = "moving", .pose = pose, .range_sigma_m = 0.01};
  sensor.mount_height_sigma_m = sensor.mount_tilt_sigma_rad = 0;
  sensor.pose_shift_sigma_m = kShift_m;
  sensor.pose_turn_sigma_rad = kTurn;
  return sensor;
}

struct Scan {
  explicit Scan(std::shared_ptr<const InitialTerrain> terrain)
      : ground(kVoxel_m, Vec3::Zero(), std::move(terrain)) {
    state.emplace(ground, std::vector<Bucket>{}, std::vector<double>{}, nullptr);
  }
  /// What a sensor sees from its true pose, as ends of rays of the told one.
  /// @param half of its view, as a slope
  ScanRays seen(const Pose& truth, const Pose& told, double half, double noise_m = 0) {
    std::vector<Vec3> ways;
    constexpr int kRays = 140;
    for (int i = 0; i < kRays; ++i)
      for (int j = 0; j < kRays; ++j)
        ways.push_back(
            Vec3(half * (2.0 * i / kRays - 1), half * (2.0 * j / kRays - 1), 1).normalized());
    std::vector<Vec3> true_ways;
    for (const Vec3& way : ways) true_ways.push_back(truth.rotation * way);
    std::vector<double> ranges(ways.size());
    state->map.cast(std::span(&truth.position, 1), true_ways, ranges).check();
    std::mt19937_64 random(1);
    std::normal_distribution<double> noise(0, 1);
    ScanRays rays;
    rays.resize(ways.size());
    for (std::size_t i = 0; i < ways.size(); ++i) {
      rays.set_way(i, told.rotation * ways[i]);
      rays.length_m[i] = static_cast<float>(ranges[i] + noise_m * noise(random));
    }
    return rays;
  }

  Ground ground;
  std::optional<ScanState> state;
};

void expect_same(const std::optional<Pose>& a, const std::optional<Pose>& b) {
  ASSERT_TRUE(a && b);
  EXPECT_EQ(a->position, b->position);
  EXPECT_EQ(a->rotation.coeffs(), b->rotation.coeffs());
}

constexpr double kWide = 1.1, kNarrow = 0.5;  // 6.6 m, and 3 m: at most 16 squares

class ScanPoses : public testing::TestWithParam<std::uint64_t> {
 protected:
  Off random_off() {
    std::mt19937_64 random(GetParam() + 100);
    std::uniform_real_distribution<double> any(-1, 1);
    const auto one = [&] { return Vec3(any(random), any(random), any(random)).normalized(); };
    return {kShift_m * one(), kTurn * one()};
  }
};

TEST_P(ScanPoses, AreFoundOnRoughGround) {
  Scan scan(rough(GetParam()));
  const Sensor sensor = moving();
  const Pose truth = moved(sensor.pose, random_off());
  ScanRays rays = scan.seen(truth, sensor.pose, kWide);
  const Off left = between(scan.state->fit_pose(sensor, rays).value(), truth);
  EXPECT_LT(left.shift.norm(), 1e-3) << left.shift.transpose();
  EXPECT_LT(left.turn.norm(), 2e-4) << left.turn.transpose();
  // Rays are turned with it.
  const ScanRays there = scan.seen(truth, truth, kWide);
  for (std::size_t i = 0; i < rays.count(); ++i)
    EXPECT_LT((rays.way(i) - there.way(i)).cwiseAbs().maxCoeff(), 2e-4);
}

TEST_P(ScanPoses, AreTheSameInAnyOrderOfRays) {
  Scan scan(rough(GetParam()));
  const Sensor sensor = moving();
  ScanRays rays = scan.seen(moved(sensor.pose, random_off()), sensor.pose, kWide, 0.01);
  std::vector<std::size_t> order(rays.count());
  std::iota(order.begin(), order.end(), 0);
  std::shuffle(order.begin(), order.end(), std::mt19937_64(GetParam()));
  ScanRays mixed = rays;
  for (std::size_t i = 0; i < order.size(); ++i) {
    mixed.set_way(i, rays.way(order[i]));
    mixed.length_m[i] = rays.length_m[order[i]];
  }
  const std::optional<Pose> one = scan.state->fit_pose(sensor, rays);
  expect_same(one, scan.state->fit_pose(sensor, mixed));
  EXPECT_NE(one->position, sensor.pose.position);
}

// Level ground tells a height and two tilts; the rest stays as it was told.
TEST_P(ScanPoses, StayWhereGroundDoesNotTellThem) {
  Scan scan(make_plane(0.0, {0, 0}));
  const Sensor sensor = moving();
  const Off off = random_off();
  ScanRays rays = scan.seen(moved(sensor.pose, off), sensor.pose, kWide);
  const Off found = between(sensor.pose, scan.state->fit_pose(sensor, rays).value());
  EXPECT_LT(found.shift.head<2>().norm(), 1e-4) << found.shift.transpose();
  EXPECT_LT(std::abs(found.turn.z()), 5e-5) << found.turn.transpose();
  EXPECT_NEAR(found.shift.z(), off.shift.z(), 1e-3);
  EXPECT_NEAR(found.turn.x(), off.turn.x(), 2e-4);
  EXPECT_NEAR(found.turn.y(), off.turn.y(), 2e-4);
}

TEST_P(ScanPoses, AreNotFoundIfTooLittleGroundIsSeen) {
  Scan scan(rough(GetParam()));
  const Sensor sensor = moving();
  for (const double half : {kNarrow, kWide}) {
    const ScanRays before = scan.seen(moved(sensor.pose, random_off()), sensor.pose, half);
    ScanRays rays = before;
    const bool is_found = scan.state->fit_pose(sensor, rays).has_value();
    EXPECT_EQ(is_found, half == kWide);
    if (is_found) continue;
    EXPECT_EQ(rays.x, before.x);
    EXPECT_EQ(rays.y, before.y);
    EXPECT_EQ(rays.z, before.z);
  }
}

/// The same rays, but those of which `is_left_out` says so of their ends, from the sensor's place.
template <typename F>
ScanRays without(const ScanRays& rays, const Pose& told, const F& is_left_out) {
  ScanRays left = rays;
  std::size_t count = 0;
  for (std::size_t i = 0; i < rays.count(); ++i) {
    if (!is_left_out(Vec3(told.position + rays.length_m[i] * rays.way(i)))) left.copy(i, count++);
  }
  left.resize(count);
  return left;
}

// Ground that is not as it always was, steep or beside an edge tells nothing: as if no ray had met
// it.
TEST_P(ScanPoses, AreOfStableGroundAlone) {
  using Change = void (*)(ScanTile&, std::size_t);
  const std::vector<Change> changes = {
      [](ScanTile& tile, std::size_t i) { tile.columns[i].origin = kFirstMachine; },
      [](ScanTile& tile, std::size_t i) { tile.columns[i].origin = kSurveyed; },
      [](ScanTile& tile, std::size_t i) { tile.columns[i].first += 0.1; },
      [](ScanTile& tile, std::size_t i) {
        tile.columns[i].prior = kChangedSigmaM * kChangedSigmaM;
      },
      [](ScanTile& tile, std::size_t i) {
        tile.slopes[i] = {0.8, 0.8};
      },
      [](ScanTile& tile, std::size_t i) { tile.bends[i] = 2; }};
  const Sensor sensor = moving({{0, 0, 5}, {0, 1, 0, 0}});
  const Pose truth = moved(sensor.pose, random_off());
  for (const Change change : changes) {
    Scan scan(rough(GetParam()));
    const auto is_changed = [](int x) { return x >= 1; };  // tiles
    for (int x = -18; x < 18; ++x)
      for (int y = -18; y < 18; ++y)
        if (is_changed(x))
          for (std::size_t i = 0; i < BaseColumn::kCells; ++i)
            change(scan.state->tile({x * kChunkSide, y * kChunkSide}), i);
    ScanRays all = scan.seen(truth, sensor.pose, kWide, 0.01);
    // Beside the border a ray may meet either.
    const double border = (kChunkSide - 0.5) * kVoxel_m;
    all = without(all, sensor.pose, [&](const Vec3& p) { return std::abs(p.x() - border) < 0.15; });
    ScanRays some = without(all, sensor.pose, [&](const Vec3& p) { return p.x() > border; });
    ASSERT_LT(some.count(), 0.7 * static_cast<double>(all.count()));
    for (std::size_t i = 0; i < all.count(); ++i)  // it is higher than it is known to be
      if (sensor.pose.position.x() + all.length_m[i] * all.x[i] > border) all.length_m[i] -= 0.03F;
    expect_same(scan.state->fit_pose(sensor, all), scan.state->fit_pose(sensor, some));
  }
}

// Dust and machines tell nothing; if most rays end elsewhere, the scan is of other ground.
TEST_P(ScanPoses, AreNotThoseOfRaysThatEndElsewhere) {
  Scan scan(rough(GetParam()));
  const Sensor sensor = moving();
  const ScanRays clean = scan.seen(moved(sensor.pose, random_off()), sensor.pose, kWide, 0.01);
  for (const int elsewhere : {2, 3}) {  // of five
    ScanRays rays = clean, left = clean;
    std::size_t count = 0;
    for (std::size_t i = 0; i < rays.count(); ++i) {
      if (static_cast<int>(i % 5) < elsewhere)
        rays.length_m[i] -= 0.6F;
      else
        left.copy(i, count++);
    }
    left.resize(count);
    const std::optional<Pose> found = scan.state->fit_pose(sensor, rays);
    if (elsewhere == 2)
      expect_same(found, scan.state->fit_pose(sensor, left));
    else
      EXPECT_FALSE(found);
  }
}

TEST_P(ScanPoses, NeedTwentySquares) {
  Scan scan(rough(GetParam()));
  const Sensor sensor = moving();
  const ScanRays all = scan.seen(sensor.pose, sensor.pose, kWide);
  for (const int squares : {19, 20}) {
    std::set<std::pair<int, int>> seen;
    ScanRays rays = without(all, sensor.pose, [&](const Vec3& p) {
      const double x = p.x() + kVoxel_m / 2, y = p.y() + kVoxel_m / 2;  // columns' corners
      const double u = x - std::floor(x), v = y - std::floor(y);
      if (std::min({u, v, 1 - u, 1 - v}) < 0.1) return true;  // beside another square
      const std::pair square(static_cast<int>(std::floor(x)), static_cast<int>(std::floor(y)));
      if (static_cast<int>(seen.size()) < squares) seen.insert(square);
      return !seen.contains(square);
    });
    ASSERT_EQ(static_cast<int>(seen.size()), squares);
    EXPECT_EQ(scan.state->fit_pose(sensor, rays).has_value(), squares == 20);
  }
}

// The sigmas of a mount count as well, and errors of none are not looked for.
TEST_P(ScanPoses, HaveTheErrorsThatTheirSensorHas) {
  Scan scan(rough(GetParam()));
  Sensor sensor = moving();
  sensor.pose_shift_sigma_m = 0;
  sensor.mount_height_sigma_m = 0.02;
  const Off off{{0, 0, 0.015}, random_off().turn};
  ScanRays rays = scan.seen(moved(sensor.pose, off), sensor.pose, kWide);
  const Off found = between(sensor.pose, scan.state->fit_pose(sensor, rays).value());
  EXPECT_LT(found.shift.head<2>().norm(), 1e-4);
  EXPECT_NEAR(found.shift.z(), 0.015, 1e-3);
  EXPECT_LT((found.turn - off.turn).norm(), 4e-4);
}

// What is far beyond its sigmas is no error of the pose: axes or place are wrong.
TEST_P(ScanPoses, AreNotFoundFarBeyondTheirSigmas) {
  Scan scan(rough(GetParam()));
  Sensor sensor = moving();
  const Off off{{0, 0, 0.15}, {0, 0, 0}};
  const ScanRays told = scan.seen(moved(sensor.pose, off), sensor.pose, kWide);
  for (const double sigma_m : {0.02, 0.06}) {
    sensor.pose_shift_sigma_m = sigma_m;
    sensor.range_sigma_m = 0.05;  // so that rays may count
    ScanRays rays = told;
    EXPECT_EQ(scan.state->fit_pose(sensor, rays).has_value(), sigma_m > 0.03);
  }
}

INSTANTIATE_TEST_SUITE_P(Random, ScanPoses, testing::Range<std::uint64_t>(0, 3));

}  // namespace scan_pose_test
}  // namespace soilvdb::test
