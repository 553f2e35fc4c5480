// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Forward kinematics against closed forms and plain 4x4 matrices written out by hand.
#include "soilvdb/kinematics.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <numbers>

#include "soilvdb/io/urdf.h"

namespace soilvdb {
namespace kinematics_test {

constexpr double kRounding = 1e-12;  // m and rad, for chains of a few metres
constexpr double kPi = std::numbers::pi;

using Matrix = Eigen::Matrix4d;

Matrix translation(double x, double y, double z) {
  Matrix m = Matrix::Identity();
  m(0, 3) = x, m(1, 3) = y, m(2, 3) = z;
  return m;
}
Matrix about_x(double a) {
  Matrix m = Matrix::Identity();
  m(1, 1) = m(2, 2) = std::cos(a), m(2, 1) = std::sin(a), m(1, 2) = -std::sin(a);
  return m;
}
Matrix about_y(double a) {
  Matrix m = Matrix::Identity();
  m(0, 0) = m(2, 2) = std::cos(a), m(0, 2) = std::sin(a), m(2, 0) = -std::sin(a);
  return m;
}
Matrix about_z(double a) {
  Matrix m = Matrix::Identity();
  m(0, 0) = m(1, 1) = std::cos(a), m(1, 0) = std::sin(a), m(0, 1) = -std::sin(a);
  return m;
}

void expect_same(const Pose& pose, const Matrix& expected, double tolerance = kRounding) {
  EXPECT_LT((pose.position - expected.topRightCorner<3, 1>()).norm(), tolerance)
      << pose.position.transpose() << " instead of " << expected.topRightCorner<3, 1>().transpose();
  EXPECT_LT((pose.rotation.toRotationMatrix() - expected.topLeftCorner<3, 3>()).norm(), tolerance);
}

Joint joint(Joint::Type type, Vec3 axis, Vec3 origin, Vec3 rpy = Vec3::Zero()) {
  Joint j;
  j.name = "joint";
  j.type = type;
  j.axis = axis;
  j.parent_from_joint = {origin, from_rpy(rpy.x(), rpy.y(), rpy.z())};
  return j;
}

TEST(FromRpy, TurnsAboutFixedXThenYThenZ) {
  const double roll = 0.3, pitch = -0.7, yaw = 2.1;
  const Matrix expected = about_z(yaw) * about_y(pitch) * about_x(roll);
  expect_same({Vec3::Zero(), from_rpy(roll, pitch, yaw)}, expected);
}

TEST(FromRpy, PositivePitchLowersTheNose) {
  EXPECT_LT((from_rpy(0, 0.5, 0) * Vec3::UnitX()).z(), 0);
}

TEST(Chain, APlanarArmOfTwoLinksFollowsItsClosedForm) {
  const double l1 = 3, l2 = 2;
  Chain chain;
  chain.joints = {joint(Joint::Type::kRevolute, Vec3::UnitZ(), {0, 0, 0}),
                  joint(Joint::Type::kContinuous, Vec3::UnitZ(), {l1, 0, 0})};
  chain.link_from_bucket.position = {l2, 0, 0};
  for (double a : {-2.0, 0.0, 0.4, 3.0}) {
    for (double b : {-1.0, 0.0, 2.5}) {
      const Pose tip = chain.world_from_bucket(std::array{a, b});
      const Vec3 expected(l1 * std::cos(a) + l2 * std::cos(a + b),
                          l1 * std::sin(a) + l2 * std::sin(a + b), 0);
      EXPECT_LT((tip.position - expected).norm(), kRounding);
      EXPECT_LT((tip.rotation * Vec3::UnitX() - Vec3(std::cos(a + b), std::sin(a + b), 0)).norm(),
                kRounding);
    }
  }
}

TEST(Chain, APrismaticJointMovesAlongItsTurnedAxis) {
  Chain chain;
  chain.joints = {joint(Joint::Type::kPrismatic, Vec3::UnitX(), {1, 2, 3}, {0, 0, kPi / 2})};
  const Pose tip = chain.world_from_bucket(std::array{0.75});
  EXPECT_LT((tip.position - Vec3(1, 2.75, 3)).norm(), kRounding);
}

TEST(Chain, FixedJointsTakeNoValue) {
  Chain chain;
  chain.joints = {joint(Joint::Type::kFixed, Vec3::UnitX(), {1, 0, 0}),
                  joint(Joint::Type::kRevolute, Vec3::UnitY(), {0, 0, 1}),
                  joint(Joint::Type::kFixed, Vec3::UnitX(), {0, 1, 0})};
  chain.joints[1].name = "boom";
  EXPECT_EQ(chain.movable(), std::vector<std::string>{"boom"});
  expect_same(chain.world_from_bucket(std::array{0.5}),
              translation(1, 0, 1) * about_y(0.5) * translation(0, 1, 0));
}

TEST(Chain, NoJointsAtAllIsTheBucketOnTheRoot) {
  Chain chain;
  chain.world_from_root = {Vec3(500000, 5400000, 100), from_rpy(0, 0, 1)};
  chain.link_from_bucket = {Vec3(0, 0, 2), from_rpy(0.1, 0.2, 0.3)};
  expect_same(chain.world_from_bucket({}),
              translation(500000, 5400000, 100) * about_z(1) * translation(0, 0, 2) * about_z(0.3) *
                  about_y(0.2) * about_x(0.1),
              1e-9);  // rounding of UTM coordinates
}

std::filesystem::path shared(const std::string& name) {
  const char* folder = std::getenv("SOILVDB_SHARED");
  const std::filesystem::path root =
      folder ? std::filesystem::path(folder)
             : std::filesystem::path(SOILVDB_SOURCE_DIR).parent_path() / "shared";
  return root / "data" / name;
}

// The numbers are those of zx120.urdf, multiplied out by hand.
TEST(Chain, ARealExcavatorIsWhereItsMatricesSay) {
  const auto file = shared("machine/zx120/zx120.urdf");
  if (!std::filesystem::exists(file)) GTEST_SKIP() << "no " << file;
  Chain chain = io::read_chain(file, "bucket_link");
  const std::vector<std::string> names = {"swing_joint", "boom_joint", "arm_joint", "bucket_joint"};
  ASSERT_EQ(chain.movable(), names);
  EXPECT_EQ(chain.joints[1].axis, Vec3::UnitZ()) << "its axis 0 0 2 is made unit";
  EXPECT_DOUBLE_EQ(chain.joints[2].lower, -1.2217304764);
  EXPECT_DOUBLE_EQ(chain.joints[2].upper, 0.767944870878);

  // At zero the boom's z points forward: 0.14 + 4.6 + 2.519 m ahead, 1 + 0.424 m up.
  const Pose zero = chain.world_from_bucket(std::array{0.0, 0.0, 0.0, 0.0});
  EXPECT_NEAR(zero.position.x(), 7.259, 1e-9);
  EXPECT_NEAR(zero.position.y(), -0.16443, 1e-9);
  EXPECT_NEAR(zero.position.z(), 1.424, 1e-9);

  const double s = 0.7, b = -0.4, a = 1.3, k = 0.9;
  chain.link_from_bucket = {Vec3(0, 0, 1.23), from_rpy(kPi, 0, 0)};
  expect_same(chain.world_from_bucket(std::array{s, b, a, k}),
              translation(0, 0, 1) * about_z(s) * translation(0.14, -0.16443, 0.424) *
                  about_y(1.57079632679 + b) * translation(0, 0, 4.6) * about_y(a) *
                  translation(0, 0, 2.519) * about_y(k) * translation(0, 0, 1.23) * about_x(kPi));
}

}  // namespace kinematics_test
}  // namespace soilvdb
