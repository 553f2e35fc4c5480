// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Machines with a tool of any shape, from a mesh.
#include <cmath>

#include "tests/program/cli_fixture.h"

namespace soilvdb::test {
namespace tool_test {

/// A blade 2 m wide, 0.1 m thick and 0.8 m high, whose lower edge's middle is at the origin.
constexpr const char* kBlade = R"(v -0.05 -1 0
v 0.05 -1 0
v 0.05 1 0
v -0.05 1 0
v -0.05 -1 0.8
v 0.05 -1 0.8
v 0.05 1 0.8
v -0.05 1 0.8
f 1 4 3 2
f 5 6 7 8
f 1 2 6 5
f 2 3 7 6
f 3 4 8 7
f 4 1 5 8
)";

class Tools : public CommandLine {
 protected:
  void SetUp() override {
    CommandLine::SetUp();
    write_file(folder() / "blade.obj", kBlade);
    write_file(folder() / "push.csv", "time,x,y,z\n0,0,0,0.3\n1,0,0,-0.1\n4,3,0,-0.1\n5,3,0,0.3\n");
  }
  void write_scenario(const std::string& tool, const std::string& more = "") const {
    write_file(folder() / "s.yaml", "soilvdb: 1\nvoxel_size: 0.05\nterrain: {plane: {z: 0}}\n" +
                                        more +
                                        "machines:\n  - name: dozer\n    motion: push.csv\n" +
                                        tool + "output: {snapshots: {every: 1}}\n");
  }
};

TEST_F(Tools, DigWhatTheyPass) {
  write_scenario("    tool: {mesh: blade.obj}\n");
  const Result result = run("run s.yaml --updates 50 --out o");
  ASSERT_EQ(result.status, 0) << result.err;
  const auto s = read_json(folder() / "o/summary.json");
  EXPECT_NEAR(s["volume_m3"]["displaced"], 2 * 0.1 * 3.1, 2e-3 * 0.62);
  EXPECT_EQ(s["volume_m3"]["captured"], 0);
  EXPECT_LT(std::abs(s["volume_m3"]["residual"].get<double>()), 1e-9);
  ASSERT_EQ(run("run s.yaml --updates 10 --out few").status, 0);
  EXPECT_NEAR(read_json(folder() / "few/summary.json")["volume_m3"]["cut"], s["volume_m3"]["cut"],
              1e-4);
  // The mesh is an input of the run as any.
  fs::remove(folder() / "o/soil_2.vdb");
  fs::remove(folder() / "o/soil_final.vdb");
  EXPECT_EQ(run("resume o").status, 0);
  write_file(folder() / "blade.obj", std::string(kBlade) + "v 9 9 9\n");
  fs::remove(folder() / "o/soil_final.vdb");
  expect_refused("resume o", "blade.obj: has changed since the run in o began");
}

TEST_F(Tools, PushSoilThatMovesAndLoseNone) {
  write_scenario("    tool: {mesh: blade.obj, voxel: 0.02}\n", "soil: {repose_angle: 0.6}\n");
  const Result result = run("run s.yaml --out o");
  ASSERT_EQ(result.status, 0) << result.err;
  EXPECT_EQ(result.err, "");
  const auto s = read_json(folder() / "o/summary.json");
  EXPECT_EQ(s["mass_kg"]["residual"], 0);
  EXPECT_EQ(s["volume_m3"]["residual"], 0);
  EXPECT_GT(s["volume_m3"]["fill"], 0.3);
  EXPECT_EQ(s["machines"][0]["bucket_m3"], 0);
}

TEST_F(Tools, ThatCannotBeAreRefused) {
  write_scenario("    tool: {mesh: blade.obj}\n    bucket: {width: 1, height: 1}\n");
  expect_refused("run s.yaml", "s.yaml:7: a machine has a bucket or a tool, not both");
  write_scenario("    tool: {mesh: none.stl}\n");
  expect_refused("run s.yaml", "none.stl: no such file");
  write_scenario("    tool: {mesh: push.csv}\n");
  expect_refused("run s.yaml", "push.csv: is not a readable mesh; use .stl, .obj or .dae");
  write_scenario("    tool: {mesh: blade.obj, voxel: 1e-9}\n");
  expect_refused("run s.yaml", "voxel");
  write_file(folder() / "blade.obj", std::string(kBlade).substr(0, std::string(kBlade).rfind("f")));
  write_scenario("    tool: {mesh: blade.obj}\n");
  expect_refused("run s.yaml", "blade.obj: the tool's mesh isn't closed");
  write_file(folder() / "blade.obj", "v 0 0 0\n");
  expect_refused("run s.yaml", "blade.obj: ");
  write_scenario("");
  expect_refused("run s.yaml", "key 'bucket' is missing in machine");
}

}  // namespace tool_test
}  // namespace soilvdb::test
