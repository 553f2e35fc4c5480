// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The command line: what is refused and how.
#include <algorithm>
#include <array>

#include "soilvdb/version.h"
#include "tests/program/cli_fixture.h"

namespace soilvdb::test {
namespace cli_test {

TEST_F(CommandLine, HelpAndVersionAreNoErrors) {
  for (const char* arguments : {"--help", "run --help", "resume --help", "verify --help",
                                "info --help", "export --help", "diff --help", "--version"}) {
    const Result result = run(arguments);
    EXPECT_EQ(result.status, 0) << arguments;
    EXPECT_NE(result.out, "") << arguments;
    EXPECT_EQ(result.err, "") << arguments;
  }
  EXPECT_EQ(run("--version").out, "soilvdb " SOILVDB_VERSION "\n");
  for (const char* option :
       {"--out", "--voxel", "--threads", "--updates", "--no-mesh", "--no-snapshots"})
    EXPECT_NE(run("run --help").out.find(option), std::string::npos) << option;
}

TEST_F(CommandLine, WorksWithoutStandardStreams) {
  ASSERT_EQ(run("run dig.yaml --out whole").status, 0);
  const std::string hash = read_json(folder() / "whole/summary.json")["state_hash"];
  for (const std::string streams : {"<&- >&- 2>&-", "2>&-", "2>/dev/full", "<&-"}) {
    SCOPED_TRACE(streams);
    EXPECT_EQ(run("info none " + streams).status, 2);
    write_file(folder() / "bad.vdb", std::string("\x20\x42\x44\x56\0\0\0\0", 8) + "bad");
    EXPECT_EQ(run("info bad.vdb " + streams).status, 2);
    fs::remove_all(folder() / "out");
    // A warning and, at the end, what was done.
    EXPECT_EQ(run("run dig.yaml --voxel 0.15 --out out " + streams).status, 0);
    EXPECT_EQ(run("verify out").status, 0);
    EXPECT_EQ(run("run dig.yaml --out out " + streams).status, 0);
    EXPECT_EQ(read_json(folder() / "out/summary.json")["state_hash"], hash);
  }
}

TEST_F(CommandLine, RefusesADamagedForeignFileWhereChildrenCantBeWaitedFor) {
  write_file(folder() / "bad.vdb", std::string("\x20\x42\x44\x56\0\0\0\0", 8) + "bad");
  const Result result = shell(fmt::format("trap '' CHLD; '{}' info bad.vdb", SOILVDB_PROGRAM));
  EXPECT_EQ(result.status, 2);
  EXPECT_TRUE(result.err.starts_with("soilvdb: bad.vdb: ")) << result.err;
}

TEST_F(CommandLine, RefusesWhatItDoesNotKnow) {
  expect_refused("", "no command is named; there are run, resume,");
  expect_refused("dig dig.yaml", "no command 'dig'");
  expect_refused("exprot a.vdb", "the nearest is 'export'");
  expect_refused("--colour run dig.yaml", "--colour");
  expect_refused("run dig.yaml --colour", "--colour");
  expect_refused("run --colour dig.yaml", "--colour");
  expect_refused("run dig.yaml other.yaml", "other.yaml");
  expect_refused("run", "SCENARIO is missing; usage: soilvdb run SCENARIO; see soilvdb run --help");
  expect_refused("export dig.vdb", "--to OUT is missing; usage: soilvdb export FILE --to OUT;");
  expect_refused("diff a.vdb", "B.vdb is missing; usage: soilvdb diff A.vdb B.vdb;");
  expect_refused("run dig.yaml --out",
                 "--out needs a value; usage: --out DIR; see soilvdb run --help");
}

TEST_F(CommandLine, RefusesOptionsWithWrongValuesInBothOrders) {
  const std::array<std::array<const char*, 2>, 14> cases = {{
      {"--updates 0", "--updates"},
      {"--updates -5", "--updates"},
      {"--updates 1.5", "--updates"},
      {"--updates 100000001", "--updates"},
      {"--updates many", "'many' is not a whole number"},
      {"--threads 0", "--threads"},
      {"--threads 2x", "--threads"},
      {"--voxel 0", "--voxel"},
      {"--voxel -0.1", "--voxel"},
      {"--voxel nan", "--voxel"},
      {"--voxel inf", "--voxel"},
      {"--voxel 1000", "--voxel"},
      {"--voxel ''", "--voxel"},
      {"--no-mesh=maybe", "--no-mesh takes no value; see soilvdb run --help"},
  }};
  for (const auto& [option, hint] : cases) {
    expect_refused(fmt::format("run dig.yaml {}", option), hint);
    expect_refused(fmt::format("run {} dig.yaml", option), hint);
  }
  expect_refused("run dig.yaml --out", "--out");
}

TEST_F(CommandLine, RefusesFilesThatAreMissingOrSomethingElse) {
  write_file(folder() / "noise.bin", std::string("\x01\x02\x03\0\xff", 5));
  write_file(folder() / "empty.vdb", "");
  write_file(folder() / "short.vdb", std::string("\x20\x42\x44\x56\0\0\0\0", 8));
  fs::create_directories(folder() / "a folder");
  expect_refused("run none.yaml", "none.yaml");
  expect_refused("run 'a folder'", "a folder");
  expect_refused("run noise.bin", "noise.bin");
  for (const char* file : {"none.vdb", "'a folder'", "noise.bin", "empty.vdb", "short.vdb", "''"})
    expect_refused(fmt::format("info {}", file), "");
  for (const char* file : {"none.vdb", "noise.bin", "empty.vdb", "short.vdb", "dig.yaml"}) {
    expect_refused(fmt::format("export {} --to x.ply", file), file);
    expect_refused(fmt::format("diff {0} {0}", file), file);
  }
}

TEST_F(CommandLine, RefusesABrokenScenarioByFileAndLine) {
  std::string scenario = half_sine_scenario();
  scenario.replace(scenario.find("voxel_size"), 10, "voxel_sise");
  write_file(folder() / "broken.yaml", scenario);
  expect_refused("run broken.yaml", "broken.yaml:3: ");
  expect_refused("info broken.yaml", "broken.yaml:3: ");
  write_file(folder() / "dig.csv", "time,x,y,z\n0,0,0,1\n0,0,0,2\n");
  expect_refused("run dig.yaml --out deep/new/folder", "dig.csv:3: ");
}

TEST_F(CommandLine, RefusesAnOutFolderThatCannotBe) {
  write_file(folder() / "file", "x");
  expect_refused("run dig.yaml --out file", "is not a folder; name another");
  expect_refused("run dig.yaml --out file/below", "is not a folder; name another");
}

TEST_F(CommandLine, KeepsItsErrorOnOneLine) {
  expect_refused("run $'two\\nlines.yaml'", "lines.yaml");
  expect_refused("$'ru\\nn' x", "no command");
}

TEST_F(CommandLine, WorksWithSpacesInNames) {
  write_file(folder() / "my site/my dig.yaml", half_sine_scenario("{plane: {z: 0}}", "my dig.csv"));
  write_file(folder() / "my site/my dig.csv", HalfSine{}.csv(101));
  EXPECT_EQ(run("run --out 'the out' 'my site/my dig.yaml'").status, 0);
  EXPECT_TRUE(fs::exists(folder() / "the out/summary.json"));
  EXPECT_EQ(run("export 'the out/soil_final.vdb' --to 'the out/my mesh.ply'").status, 0);
  EXPECT_TRUE(fs::exists(folder() / "the out/my mesh.ply"));
}

TEST_F(CommandLine, InfoTellsWhatABucketWithABodyHolds) {
  EXPECT_EQ(run("info dig.yaml").out.find("struck"), std::string::npos);
  std::string scenario = half_sine_scenario();
  const std::string height = "height: 0.5";
  scenario.insert(scenario.find(height) + height.size(),
                  ", profile: [[0, 0], [-0.4, 0], [-0.4, 0.5], [0, 0.5]]");
  write_file(folder() / "body.yaml", scenario);
  const Result result = run("info body.yaml");
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_NE(result.out.find("0.04 m³ struck, 0.04433 m³ heaped"), std::string::npos) << result.out;
}

TEST_F(CommandLine, AFullStandardOutputIsAnError) {
  const Result result = shell(fmt::format("'{}' info dig.yaml >/dev/full", SOILVDB_PROGRAM));
  EXPECT_EQ(result.status, 1);
  EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
}

}  // namespace cli_test
}  // namespace soilvdb::test
