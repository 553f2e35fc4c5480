// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soilvdb verify: what it finds wrong with a run, and how far it says one is good.
#include "tests/resume_fixture.h"

namespace soilvdb::testing {
namespace {

TEST_F(Resume, VerifyNamesEveryFileThatIsNotAsItWasWritten) {
  run_whole();
  const Result good = run("verify out/dig");
  EXPECT_EQ(good.status, 0) << good.err;
  EXPECT_NE(good.out.find("out/dig: intact, good to 5 s"), std::string::npos) << good.out;
  for (const auto& entry : fs::directory_iterator(out())) {
    const std::string name = entry.path().filename();
    const std::string bytes = read_file(entry.path());
    EXPECT_EQ(run("verify out/dig/" + name).status, 0) << name;
    damage(name, bytes.size() / 2);
    for (const std::string& what : {std::string(), "/" + name}) {
      const Result bad = run("verify out/dig" + what);
      EXPECT_EQ(bad.status, 1) << name;
      EXPECT_NE(bad.err.find(name), std::string::npos) << bad.err;
      EXPECT_EQ(std::count(bad.err.begin(), bad.err.end(), '\n'), 1) << bad.err;
    }
    fs::remove(entry.path());
    if (name != "journal") {
      EXPECT_EQ(run("verify out/dig").status, 1) << name;
    }
    expect_refused("verify out/dig/" + name, name);
    write_file(entry.path(), bytes);
  }
}

TEST_F(Resume, VerifyFindsAFinishedRunWhoseJournalWasCutShortOrZeroed) {
  run_whole();
  const std::string journal = read_file(out() / "journal");
  const auto expect_found = [&](const std::string& bytes) {
    write_file(out() / "journal", bytes);
    const Result bad = run("verify out/dig");
    EXPECT_EQ(bad.status, 1);
    EXPECT_NE(bad.err.find("journal is damaged: it ends after"), std::string::npos) << bad.err;
    EXPECT_NE(bad.err.find("held 41 when summary.json was written"), std::string::npos) << bad.err;
    EXPECT_NE(bad.out.find("soil_4.vdb           is there, but the journal doesn't know it; by "
                           "itself good, the ground at 4 s"),
              std::string::npos)
        << bad.out;
    EXPECT_NE(bad.out.find("soil_1.vdb           good"), std::string::npos) << bad.out;
  };
  const std::size_t half = journal.size() / 2;
  expect_found(journal.substr(0, half));
  expect_found(journal.substr(0, half) + std::string(journal.size() - half, '\0'));
  EXPECT_EQ(run("resume out/dig").status, 0);
  expect_same_as_whole();
  write_file(out() / "journal", std::string(journal.size(), '\0'));
  const Result none = run("verify out/dig");
  EXPECT_EQ(none.status, 1);
  EXPECT_NE(none.out.find("soil_1.vdb           is there, but the journal doesn't know it; by "
                          "itself good, the ground at 1 s"),
            std::string::npos)
      << none.out;
}

TEST_F(Resume, VerifyNamesASnapshotThatTheJournalDoesNotKnow) {
  run_whole();
  fs::copy(out() / "soil_2.vdb", out() / "soil_2 of Monday.vdb");
  const Result result = run("verify out/dig");
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_NE(result.out.find("soil_2 of Monday.vdb is there, but the journal doesn't know it; by "
                            "itself good, the ground at 2 s\n"),
            std::string::npos)
      << result.out;
}

TEST_F(Resume, VerifyFindsAJournalThatIsDamagedAtItsStart) {
  run_whole();
  damage("journal", 60);
  for (const char* what : {"out/dig", "out/dig/journal"}) {
    const Result bad = run(fmt::format("verify {}", what));
    EXPECT_EQ(bad.status, 1);
    EXPECT_NE(bad.err.find("journal: is not a journal, or damaged at its start"),
              std::string::npos);
  }
}

TEST_F(Resume, VerifyOfAnInterruptedRunSaysHowFarItIsGood) {
  run_whole();
  interrupt(0.7);
  const Result result = run("verify out/dig");
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_NE(result.out.find("not finished"), std::string::npos) << result.out;
  EXPECT_NE(result.out.find("out/dig: intact, good to 3."), std::string::npos) << result.out;
  expect_refused("verify dig.yaml", "can't be verified");
  expect_refused("verify none", "none: no such file");
}

}  // namespace
}  // namespace soilvdb::testing
