// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Runs whose sensors send nonsense: what is left out, where they stop, and how they go on.
#include <vector>

#include "soilvdb/io/journal.h"
#include "soilvdb/io/snapshot.h"
#include "tests/program.h"

namespace soilvdb::testing {
namespace {

constexpr int kRows = 41;

class BadRows : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    write_file(folder() / "clean.csv", HalfSine{}.csv(kRows));
    std::istringstream csv(HalfSine{}.csv(kRows));
    for (std::string line; std::getline(csv, line);) lines_.push_back(line + '\n');
    write_scenario("clean.yaml", "clean.csv", "stop");
  }
  void write_scenario(const std::string& name, const std::string& motion,
                      const std::string& policy) const {
    std::string text =
        half_sine_scenario("{plane: {z: 0}}", motion + "\n    bad_rows: " + policy,
                           "{snapshots: {every: 1}, mesh: ply, raster: {cell: 0.1}}");
    text.replace(text.find("0.025"), 5, "0.05");
    write_file(folder() / name, text);
  }
  /// The motion with more lines, each in front of one of its rows (1..kRows; kRows + 1: the end).
  std::string with(const std::vector<std::pair<std::size_t, std::string>>& more) const {
    std::string text;
    for (std::size_t i = 0; i <= lines_.size(); ++i) {
      for (const auto& [row, line] : more) text += row == i ? line + '\n' : "";
      if (i < lines_.size()) text += lines_[i];
    }
    return text;
  }
  nlohmann::json summary(const std::string& out) const {
    return read_json(folder() / out / "summary.json");
  }
  /// updates.csv without the last column, the time each took.
  std::string updates(const std::string& out) const {
    std::istringstream csv(read_file(folder() / out / "updates.csv"));
    std::string text;
    for (std::string line; std::getline(csv, line);) text += line.substr(0, line.rfind(',')) + '\n';
    return text;
  }
  void expect_same(const std::string& out, const std::string& expected) const {
    for (const char* key : {"state_hash", "volume_m3", "updates", "soil"})
      EXPECT_EQ(summary(out)[key], summary(expected)[key]) << key;
    EXPECT_EQ(updates(out), updates(expected));
    for (const char* name : {"soil_final.ply", "soil_final.tif"})
      EXPECT_EQ(read_file(folder() / out / name), read_file(folder() / expected / name)) << name;
  }

  std::vector<std::string> lines_;  ///< header, rows
};

/// One of each kind, for a row between those at 2.5 and 2.625 s.
const std::vector<std::pair<std::string, std::string>> kKinds = {
    {"2.55,nan,0,0,0", "x is nan; it must be a number within 1e+09"},
    {"2.55,0.5,0,-inf,0", "z is -inf"},
    {"2.55,0.5,1e-310,0,0", "y is 1e-310, less than any sensor tells from 0"},
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
  for (const auto& [line, what] : kKinds) {
    SCOPED_TRACE(what);
    all.emplace_back(22, line);
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
  for (const auto& [line, what] : kKinds) {
    SCOPED_TRACE(what);
    write_file(folder() / "bad.csv", with({{22, line}, {kRows + 1, line}}));
    fs::remove_all(folder() / "bad");
    const Result result = run("run bad.yaml --out bad");
    EXPECT_EQ(result.status, 1);
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
    EXPECT_TRUE(result.err.starts_with("soilvdb: bad.csv:23: ")) << result.err;
    EXPECT_TRUE(result.err.ends_with(
        "; mend or delete it; stopped before it, at 2.5 s of 5 s; safe in bad: soil_1.vdb, "
        "soil_2.vdb, updates.csv, soil_final.vdb, soil_final.ply, soil_final.tif, summary.json, "
        "journal; `soilvdb resume bad` goes on from 2.5 s\n"))
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
  EXPECT_EQ(summary("bad")["machines"][0]["bad_rows"], 2 * kRows);
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

TEST_F(BadRows, ResumeStopsThereAgainUntilTheRowIsMended) {
  ASSERT_EQ(run("run clean.yaml --out clean").status, 0);
  ASSERT_EQ(run("run clean.yaml --updates 10 --out clean10").status, 0);
  write_scenario("bad.yaml", "bad.csv", "stop");
  std::string mended = with({}), broken = mended;
  broken.replace(broken.find(lines_[22]), lines_[22].size() - 1, "2.625,nan,0,0,0");
  for (const char* options : {"", "--updates 10"}) {
    SCOPED_TRACE(options);
    fs::remove_all(folder() / "bad");
    write_file(folder() / "bad.csv", broken);
    EXPECT_EQ(run(fmt::format("run bad.yaml {} --out bad", options)).status, 1);
    EXPECT_EQ(run("verify bad").status, 0);
    const nlohmann::json stopped = summary("bad");
    EXPECT_EQ(stopped["updates"], *options ? 5 : 21);
    const Result again = run("resume bad");
    EXPECT_EQ(again.status, 1);
    EXPECT_TRUE(again.err.starts_with("soilvdb: bad.csv:23: x is nan;")) << again.err;
    EXPECT_NE(again.err.find("stopped before it, at 2.5 s of 5 s"), std::string::npos) << again.err;
    EXPECT_EQ(summary("bad")["state_hash"], stopped["state_hash"]);
    EXPECT_EQ(summary("bad")["updates"], stopped["updates"]);
    // What was dug already is not to be changed.
    std::string other = mended;
    other[other.find("0.25,") + 2] = '4';
    write_file(folder() / "bad.csv", other);
    expect_refused("resume bad", "bad.csv:4: the row at 0.25 s");
    write_file(folder() / "bad.csv", mended.substr(0, mended.size() / 4));
    expect_refused("resume bad", "was dug; put it back");
    write_file(folder() / "bad.csv", mended);
    const Result on = run("resume bad");
    EXPECT_EQ(on.status, 0) << on.err;
    EXPECT_EQ(on.err, "");
    EXPECT_EQ(run("verify bad").status, 0);
    expect_same("bad", *options ? "clean10" : "clean");
    EXPECT_EQ(summary("bad")["machines"][0]["bad_rows"], 0);
  }
}

/// Digs up to a bad row at 2.5 s, mends that, goes on to another at 3.75 s.
TEST_F(BadRows, WhatWasDugIsNotToBeChangedWhoeverDugIt) {
  ASSERT_EQ(run("run clean.yaml --out clean").status, 0);
  write_scenario("bad.yaml", "bad.csv", "stop");
  const auto motion = [&](std::size_t row, const std::string& line) {
    std::string text;
    for (std::size_t i = 0; i < lines_.size(); ++i) text += i == row ? line : lines_[i];
    return text;
  };
  const std::size_t by_run = 9, by_resume = 25, undug = 37;  // rows of 1 s, 3 s, 4.5 s
  const auto moved = [&](std::size_t row) {
    std::string line = lines_[row];
    return line.replace(line.find(',') + 1, 3, "0.3");  // x
  };
  const std::string bad = "3.875,nan,0,0,0\n";
  // Updates of 0.5 s and of 0.1 s: of the first, rows are left out.
  for (const char* options : {"", "--updates 10", "--updates 50"}) {
    SCOPED_TRACE(options);
    fs::remove_all(folder() / "bad");
    std::string broken = motion(32, bad);
    broken.replace(broken.find(lines_[22]), lines_[22].size(), "2.625,nan,0,0,0\n");
    write_file(folder() / "bad.csv", broken);
    ASSERT_EQ(run(fmt::format("run bad.yaml {} --out bad", options)).status, 1);
    write_file(folder() / "bad.csv", motion(32, bad));
    ASSERT_EQ(run("resume bad").status, 1);
    EXPECT_EQ(run("verify bad").status, 0);
    const auto before = content();
    for (const auto& [row, time] : {std::pair(by_run, "1"), std::pair(by_resume, "3")}) {
      const std::string line = fmt::format("bad.csv:{}: ", row + 1);
      for (const auto& [text, hint] : std::vector<std::pair<std::string, std::string>>{
               {motion(row, moved(row)), *options ? line : line + "x is 0.3"},
               {motion(row, ""), fmt::format("the row at {} s (x ", time)},
               {motion(row, lines_[row] + fmt::format("{}.01,0.3,0,0,0\n", time)),
                fmt::format("bad.csv:{}: ", row + 2)},
               {motion(row, fmt::format("{},nan,0,0,0\n", time)), line + "x is nan"}}) {
        if (*options && text == motion(row, "")) continue;  // may be one that was left out
        SCOPED_TRACE(hint);
        write_file(folder() / "bad.csv", text);
        expect_refused("resume bad", hint);
        const Result verified = run("verify bad");
        EXPECT_EQ(verified.status, 1);
        EXPECT_NE(verified.err.find(hint), std::string::npos) << verified.err;
      }
    }
    write_file(folder() / "bad.csv", motion(32, bad));
    EXPECT_EQ(content(), before);
    write_file(folder() / "bad.csv", motion(undug, moved(undug)));
    const Result on = run("resume bad");
    EXPECT_EQ(on.status, 0) << on.err;
    EXPECT_EQ(run("verify bad").status, 0);
    EXPECT_NE(summary("bad")["state_hash"], summary("clean")["state_hash"]);
  }
}

TEST_F(BadRows, ALastRowThatIsMendedIsDugHoweverTheMotionIsSplit) {
  std::string broken = with({});
  broken.replace(broken.find(lines_.back()), lines_.back().size(), "5,nan,0,0,0\n");
  write_scenario("bad.yaml", "bad.csv", "stop");
  ASSERT_EQ(run("run clean.yaml --out clean").status, 0);
  for (const char* options : {"--updates 10", "--updates 39", "--updates 100", ""}) {
    SCOPED_TRACE(options);
    fs::remove_all(folder() / "bad");
    write_file(folder() / "bad.csv", broken);
    ASSERT_EQ(run(fmt::format("run bad.yaml {} --out bad", options)).status, 1);
    const int updates = summary("bad")["updates"];
    write_file(folder() / "bad.csv", with({}));
    const Result on = run("resume bad");
    EXPECT_EQ(on.status, 0) << on.err;
    EXPECT_GT(summary("bad")["updates"], updates);
    const double cut_m3 = summary("clean")["volume_m3"]["cut"];
    EXPECT_NEAR(summary("bad")["volume_m3"]["cut"], cut_m3, 1e-4 * cut_m3);
    EXPECT_EQ(run("verify bad").status, 0);
  }
}

TEST_F(BadRows, MotionsThatWereMendedMayEndElsewhere) {
  const auto drag = [](int first, int rows) {
    std::string csv;
    for (int i = first; i < first + rows; ++i)
      csv += fmt::format("{:.1f},{:.3f},0,{}\n", 0.1 * i, 0.01 * i, i == 0 ? 0.1 : -0.1);
    return csv;
  };
  const std::string header = "time,x,y,z\n";
  // 20 s in 100 updates: one ends at 3.5999999999999996 s, and the last good row is at 3.6 s.
  write_scenario("bad.yaml", "bad.csv", "stop");
  write_file(folder() / "bad.csv", header + drag(0, 37) + "3.7,nan,0,0\n" + drag(38, 163));
  ASSERT_EQ(run("run bad.yaml --updates 100 --out bad").status, 1);
  write_file(folder() / "bad.csv", header + drag(0, 37));
  const Result cut_off = run("resume bad");
  EXPECT_EQ(cut_off.status, 0) << cut_off.err;
  EXPECT_EQ(run("verify bad").status, 0);
  // A machine that had one row when the run began, beside one that stops, and has many by now.
  std::string two = read_file(folder() / "bad.yaml");
  two.insert(two.find("output:"),
             "  - name: other\n    bucket: {width: 0.4, height: 0.5}\n    motion: other.csv\n");
  write_file(folder() / "two.yaml", two);
  write_file(folder() / "bad.csv", header + drag(0, 37) + "3.7,nan,0,0\n");
  write_file(folder() / "other.csv", header + "1,0,3,0.1\n");
  ASSERT_EQ(run("run two.yaml --updates 3 --out two").status, 1);
  write_file(folder() / "bad.csv", header + drag(0, 41));
  std::string more = header + "1,0,3,0.1\n";
  for (int i = 0; i < 30; ++i) more += fmt::format("{},{:.3f},3,-0.1\n", 5 + 0.1 * i, 0.01 * i);
  write_file(folder() / "other.csv", more);
  const Result on = run("resume two");
  EXPECT_EQ(on.status, 0) << on.err;
  EXPECT_GT(summary("two")["machines"][1]["cut_m3"], 0.01);
  EXPECT_EQ(run("verify two").status, 0);
}

TEST_F(BadRows, VerifyChecksWhatAStoppedRunLeft) {
  std::string broken = with({});
  broken.replace(broken.find(lines_[22]), lines_[22].size() - 1, "2.625,nan,0,0,0");
  write_scenario("bad.yaml", "bad.csv", "stop");
  write_file(folder() / "bad.csv", broken);
  ASSERT_EQ(run("run bad.yaml --out bad").status, 1);
  for (const std::string name : {"soil_1.vdb", "updates.csv", "soil_final.vdb", "soil_final.ply",
                                 "soil_final.tif", "summary.json"}) {
    SCOPED_TRACE(name);
    const std::string bytes = read_file(folder() / "bad" / name);
    std::string damaged = bytes;
    damaged[bytes.size() / 2] = static_cast<char>(damaged[bytes.size() / 2] ^ 1);
    write_file(folder() / "bad" / name, damaged);
    const Result verified = run("verify bad");
    EXPECT_EQ(verified.status, 1);
    EXPECT_NE(verified.err.find(name + " is damaged"), std::string::npos) << verified.err;
    write_file(folder() / "bad" / name, bytes);
  }
  // Once it has gone on, they are not what the run left.
  write_file(folder() / "bad.csv", with({}));
  ASSERT_EQ(run("resume bad").status, 0);
  io::JournalReader reader(folder() / "bad/journal");
  std::uint64_t dug = 0;
  while (const auto record = reader.next())
    if (std::holds_alternative<io::JournalMove>(*record)) dug = reader.good_bytes();
  fs::resize_file(folder() / "bad/journal", dug);
  const Result verified = run("verify bad");
  EXPECT_EQ(verified.status, 0) << verified.err;
  EXPECT_EQ(verified.out.find("soil_final"), std::string::npos) << verified.out;
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

}  // namespace
}  // namespace soilvdb::testing
