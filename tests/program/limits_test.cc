// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Requests that no site and no computer meets are refused before anything is begun, in no time and
// with no memory to speak of.
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tests/support/program.h"
#include "tests/support/sanitized.h"

namespace soilvdb::test {
namespace limits_test {

constexpr double kMost_s = 1;  // of processor time: the computer may be busy
constexpr long kMost_kb = 200 * 1024;
constexpr rlim_t kMostAddresses = rlim_t{4} << 30;  // the program's libraries take one of these

class Limits : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    write_file(folder() / "dig.csv", HalfSine{}.csv(101));
  }
  /// A scenario that is sane but for one thing.
  void write_scenario(const std::string& from, const std::string& to) const {
    std::string text = half_sine_scenario("{plane: {z: 0}}", "dig.csv", "{mesh: ply}");
    ASSERT_NE(text.find(from), std::string::npos) << from;
    text.replace(text.find(from), from.size(), to);
    write_file(folder() / "s.yaml", text);
  }
  /// Expects one line, exit status 2 and nothing written, for little.
  void expect_refused_at_once(const std::string& arguments, const std::string& hint) const {
    SCOPED_TRACE(arguments);
    const auto files = content();
    const pid_t child = fork();
    if (child == 0) {
      const rlimit addresses{kMostAddresses, kMostAddresses};
      if (!test::kSanitized) setrlimit(RLIMIT_AS, &addresses);  // sanitizers reserve terabytes
      const rlimit time{20, 20};
      setrlimit(RLIMIT_CPU, &time);
      const std::string command =
          fmt::format("cd '{}' && exec '{}' {} >'{}' 2>&1", folder().string(), SOILVDB_PROGRAM,
                      arguments, (said_ / "said").string());
      execl("/bin/sh", "sh", "-c", command.c_str(), nullptr);
      _exit(127);
    }
    int status = 0;
    rusage usage{};
    wait4(child, &status, 0, &usage);
    const std::string said = read_file(said_ / "said");
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 2) << status;
    EXPECT_TRUE(said.starts_with("soilvdb: ")) << said;
    EXPECT_EQ(std::count(said.begin(), said.end(), '\n'), 1) << said;
    EXPECT_NE(said.find(hint), std::string::npos) << said;
    EXPECT_TRUE(content() == files);
    if (test::kSanitized) return;
    const auto seconds = [](const timeval& t) {
      return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
    };
    EXPECT_LT(seconds(usage.ru_utime) + seconds(usage.ru_stime), kMost_s);
    EXPECT_LT(usage.ru_maxrss, kMost_kb);
  }

 private:
  test::TempFolder said_;
};

TEST_F(Limits, ScenariosThatAskForTheAbsurd) {
  struct Absurd {
    std::string from, to, hint;
  };
  const std::string voxel = "voxel_size: 0.025", width = "width: 0.2", height = "height: 0.5";
  const std::string mesh = "{mesh: ply}", plane = "{z: 0}";
  for (const Absurd& a : std::vector<Absurd>{
           {voxel, "voxel_size: 1e-6", "s.yaml:3: voxel_size is 1e-06 m; it must be from 0.0001"},
           {voxel, "voxel_size: 1e-4", "voxel_size 0.0001 is too small for what is dug"},
           {voxel, "voxel_size: 1e6", "s.yaml:3: voxel_size is 1000000 m"},
           {voxel, "voxel_size: -1", "s.yaml:3: voxel_size is -1 m"},
           {voxel, "voxel_size: 0", "s.yaml:3: voxel_size is 0 m"},
           {voxel, "voxel_size: .nan", "s.yaml:3: voxel_size is '.nan'"},
           {width, "width: 1000", "s.yaml:7: width is 1000 m; it must be from 0.001 to 100 m"},
           {width, "width: 1e-6", "s.yaml:7: width is 1e-06 m"},
           {height, "height: 1e300", "s.yaml:7: height is '1e300'"},
           {plane, "{z: 1e300}", "s.yaml:4: z is '1e300'"},
           {plane, "{z: 0, slope: [1e300, 0]}", "s.yaml:4: slope is '1e300'"},
           {mesh, "{raster: {cell: 1e-9}}", "s.yaml:9: cell is 1e-09 m; it must be from 0.001"},
           {mesh, "{raster: {cell: 1e9}}", "s.yaml:9: cell is 1000000000 m"},
           {mesh, "{snapshots: {every: 1e-12}}", "s.yaml:9: every is 1e-12 s; it must be from"},
           {mesh, "{snapshots: {every: -1}}", "s.yaml:9: every is -1 s"},
           {mesh, "{journal: {sync: 1e-12}}", "s.yaml:9: sync is 1e-12 s"}}) {
    write_scenario(a.from, a.to);
    expect_refused_at_once("run s.yaml", a.hint);
  }
}

TEST_F(Limits, ABucketOfTheLargestSizeInTheSmallestVoxels) {
  write_scenario("{width: 0.2, height: 0.5}", "{width: 100, height: 100}");
  expect_refused_at_once("run s.yaml --voxel 5e-4", "is too small for what is dug");
}

TEST_F(Limits, StrokesThatNoMachineMakes) {
  write_scenario("{mesh: ply}", "{mesh: ply}");
  const auto stroke = [&](double length_m, double z_m) {
    write_file(folder() / "dig.csv",
               fmt::format("time,x,y,z\n0,0,0,{}\n1e8,{},0,{}\n", z_m, length_m, z_m));
  };
  stroke(9e8, -0.2);
  expect_refused_at_once("run s.yaml", "more than the 209715 m that voxels of 0.025 m can number");
  write_file(folder() / "dig.csv", "time,x,y,z\n0,1e10,0,0\n");
  expect_refused_at_once("run s.yaml", "dig.csv:2: x is 1e10; it must be a number within 1e+09");
  for (const double length_m : {1001.0, 1e5}) {
    stroke(length_m, -0.2);
    expect_refused_at_once("run s.yaml", "s.yaml: machine 'digger' digs on for");
  }
  // Travel is none.
  stroke(1e5, 1);
  EXPECT_EQ(run("run s.yaml").status, 0);
}

TEST_F(Limits, OptionsThatAskForTheAbsurd) {
  write_scenario("{mesh: ply}", "{mesh: ply}");
  for (const auto& [option, hint] : std::vector<std::pair<std::string, std::string>>{
           {"--voxel 1e-6", "'1e-6' is not a voxel size from 0.0001 to 100 m"},
           {"--voxel nan", "'nan' is not a voxel size"},
           {"--updates 1e12", "'1e12' is not a whole number from 1 to 100000000"},
           {"--updates 1e300", "'1e300' is not a whole number"},
           {"--updates 0", "'0' is not a whole number"},
           {"--threads 1e6", "'1e6' is not a whole number from 1 to 1024"},
           {"--threads -1", "'-1' is not a whole number"}})
    expect_refused_at_once("run s.yaml " + option, hint);
}

TEST_F(Limits, RegionsThatAreAbsurd) {
  write_scenario("{mesh: ply}", "{mesh: ply}");
  ASSERT_EQ(run("run s.yaml --out out").status, 0);
  for (const char* to : {"o.vdb", "o.ply", "o.tif", "o.png"}) {
    for (const char* region : {"0,0,1e9,1e9", "-1e300,-1e300,1e300,1e300", "0,0,1e-12,1e-12",
                               "-1e7,0,1,1", "0,0,1,1e-4"})
      expect_refused_at_once(
          fmt::format("export out/soil_final.vdb --to {} --region={}", to, region),
          "its sides must be from 1 mm to 1000 km");
    for (const char* region : {"nan,0,1,1", "0,0,inf,1", "0,0,1", "1e8,1e8,1.0001e8,1.0001e8"})
      expect_refused_at_once(
          fmt::format("export out/soil_final.vdb --to {} --region={}", to, region), "--region ");
  }
  expect_refused_at_once("export out/soil_final.vdb --to o.vdb --region=-4e5,-4e5,4e5,4e5",
                         ": the region is too large at this voxel size");
}

}  // namespace limits_test
}  // namespace soilvdb::test
