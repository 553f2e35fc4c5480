// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Runs whose sensors send nonsense: what is left out, and where they stop.
#include <vector>

#include "soilvdb/io/snapshot.h"
#include "tests/program/bad_rows_fixture.h"
#include "tests/support/sanitized.h"

namespace soilvdb::test {
namespace bad_rows_test {

/// Of so many kinds one is dug alone, but in long tests: motion_csv_test reads each.
constexpr std::size_t kEach = 4;

/// One of each kind, for a row between those at 2.5 and 2.625 s.
const std::vector<std::pair<std::string, std::string>> kKinds = {
    {"2.55,nan,0,0,0", "x is nan; it must be a number within 1e+09"},
    {"2.55,0.5,0,-inf,0", "z is -inf"},
    {"2.55,0.5,1e-310,0,0", "y is 1e-310, too small for any sensor"},
    {"2.55,1e308,0,0,0", "x is 1e308; it must be a number within 1e+09"},
    {"1e308,0.5,0,0,0", "time is 1e308"},
    {"2.5,0.5,0,0,0", "time 2.5 doesn't come after 2.5"},
    {"1,0.5,0,0,0", "time 1 doesn't come after 2.5"},
    {"2.55,9.5,0,0,0", "the bucket moves 9"},
    {"2.55,0.5,0,0,3", "the bucket turns 3 rad in 0.05 s"},
    {"2.55,half,0,0,0", "x is 'half'; it must be a number"},
    {"2.55,0.5,0", "has 3 fields; the header has 5 columns"},
    {"2.55,0.5,0,0,0,0", "has 6 fields; the header has 5 columns"},
    {"", "is a blank line between rows"},
    {std::string("\0\0\0\0", 4), "is a binary file"},
    {std::string(70'000, '0'), "line is longer than 65536 characters"}};

TEST_F(BadRows, SkippedOnesLeaveNoTraceButACountAndAWarning) {
  ASSERT_EQ(run("run clean.yaml --out clean").status, 0);
  ASSERT_EQ(run("run clean.yaml --updates 7 --out clean7").status, 0);
  EXPECT_EQ(summary("clean")["machines"][0]["bad_rows"], 0);
  write_scenario("bad.yaml", "bad.csv", "skip");
  std::vector<std::pair<std::size_t, std::string>> all = {{1, "nan,0,0,0,0"}, {kRows + 1, "9"}};
  for (std::size_t k = 0; k < kKinds.size(); ++k) {
    const auto& [line, what] = kKinds[k];
    SCOPED_TRACE(what);
    all.emplace_back(22, line);
    if (!test::kLong && k % kEach != 0) continue;
    write_file(folder() / "bad.csv", with({{22, line}}));
    const Result result = run("run bad.yaml --out bad");
    EXPECT_EQ(result.status, 0) << result.err;
    EXPECT_TRUE(result.err.starts_with("soilvdb: warning: bad.csv:23: ")) << result.err;
    EXPECT_NE(result.err.find(what), std::string::npos) << result.err;
    EXPECT_TRUE(result.err.ends_with("; this row is left out\n")) << result.err;
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
    EXPECT_EQ(summary("bad")["machines"][0]["bad_rows"], 1);
    expect_same("bad", "clean");
  }
  write_file(folder() / "bad.csv", with(all));
  const Result result = run("run bad.yaml --out bad");
  EXPECT_EQ(result.status, 0);
  EXPECT_EQ(result.err,
            fmt::format("soilvdb: warning: bad.csv:2: time is nan; it must be a number within "
                        "1e+11 (seconds); this row and {} more are left out\n",
                        kKinds.size() + 1));
  EXPECT_EQ(summary("bad")["machines"][0]["bad_rows"], kKinds.size() + 2);
  expect_same("bad", "clean");
  ASSERT_EQ(run("run bad.yaml --updates 7 --out bad7").status, 0);
  expect_same("bad7", "clean7");
}

TEST_F(BadRows, ByDefaultARunStopsAtOneWithWhatCameBeforeItSaved) {
  write_file(folder() / "first.csv", HalfSine{}.csv(kRows, 0, 20));  // up to 2.5 s
  write_scenario("first.yaml", "first.csv", "stop");
  ASSERT_EQ(run("run first.yaml --out first").status, 0);
  write_scenario("bad.yaml", "bad.csv", "stop");
  std::string by_default = read_file(folder() / "bad.yaml");
  by_default.erase(by_default.find("    bad_rows: stop\n"), 19);
  write_file(folder() / "bad.yaml", by_default);
  for (std::size_t k = 0; k < kKinds.size(); ++k) {
    const auto& [line, what] = kKinds[k];
    SCOPED_TRACE(what);
    if (!test::kLong && k % kEach != kEach / 2) continue;
    write_file(folder() / "bad.csv", with({{22, line}, {kRows + 1, line}}));
    fs::remove_all(folder() / "bad");
    const Result result = run("run bad.yaml --out bad");
    EXPECT_EQ(result.status, 1);
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
    EXPECT_TRUE(result.err.starts_with("soilvdb: bad.csv:23: ")) << result.err;
    EXPECT_TRUE(result.err.ends_with(
        "; mend or delete it, or leave out all bad rows by 'bad_rows: skip'; stopped before it, at "
        "2.5 s of 5 s; safe in bad: soil_1.vdb, soil_2.vdb, updates.csv, soil_final.vdb, "
        "soil_final.ply, soil_final.tif, summary.json, journal; `soilvdb resume bad` goes on from "
        "2.5 s\n"))
        << result.err;
    EXPECT_NE(result.err.find(what), std::string::npos) << result.err;
    EXPECT_NE(run("info bad.yaml").out.find("; a run ends before this row"), std::string::npos);
    expect_same("bad", "first");
    EXPECT_EQ(summary("bad")["machines"][0]["bad_rows"], line.empty() ? 1 : 2);
    io::SnapshotInfo info;
    io::read_snapshot(folder() / "bad/soil_final.vdb", &info);
    EXPECT_EQ(info.time_s, 2.5);
  }
}

TEST_F(BadRows, AStoppedRunGoesOnThatLeavesThemOut) {
  ASSERT_EQ(run("run clean.yaml --out clean").status, 0);
  write_scenario("bad.yaml", "bad.csv", "stop");
  write_file(folder() / "bad.csv", with({{22, "2.55,nan,0,0,0"}, {30, "nan,0,0,0,0"}}));
  ASSERT_EQ(run("run bad.yaml --out bad").status, 1);
  write_scenario("bad.yaml", "bad.csv", "skip");
  const Result on = run("resume bad");
  EXPECT_EQ(on.status, 0) << on.err;
  EXPECT_NE(on.err.find("and 1 more are left out"), std::string::npos) << on.err;
  expect_same("bad", "clean");
  EXPECT_EQ(summary("bad")["machines"][0]["bad_rows"], 2);
  // Nothing else of it may change.
  write_scenario("bad.yaml", "bad.csv", "stop");
  ASSERT_EQ(run("run bad.yaml --out other").status, 1);
  write_scenario("bad.yaml", "bad.csv", "skip\n    angles: degrees");
  expect_refused("resume other", "has changed since the run in other began (machines[0].angles");
}

TEST_F(BadRows, WhereNothingCouldBeDugBeforeOneTheInputIsWrong) {
  write_scenario("bad.yaml", "bad.csv", "stop");
  write_file(folder() / "bad.csv", with({{1, "0,nan,0,0,0"}}));
  expect_refused("run bad.yaml", "bad.csv:2: x is nan; it must be a number within 1e+09");
  expect_refused("info bad.yaml", "bad.csv:2: x is nan");
  // An update that a bad row is in can't be dug.
  write_file(folder() / "bad.csv", with({{22, "3,nan,0,0,0"}}));
  expect_refused("run bad.yaml --updates 1", "bad.csv:23: x is nan");
  // Without a single good row there is nothing to leave out bad ones from.
  write_scenario("bad.yaml", "bad.csv", "skip");
  write_file(folder() / "bad.csv", "time,x,y,z\n0,nan,0,0\n1\n");
  expect_refused("run bad.yaml", "bad.csv:2: x is nan");
  write_scenario("bad.yaml", "bad.csv", "ignore");
  expect_refused("run bad.yaml", "bad.yaml:9: bad_rows is 'ignore'; it must be stop or skip");
  // What is wrong with the file and not with a row stays wrong.
  write_scenario("bad.yaml", "bad.csv", "skip");
  for (const char* text : {"", "time,x,y,z\n", "time,x,y\n0,0,0\n", "time,x,y,z,x\n0,0,0,0,0\n"}) {
    write_file(folder() / "bad.csv", text);
    expect_refused("run bad.yaml", "bad.csv");
  }
}

TEST_F(BadRows, WhereMostContradictOneThisOneMayBeWrong) {
  write_scenario("bad.yaml", "bad.csv", "skip");
  write_file(folder() / "bad.csv", with({{1, "-1,5e8,0,0,0"}}));  // a position without a fix
  expect_refused("run bad.yaml",
                 "bad.csv:2: 41 of the 42 rows contradict the good ones before "
                 "them, this one above all (first: "
                 "bad.csv:3: the bucket moves 5e+08 m in 1 s since the row before");
  write_file(folder() / "bad.csv", with({{4, "1e9,0,0,0,0"}}));  // a clock that jumped
  expect_refused("run bad.yaml",
                 "bad.csv:5: 38 of the 42 rows contradict the good ones before "
                 "them, this one above all (first: "
                 "bad.csv:6: time 0.375 doesn't come after 1e9");
  // A value that comes again, and two rows of which nobody knows which is right.
  write_file(folder() / "bad.csv", with({{1, "-1,5e8,0,0,0"}, {21, "2.45,5e8,0,0,0"}}));
  expect_refused("run bad.yaml", "bad.csv:23: 41 of the 43 rows contradict");
  write_file(folder() / "bad.csv", "time,x,y,z\n0,0,0,0\n1,0,0,99\n");
  expect_refused("run bad.yaml", "bad.csv:2: 1 of the 2 rows contradict");
  // A log that has each row three times is good.
  std::string thrice = lines_[0];
  for (std::size_t i = 1; i < lines_.size(); ++i) thrice += lines_[i] + lines_[i] + lines_[i];
  write_file(folder() / "bad.csv", thrice);
  EXPECT_EQ(run("run bad.yaml --out bad").status, 0);
  EXPECT_EQ(summary("bad")["machines"][0]["bad_rows"], 0);
  // Less than half of them are wrong themselves.
  write_file(folder() / "bad.csv", with({{30, "1e9,0,0,0,0"}}));
  EXPECT_EQ(run("run bad.yaml --out bad").status, 0);
  EXPECT_EQ(summary("bad")["machines"][0]["bad_rows"], 12);
}

TEST_F(BadRows, ABeginningThatIsOutnumberedIsNotDug) {
  write_scenario("bad.yaml", "bad.csv", "stop");
  // Two rows of the day before, at the gate; at 50 m/s the bucket could be back at 2.2 s.
  write_file(folder() / "bad.csv", with({{1, "-2,102,0,0,0"}, {1, "-1,102,0,0,0"}}));
  expect_refused("run bad.yaml",
                 "bad.csv:3: the 9 rows after this one contradict it, and fewer good ones come up "
                 "to it (first: bad.csv:4: the bucket moves 102 m in 1 s since the row before");
  expect_refused("info bad.yaml", "bad.csv:3: the 9 rows after this one contradict it");
  // As 'skip' does, where all that come contradict.
  write_file(folder() / "bad.csv", with({{1, "-1,5e8,0,0,0"}}));
  expect_refused("run bad.yaml", "bad.csv:2: 41 of the 42 rows contradict the good ones before");
  // Good rows that outnumber those that contradict them are dug.
  write_file(folder() / "bad.csv", with({{30, "3.6,99,0,0,0"}}));
  EXPECT_EQ(run("run bad.yaml --out bad").status, 1);
}

/// A boom that lowers the lip from 0.1 m above the ground, on a slide, as angles of 0 to 25
/// degrees.
TEST_F(BadRows, JointsInDegreesAreRefusedUnlessTheScenarioSaysSo) {
  write_file(folder() / "m.urdf",
             R"(<robot name="m"><link name="a"/><link name="b"/><link name="c"/>
<joint name="slide" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="1 0 0"/>
<limit lower="0" upper="3" effort="1" velocity="1"/></joint>
<joint name="boom" type="revolute"><parent link="b"/><child link="c"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>)");
  const auto write = [&](const std::string& name, const std::string& motion,
                         const std::string& more) {
    write_scenario(name, motion,
                   "stop" + more +
                       "\n    urdf: m.urdf\n    base: {xyz: [0, 0, 0.1]}\n"
                       "    lip: {link: c, xyz: [1, 0, 0]}");
  };
  const auto rows = [](double unit, int bad) {
    std::string text = "time,slide,boom\n";
    for (int i = 0; i <= 50; ++i) {
      const std::string boom = fmt::format("{:.17g}", std::min(0.5 * i, 20.0) * unit);
      text += fmt::format("{:.1f},{:.2f},{}\n", 0.1 * i, 0.02 * i, i == bad ? "nan" : boom);
    }
    return text;
  };
  write_file(folder() / "radians.csv", rows(std::numbers::pi / 180, -1));
  write_file(folder() / "degrees.csv", rows(1, -1));
  write("radians.yaml", "radians.csv", "");
  write("wrong.yaml", "degrees.csv", "");
  write("degrees.yaml", "degrees.csv", "\n    angles: degrees");
  for (const char* command : {"run", "info"})
    expect_refused(
        fmt::format("{} wrong.yaml", command),
        "degrees.csv:15: boom is 6.5 rad, more than a whole turn, and 38 of 51 rows have "
        "such angles: they look like degrees");
  ASSERT_EQ(run("run radians.yaml --out radians").status, 0);
  const Result dug = run("run degrees.yaml --out degrees");
  EXPECT_EQ(dug.status, 0) << dug.err;
  EXPECT_EQ(run("info degrees.yaml").status, 0);
  const double cut_m3 = summary("radians")["volume_m3"]["cut"];
  EXPECT_GT(cut_m3, 0.01);
  constexpr double kSample_m3 = 0.05 * 0.05 * 0.05 / 64;  // rounding may take one or leave it
  EXPECT_NEAR(summary("degrees")["volume_m3"]["cut"], cut_m3, 1.01 * kSample_m3);
  // It stops, is mended and gone on with as any.
  write_file(folder() / "degrees.csv", rows(1, 40));
  EXPECT_EQ(run("run degrees.yaml --out stopped").status, 1);
  write_file(folder() / "degrees.csv", rows(1, -1));
  const Result on = run("resume stopped");
  EXPECT_EQ(on.status, 0) << on.err;
  expect_same("stopped", "degrees");
  EXPECT_EQ(run("verify stopped").status, 0);
}

TEST_F(BadRows, ABucketThatIsUndergroundAllTheTimeIsWarnedOf) {
  const std::string warning =
      "the bucket of digger is 46.5 m or more below the ground all the time; heights of motion "
      "and terrain must be from the same zero";
  write_file(folder() / "geoid.yaml",  // the mouth goes up to 0.5 m
             half_sine_scenario("{plane: {z: 47}}", "clean.csv", "{}"));
  EXPECT_NE(run("info geoid.yaml").out.find(warning), std::string::npos);
  const Result deep = run("run geoid.yaml --out deep");
  EXPECT_EQ(deep.status, 0);
  EXPECT_TRUE(deep.err.starts_with("soilvdb: warning: geoid.yaml: " + warning)) << deep.err;
  EXPECT_EQ(run("info clean.yaml").out.find("below the ground"), std::string::npos);
  EXPECT_EQ(run("run clean.yaml --out clean").err, "");
}

TEST_F(BadRows, AllMachinesStopWhereTheFirstOneDoes) {
  HalfSine beside;
  beside.y_m = 3;
  write_file(folder() / "beside.csv", beside.csv(26));
  const auto two = [&](const std::string& name, const std::string& motion) {
    write_scenario(name, motion, "stop");
    std::string text = read_file(folder() / name);
    text.insert(text.find("output:"),
                "  - name: other\n    bucket: {width: 0.4, height: 0.5}\n    motion: beside.csv\n");
    write_file(folder() / name, text);
  };
  two("clean.yaml", "clean.csv");
  two("bad.yaml", "bad.csv");
  ASSERT_EQ(run("run clean.yaml --out clean").status, 0);
  std::string broken = with({});
  broken.replace(broken.find(lines_[22]), lines_[22].size() - 1, "2.625,nan,0,0,0");
  write_file(folder() / "bad.csv", broken);
  const Result result = run("run bad.yaml --out bad");
  EXPECT_EQ(result.status, 1);
  EXPECT_NE(result.err.find("stopped before it, at 2.5 s of 5 s"), std::string::npos) << result.err;
  EXPECT_EQ(summary("bad")["updates"], 21 + 13);
  EXPECT_EQ(summary("bad")["machines"][0]["bad_rows"], 1);
  EXPECT_EQ(summary("bad")["machines"][1]["bad_rows"], 0);
  // A row of one machine that comes before what the other dug.
  write_file(folder() / "bad.csv", with({}));
  std::string late = beside.csv(26);
  late.insert(late.find("\n2.6,") + 1, "2.45,0.5,3,-0.3,0\n");
  write_file(folder() / "beside.csv", late);
  expect_refused("resume bad", "beside.csv: its rows up to 2.5 s are not those of the run");
  write_file(folder() / "beside.csv", beside.csv(26));
  const Result on = run("resume bad");
  EXPECT_EQ(on.status, 0) << on.err;
  expect_same("bad", "clean");
}

}  // namespace bad_rows_test
}  // namespace soilvdb::test
