// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What is read from a scenario, and the one line said about each way to get it wrong.
#include "soilvdb/io/scenario.h"

#include <gtest/gtest.h>

#include <fstream>
#include <numbers>

#include "temp_folder.h"

namespace soilvdb::io {
namespace {

using test::TempFolder;

/// A good scenario, a line each that a test can replace.
const std::vector<std::string> kGood = {
    "soilvdb: 1",
    "name: dig",
    "voxel_size: 0.05",
    "terrain:",
    "  plane: {z: 2.5, slope: [0.1, -0.2]}",
    "machines:",
    "  - name: digger",
    "    bucket:",
    "      width: 1.2",
    "      height: 0.5",
    "      profile: [[0, 0], [-0.3, 0.02], [-0.45, 0.25], [0, 0.5]]",
    "      dump_angle: 0.8",
    "    motion: m.csv",
    "output:",
    "  snapshots: {every: 2}",
    "  mesh: obj",
    "  raster: {cell: 0.1}",
};

const char* const kUrdf = R"(<robot name="m"><link name="base"/><link name="bucket_link"/>
<joint name="boom" type="revolute"><parent link="base"/><child link="bucket_link"/>
<origin xyz="0 0 1"/><axis xyz="0 -1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>)";

class ScenarioFile : public testing::Test {
 protected:
  void SetUp() override {
    folder_.write("m.csv", "time,x,y,z\n0,0,0,0\n1,1,0,0\n");
    folder_.write("joints.csv", "time,boom\n0,0.5\n1,1.05\n");
    folder_.write("m.urdf", kUrdf);
  }
  Scenario read(const std::string& content) {
    return read_scenario(folder_.write("s.yaml", content));
  }
  std::string error_of(const std::string& content) {
    const auto message = test::message_of(folder_, [&] { read(content); });
    EXPECT_EQ(message.find('\n'), message.npos) << "one line";
    return message;
  }
  /// The good scenario with line `number` (from 1) replaced; without it if `text` is empty.
  static std::string with(std::size_t number, const std::string& text) {
    std::string content;
    for (std::size_t i = 0; i < kGood.size(); ++i) {
      const std::string& line = i + 1 == number ? text : kGood[i];
      if (!line.empty()) content += line + "\n";
    }
    return content;
  }
  std::string error(std::size_t number, const std::string& text) {
    return error_of(with(number, text));
  }

  TempFolder folder_;
};

TEST_F(ScenarioFile, EverythingInItIsRead) {
  const Scenario s = read(with(0, ""));
  EXPECT_EQ(s.file, folder_ / "s.yaml");
  EXPECT_EQ(s.name, "dig");
  EXPECT_EQ(s.voxel_size_m, 0.05);
  const auto& plane = std::get<PlaneTerrain>(s.terrain);
  EXPECT_EQ(plane.height_m, 2.5);
  EXPECT_EQ(plane.slope, Vec2(0.1, -0.2));
  ASSERT_EQ(s.machines.size(), 1u);
  EXPECT_EQ(s.machines[0].name, "digger");
  EXPECT_EQ(s.machines[0].bucket.width_m, 1.2);
  EXPECT_EQ(s.machines[0].bucket.height_m, 0.5);
  ASSERT_EQ(s.machines[0].bucket.profile.size(), 4u);
  EXPECT_EQ(s.machines[0].bucket.profile[2], Vec2(-0.45, 0.25));
  EXPECT_EQ(s.machines[0].bucket.dump_angle_rad, 0.8);
  EXPECT_EQ(s.machines[0].motion.part(0)->pose(0.5).position, Vec3(0.5, 0, 0));
  EXPECT_EQ(s.snapshot_every_s, 2);
  EXPECT_EQ(s.mesh, "obj");
  EXPECT_EQ(s.raster_cell_m, 0.1);
  EXPECT_TRUE(s.warnings.empty());
}

TEST_F(ScenarioFile, WhatIsOptionalMayBeLeftOut) {
  std::filesystem::create_directory(folder_ / "a");
  folder_.write("a/hills.tif", "");
  const Scenario s = read(
      "soilvdb: 1\nvoxel_size: 1\nterrain: {raster: a/hills.tif}\n"
      "machines: [{name: 7, bucket: {width: 1, height: 1}, motion: m.csv}]\n");
  EXPECT_EQ(s.name, "s") << "the file's";
  EXPECT_EQ(std::get<RasterTerrain>(s.terrain).file, folder_ / "a/hills.tif")
      << "relative to the scenario";
  EXPECT_EQ(s.machines[0].name, "7");
  EXPECT_TRUE(s.machines[0].bucket.profile.empty());
  EXPECT_FALSE(s.machines[0].bucket.dump_angle_rad);
  EXPECT_FALSE(s.snapshot_every_s || s.mesh || s.raster_cell_m);
}

TEST_F(ScenarioFile, SaysHowOftenTheJournalIsSynced) {
  EXPECT_EQ(read(with(17, "  journal: {sync: always}")).journal_sync_s, 0);
  EXPECT_EQ(read(with(17, "  journal: {sync: 0.2}")).journal_sync_s, 0.2);
  EXPECT_EQ(read(with(17, "")).journal_sync_s, 1);
}

TEST_F(ScenarioFile, ALevelSetIsATerrainAndAbsolutePathsStay) {
  const auto before = folder_.write("before.vdb", "");
  const Scenario s = read(with(5, "  level_set: " + before.string()));
  EXPECT_EQ(std::get<LevelSetTerrain>(s.terrain).file, before);
}

TEST_F(ScenarioFile, WindowsLineEndsAndAnchorsAreFine) {
  const Scenario s = read(
      "soilvdb: 1\r\nvoxel_size: 1\r\nterrain: {plane: {z: 0}}\r\nmachines:\r\n"
      "  - {name: a, bucket: &b {width: 1, height: 2}, motion: m.csv}\r\n"
      "  - {name: b, bucket: *b, motion: m.csv}\r\n");
  ASSERT_EQ(s.machines.size(), 2u);
  EXPECT_EQ(s.machines[1].bucket.height_m, 2);
}

TEST_F(ScenarioFile, AMachineMayBeGivenByItsJoints) {
  const Scenario s = read(with(
      13,
      "    motion: joints.csv\n    urdf: m.urdf\n    base: {xyz: [10, 20, 30], rpy: [0, 0, 1]}\n"
      "    lip: {link: bucket_link, xyz: [2, 0, 0]}"));
  const double a = 0.5;
  const Vec3 expected =
      Vec3(10, 20, 30) + from_rpy(0, 0, 1) * Vec3(2 * std::cos(a), 0, 1 + 2 * std::sin(a));
  EXPECT_LT((s.machines[0].motion.part(0)->pose(0).position - expected).norm(), 1e-12);
  ASSERT_EQ(s.warnings.size(), 1u);
  EXPECT_EQ(s.warnings[0],
            (folder_ / "joints.csv").string() +
                ": joint boom exceeds its limits (-1.00 to 1.00 rad) in 1 row, first "
                "at line 3");
}

TEST_F(ScenarioFile, AnglesOfAMotionMayBeInDegrees) {
  folder_.write("poses.csv", "time,x,y,z,pitch\n0,1,2,3,30\n");
  const Scenario s = read(with(13, "    motion: poses.csv\n    angles: degrees"));
  EXPECT_TRUE(s.machines[0].motion.part(0)->row(0).rotation.isApprox(
      from_rpy(0, std::numbers::pi / 6, 0), 1e-12));
  EXPECT_EQ(error(13, "    motion: m.csv\n    angles: deg"),
            "s.yaml:14: angles is 'deg'; it must be radians or degrees: what the joints, or roll, "
            "pitch and yaw, of the motion are in");
}

TEST_F(ScenarioFile, IsAsTheReadmeSays) {
  std::ifstream readme(SOILVDB_SOURCE_DIR "/README.md");
  std::string content;
  bool inside = false;
  for (std::string line; std::getline(readme, line);) {
    if (line == "```") inside = false;
    const bool other_kind = line.starts_with("  plane:") || line.starts_with("  level_set:") ||
                            line.starts_with("  grid:");
    if (inside && !other_kind) content += line + "\n";
    if (line == "```yaml") inside = true;
  }
  folder_.write("digger.csv", "time,boom\n0,0.5\n1,1.05\n");
  folder_.write("digger.urdf", kUrdf);
  folder_.write("site.tif", "");
  const Scenario s = read(content);
  EXPECT_EQ(s.name, "pit");
  EXPECT_EQ(s.machines.at(0).bucket.profile.size(), 3);
  EXPECT_EQ(s.snapshot_every_s, 60);
  EXPECT_EQ(s.snapshots_kept, 2);
  EXPECT_EQ(s.raster_cell_m, 0.1);
}

TEST_F(ScenarioFile, AnglesInDegreesAreRefused) {
  EXPECT_EQ(error(13,
                  "    motion: joints.csv\n    urdf: m.urdf\n"
                  "    lip: {link: bucket_link, rpy: [0, 0, 34]}"),
            "s.yaml:15: rpy has 34; angles must be in radians, within a turn");
}

TEST_F(ScenarioFile, UnknownKeysNameTheNearest) {
  EXPECT_EQ(error(9, "      widht: 1.2"),
            "s.yaml:9: unknown key 'widht' in bucket; did you mean 'width'? Its keys are "
            "width, height, profile, dump_angle");
  EXPECT_EQ(
      error(3, "voxelsize: 0.05"),
      "s.yaml:3: unknown key 'voxelsize' in scenario; did you mean 'voxel_size'? Its keys are "
      "soilvdb, name, voxel_size, terrain, machines, output");
  EXPECT_EQ(error(13, "    motoin: m.csv"),
            "s.yaml:13: unknown key 'motoin' in machine; did you mean 'motion'? Its keys are "
            "name, bucket, motion, angles, bad_rows, urdf, base, lip");
  EXPECT_EQ(error(3, "voxel: 0.05"),
            "s.yaml:3: unknown key 'voxel' in scenario; did you mean 'voxel_size'? Its keys are "
            "soilvdb, name, voxel_size, terrain, machines, output");
  EXPECT_EQ(error(5, "  plane: {hight: 1}"),
            "s.yaml:5: unknown key 'hight' in plane; did you mean 'z'? Its keys are "
            "z, slope");
  EXPECT_EQ(error(15, "  snapshot: {every: 2}"),
            "s.yaml:15: unknown key 'snapshot' in output; did you mean 'snapshots'? Its keys are "
            "snapshots, mesh, raster, journal");
  EXPECT_EQ(error(2, "<<: {name: dig}"),
            "s.yaml:2: unknown key '<<' in scenario; did you mean 'name'? Its keys are "
            "soilvdb, name, voxel_size, terrain, machines, output");
}

TEST_F(ScenarioFile, AKeyTwice) {
  EXPECT_EQ(error(2, "name: dig\nname: dug"),
            "s.yaml:3: key 'name' is there twice in scenario; leave one out");
}

TEST_F(ScenarioFile, MissingKeys) {
  EXPECT_EQ(error(1, ""), "s.yaml:1: key 'soilvdb' is missing in scenario");
  EXPECT_EQ(error(3, ""), "s.yaml:1: key 'voxel_size' is missing in scenario");
  EXPECT_EQ(error(9, ""), "s.yaml:9: key 'width' is missing in bucket");
  EXPECT_EQ(error(13, ""), "s.yaml:7: key 'motion' is missing in machine");
  EXPECT_EQ(error(5, "  plane: {}"), "s.yaml:5: key 'z' is missing in plane");
  EXPECT_EQ(error_of("soilvdb: 1\nvoxel_size: 1\nterrain: {plane: {z: 0}}\n"),
            "s.yaml:1: key 'machines' is missing in scenario");
}

TEST_F(ScenarioFile, OtherVersions) {
  EXPECT_EQ(error(1, "soilvdb: 2"),
            "s.yaml:1: format version is '2'; this program reads version 1");
}

TEST_F(ScenarioFile, ValuesOfAnotherType) {
  EXPECT_EQ(error(3, "voxel_size: fine"), "s.yaml:3: voxel_size is 'fine'; it must be a number");
  EXPECT_EQ(error(3, "voxel_size: 0.05 m"),
            "s.yaml:3: voxel_size is '0.05 m'; it must be a number");
  EXPECT_EQ(error(3, "voxel_size: \"0.05\""),
            "s.yaml:3: voxel_size is '0.05'; it must be a number without quotes");
  EXPECT_EQ(error(3, "voxel_size:"), "s.yaml:3: voxel_size is empty; it must have a value");
  EXPECT_EQ(error(3, "voxel_size: [1]"), "s.yaml:3: voxel_size is a list; it must be a number");
  EXPECT_EQ(error(2, "name: {a: b}"), "s.yaml:2: name is a map; it must be text");
  EXPECT_EQ(error(5, "  plane: 3"),
            "s.yaml:5: plane is '3'; it must be a map with keys of "
            "z, slope");
  EXPECT_EQ(error(5, "  plane: {z: 0, slope: [1]}"),
            "s.yaml:5: slope is a list of 1; it must be a list of 2 numbers");
  EXPECT_EQ(error(11, "      profile: round"),
            "s.yaml:11: profile is 'round'; it must be a list of points [x, z]");
  EXPECT_EQ(error(11, "      profile: [[0, 0], [1, 2, 3]]"),
            "s.yaml:11: a point of profile is a list of 3; it must be a list of 2 numbers");
}

TEST_F(ScenarioFile, NumbersThatAreNone) {
  for (const char* v : {".nan", "nan", ".inf", "-.inf", "1e999"}) {
    EXPECT_EQ(error(3, std::string("voxel_size: ") + v),
              std::string("s.yaml:3: voxel_size is '") + v + "'; it must be a number");
  }
  EXPECT_EQ(error(5, "  plane: {z: 1e12}"),
            "s.yaml:5: z is '1e12'; it must be a number within 1e+09");
}

TEST_F(ScenarioFile, VoxelSizesWithoutSense) {
  EXPECT_EQ(error(3, "voxel_size: 0"),
            "s.yaml:3: voxel_size is 0 m; it must be from 0.0001 to 100 m");
  EXPECT_EQ(error(3, "voxel_size: -0.05"),
            "s.yaml:3: voxel_size is -0.05 m; it must be from 0.0001 to 100 m");
  EXPECT_EQ(error(3, "voxel_size: 50000"),
            "s.yaml:3: voxel_size is 50000 m; it must be from 0.0001 to 100 m");
  EXPECT_EQ(error(3, "voxel_size: 0.00001"),
            "s.yaml:3: voxel_size is 1e-05 m; it must be from 0.0001 to 100 m");
}

TEST_F(ScenarioFile, BucketsWithoutSense) {
  EXPECT_EQ(error(9, "      width: -1.2"),
            "s.yaml:9: width is -1.2 m; it must be from 0.001 to 100 m");
  EXPECT_EQ(error(10, "      height: 0"),
            "s.yaml:10: height is 0 m; it must be from 0.001 to 100 m");
  EXPECT_EQ(error(9, "      width: 1200"),
            "s.yaml:9: width is 1200 m; it must be from 0.001 to 100 m");
  EXPECT_EQ(
      error(12, "      dump_angle: 45"),
      "s.yaml:12: dump_angle is 45 rad; it must be from 0 to 1.5708 (the mouth looks straight "
      "down)");
}

TEST_F(ScenarioFile, ProfilesWithoutSense) {
  const auto of = [&](const std::string& points) { return error(11, "      profile: " + points); };
  EXPECT_EQ(of("[]"), "s.yaml:11: profile is empty; give its points, or leave it out");
  EXPECT_EQ(
      of("[[0, 0], [0, 0.5]]"),
      "s.yaml:11: profile has 2 points; it needs at least 3, from the lip [0, 0] to the upper "
      "edge [0, 0.5]");
  EXPECT_EQ(of("[[-0.1, 0], [-0.3, 0.2], [0, 0.5]]"),
            "s.yaml:11: profile starts at [-0.1, 0]; it must start at the lip, [0, 0]");
  EXPECT_EQ(of("[[0, 0], [-0.3, 0.2], [0, 0.4]]"),
            "s.yaml:11: profile ends at [0, 0.4]; it must end at the upper edge, [0, 0.5]");
  EXPECT_EQ(
      of("[[0, 0], [0.3, 0.2], [0, 0.5]]"),
      "s.yaml:11: profile has the point [0.3, 0.2] in front of the mouth; x must be 0 or less");
  EXPECT_EQ(of("[[0, 0], [-0.3, 0.4], [-0.3, 0.1], [0, 0.5]]"),
            "s.yaml:11: profile crosses itself between the edges that start at [0, 0] and [-0.3, "
            "0.1]; it and the mouth must be a simple polygon");
  EXPECT_EQ(of("[[0, 0], [-0.3, 0.1], [0, 0.2], [-0.3, 0.4], [0, 0.5]]"),
            "s.yaml:11: profile crosses itself between the edges that start at [-0.3, 0.1] and [0, "
            "0.5]; it and the mouth must be a simple polygon");
  EXPECT_EQ(of("[[0, 0], [-0.3, 0.1], [-0.3, 0.1], [0, 0.5]]"),
            "s.yaml:11: profile has the point [-0.3, 0.1] twice in a row; leave one out");
  EXPECT_EQ(of("[[0, 0], [-0.25, 0.25], [-0.5, 0.5], [-0.25, 0.25], [0, 0.5]]"),
            "s.yaml:11: profile turns back on itself at [-0.5, 0.5]; it must enclose an area with "
            "the mouth");
  EXPECT_EQ(of("[[0, 0], [0, 0.25], [0, 0.5]]"),
            "s.yaml:11: profile turns back on itself at [0, 0.5]; it must enclose an area with the "
            "mouth");
}

TEST_F(ScenarioFile, ABodyMayReachBelowTheLipAndAboveTheUpperEdge) {
  EXPECT_NO_THROW(read(with(11, "      profile: [[0, 0], [-0.3, -0.1], [-0.5, 0.8], [0, 0.5]]")));
}

TEST_F(ScenarioFile, TerrainMustBeOfOneKind) {
  EXPECT_EQ(
      error(5, "  {}"),
      "s.yaml:4: terrain has no kind; it must have exactly one of plane, raster and level_set");
  EXPECT_EQ(
      error(5, "  plane: {z: 0}\n  raster: a.tif"),
      "s.yaml:4: terrain has 2 kinds; it must have exactly one of plane, raster and level_set");
  EXPECT_EQ(error(5, "  raster: a.tif\n  grid: ground"),
            "s.yaml:6: 'grid' is for a level_set, the name of the grid in its file; remove it");
  EXPECT_EQ(error(5, "  raster:"), "s.yaml:5: raster is empty; it must have a value");
}

TEST_F(ScenarioFile, MachinesMustBeAListWithDifferentNames) {
  const std::string head = "soilvdb: 1\nvoxel_size: 1\nterrain: {plane: {z: 0}}\n";
  EXPECT_EQ(error_of(head + "machines: []\n"),
            "s.yaml:4: machines is empty; it must be a list of at least one machine");
  EXPECT_EQ(error_of(head + "machines: {name: a}\n"),
            "s.yaml:4: machines is a map; it must be a list of at least one machine");
  EXPECT_EQ(error_of(head + "machines:\n- digger\n"),
            "s.yaml:5: machine is 'digger'; it must be a map with keys of "
            "name, bucket, motion, angles, bad_rows, urdf, base, lip");
  EXPECT_EQ(error_of(head + "machines:\n"
                            "- {name: a, bucket: {width: 1, height: 1}, motion: m.csv}\n"
                            "- {name: a, bucket: {width: 1, height: 1}, motion: m.csv}\n"),
            "s.yaml:6: machine 'a' is there twice; names must differ");
}

TEST_F(ScenarioFile, NamesMustBeFitForFiles) {
  const std::string mend =
      "'; it must be fit for the name of a file: 1 to 100 bytes, no slashes, no control characters";
  EXPECT_EQ(error(2, "name: ../../etc"), "s.yaml:2: name is '../../etc" + mend);
  EXPECT_EQ(error(2, "name: .."), "s.yaml:2: name is '.." + mend);
  EXPECT_EQ(error(7, "  - name: \"a\\nb\""), "s.yaml:7: name is 'a?b" + mend);
  EXPECT_EQ(error(2, "name: ''"), "s.yaml:2: name is empty; it must be text");
}

TEST_F(ScenarioFile, OutputsWithoutSense) {
  EXPECT_EQ(error(15, "  snapshots: {every: 0}"),
            "s.yaml:15: every is 0 s; it must be from 0.001 to 1000000000 s");
  EXPECT_EQ(error(15, "  snapshots: 1"),
            "s.yaml:15: snapshots is '1'; it must be a map with keys of "
            "every, incremental, keep");
  EXPECT_EQ(error(16, "  mesh: fbx"), "s.yaml:16: mesh is 'fbx'; it must be ply, obj, stl or glb");
  EXPECT_EQ(error(17, "  raster: {cell: -1}"),
            "s.yaml:17: cell is -1 m; it must be from 0.001 to 10000 m");
  EXPECT_EQ(error(17, "  journal: {sync: 0}"),
            "s.yaml:17: sync is 0 s; it must be from 0.001 to 3600 s");
  EXPECT_EQ(error(17, "  journal: {sync: often}"),
            "s.yaml:17: sync is 'often'; it must be a number of seconds, or always");
}

TEST_F(ScenarioFile, MachinesByJointsNeedTheirParts) {
  const auto of = [&](const std::string& rest) {
    return error(13, "    motion: joints.csv\n" + rest);
  };
  EXPECT_EQ(of("    lip: {link: bucket_link}"),
            "s.yaml:14: 'lip' is for a machine with a 'urdf'; add that, or remove 'lip'");
  EXPECT_EQ(of("    base: {xyz: [0, 0, 0]}"),
            "s.yaml:14: 'base' is for a machine with a 'urdf'; add that, or remove 'base'");
  EXPECT_EQ(of("    urdf: m.urdf"),
            "s.yaml:14: key 'lip' is missing in machine; a 'urdf' needs it to place the bucket");
  EXPECT_EQ(of("    urdf: m.urdf\n    lip: {xyz: [0, 0, 0]}"),
            "s.yaml:15: key 'link' is missing in lip");
  EXPECT_EQ(of("    urdf: m.urdf\n    lip: {link: bucket_lnk}"),
            "s.yaml:15: no link 'bucket_lnk' in m.urdf; did you mean 'bucket_link'?");
  EXPECT_EQ(of("    urdf: m.urdf\n    lip: {link: bucket_link, rpy: [0, 90deg, 0]}"),
            "s.yaml:15: rpy is '90deg'; it must be a number");
  EXPECT_EQ(
      error(13, "    motion: m.csv\n    urdf: m.urdf\n    lip: {link: bucket_link}"),
      "m.csv:1: column 'boom' is missing; the machine has a urdf, so its motion needs a column "
      "for each joint from the root to the lip: 'boom'");
  EXPECT_EQ(
      error(13, "    motion: joints.csv"),
      "joints.csv:1: columns 'x', 'y' and 'z' are missing; a motion by poses needs time,x,y,z "
      "(a motion by joints needs the machine's urdf)");
}

TEST_F(ScenarioFile, FilesItNamesMustBeThere) {
  EXPECT_EQ(error(13, "    motion: none.csv"), "s.yaml:13: motion: none.csv: no such file");
  EXPECT_EQ(error(13, "    motion: ."), "s.yaml:13: motion: .: is a folder; name a file");
  EXPECT_EQ(error(13, "    motion: m.csv\n    urdf: none.urdf\n    lip: {link: a}"),
            "s.yaml:14: urdf: none.urdf: no such file");
  EXPECT_EQ(error(5, "  raster: \"a\\nb\""), "s.yaml:5: raster: a?b: no such file");
  for (const std::string kind : {"raster", "level_set"}) {
    EXPECT_EQ(error(5, "  " + kind + ": none"), "s.yaml:5: " + kind + ": none: no such file");
  }
}

TEST_F(ScenarioFile, FilesThatAreNoScenario) {
  EXPECT_EQ(test::message_of(folder_, [&] { read_scenario(folder_ / "none.yaml"); }),
            "none.yaml: no such file");
  std::filesystem::create_directory(folder_ / "folder");
  EXPECT_EQ(test::message_of(folder_, [&] { read_scenario(folder_ / "folder"); }),
            "folder: is a folder; name a file");
  EXPECT_EQ(error_of(""), "s.yaml: is empty");
  EXPECT_EQ(error_of("# nothing\n"), "s.yaml: is empty");
  EXPECT_EQ(error_of(std::string("PK\3\4\0\0", 6)),
            "s.yaml: is a binary file; it must be UTF-8 text");
  EXPECT_EQ(error_of("hello\n"),
            "s.yaml:1: scenario is 'hello'; it must be a map with keys of "
            "soilvdb, name, voxel_size, terrain, machines, output");
  EXPECT_EQ(error_of("- a\n"),
            "s.yaml:1: scenario is a list; it must be a map with keys of "
            "soilvdb, name, voxel_size, terrain, machines, output");
  EXPECT_EQ(error_of(with(0, "") + "---\nsoilvdb: 1\n").substr(0, 7), "s.yaml:");
  EXPECT_NE(error_of(with(0, "") + "---\nsoilvdb: 1\n").find("a second document starts"),
            std::string::npos);
}

TEST_F(ScenarioFile, BrokenYaml) {
  EXPECT_EQ(error(5, "  plane: {z: 2.5").substr(0, 9), "s.yaml:6:") << "cut short on line 5";
  EXPECT_EQ(error(4, "terrain:\n\tplane: {z: 0}"),
            "s.yaml:5: is not valid YAML: a tab indents this line; use spaces instead");
  EXPECT_EQ(error(2, "name: *nobody").find("s.yaml:2: is not valid YAML: "), 0u);
}

TEST_F(ScenarioFile, AnyTruncationIsRefusedOrMissesOnlyWhatIsOptional) {
  const std::string whole = with(0, "");
  const std::size_t optional = whole.find("output:");
  for (std::size_t n = 0; n < whole.find("    motion: m.csv") + 16; ++n) {
    EXPECT_NE(error_of(whole.substr(0, n)), "nothing thrown") << n;
  }
  for (std::size_t n = optional; n < whole.size(); ++n) error_of(whole.substr(0, n));
}

TEST_F(ScenarioFile, BombsAreRefusedQuickly) {
  EXPECT_EQ(error_of("terrain: " + std::string(100000, '[')).find("s.yaml:1: is not valid YAML: "),
            0u);
  std::string laughs = "soilvdb: 1\na0: &a0 [x, x, x, x, x, x, x, x, x, x]\n";
  for (int i = 1; i < 30; ++i) {
    const std::string before = "*a" + std::to_string(i - 1);
    laughs += "a" + std::to_string(i) + ": &a" + std::to_string(i) + " [" + before;
    for (int k = 1; k < 10; ++k) laughs += ", " + before;
    laughs += "]\n";
  }
  EXPECT_EQ(error_of(laughs).substr(0, 28), "s.yaml:2: unknown key 'a0' i");
  EXPECT_EQ(error_of(with(0, "") + "#" + std::string(17 << 20, 'x')),
            "s.yaml: is larger than 16 MB; is it the right file?");
}

std::filesystem::path data(const std::string& name) {
  return std::filesystem::path(SOILVDB_SOURCE_DIR) / "data" / name;
}

TEST(HalfSine, TheLipFollowsItsHalfEllipse) {
  const Scenario s = read_scenario(data("half_sine.yaml"));
  const Motion& motion = *s.machines.at(0).motion.part(0);
  EXPECT_EQ(motion.begin_s(), 0);
  EXPECT_EQ(motion.end_s(), 1);
  double area = 0;
  Vec3 before = motion.pose(0).position;
  for (double t : motion.times_s()) {
    const Vec3 p = motion.pose(t).position;
    EXPECT_NEAR(p.x(), 2 - 0.5 * std::cos(std::numbers::pi * t), 1e-9);
    EXPECT_NEAR(p.z(), -0.25 * std::sin(std::numbers::pi * t), 1e-9);
    area -= (p.x() - before.x()) * (p.z() + before.z()) / 2;
    before = p;
  }
  const double exact = std::numbers::pi / 2 * 0.5 * 0.25;
  EXPECT_NEAR(area / exact, 1, 1e-5);
  EXPECT_NEAR(exact * s.machines[0].bucket.width_m, 0.0392699, 1e-7);
}

TEST(Excavator, StaysWithinItsLimitsAndDigsMouthForward) {
  const Scenario s = read_scenario(data("excavator.yaml"));
  EXPECT_TRUE(s.warnings.empty()) << s.warnings.front();
  const Motion& motion = *s.machines.at(0).motion.part(0);
  EXPECT_GT(motion.end_s(), 100);
  // While the mouth looks roughly level and the lip moves at digging speed, it moves mouth first.
  int digging = 0;
  for (std::size_t i = 1; i < motion.times_s().size(); ++i) {
    const Pose a = motion.pose(motion.times_s()[i - 1]), b = motion.pose(motion.times_s()[i]);
    if (b.position.z() > 432.3) continue;  // above all of the ground that is dug
    ++digging;
    const Vec3 mouth = b.rotation * Vec3::UnitX(), step = b.position - a.position;
    EXPECT_GT(mouth.dot(step), 0) << "at " << motion.times_s()[i];
  }
  EXPECT_GT(digging, 100);
}

}  // namespace
}  // namespace soilvdb::io
