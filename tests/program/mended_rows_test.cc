// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Runs that stopped at a bad row: how they go on once it is mended, and what must not be changed.
#include <cstdint>
#include <utility>
#include <variant>
#include <vector>

#include "soilvdb/io/journal.h"
#include "tests/program/bad_rows_fixture.h"

namespace soilvdb::test {
namespace mended_rows_test {

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
    if (std::holds_alternative<io::JournalUpdate>(*record)) dug = reader.good_bytes();
  fs::resize_file(folder() / "bad/journal", dug);
  const Result verified = run("verify bad");
  EXPECT_EQ(verified.status, 0) << verified.err;
  EXPECT_EQ(verified.out.find("soil_final"), std::string::npos) << verified.out;
}

}  // namespace mended_rows_test
}  // namespace soilvdb::test
