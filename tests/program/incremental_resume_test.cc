// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Runs with incremental snapshots that end early or whose files are damaged: resumed and verified.
#include "soilvdb/io/journal.h"
#include "soilvdb/io/snapshot.h"
#include "tests/program/incremental_fixture.h"

namespace soilvdb::test {
namespace incremental_resume_test {

TEST_F(Incremental, ResumeGoesOnToTheSameFiles) {
  sync_ = "always";
  for (const char* keep : {"", ", keep: 2"}) {
    run_with(std::string("every: 1, incremental: true") + keep, "dig", "--threads 1");
    const auto files = vdb_files("dig");
    const auto summary = read_json(folder() / "dig/summary.json");
    fs::copy(folder() / "dig", folder() / "saved");
    for (const double share : {0.15, 0.5, 0.8}) {
      SCOPED_TRACE(fmt::format("{} {}", keep, share));
      fs::remove_all(folder() / "dig");
      fs::copy(folder() / "saved", folder() / "dig");
      interrupt("dig", share);
      // No crash leaves a journal that knows of files deleted since: that they go is on disk first.
      const auto known = snapshots("dig");
      const bool lost = std::any_of(known.begin(), known.end(), [&](const auto& file) {
        return !fs::exists(folder() / "dig" / file.name);
      });
      const Result result = run("resume dig");
      EXPECT_EQ(result.status, 0) << result.err;
      // What this journal knows may have been deleted by the end of the run.
      const char* from = *keep ? "going on from" : "going on from soil_";
      EXPECT_NE(result.out.find(from), std::string::npos) << result.out;
      EXPECT_TRUE(vdb_files("dig") == files);
      EXPECT_EQ(read_json(folder() / "dig/summary.json")["state_hash"], summary["state_hash"]);
      EXPECT_EQ(read_json(folder() / "dig/summary.json")["files"], summary["files"]);
      if (lost) {
        EXPECT_EQ(run("resume dig").status, 0);
      }
      EXPECT_EQ(run("verify dig").status, 0);
    }
    fs::remove_all(folder() / "saved");
  }
}

TEST_F(Incremental, ABrokenChainIsToldAndResumeFallsBack) {
  sync_ = "always";
  run_with("every: 1, incremental: true", "dig", "--threads 1");
  const auto files = vdb_files("dig");
  // One that ended when the newest two were incremental.
  std::vector<io::JournalFile> known;
  do {
    interrupt("dig", 0.95);
    known = snapshots("dig");
    ASSERT_GT(known.size(), 2u);
  } while (known.back().parent.empty() || known[known.size() - 2].parent.empty());
  const std::string file = known.back().name, since = known.back().parent;
  damage("dig/" + since);
  const std::string what = " is good by itself but needs " + since + ", which is damaged";
  const Result of_file = run("verify dig/" + file), of_folder = run("verify dig");
  EXPECT_EQ(of_file.status, 1);
  EXPECT_NE(of_file.err.find(file + ":" + what), std::string::npos) << of_file.err;
  EXPECT_EQ(of_folder.status, 1);
  EXPECT_NE(of_folder.err.find("; " + file + what), std::string::npos) << of_folder.err;
  expect_refused("info dig/" + file, what);
  const Result result = run("resume dig");
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_NE(result.err.find(what), std::string::npos) << result.err;
  EXPECT_TRUE(vdb_files("dig") == files);
  EXPECT_EQ(run("verify dig").status, 0);
}

TEST_F(Incremental, AllKeptMayHangOnOneAndWithoutItTheJournalGivesEverythingBack) {
  run_with("every: 1, incremental: true, keep: 2", "dig");
  const auto files = vdb_files("dig");
  const auto summary = read_json(folder() / "dig/summary.json");
  const std::vector<io::JournalFile> kept = snapshots("dig");
  const auto roots =
      std::count_if(kept.begin(), kept.end(), [](const auto& file) { return file.parent.empty(); });
  ASSERT_EQ(roots, 1);
  // Killed before it came to its end, which is the last frame: a head and a letter.
  fs::resize_file(folder() / "dig/journal", fs::file_size(folder() / "dig/journal") - 33);
  for (const char* name : {"summary.json", "soil_final.vdb", "updates.csv"})
    fs::remove(folder() / "dig" / name);
  damage("dig/" + kept.front().name);
  for (const io::JournalFile& file : kept) EXPECT_EQ(run("verify dig/" + file.name).status, 1);
  const Result result = run("resume dig");
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_NE(result.out.find("going on from the beginning"), std::string::npos) << result.out;
  EXPECT_TRUE(vdb_files("dig") == files);
  EXPECT_EQ(read_json(folder() / "dig/summary.json")["state_hash"], summary["state_hash"]);
  EXPECT_EQ(run("verify dig").status, 0);
}

TEST_F(Incremental, OneOfAFinishedRunIsMadeAnew) {
  for (const char* keep : {"", ", keep: 2"}) {
    run_with(std::string("every: 1, incremental: true") + keep, "dig");
    const auto files = vdb_files("dig");
    const std::string summary = read_file(folder() / "dig/summary.json");
    const std::vector<io::JournalFile> known = snapshots("dig");
    for (std::size_t i = 0; i < known.size(); i += (known.size() + 3) / 4) {
      const std::string& name = known[i].name;
      SCOPED_TRACE(name);
      damage("dig/" + name);
      const Result result = run("resume dig");
      EXPECT_EQ(result.status, 0) << result.err;
      EXPECT_NE(result.err.find(name + ": is damaged"), std::string::npos) << result.err;
      EXPECT_TRUE(vdb_files("dig") == files);
      EXPECT_EQ(read_file(folder() / "dig/summary.json"), summary);
      EXPECT_EQ(run("verify dig").status, 0);
    }
  }
}

TEST_F(Incremental, VerifyKnowsWhatASnapshotGoesOnFromByMoreThanItsName) {
  run_with("every: 1", "whole");
  run_with("every: 1, incremental: true", "dig");
  const auto files = vdb_files("dig");
  const std::vector<io::JournalFile> known = snapshots("dig");
  const auto one = std::find_if(known.begin(), known.end(),
                                [](const auto& file) { return !file.parent.empty(); });
  ASSERT_NE(one, known.end());
  // Another good one in its place, of which the journal knows.
  io::JournalFile other = *(one - 1);
  ASSERT_EQ(other.name, one->parent);
  io::SnapshotInfo info;
  const io::Site site = io::read_snapshot(folder() / "whole" / other.name, &info);
  info.scenario = "another";
  io::write_snapshot(folder() / "dig" / other.name, site, info);
  const io::FileDigest digest = io::file_digest(folder() / "dig" / other.name);
  other.size = digest.size, other.crc = digest.crc, other.parent = "";
  const io::JournalContent journal = io::read_journal(folder() / "dig/journal");
  io::JournalWriter(folder() / "dig/journal", journal.good_bytes, journal.done, 1).add(other);
  const Result result = run("verify dig");
  EXPECT_EQ(result.status, 1);
  const std::string what = one->name + " is good by itself but needs " + other.name +
                           ", which is not the snapshot that it continues";
  EXPECT_NE(result.err.find(what), std::string::npos) << result.err;
  EXPECT_EQ(run("resume dig").status, 0);
  EXPECT_EQ(run("verify dig").status, 0);
}

TEST_F(Incremental, OfARunThatWasStoppedGoOnFromTheLastOnTheWay) {
  run_with("every: 0.3, incremental: true", "dig", "--updates 3000");
  const auto files = vdb_files("dig");
  fs::remove_all(folder() / "dig");
  const Result stopped =
      shell(fmt::format("'{}' run dig.yaml --out dig --updates 3000 & run=$!\n"
                        "until ls dig/soil_[3-9]* >/dev/null 2>&1 || ! kill -0 $run; do sleep "
                        "0.01; done\nkill $run; wait $run",
                        SOILVDB_PROGRAM));
  if (stopped.status == 0) GTEST_SKIP() << "came to its end first";
  EXPECT_EQ(stopped.status, 1);
  EXPECT_TRUE(fs::exists(folder() / "dig/soil_final.vdb"));
  EXPECT_EQ(run("verify dig").status, 0);
  EXPECT_EQ(run("resume dig").status, 0);
  EXPECT_TRUE(vdb_files("dig") == files);
}

}  // namespace incremental_resume_test
}  // namespace soilvdb::test
