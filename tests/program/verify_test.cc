// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soilvdb verify: what it finds wrong with a run, and how far it says one is good.
#include "tests/program/resume_fixture.h"

namespace soilvdb::test {
namespace verify_test {

TEST_F(Resume, VerifyNamesEveryFileThatIsNotAsItWasWritten) {
  run_whole();
  const Result whole = good("verify out/dig");
  EXPECT_NE(whole.out.find("out/dig: intact, good to 5 s"), std::string::npos) << whole.out;
  for (const auto& entry : fs::directory_iterator(out())) {
    const std::string name = entry.path().filename();
    const std::string bytes = read_file(entry.path());
    EXPECT_EQ(run("verify out/dig/" + name).status, 0) << name;
    damage(name, bytes.size() / 2);
    for (const std::string& what : {std::string(), "/" + name}) {
      const Result result = bad("verify out/dig" + what, name);
      EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
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
    const Result result = bad("verify out/dig", "journal is damaged: it ends after");
    EXPECT_NE(result.err.find("held 41 when summary.json was written"), std::string::npos)
        << result.err;
    EXPECT_NE(result.out.find("soil_4.vdb           exists, but is not in the journal; by itself "
                              "good, the ground at 4 s"),
              std::string::npos)
        << result.out;
    EXPECT_NE(result.out.find("soil_1.vdb           good"), std::string::npos) << result.out;
  };
  const std::size_t half = journal.size() / 2;
  expect_found(journal.substr(0, half));
  expect_found(journal.substr(0, half) + std::string(journal.size() - half, '\0'));
  expect_goes_on_to_the_same();
  write_file(out() / "journal", std::string(journal.size(), '\0'));
  const Result none = run("verify out/dig");
  EXPECT_EQ(none.status, 1);
  EXPECT_NE(none.out.find("soil_1.vdb           exists, but is not in the journal; by itself good, "
                          "the ground at 1 s"),
            std::string::npos)
      << none.out;
}

TEST_F(Resume, VerifyNamesASnapshotThatTheJournalDoesNotKnow) {
  run_whole();
  fs::copy(out() / "soil_2.vdb", out() / "soil_2 of Monday.vdb");
  const Result result = good("verify out/dig");
  EXPECT_NE(result.out.find("soil_2 of Monday.vdb exists, but is not in the journal; by itself "
                            "good, the ground at 2 s\n"),
            std::string::npos)
      << result.out;
}

TEST_F(Resume, VerifyFindsAJournalThatIsDamagedAtItsStart) {
  run_whole();
  damage("journal", 60);
  for (const char* what : {"out/dig", "out/dig/journal"})
    bad(fmt::format("verify {}", what), "journal: is not a journal, or damaged at its start");
}

TEST_F(Resume, VerifyOfAnInterruptedRunSaysHowFarItIsGood) {
  run_part(0.6);
  const Result result = good("verify out/dig");
  EXPECT_NE(result.out.find("not finished"), std::string::npos) << result.out;
  EXPECT_NE(result.out.find("out/dig: intact, good to 3."), std::string::npos) << result.out;
  expect_refused("verify dig.yaml", "can't be verified");
  expect_refused("verify none", "none: no such file");
}

}  // namespace verify_test
}  // namespace soilvdb::test
