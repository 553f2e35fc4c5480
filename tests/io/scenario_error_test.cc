// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The one line said about each way to get a key or a value of a scenario wrong.
#include <gtest/gtest.h>

#include <string>

#include "soilvdb/io/scenario.h"
#include "tests/support/scenario_fixture.h"

namespace soilvdb::io {
namespace scenario_error_test {

TEST_F(ScenarioFile, AnglesInDegreesAreRefused) {
  EXPECT_EQ(error(13,
                  "    motion: joints.csv\n    urdf: m.urdf\n"
                  "    lip: {link: bucket_link, rpy: [0, 0, 34]}"),
            "s.yaml:15: rpy has 34; angles must be in radians, within a turn");
}

TEST_F(ScenarioFile, ReceiversThatCantBe) {
  const auto said = [&](const std::string& gnss) {
    return error(13, "    motion: m.csv\n    gnss: {" + gnss + "}");
  };
  EXPECT_EQ(said("crs: EPSG:4979"), "s.yaml:14: key 'antennas' is missing in gnss");
  EXPECT_EQ(said("antennas: []"),
            "s.yaml:14: antennas has 0 places; it must have one or two, of the antennas on the "
            "machine");
  EXPECT_EQ(said("antennas: 3"),
            "s.yaml:14: antennas is '3'; it must be a list of points [x, y, z]");
  EXPECT_EQ(said("antennas: [[0, 1]]"),
            "s.yaml:14: a point of antennas is a list of 2; it must be a list of 3 numbers");
  EXPECT_EQ(said("antennas: [[0, 1200, 0]]"),
            "s.yaml:14: antennas has a place 1200 m from the machine's frame; it must be within "
            "100 m");
  EXPECT_EQ(said("antennas: [[0, 0, 3], [0, 0.2, 1]]"),
            "s.yaml:14: antennas are 0.2 m apart beside each other; for a heading it must be 0.5 m "
            "or more");
  EXPECT_EQ(said("antennas: [[0, 0, 120]]"),
            "s.yaml:14: antennas has a place 120 m from the machine's frame; it must be within "
            "100 m");
  EXPECT_EQ(said("antennas: [[0, 0, 3], [0, 0.6, 7]]"),
            "s.yaml:14: antennas are 0.6 m apart beside each other; for a heading it must be "
            "0.8089 m or more");
  EXPECT_EQ(said("antennas: [[0, 0, 3]], geoid: 470"),
            "s.yaml:14: geoid is 470 m; it must be from -200 to 200 m");
  EXPECT_EQ(said("antennas: [[0, 0, 3]], geod: 1"),
            "s.yaml:14: unknown key 'geod' in gnss; did you mean 'geoid'? Its keys are antennas, "
            "crs, site_crs, geoid");
}

TEST_F(ScenarioFile, UnknownKeysNameTheNearest) {
  EXPECT_EQ(error(9, "      widht: 1.2"),
            "s.yaml:9: unknown key 'widht' in bucket; did you mean 'width'? Its keys are "
            "width, height, profile, dump_angle, edge, plate");
  EXPECT_EQ(
      error(3, "voxelsize: 0.05"),
      "s.yaml:3: unknown key 'voxelsize' in scenario; did you mean 'voxel_size'? Its keys are "
      "soilvdb, name, voxel_size, terrain, soil, machines, pours, hoppers, sensors, scans, output");
  EXPECT_EQ(error(13, "    motoin: m.csv"),
            "s.yaml:13: unknown key 'motoin' in machine; did you mean 'motion'? Its keys are "
            "name, bucket, tool, motion, angles, bad_rows, urdf, base, lip, known, gnss");
  EXPECT_EQ(
      error(3, "voxel: 0.05"),
      "s.yaml:3: unknown key 'voxel' in scenario; did you mean 'voxel_size'? Its keys are "
      "soilvdb, name, voxel_size, terrain, soil, machines, pours, hoppers, sensors, scans, output");
  EXPECT_EQ(error(5, "  plane: {hight: 1}"),
            "s.yaml:5: unknown key 'hight' in plane; did you mean 'z'? Its keys are "
            "z, slope");
  EXPECT_EQ(error(15, "  snapshot: {every: 2}"),
            "s.yaml:15: unknown key 'snapshot' in output; did you mean 'snapshots'? Its keys are "
            "snapshots, mesh, raster, mcap, force, journal");
  EXPECT_EQ(
      error(2, "<<: {name: dig}"),
      "s.yaml:2: unknown key '<<' in scenario; did you mean 'name'? Its keys are "
      "soilvdb, name, voxel_size, terrain, soil, machines, pours, hoppers, sensors, scans, output");
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
            "name, bucket, tool, motion, angles, bad_rows, urdf, base, lip, known, gnss");
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
      error(13, "    motion: {mcap: m.mcap, topic: /a, base: {topic: /tf, frame: root}}"),
      "s.yaml:13: 'base' is where a machine with a 'urdf' stands; add that, or remove 'base'");
  const std::string by_joints = "    urdf: m.urdf\n    lip: {link: bucket_link}\n";
  EXPECT_EQ(error(13, by_joints + "    motion: {mcap: m.mcap, topic: /a, base: {frame: root}}"),
            "s.yaml:15: key 'topic' is missing in base");
  EXPECT_EQ(error(13, by_joints +
                          "    motion: {mcap: m.mcap, topic: /a, base: {topic: /tf, parent: map}}"),
            "s.yaml:15: 'parent' goes with 'frame', the urdf's root's, which is seen from there; "
            "add that, or remove 'parent'");
  EXPECT_EQ(error(13, by_joints + "    motion: {mcap: m.mcap, topic: /a, base: {topic: /tf, "
                                  "frame: map, parent: map}}"),
            "s.yaml:15: 'parent' is 'map', as 'frame' is; name the world's frame");
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
  EXPECT_EQ(error(13, "    motion: ."),
            "s.yaml:13: motion: .: is a folder; name a file, or say which topic of the .mcap files "
            "in it: 'motion: {mcap: FOLDER, topic: /joint_states}'");
  EXPECT_EQ(error(13, "    motion: m.csv\n    urdf: none.urdf\n    lip: {link: a}"),
            "s.yaml:14: urdf: none.urdf: no such file");
  EXPECT_EQ(error(5, "  raster: \"a\\nb\""), "s.yaml:5: raster: a?b: no such file");
  for (const std::string kind : {"raster", "level_set"}) {
    EXPECT_EQ(error(5, "  " + kind + ": none"), "s.yaml:5: " + kind + ": none: no such file");
  }
}

}  // namespace scenario_error_test
}  // namespace soilvdb::io
