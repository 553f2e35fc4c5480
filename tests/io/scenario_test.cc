// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What is read from a scenario, and files that are none.
#include "soilvdb/io/scenario.h"

#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <numbers>
#include <set>
#include <sstream>
#include <string>
#include <string_view>

#include "soilvdb/io/site.h"
#include "soilvdb/lattice.h"
#include "tests/support/scenario_fixture.h"

namespace soilvdb::io {
namespace scenario_test {

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

TEST_F(ScenarioFile, MachinesThatAreFedNeedNoMotion) {
  const auto fed = [&](const std::string& content) {
    return read_scenario(folder_.write("s.yaml", content), {}, Motions::kOptional);
  };
  const Scenario with_urdf = fed(with(
      13,
      "    urdf: m.urdf\n    base: {xyz: [512340, 5403640, 30]}\n    lip: {link: bucket_link}"));
  ASSERT_EQ(with_urdf.machines.size(), 1u);
  EXPECT_FALSE(with_urdf.machines[0].has_motion());
  ASSERT_TRUE(with_urdf.machines[0].chain);
  EXPECT_EQ(with_urdf.machines[0].chain->movable(), std::vector<std::string>{"boom"});
  EXPECT_EQ(open_site(with_urdf).ground->origin(), lattice_origin(0.05, Vec3(512340, 5403640, 30)))
      << "voxels are numbered from where it stands";
  EXPECT_FALSE(fed(with(13, "")).machines[0].chain);
  EXPECT_TRUE(fed(with(0, "")).machines[0].has_motion());
  EXPECT_EQ(error(13, ""), "s.yaml:7: key 'motion' is missing in machine");
  EXPECT_EQ(test::message_of(folder_, [&] { fed(with(13, "    angles: degrees")); }),
            "s.yaml:13: 'angles' goes with a motion; without 'motion:' states are in radians, "
            "and each is answered");
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

/// The example in the guide, with one of its three kinds of terrain and a bucket, or with all.
std::string guides_example(const std::string& terrain) {
  std::ifstream page(SOILVDB_SOURCE_DIR "/tools/guide/scenario.md");
  std::string content, section;
  bool inside = false;
  for (std::string line; std::getline(page, line);) {
    if (line == "```") inside = false;
    if (!line.starts_with(" ")) section = line.substr(0, line.find(' '));
    const bool other_kind = section == "terrain:" && line.starts_with(" ") && terrain != "all" &&
                            !line.starts_with("  " + terrain + ": ");
    for (const char* other : {"# tool: ", "# machine: ", "# link: ", "# - {"}) {
      const std::size_t at = terrain == "all" ? line.find(other) : line.npos;
      if (at != line.npos) line.erase(at, 2);
    }
    if (inside && !other_kind) content += line + "\n";
    if (line == "```yaml") inside = true;
  }
  return content;
}

/// The keys of each map in a document, by where it is; lists have one place for all.
void collect(const YAML::Node& node, const std::string& path,
             std::map<std::string, std::set<std::string>>& keys) {
  if (node.IsSequence())
    for (const auto& item : node) collect(item, path, keys);
  if (!node.IsMap()) return;
  for (const auto& entry : node) {
    keys[path].insert(entry.first.Scalar());
    collect(entry.second, path + "/" + entry.first.Scalar(), keys);
  }
}

/// Puts a key that there is not into the map, or the first of the maps, at `path`.
void spoil(YAML::Node node, std::string_view path) {
  if (node.IsSequence()) return spoil(node[0], path);
  if (path.empty()) {
    node["zzz"] = 1;
    return;
  }
  const std::size_t end = std::min(path.find('/', 1), path.size());
  spoil(node[std::string(path.substr(1, end - 1))], path.substr(end));
}

class GuidesExample : public ScenarioFile {
 protected:
  void SetUp() override {
    ScenarioFile::SetUp();
    folder_.write("digger.csv", "time,boom\n0,0.5\n1,1.05\n");
    folder_.write("digger.urdf", kUrdf);
    folder_.write("site.tif", "");
    folder_.write("soil_final.vdb", "");
    folder_.write("after.ply",
                  "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
                  "property float z\nend_header\n0 0 -1\n");
  }
};

TEST_F(GuidesExample, IsRead) {
  const Scenario s = read(guides_example("raster"));
  EXPECT_EQ(s.name, "pit");
  EXPECT_EQ(s.machines.at(0).bucket.profile.size(), 3);
  EXPECT_EQ(s.snapshot_every_s, 60);
  EXPECT_EQ(s.snapshots_kept, 2);
  EXPECT_EQ(s.raster_cell_m, 0.1);
}

TEST_F(GuidesExample, HasEveryKeyThatThereIs) {
  std::map<std::string, std::set<std::string>> documented;
  collect(YAML::Load(guides_example("all")), "", documented);
  documented.erase("/sensors");  // its keys are names
  EXPECT_EQ(documented.size(), 22) << "maps";
  for (const auto& [path, keys] : documented) {
    // What is below terrain is read of the kind alone that it has.
    YAML::Node scenario =
        YAML::Load(guides_example(path == "/terrain" ? "all" : std::string("plane")));
    if (path == "/machines/tool") scenario["machines"][0].remove("bucket");
    spoil(scenario, path);
    const std::string said = error_of(YAML::Dump(scenario));
    const std::string before = "Its keys are ";
    ASSERT_NE(said.find(before), std::string::npos) << path << ": " << said;
    std::set<std::string> known;
    std::istringstream words(said.substr(said.find(before) + before.size()));
    for (std::string word; std::getline(words >> std::ws, word, ',');) known.insert(word);
    EXPECT_EQ(known, keys) << path;
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
  for (const char* content : {"\x20\x42\x44\x56\0\0", "hello"})
    EXPECT_EQ(
        test::message_of(folder_, [&] { read_scenario(folder_.write("a.vdb", content)); }),
        "a.vdb: is a .vdb, and a scenario is YAML; its 'terrain: {level_set: FILE}' may be a .vdb, "
        "and 'soilvdb info' shows what is in it");
  EXPECT_EQ(
      error_of("hello\n"),
      "s.yaml:1: scenario is 'hello'; it must be a map with keys of "
      "soilvdb, name, voxel_size, terrain, soil, machines, pours, hoppers, sensors, scans, output");
  EXPECT_EQ(
      error_of("- a\n"),
      "s.yaml:1: scenario is a list; it must be a map with keys of "
      "soilvdb, name, voxel_size, terrain, soil, machines, pours, hoppers, sensors, scans, output");
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

TEST_F(ScenarioFile, LimitsOfAUrdfThatLookLikeDegreesAreWarnedOfOnce) {
  std::string urdf = kUrdf;
  urdf.replace(urdf.find("lower=\"-1\""), 10, "lower=\"-57\"");
  folder_.write("m.urdf", urdf);
  std::string text =
      with(13, "    motion: joints.csv\n    urdf: m.urdf\n    lip: {link: bucket_link}");
  std::string second =
      text.substr(text.find("  - name"), text.find("output:") - text.find("  - name"));
  second.replace(second.find("digger"), 6, "other");
  text.insert(text.find("output:"), second);
  const Scenario scenario = read(text);
  EXPECT_EQ(std::count_if(scenario.warnings.begin(), scenario.warnings.end(),
                          [](const std::string& warning) {
                            return warning.ends_with(
                                "m.urdf: limits of joint 'boom' are beyond a "
                                "turn (first: -57 to 1): they look like "
                                "degrees, and a urdf has radians");
                          }),
            1);
}

TEST_F(ScenarioFile, AGeoidIsAFileBesideTheScenarioOrOneOfProj) {
  folder_.write("local.gtx", "");
  const auto geoid = [&](const std::string& given) {
    const std::string gnss = "    gnss: {antennas: [[0, 0, 3]], geoid: " + given + "}";
    return read(with(13, "    motion: m.csv\n" + gnss)).machines[0].gnss->geoid;
  };
  EXPECT_EQ(geoid("local.gtx"), (folder_ / "local.gtx").string());
  EXPECT_EQ(geoid("egm96_15.gtx"), "egm96_15.gtx");
}

}  // namespace scenario_test
}  // namespace soilvdb::io
