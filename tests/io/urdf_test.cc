// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What is read from a URDF, and the one line said about each way to get it wrong.
#include "soilvdb/io/urdf.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <numbers>
#include <random>
#include <thread>

#include "io/mesh/mesh_boxes.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::io {
namespace urdf_test {

using test::TempFolder;

/// A machine a - slide - b - JOINT - c, with a thumb beyond c.
std::string machine(const std::string& joint) {
  return R"(<?xml version="1.0"?>
<robot name="m">
  <link name="a"><visual><geometry><mesh filename="package://nowhere/a.dae"/></geometry></visual></link>
  <link name="b"/><link name="c"/><link name="d"/>
  <!-- <joint name="turn" type="fixed"> is a comment -->
  <joint name="slide" type="prismatic">
    <parent link="a"/><child link="b"/><origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/>
    <axis xyz="0 3 4"/><limit lower="-0.5" upper="1.5" effort="1" velocity="1"/>
  </joint>
  )" + joint +
         R"(
  <joint name="thumb" type="planar"><parent link="c"/><child link="d"/></joint>
</robot>
)";
}

const std::string kTurn =
    R"(<joint name="turn" type="continuous"><parent link="b"/><child link="c"/></joint>)";

class Urdf : public ::testing::Test {
 protected:
  Chain read(const std::string& content, const std::string& link = "c") {
    return read_chain(folder_.write("m.urdf", content), link);
  }
  std::string error(const std::string& content, const std::string& link = "c") {
    ::testing::internal::CaptureStderr();
    ::testing::internal::CaptureStdout();
    const auto message = test::message_of(folder_, [&] { read(content, link); });
    EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
    EXPECT_EQ(::testing::internal::GetCapturedStdout(), "");
    EXPECT_EQ(message.find('\n'), message.npos);
    return message;
  }

  TempFolder folder_;
};

TEST_F(Urdf, TheChainRunsFromTheRootToTheLinkAndNoFurther) {
  const Chain chain = read(machine(kTurn));
  ASSERT_EQ(chain.movable(), (std::vector<std::string>{"slide", "turn"}));
  EXPECT_EQ(read(machine(kTurn), "b").movable(), std::vector<std::string>{"slide"});
  EXPECT_TRUE(read(machine(kTurn), "a").joints.empty());
}

TEST_F(Urdf, OriginsAxesAndLimitsAreTheJoints) {
  const Chain chain = read(machine(kTurn));
  const Joint& slide = chain.joints[0];
  EXPECT_EQ(slide.type, Joint::Type::kPrismatic);
  EXPECT_EQ(slide.parent_from_joint.position, Vec3(1, 2, 3));
  EXPECT_TRUE((slide.parent_from_joint.rotation * Vec3::UnitX()).isApprox(Vec3::UnitY(), 1e-12));
  EXPECT_TRUE(slide.axis.isApprox(Vec3(0, 0.6, 0.8), 1e-15)) << "made unit";
  EXPECT_EQ(slide.lower, -0.5);
  EXPECT_EQ(slide.upper, 1.5);
  EXPECT_EQ(slide.fastest, 1);
  EXPECT_EQ(chain.joints[1].fastest, 0) << "it has none";
  EXPECT_EQ(chain.joints[1].type, Joint::Type::kContinuous);
  EXPECT_EQ(chain.joints[1].axis, Vec3::UnitX()) << "the default of URDF";
}

TEST_F(Urdf, AnAxisGivesADirectionWhateverItsLength) {
  const auto about = [&](const std::string& axis) {
    return read(machine(R"(<joint name="turn" type="continuous"><parent link="b"/>
      <child link="c"/><axis xyz=")" +
                        axis + "\"/></joint>"))
        .world_from_bucket(std::array{0.3, 0.9});
  };
  const Pose unit = about("0 0 1");
  for (const char* axis : {"0 0 0.25", "0 0 1e-6", "0 0 40"}) {
    const Pose pose = about(axis);
    EXPECT_EQ(pose.position, unit.position) << axis;
    EXPECT_TRUE(pose.rotation.isApprox(unit.rotation, 1e-15)) << axis;
  }
  // The slide's z stays; the turn adds to the quarter turn of its origin.
  EXPECT_TRUE(unit.rotation.isApprox(from_rpy(0, 0, 1.5707963267948966 + 0.9), 1e-12));
  EXPECT_EQ(error(machine(R"(<joint name="turn" type="continuous"><parent link="b"/>
      <child link="c"/><axis xyz="0 1e-12 0"/></joint>)")),
            "m.urdf:10: joint 'turn' has the axis 0 1e-12 0; it must have a direction");
}

TEST_F(Urdf, VelocityLimitsAreTakenWhereTheyAreAny) {
  const auto fastest = [&](const std::string& velocity) {
    return read(machine(R"(<joint name="turn" type="continuous"><parent link="b"/>
      <child link="c"/><limit effort="1" velocity=")" +
                        velocity + "\"/></joint>"))
        .joints[1]
        .fastest;
  };
  EXPECT_EQ(fastest("0.5"), 0.5);
  EXPECT_EQ(fastest("0"), 0);
  EXPECT_EQ(fastest("1e12"), 0);
  EXPECT_EQ(
      test::message_of(folder_, [&] { fastest("fast"); }),
      "m.urdf:11: joint 'turn' has velocity=\"fast\" in <limit>; it must be a number of rad/s "
      "or m/s");
}

TEST_F(Urdf, AMissingLinkNamesTheNearest) {
  const std::string content = R"(<robot name="m"><link name="boom_link"/></robot>)";
  EXPECT_EQ(error(content, "bom_link"), "no link 'bom_link' in m.urdf; did you mean 'boom_link'?");
  EXPECT_EQ(error(R"(<robot name="m"><link name="bucket_end_link"/><link name="bucket_link"/>
                     <link name="bracket"/></robot>)",
                  "bucket"),
            "no link 'bucket' in m.urdf; did you mean 'bucket_link'?");
}

TEST_F(Urdf, JointsThatCantBeDrivenByOneNumber) {
  const auto of_type = [&](const std::string& type) {
    return error(machine("<joint name=\"turn\" type=\"" + type +
                         "\"><parent link=\"b\"/><child link=\"c\"/></joint>"));
  };
  EXPECT_EQ(of_type("floating"),
            "m.urdf:10: joint 'turn' is floating; it must be fixed, revolute, continuous or "
            "prismatic");
  EXPECT_EQ(
      of_type("planar"),
      "m.urdf:10: joint 'turn' is planar; it must be fixed, revolute, continuous or prismatic");
}

TEST_F(Urdf, JointsThatMimicOthersFollowThem) {
  const auto link = [](const std::string& name) { return "<link name=\"" + name + "\"/>"; };
  const auto slide = [](const std::string& name, const std::string& parent,
                        const std::string& child, const std::string& mimic) {
    return "<joint name=\"" + name + "\" type=\"prismatic\"><parent link=\"" + parent +
           "\"/><child link=\"" + child + "\"/><axis xyz=\"1 0 0\"/>" +
           "<limit lower=\"0\" upper=\"9\" effort=\"1\" velocity=\"1\"/>" + mimic + "</joint>\n";
  };
  // A boom of three stages: the second goes half as far as the first, the third follows that; and
  // a tip that follows a cylinder beside the way.
  const std::string robot =
      "<robot name=\"m\">" + link("a") + link("b") + link("c") + link("d") + link("e") + link("f") +
      "\n" + slide("first", "a", "b", "") +
      slide("second", "b", "c", R"(<mimic joint="first" multiplier="0.5" offset="0.1"/>)") +
      slide("third", "c", "d", R"(<mimic joint="second" multiplier="2"/>)") +
      slide("tip", "d", "e", R"(<mimic joint="cylinder" multiplier="-1" offset="3"/>)") +
      slide("cylinder", "a", "f", "") + "</robot>";
  const Chain chain = read_chain(folder_.write("m.urdf", robot), "e");
  EXPECT_EQ(chain.movable(), (std::vector<std::string>{"first", "cylinder"}));
  for (const double first : {0.0, 1.0, 2.5}) {
    const double second = 0.5 * first + 0.1, third = 2 * second, tip = 3 - 0.4;
    EXPECT_NEAR(chain.world_from_bucket(std::vector<double>{first, 0.4}).position.x(),
                first + second + third + tip, 1e-12);
  }
  const auto mimics = [&](const std::string& name) {
    return error("<robot name=\"m\">" + link("a") + link("b") + "\n" +
                     slide("boom", "a", "b", "<mimic joint=\"" + name + "\"/>") + "</robot>",
                 "b");
  };
  EXPECT_EQ(
      mimics("bom"),
      "m.urdf:2: joint 'boom' mimics joint 'bom', which does not exist; did you mean 'boom'?");
  EXPECT_EQ(mimics("boom"), "m.urdf:2: joint 'boom' mimics itself, through other joints");
}

/// An arm that turns about z at (1, 0, 0), a claw fixed to it that a finger turns on, and a wheel.
std::string arm(const std::string& of_base, const std::string& of_arm, const std::string& of_claw) {
  const auto turn = [](const std::string& name, const std::string& parent, const std::string& child,
                       const std::string& more) {
    return "<joint name=\"" + name + "\" type=\"continuous\"><parent link=\"" + parent +
           "\"/><child link=\"" + child + "\"/><axis xyz=\"0 0 1\"/>" + more + "</joint>";
  };
  const std::string ball = R"(<collision><geometry><sphere radius="0.5"/></geometry></collision>)";
  return "<robot name=\"m\"><link name=\"base\">" + of_base + "</link><link name=\"arm\">" +
         of_arm + "</link><link name=\"claw\">" + of_claw + "</link>\n<link name=\"wheel\">" +
         ball + "</link><link name=\"finger\">" + ball + "</link><link name=\"bucket\"/>" +
         turn("swing", "base", "arm", R"(<origin xyz="1 0 0"/>)") +
         R"(<joint name="weld" type="fixed"><parent link="arm"/><child link="claw"/>
            <origin xyz="2 0 0" rpy="0 0 1.5707963267948966"/></joint>)" +
         turn("rolls", "base", "wheel", "") +
         turn("grips", "claw", "finger",
              R"(<origin xyz="0 3 0"/><mimic joint="swing" multiplier="-0.5"/>)") +
         R"(<joint name="end" type="fixed"><parent link="arm"/><child link="bucket"/></joint></robot>)";
}

/// The corners of the boxes of all bodies, in the order of x, y, z.
std::vector<Vec3> corners_of(const std::vector<PlacedBoxes>& bodies) {
  std::vector<Vec3> corners;
  for (const PlacedBoxes& body : bodies)
    for (const Eigen::AlignedBox3d& box : body.boxes_m)
      for (int i = 0; i < 8; ++i)
        corners.push_back(body.world_from_boxes *
                          box.corner(static_cast<Eigen::AlignedBox3d::CornerType>(i)));
  return corners;
}
/// The smallest box about all, world.
Eigen::AlignedBox3d around(const std::vector<PlacedBoxes>& bodies) {
  Eigen::AlignedBox3d all;
  for (const Vec3& corner : corners_of(bodies)) all.extend(corner);
  return all;
}
void expect_box(const Eigen::AlignedBox3d& box, const Vec3& low, const Vec3& high) {
  EXPECT_LT((box.min() - low).cwiseAbs().maxCoeff(), 1e-9) << box.min().transpose();
  EXPECT_LT((box.max() - high).cwiseAbs().maxCoeff(), 1e-9) << box.max().transpose();
}

TEST_F(Urdf, ShapesOfLinksAreWhereTheJointsPutThem) {
  const std::string seen = R"(<visual><geometry><sphere radius="9"/></geometry></visual>)";
  const std::string base = seen + R"(<collision><origin xyz="0 0 1"/><geometry>
      <cylinder radius="0.5" length="4"/></geometry></collision>)";
  const std::string beam = R"(<visual><origin xyz="1 0 0"/><geometry><box size="2 0.2 0.4"/>
      </geometry></visual>)";
  const std::string claw = R"(<collision><origin xyz="0 0 0" rpy="0 0 0"/><geometry>
      <box size="0.6 0.2 0.2"/></geometry></collision>
      <collision><origin xyz="0 0 5"/><geometry><sphere radius="0.1"/></geometry></collision>)";
  Chain chain = read(arm(base, beam, claw), "bucket");
  chain.world_from_root = {{100, 0, 0}, from_rpy(0, 0, 0)};
  ASSERT_EQ(chain.movable(), std::vector<std::string>{"swing"});
  const double quarter = std::numbers::pi / 2;
  const std::vector<PlacedBoxes> bodies = chain.placed_bodies(std::array{quarter});
  // The arm, the base's collision alone, the claw's two, and the finger, which follows the swing;
  // not the wheel, which turns by a joint of its own.
  ASSERT_EQ(bodies.size(), 5);
  expect_box(around({bodies[0]}), {100.9, 0, -0.2}, {101.1, 2, 0.2});
  expect_box(around({bodies[1]}), {99.5, -0.5, -1}, {100.5, 0.5, 3});
  expect_box(around({bodies[2]}), {100.7, 1.9, -0.1}, {101.3, 2.1, 0.1});
  expect_box(around({bodies[3]}), {100.9, 1.9, 4.9}, {101.1, 2.1, 5.1});
  // 3 m along the claw's y, which points to -y; about it the box of a ball, turned by an eighth.
  const double half = std::sqrt(0.5);
  expect_box(around({bodies[4]}), {101 - half, -1 - half, -0.5}, {101 + half, -1 + half, 0.5});
  // Where the base drives to, they follow.
  std::vector<double> driven = {quarter};
  Chain::add_base(driven, {{-7, 0, 0}, from_rpy(0, 0, std::numbers::pi)});
  expect_box(around({chain.placed_bodies(driven)[0]}), {-8.1, -2, -0.2}, {-7.9, 0, 0.2});
  EXPECT_EQ(chain.bodies->take_warning(), "");
  EXPECT_TRUE(Chain().placed_bodies({}).empty());
}

TEST_F(Urdf, ShapesOfMeshesCoverThem) {
  std::filesystem::create_directories(folder_ / "robot/meshes");
  std::filesystem::create_directories(folder_ / "robot/urdf");
  folder_.write("robot/meshes/tip.obj",
                "v 0 0 0\nv 2000 0 0\nv 0 1000 0\nv 0 0 500\n"
                "f 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n");
  const auto mesh = [](const std::string& file) {
    return "<collision><geometry><mesh filename=\"" + file +
           "\" scale=\"0.001 0.001 -0.001\"/></geometry></collision>";
  };
  for (const std::string& file :
       {std::string("package://robot/meshes/tip.obj"), std::string("../meshes/tip.obj"),
        "file://" + (folder_ / "robot/meshes/tip.obj").string()}) {
    const auto urdf = folder_.write("robot/urdf/m.urdf", arm(mesh(file), "", ""));
    const Chain chain = read_chain(urdf, "bucket");
    const std::vector<PlacedBoxes> bodies = chain.placed_bodies(std::array{0.0});
    ASSERT_EQ(bodies.size(), 2) << file << chain.bodies->take_warning();
    expect_box(around({bodies[0]}), {0, 0, -0.5}, {2, 1, 0});
  }
}

// A package's folder may have another name, and whoever passes a machine on may put all in one.
TEST_F(Urdf, MeshesOfAPackageAreFoundBesideTheUrdf) {
  const auto length = [&](const std::string& urdf) {  // of the arm
    const std::string mesh =
        R"(<collision><geometry><mesh filename="package://digger/meshes/tip.obj"/></geometry></collision>)";
    const Chain chain = read_chain(folder_.write(urdf, arm(mesh, "", "")), "bucket");
    const std::vector<PlacedBoxes> bodies = chain.placed_bodies(std::array{0.0});
    return bodies.size() == 2 ? around({bodies[0]}).max().x() : 0.0;
  };
  double longer = 0;
  for (const char* place :
       {"clone/urdf/tip.obj", "clone/meshes/tip.obj", "clone/urdf/meshes/tip.obj",
        "clone/digger/meshes/tip.obj"}) {  // the last goes first
    std::filesystem::create_directories((folder_ / place).parent_path());
    EXPECT_NEAR(length("clone/urdf/m.urdf"), longer, 1e-6) << place;
    folder_.write(place, fmt::format("v 0 0 0\nv {} 0 0\nv 0 1 0\nv 0 0 1\n"
                                     "f 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n",
                                     ++longer));
    EXPECT_NEAR(length("clone/urdf/m.urdf"), longer, 1e-6) << place;
  }
}

TEST_F(Urdf, LinksWhoseJointsCantBeReadAreSaid) {
  const std::string box = R"(<collision><geometry><box size="1 1 1"/></geometry></collision>)";
  const auto said = [&](const std::string& joint) {
    const auto file =
        folder_.write("m.urdf", R"(<robot name="m"><link name="base"/><link name="tank">)" + box +
                                    R"(</link><link name="bucket"/>
<joint name="end" type="fixed"><parent link="base"/><child link="bucket"/></joint>
<joint name="holds" type=)" + joint +
                                    R"(<parent link="base"/><child link="tank"/></joint></robot>)");
    const Chain chain = read_chain(file, "bucket");
    return chain.bodies->take_warning();
  };
  EXPECT_EQ(said(R"("fixed">)"), "");
  EXPECT_EQ(said(R"("floating">)"), "") << "no number places it";
  EXPECT_NE(said(R"("">)").find("has no type"), std::string::npos);
  EXPECT_NE(said(R"("fixed"><origin xyz="0 0 abc"/>)").find("'abc'"), std::string::npos);
}

TEST_F(Urdf, ShapesThatCantBeReadAreSaidOnceAndTheOthersCount) {
  const auto collision = [](const std::string& shape) {
    return "<collision><geometry>" + shape + "</geometry></collision>";
  };
  const std::string good = collision(R"(<box size="1 1 1"/>)");
  const auto warning = [&](const std::string& bad) {
    const auto file = folder_.write("m.urdf", arm("", bad + good, ""));
    const Chain chain = read_chain(file, "bucket");
    EXPECT_EQ(chain.placed_bodies(std::array{0.0}).size(), 2);
    const std::string said = chain.bodies->take_warning();
    EXPECT_EQ(chain.bodies->take_warning(), "");
    const std::string begin = file.string() +
                              ": 1 shape of links can't be read, so that scans take it for ground "
                              "(first: " +
                              file.string() + ":1: ";
    EXPECT_TRUE(said.starts_with(begin)) << said;
    EXPECT_TRUE(said.ends_with(")")) << said;
    return said.starts_with(begin) ? said.substr(begin.size(), said.size() - begin.size() - 1) : "";
  };
  EXPECT_EQ(warning(collision(R"(<box size="1 0 1"/>)")),
            "link 'arm' has a size that is not more than 0");
  EXPECT_EQ(warning(collision("<box/>")), "link 'arm' has no size=\"...\"");
  EXPECT_EQ(warning(collision(R"(<box size="1 1"/>)")),
            "link 'arm' has size=\"1 1\" in <box>; it must be three numbers");
  EXPECT_EQ(warning(collision(R"(<sphere radius="-1"/>)")),
            "link 'arm' has radius=\"-1\"; it must be more than 0");
  EXPECT_EQ(warning(collision(R"(<cylinder radius="1"/>)")), "link 'arm' has no length=\"...\"");
  EXPECT_EQ(warning(collision("<capsule/>")), "link 'arm' is no box, cylinder, sphere or mesh");
  EXPECT_EQ(warning("<collision/>"), "link 'arm' has no <geometry> with a shape");
  EXPECT_EQ(warning(collision(R"(<mesh filename="package://far/boom.stl"/>)")),
            "link 'arm' has 'package://far/boom.stl', and no folder 'far' at or above the URDF has "
            "that file, nor the URDF's own");
  const auto two = folder_.write("m.urdf", arm(collision(R"(<mesh filename="a.dae"/>)"),
                                               collision(R"(<mesh filename="b.stl"/>)"), ""));
  const Chain chain = read_chain(two, "bucket");
  const std::string said = chain.bodies->take_warning();
  EXPECT_TRUE(said.starts_with(two.string() +
                               ": 2 shapes of links can't be read, so that scans take them for "
                               "ground (first: " +
                               (folder_ / "b.stl").string() + ": "))
      << said;
}

/// A tube of triangles about a line, `width` wide.
void add_tube(std::vector<std::array<Vec3, 3>>& to, const Vec3& from, const Vec3& end,
              double width) {
  const Vec3 side(0, width / 2, 0), up = (end - from).cross(side).normalized() * width / 2;
  const std::array ring = {Vec3(side + up), Vec3(side - up), Vec3(-side - up), Vec3(up - side)};
  for (std::size_t i = 0; i < 4; ++i) {
    const Vec3 &a = ring[i], &b = ring[(i + 1) % 4];
    to.push_back({from + a, from + b, end + a});
    to.push_back({from + b, end + b, end + a});
  }
}

TEST(MeshBoxes, CoverEachPointOfEachTriangle) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> place(-3, 3), share(0, 1);
  std::vector<std::array<Vec3, 3>> triangles;
  for (int i = 0; i < 40; ++i)
    for (Vec3& corner : triangles.emplace_back())
      corner = {place(random), place(random) / 10, place(random)};
  const auto boxes = boxes_about(triangles, 0.12);
  for (const auto& [a, b, c] : triangles) {
    for (int i = 0; i < 100; ++i) {
      const double u = share(random), v = (1 - u) * share(random);
      const Vec3 point = a + u * (b - a) + v * (c - a);
      EXPECT_TRUE(std::any_of(boxes.begin(), boxes.end(), [&](const Eigen::AlignedBox3d& box) {
        return box.exteriorDistance(point) < 1e-9;
      })) << point.transpose();
    }
  }
  EXPECT_TRUE(boxes_about({}, 0.12).empty());
}

// A boom's mesh has long triangles: they are cut, or its bend would hide all ground below it.
TEST(MeshBoxes, LeaveTheGroundBelowABendFree) {
  std::vector<std::array<Vec3, 3>> straight, bent;
  add_tube(straight, {0, 0, 0}, {6, 0, 0}, 0.5);
  add_tube(bent, {0, 0, 0}, {3, 0, 2.5}, 0.5);
  add_tube(bent, {3, 0, 2.5}, {6, 0, 0}, 0.5);
  EXPECT_EQ(boxes_about(straight, 0.12).size(), 1);
  const auto boxes = boxes_about(bent, 0.12);
  for (double x = 1.5; x <= 4.5; x += 0.1)  // 1.2 m below the beam's middle
    for (const Eigen::AlignedBox3d& box : boxes)
      EXPECT_GT(box.exteriorDistance(Vec3(x, 0, (3 - std::abs(x - 3)) * 2.5 / 3 - 1.2)), 0.12);
  EXPECT_LT(boxes.size(), 40);
}

TEST_F(Urdf, LimitsFarBeyondATurnLookLikeDegrees) {
  Chain chain;
  chain.joints = {{"swing", Joint::Type::kRevolute, {}, Vec3::UnitZ(), -6.28, 6.28},
                  {"slide", Joint::Type::kPrismatic, {}, Vec3::UnitX(), 0, 12}};
  EXPECT_EQ(limits_in_degrees(chain), "");
  chain.joints.push_back({"boom", Joint::Type::kRevolute, {}, Vec3::UnitY(), -45, 60});
  chain.joints.push_back({"stick", Joint::Type::kRevolute, {}, Vec3::UnitY(), 0, 7});
  EXPECT_EQ(limits_in_degrees(chain),
            "limits of joints 'boom' and 'stick' are beyond a turn (first: -45 to 60): they look "
            "like degrees, and a urdf has radians");
}

TEST_F(Urdf, AxesAndLimitsWithoutSense) {
  EXPECT_EQ(error(machine(R"(<joint name="turn" type="continuous"><parent link="b"/>
      <child link="c"/><axis xyz="0 0 0"/></joint>)")),
            "m.urdf:10: joint 'turn' has the axis 0 0 0; it must have a direction");
  EXPECT_EQ(error(machine(R"(<joint name="turn" type="revolute"><parent link="b"/>
      <child link="c"/><limit lower="1" upper="-1" effort="1" velocity="1"/></joint>)")),
            "m.urdf:10: joint 'turn' has the lower limit 1 above its upper limit -1; swap them");
}

TEST_F(Urdf, WhatIsMissingOrNoNumberIsNamedWithItsLine) {
  EXPECT_EQ(error("<html></html>"), "m.urdf:1: <html> is not the <robot> of a URDF");
  EXPECT_EQ(error("<robot name=\"m\"></robot>"), "m.urdf:1: robot 'm' has no link");
  EXPECT_EQ(error("<robot name=\"m\">\n<link/></robot>"),
            "m.urdf:2: robot 'm' has no name=\"...\"");
  const auto turn = [&](const std::string& type, const std::string& inside) {
    return error(machine("<joint name=\"turn\" type=\"" + type + "\">" + inside + "</joint>"));
  };
  const std::string links = R"(<parent link="b"/><child link="c"/>)";
  EXPECT_EQ(turn("revolute", links),
            "m.urdf:10: joint 'turn' has no <limit lower=\"...\" upper=\"...\"/>; without limits "
            "it is continuous");
  EXPECT_EQ(turn("fixed", "<parent link=\"b\"/>"),
            "m.urdf:10: joint 'turn' has no <child link=\"...\"/>");
  EXPECT_EQ(turn("fixed", "<child link=\"c\"/>"),
            "m.urdf:10: joint 'turn' has no <parent link=\"...\"/>");
  EXPECT_EQ(turn("fixed", "<parent/><child link=\"c\"/>"),
            "m.urdf:10: joint 'turn' has no link=\"...\"");
  EXPECT_EQ(
      turn("fixed", "<parent link=\"bb\"/><child link=\"c\"/>"),
      "m.urdf:10: joint 'turn' has the parent link 'bb', which does not exist; did you mean 'b'?");
  EXPECT_EQ(turn("turning", links),
            "m.urdf:10: joint 'turn' is turning; it must be fixed, revolute, continuous or "
            "prismatic");
  EXPECT_EQ(turn("continuous", links + "\n<origin xyz=\"1 2 three\"/>"),
            "m.urdf:11: joint 'turn' has 'three' where a number is needed, -1e9 to 1e9");
  EXPECT_EQ(turn("continuous", links + "\n<origin rpy=\"1 2 nan\"/>"),
            "m.urdf:11: joint 'turn' has 'nan' where a number is needed, -1e9 to 1e9");
  EXPECT_EQ(turn("continuous", links + "<axis xyz=\"1 2\"/>"),
            "m.urdf:10: joint 'turn' has xyz=\"1 2\" in <axis>; it must be three numbers");
  EXPECT_EQ(turn("revolute", links + "<limit lower=\"-1 0\" upper=\"1\"/>"),
            "m.urdf:10: joint 'turn' has '-1 0' where a number is needed, -1e9 to 1e9");
  EXPECT_EQ(error("<robot name=\"m\"><link name=\"a\"/>\n<link name=\"a\"/></robot>"),
            "m.urdf:2: link 'a' is there twice; rename one");
  EXPECT_EQ(error(machine(kTurn + "\n" + kTurn)),
            "m.urdf:11: joint 'turn' is there twice; rename one");
  EXPECT_EQ(error("<robot name=\"m\"><link name=\"a\"/>\n<xacro:include filename=\"b\"/></robot>"),
            "m.urdf:2: robot 'm' is written in xacro; make a URDF of it first: xacro m.urdf > "
            "m_made.urdf");
}

TEST_F(Urdf, WhatIsBesideTheChainIsNotLookedAt) {
  EXPECT_EQ(read(machine(kTurn + R"(<link name="e"><visual><origin xyz="none"/></visual></link>
      <joint name="f" type="odd"><parent link="x"/><child link="y"/><origin xyz="1"/></joint>
      <material name="grey"><color rgba="0.5 %s%s%s%n%s%s 0.5 1"/></material><gazebo/>)"))
                .joints.size(),
            2U);
}

TEST_F(Urdf, ALoopAndTwoParents) {
  EXPECT_EQ(error(R"(<robot name="m"><link name="a"/><link name="c"/><link name="d"/>
<joint name="p" type="fixed"><parent link="c"/><child link="d"/></joint>
<joint name="q" type="fixed"><parent link="d"/><child link="c"/></joint></robot>)"),
            "m.urdf:3: joint 'q' is part of a loop, so link 'c' has no root");
  EXPECT_EQ(error(R"(<robot name="m"><link name="a"/><link name="b"/><link name="c"/>
<joint name="o" type="fixed"><parent link="a"/><child link="b"/></joint>
<joint name="p" type="fixed"><parent link="a"/><child link="c"/></joint>
<joint name="q" type="fixed"><parent link="b"/><child link="c"/></joint></robot>)"),
            "m.urdf:4: joint 'q' leads to link 'c', as joint 'p' does; a link has one parent");
}

TEST_F(Urdf, FilesThatAreNone) {
  EXPECT_EQ(test::message_of(folder_, [&] { read_chain(folder_ / "none.urdf", "c"); }),
            "none.urdf: no such file");
  EXPECT_EQ(error(" \n"), "m.urdf: is empty");
  EXPECT_EQ(error("lower,upper\n"), "m.urdf:1: isn't XML; a URDF begins with <robot name=\"...\">");
  EXPECT_EQ(error("<!-- nothing -->"),
            "m.urdf: has no element; a URDF begins with <robot name=\"...\">");
  EXPECT_EQ(error(std::string("\x7f"
                              "ELF\0",
                              5)),
            "m.urdf: is a binary file; it must be UTF-8 text");
  const std::string whole = machine(kTurn);
  for (const char* cut_short : {"\xEB", "\xEB\xA4", "\xF0\x9F\x9A", "\xA4"})
    EXPECT_EQ(error(whole + "\n" + cut_short),
              fmt::format("m.urdf:{}: isn't UTF-8; convert the file to that",
                          std::count(whole.begin(), whole.end(), '\n') + 2));
  EXPECT_EQ(error("<robot name=\"m\">\n<link name=\"&#xD800;\"/></robot>"),
            "m.urdf:2: 'name' isn't UTF-8; write it without '&#'");
  EXPECT_EQ(error(whole.substr(0, whole.find("prismatic"))),
            "m.urdf:6: an attribute isn't name=\"value\"; the file may be cut short");
  EXPECT_EQ(error(whole.substr(0, whole.find(" is a comment"))),
            "m.urdf:5: a comment isn't closed; '-->' is missing");
  EXPECT_EQ(error("<robot name=\"m\">\n<link name=\"a\">\n</robot>"),
            "m.urdf:2: an element isn't closed, or closed without being opened; each needs an end "
            "tag");
}

TEST_F(Urdf, WhatIsStillXacroIsToldHowToBecomeOne) {
  const auto said = [&](const std::string& name, const std::string& body) {
    const auto file =
        folder_.write(name, "<robot name=\"m\" xmlns:xacro=\"x\">\n" + body + "</robot>");
    return test::message_of(folder_, [&] { read_chain(file, "bucket"); });
  };
  EXPECT_EQ(said("m.urdf.xacro", "<link name=\"${prefix}bucket\"/>"),
            "m.urdf.xacro:2: link '${prefix}bucket' is written in xacro; make a URDF of it first: "
            "xacro m.urdf.xacro > m.urdf");
  EXPECT_EQ(said("m.xacro", "<xacro:include filename=\"boom.xacro\"/>"),
            "m.xacro:2: robot 'm' is written in xacro; make a URDF of it first: xacro m.xacro > "
            "m.urdf");
  EXPECT_EQ(
      said("m.urdf", "<link name=\"a\"/>\n<link name=\"b\"><visual><xacro:box/></visual></link>"),
      "m.urdf:3: link 'b' is written in xacro; make a URDF of it first: xacro m.urdf > "
      "m_made.urdf");
  // What xacro makes still names it.
  EXPECT_EQ(said("made.urdf", "<link name=\"bucket\"/>"), "nothing thrown");
}

TEST_F(Urdf, EntitiesAreNotExpandedAndDeepNestingIsRefused) {
  EXPECT_EQ(read("<?xml version=\"1.0\"?>\n<!DOCTYPE robot SYSTEM \"robot.dtd\">\n"
                 "<robot name=\"&b;\"><link name=\"c\"/><x><![CDATA[<a>\"]]></x></robot>\n")
                .joints.size(),
            0U);
  std::string deep = "<robot name=\"m\">\n";
  for (int i = 0; i < 1'000'000; ++i) deep += "<a>";
  EXPECT_EQ(error(deep), "m.urdf:2: elements are nested too deep; such a file has a few levels");
}

TEST_F(Urdf, AJointNamedTimeWouldTakeTheMotionsFirstColumn) {
  EXPECT_EQ(error(machine(R"(<joint name="time" type="continuous"><parent link="b"/>
      <child link="c"/></joint>)")),
            "m.urdf: joint 'time' has the name of the motion's first column; rename it");
}

TEST_F(Urdf, CanBeReadFromSeveralThreads) {
  const auto good = folder_.write("good.urdf", machine(kTurn));
  const auto bad = folder_.write("bad.urdf", "<robot><link/></robot>");
  std::vector<int> right(4, 0);
  std::vector<std::thread> threads;
  for (std::size_t i = 0; i < right.size(); ++i) {
    threads.emplace_back([&, i] {
      for (int k = 0; k < 50; ++k) {
        try {
          right[i] += read_chain(i % 2 ? bad : good, "c").movable().size() == 2;
        } catch (const InputError& e) {
          right[i] += std::string(e.what()).find("has no name") != std::string::npos;
        }
      }
    });
  }
  for (auto& thread : threads) thread.join();
  EXPECT_EQ(right, (std::vector<int>{50, 50, 50, 50}));
}

}  // namespace urdf_test
}  // namespace soilvdb::io
