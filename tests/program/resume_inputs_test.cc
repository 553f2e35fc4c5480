// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soilvdb resume where inputs have changed, moved or gone.
#include <array>

#include "soilvdb/io/raster.h"
#include "tests/program/resume_fixture.h"

namespace soilvdb::test {
namespace resume_inputs_test {

TEST_F(Resume, RefusesInputsThatHaveChangedOrGone) {
  const HeightGrid grid{9, 9, {-4, -4}, {1, 1}};
  io::write_geotiff(folder() / "flat.tif", grid, {{"z", std::vector<float>(81)}}, "");
  write_scenario("{raster: flat.tif}");
  run_part(0.6);
  for (const char* name : {"dig.yaml", "flat.tif"}) {
    const std::string text = read_file(folder() / name);
    std::string other = text + "\n";
    if (name == std::string("dig.yaml"))
      other.replace(other.find("height: 0.5"), 11, "height: 0.6");
    write_file(folder() / name, other);
    expect_refused("resume out/dig", std::string(name) + ": has changed since the run");
    const Result verified = bad("verify out/dig", name);
    EXPECT_EQ(verified.err.find("makes what is missing"), std::string::npos) << verified.err;
    fs::remove(folder() / name);
    expect_refused("resume out/dig", std::string(name) + ": is missing");
    write_file(folder() / name, text);
  }
  fs::rename(folder() / "dig.csv", folder() / "gone.csv");
  expect_refused("resume out/dig", "dig.csv: is missing");
  fs::rename(folder() / "gone.csv", folder() / "dig.csv");
  expect_goes_on_to_the_same();
}

TEST_F(Resume, ATerrainBesideWhatAFolderLinksToIsFoundAgain) {
  const HeightGrid grid{9, 9, {-4, -4}, {1, 1}};
  fs::create_directories(folder() / "data/a");
  io::write_geotiff(folder() / "data/flat.tif", grid, {{"z", std::vector<float>(81)}}, "");
  fs::create_directory_symlink(folder() / "data/a", folder() / "site");
  write_scenario("{raster: ../flat.tif}");
  for (const char* name : {"dig.yaml", "dig.csv"})
    fs::rename(folder() / name, folder() / "site" / name);
  const Result whole = run("run site/dig.yaml --out out");
  ASSERT_EQ(whole.status, 0) << whole.err;
  EXPECT_EQ(run("info out/soil_final.vdb").status, 0);
  fs::resize_file(folder() / "out/journal", fs::file_size(folder() / "out/journal") * 3 / 5);
  good("resume out");
}

TEST_F(Resume, AnotherFileAtItsPlaceIsNotTakenForTheScenario) {
  run_part(0.6);
  write_file(folder() / "dig.yaml", "no: [scenario");
  expect_refused("resume out/dig", "dig.yaml: has changed since the run in out/dig began (");
}

TEST_F(Resume, AScenarioMayBeWrittenAnotherWayButMustSayTheSame) {
  run_part(0.6);
  const std::string text = read_file(folder() / "dig.yaml");
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string other = text;
    write_file(folder() / "dig.yaml", other.replace(other.find(from), from.size(), to));
  };
  for (const auto& [from, to, change] :
       {std::array{"0.05", "0.1", "(voxel_size was 0.05 and is 0.1)"},
        std::array{"width: 0.2", "width: 0.3", "(machines[0].bucket.width was 0.2 and is 0.3)"},
        std::array{"{every: 1}", "{}", "(output.snapshots.every was 1 and is gone)"},
        std::array{"mesh: ply", "mesh: ply, raster: {cell: 1}",
                   "(output.raster.cell was not there)"},
        std::array{"  - name: digger", "  - name: dagger", "name was digger and is dagger"}}) {
    SCOPED_TRACE(to);
    with(from, to);
    expect_refused("resume out/dig", "dig.yaml: has changed since the run in out/dig began");
    expect_refused("resume out/dig", change);
    EXPECT_EQ(run("verify out/dig").status, 1);
  }
  with("voxel_size: 0.05", "# as measured\nvoxel_size:   0.0500\n\n");
  EXPECT_EQ(run("verify out/dig").status, 0);
  with("name: dig\n", "name: 'dig'   # of last week\r\n");
  expect_goes_on_to_the_same();
}

TEST_F(Resume, FollowsALinkToItsTerrainAsItIsNow) {
  const HeightGrid grid{9, 9, {-4, -4}, {1, 1}};
  const fs::path project = folder() / "project", moved = folder() / "moved";
  fs::create_directories(project);
  fs::create_directories(folder() / "data");
  io::write_geotiff(folder() / "data/flat.tif", grid, {{"z", std::vector<float>(81)}}, "");
  fs::create_symlink(folder() / "data/flat.tif", project / "site.tif");
  write_scenario("{raster: site.tif}");
  for (const char* name : {"dig.yaml", "dig.csv"}) fs::rename(folder() / name, project / name);
  const Result whole = run("run project/dig.yaml --out project/out");
  ASSERT_EQ(whole.status, 0) << whole.err;
  const std::string hash = read_json(project / "out/summary.json")["state_hash"];
  fs::resize_file(project / "out/journal", fs::file_size(project / "out/journal") * 3 / 5);
  fs::rename(project, moved);
  fs::rename(folder() / "data", folder() / "data of May");
  const std::string there = (folder() / "project/site.tif").string(),
                    here = (moved / "site.tif").string();
  // A link that leads nowhere: both places are named, the one of then and the one looked at.
  const Result none = run("resume moved/out");
  EXPECT_EQ(none.status, 2);
  EXPECT_NE(none.err.find("soilvdb: " + there + ": is missing, and there is no moved/site.tif"),
            std::string::npos)
      << none.err;
  expect_refused("info moved/out/soil_2.vdb", "soil_2.vdb: its base surface " + there +
                                                  " is missing, and there is no " + here +
                                                  "; put it back there");
  fs::remove(moved / "site.tif");
  fs::create_symlink(folder() / "data of May/flat.tif", moved / "site.tif");
  EXPECT_EQ(run("info moved/out/soil_2.vdb").status, 0);
  const Result result = good("resume moved/out");
  EXPECT_NE(result.out.find("going on from soil_"), std::string::npos) << result.out;
  EXPECT_EQ(result.err, "");
  EXPECT_EQ(read_json(moved / "out/summary.json")["state_hash"], hash);
}

TEST_F(Resume, FindsInputsThatMovedTogetherWithTheRun) {
  write_file(folder() / "site/dig.csv", HalfSine{}.csv(41));
  fs::copy(folder() / "dig.yaml", folder() / "site/dig.yaml");
  run_part(0.6, "site/dig.yaml");
  fs::create_directories(folder() / "elsewhere/out");
  fs::rename(folder() / "site", folder() / "elsewhere/site");
  fs::rename(out(), folder() / "elsewhere/out/dig");
  EXPECT_EQ(run("resume elsewhere/out/dig").status, 0);
  EXPECT_EQ(read_json(folder() / "elsewhere/out/dig/summary.json")["state_hash"], hash_);
}

TEST_F(Resume, ByALinkToAFolderThatMovedWithItsInputs) {
  run_part(0.7);
  const fs::path moved = folder() / "moved/deep", link = folder() / "link";
  fs::create_directories(moved);
  for (const char* name : {"dig.yaml", "dig.csv", "out"}) fs::rename(folder() / name, moved / name);
  fs::create_directory_symlink(moved / "out/dig", link);
  good("resume link");
  EXPECT_EQ(read_json(link / "summary.json")["state_hash"], hash_);
}

TEST_F(Resume, RefusesAMachineThatHasChanged) {
  const std::string urdf =
      "<robot name=\"m\"><link name=\"root\"/><link name=\"tip\"/>\n"
      "<joint name=\"slide\" type=\"prismatic\"><parent link=\"root\"/><child link=\"tip\"/>\n"
      "<origin xyz=\"0 0 -0.1\"/><axis xyz=\"1 0 0\"/><limit lower=\"-9\" upper=\"9\"/></joint>\n"
      "</robot>\n";
  write_file(folder() / "m.urdf", urdf);
  std::string csv = "time,slide\n";
  for (int i = 0; i <= 40; ++i) csv += fmt::format("{},{}\n", i / 8.0, i / 40.0);
  write_file(folder() / "dig.csv", csv);
  write_file(
      folder() / "dig.yaml",
      half_sine_scenario("{plane: {z: 0}}", "dig.csv\n    urdf: m.urdf\n    lip: {link: tip}",
                         "{snapshots: {every: 1}, journal: {sync: always}}"));
  good("run dig.yaml --out o");
  fs::resize_file(folder() / "o/journal", fs::file_size(folder() / "o/journal") * 3 / 5);
  std::string other = urdf;
  other.replace(other.find("-0.1"), 4, "-0.2");
  write_file(folder() / "m.urdf", other);
  expect_refused("resume o", "m.urdf: has changed since the run");
  write_file(folder() / "m.urdf", urdf);
  good("resume o");
}

TEST_F(Resume, OfAMachineThatDrivesRefusesWhatWasDugElsewhere) {
  write_file(
      folder() / "m.urdf",
      "<robot name=\"m\"><link name=\"root\"/><link name=\"tip\"/>\n"
      "<joint name=\"slide\" type=\"prismatic\"><parent link=\"root\"/><child link=\"tip\"/>\n"
      "<origin xyz=\"0 0 -0.1\"/><axis xyz=\"1 0 0\"/><limit lower=\"-9\" upper=\"9\"/></joint>\n"
      "</robot>\n");
  const auto csv = [&](double at_10_m) {
    std::string text = "time,slide,base_x,base_y,base_z,base_yaw\n";
    for (int i = 0; i <= 40; ++i)
      text += fmt::format("{},{},{},0,0,{}\n", i / 8.0, i / 80.0, i == 10 ? at_10_m : i / 80.0,
                          i / 400.0);
    write_file(folder() / "dig.csv", text);
  };
  csv(0.125);
  write_file(
      folder() / "dig.yaml",
      half_sine_scenario("{plane: {z: 0}}", "dig.csv\n    urdf: m.urdf\n    lip: {link: tip}",
                         "{snapshots: {every: 1}, journal: {sync: always}}"));
  good("run dig.yaml --out whole");
  good("run dig.yaml --out o");
  fs::resize_file(folder() / "o/journal", fs::file_size(folder() / "o/journal") * 3 / 5);
  csv(0.13);
  expect_refused("resume o", "dig.csv:12: base_x is 0.13, but was dug as 0.125; restore it");
  csv(0.125);
  good("resume o");
  EXPECT_EQ(read_json(folder() / "o/summary.json")["state_hash"],
            read_json(folder() / "whole/summary.json")["state_hash"]);
}

}  // namespace resume_inputs_test
}  // namespace soilvdb::test
