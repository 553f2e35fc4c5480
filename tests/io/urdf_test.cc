// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What is read from a URDF, and the one line said about each way to get it wrong.
#include "soilvdb/io/urdf.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <thread>

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
