// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Runs that are killed or lose their power at any operation on any file, and what is left of them.
#include <atomic>
#include <random>
#include <thread>

#include "soilvdb/io/journal.h"
#include "soilvdb/io/snapshot.h"
#include "tests/program/crash_fixture.h"
#include "tests/support/faults.h"

namespace soilvdb::test {
namespace crash_test {

std::string without_warnings(const std::string& text) {
  std::istringstream lines(text);
  std::string rest;
  for (std::string line; std::getline(lines, line);)
    if (!line.starts_with("soilvdb: warning: ")) rest += line + '\n';
  return rest;
}

#ifdef SOILVDB_IO_SHIM

/// At random; there are more at operations in turn.
std::size_t crashes() { return faults(30, 170, 10'000); }

TEST_F(Crash, KilledAtRandomOperationsItEndsInTheSameFiles) {
  std::atomic<std::size_t> kills = 0, ends = 0;
  const auto lane = [&](unsigned seed) {
    const std::string out = fmt::format("lane{}", seed);
    std::mt19937 random(seed);
    std::uint64_t reached = 0;
    while (kills < crashes() && !HasFailure()) {
      // What is left to do is less: sooner or later it isn't killed.
      const auto at = 1 + random() % operations_.size();
      const Result result =
          launch(has_journal(out) ? "resume" : run_, out, fmt::format("kill {}", at));
      if (result.status == kKilled) {
        ++kills;
        if (!has_journal(out)) continue;
        const io::JournalContent journal = io::read_journal(folder() / out / "journal");
        EXPECT_FALSE(journal.damaged);
        EXPECT_GE(journal.done.updates, reached) << "an acknowledged update is lost";
        reached = journal.done.updates;
        continue;
      }
      EXPECT_EQ(result.status, 0) << result.err;
      expect_as_reference(out);
      fs::remove_all(folder() / out);
      reached = 0;
      ++ends;
    }
  };
  std::thread other(lane, 1);
  lane(2);
  other.join();
  EXPECT_GT(ends, 0u);
  record_faults("kill -9 at a random operation", kills, "went on to the same files");
}

TEST_F(Crash, KilledAtRandomTimesItEndsInTheSameFiles) {
  const std::size_t count = faults(5, 20, 500);
  std::atomic<std::size_t> kills = 0;
  in_two_lanes(count, 1, [&](std::size_t i, const std::string& out) {
    std::mt19937 random(static_cast<unsigned>(i));
    fs::remove_all(folder() / out);
    const double seconds = 0.02 + 0.3 * static_cast<double>(random() % 1000) / 1000;
    const Result result =
        launch("run lazy.yaml --threads 1", out, "", fmt::format("timeout -s KILL {} ", seconds));
    kills += result.status != 0;
    expect_comes_back(out);
  });
  record_faults("kill -9 at a random time", kills, "went on to the same files");
}

TEST_F(Crash, NoAcknowledgedUpdateIsLostWhenThePowerGoes) {
  // With sync: always each record is a frame, acknowledged by the fdatasync after it.
  std::vector<std::size_t> updates;  // acknowledged before each operation
  io::JournalReader reader(folder() / "ref/journal");
  reader.next();
  std::size_t acknowledged = 0;
  for (const std::string& operation : operations_) {
    updates.push_back(acknowledged);
    if (operation == "fdatasync /journal")
      acknowledged += std::holds_alternative<io::JournalUpdate>(reader.next().value());
  }
  std::atomic<std::size_t> cuts = 0;
  in_two_lanes(operations_.size(), step(), [&](std::size_t i, const std::string& out) {
    SCOPED_TRACE(fmt::format("operation {}: {}", i + 1, operations_[i]));
    fs::remove_all(folder() / out);
    ASSERT_EQ(launch(run_, out, fmt::format("cut {}", i + 1)).status, kKilled);
    ++cuts;
    if (has_journal(out)) {
      const io::JournalContent journal = io::read_journal(folder() / out / "journal");
      EXPECT_FALSE(journal.damaged);
      EXPECT_GE(journal.done.updates, updates[i]);
    } else {
      EXPECT_EQ(updates[i], 0u);
    }
    if (i % 4 == 0) expect_comes_back(out);
  });
  record_faults("power cut at each operation", cuts, "no acknowledged update lost");
}

TEST_F(Crash, KilledWhileItReplacesARunItLeavesOneOrTheOther) {
  const std::map<std::string, std::string> old = run_before();
  const std::vector<std::string> all = operations("again");
  std::atomic<std::size_t> kills = 0;
  in_two_lanes(std::min<std::size_t>(all.size(), 30), fault_step(4, 1),
               [&](std::size_t i, const std::string& out) {
                 SCOPED_TRACE(fmt::format("operation {}: {}", i + 1, all[i]));
                 fs::remove_all(folder() / out);
                 fs::copy(folder() / "old", folder() / out);
                 const char* kind = i % 3 ? "kill" : "cut";
                 ASSERT_EQ(launch(run_, out, fmt::format("{} {}", kind, i + 1)).status, kKilled);
                 ++kills;
                 expect_old_or_new(out, old);
                 expect_comes_back(out);
               });
  record_faults("killed or cut while it replaces a run", kills, "went on to the new files alone");
}

/// A run that was stopped at a bad row and is gone on with.
TEST_F(Crash, KilledOnItsWayOnFromAStopItVerifiesAndEndsInTheSameFiles) {
  std::string broken = HalfSine{}.csv(13);
  broken.insert(broken.find("2.5,"), "2.2,nan,0,0,0\n");
  write_file(folder() / "dig.csv", broken);
  ASSERT_EQ(launch(run_, "stopped", "").status, 1);
  write_file(folder() / "dig.csv", HalfSine{}.csv(13));
  fs::copy(folder() / "stopped", folder() / "again");
  fs::remove(folder() / "again.log");
  ASSERT_EQ(launch("resume", "again", "").status, 0);
  const std::vector<std::string> all = operations("again");
  std::atomic<std::size_t> kills = 0;
  in_two_lanes(all.size(), step(), [&](std::size_t i, const std::string& out) {
    SCOPED_TRACE(fmt::format("operation {}: {}", i + 1, all[i]));
    fs::remove_all(folder() / out);
    fs::copy(folder() / "stopped", folder() / out);
    const char* kind = i % 3 ? "kill" : "cut";
    ASSERT_EQ(launch("resume", out, fmt::format("{} {}", kind, i + 1)).status, kKilled);
    ++kills;
    const Result verified = launch("verify", out, "");
    EXPECT_EQ(verified.status, 0) << verified.err;
    expect_comes_back(out);
  });
  record_faults("killed or cut on the way on from a stop", kills, "verified; same files");
}

/// A finished run of which files are made anew.
TEST_F(Crash, KilledWhileItMakesFilesAnewItEndsInTheSameFiles) {
  const auto damage = [&](const std::string& out) {
    fs::remove_all(folder() / out);
    fs::copy(folder() / "ref", folder() / out);
    ASSERT_TRUE(fs::remove(folder() / out / "soil_4.166667.vdb"));
    fs::resize_file(folder() / out / "soil_final.vdb", 1000);
    fs::remove(folder() / out / "summary.json");
  };
  damage("again");
  ASSERT_EQ(launch("resume", "again", "").status, 0);
  expect_as_reference("again");
  const std::vector<std::string> all = operations("again");
  std::atomic<std::size_t> kills = 0;
  in_two_lanes(all.size(), step(), [&](std::size_t i, const std::string& out) {
    SCOPED_TRACE(fmt::format("operation {}: {}", i + 1, all[i]));
    damage(out);
    ASSERT_EQ(launch("resume", out, fmt::format("{} {}", i % 3 ? "kill" : "cut", i + 1)).status,
              kKilled);
    ++kills;
    expect_comes_back(out);
  });
  record_faults("killed or cut while it makes files anew", kills, "went on to the same files");
}

/// Snapshots that are incremental, written beside the updates and deleted when they are old.
class CrashBeside : public Crash {
 protected:
  CrashBeside() { run_ = "run beside.yaml --threads 2"; }

  /// Once there have been two, are two of them good?
  void expect_two_generations(const std::string& out) const {
    const io::JournalContent journal = io::read_journal(folder() / out / "journal");
    EXPECT_FALSE(journal.damaged);
    std::size_t known = journal.removed.size(), good = 0;
    for (const io::JournalFile& file : journal.files) {
      if (!file.name.ends_with(".vdb") || file.name == "soil_final.vdb") continue;
      ++known;
      try {
        io::read_snapshot(folder() / out / file.name);
        ++good;
      } catch (const io::InputError& e) {
        ADD_FAILURE() << e.what();
      }
    }
    EXPECT_GE(good, std::min<std::size_t>(known, 2));
  }
};

TEST_F(CrashBeside, WhateverHappensTwoGenerationsAreGoodAndItEndsInTheSameFiles) {
  const io::JournalContent whole = io::read_journal(folder() / "ref/journal");
  EXPECT_GT(whole.removed.size(), 0u);
  const auto incremental = [](const io::JournalFile& file) { return !file.parent.empty(); };
  EXPECT_TRUE(std::any_of(whole.files.begin(), whole.files.end(), incremental));
  const std::vector<std::string> kinds = {"kill {}", "cut {}", "fail {} 5", "short {} 28"};
  std::atomic<std::size_t> kills = 0, errors = 0;
  in_two_lanes(operations_.size(), step(), [&](std::size_t i, const std::string& out) {
    const std::string fault = fmt::format(fmt::runtime(kinds[i % kinds.size()]), i + 1);
    SCOPED_TRACE(fault);
    fs::remove_all(folder() / out);
    const Result result = launch(run_, out, fault);
    if (result.status == kKilled) {
      ++kills;
    } else if (result.status != 0) {
      ++errors;
      EXPECT_EQ(result.status, 1);
      const std::string error = without_warnings(result.err);
      EXPECT_EQ(std::count(error.begin(), error.end(), '\n'), 1) << error;
      EXPECT_NE(error.find((folder() / out).string()), std::string::npos) << error;
    }
    if (has_journal(out)) expect_two_generations(out);
    const bool ended = result.status == 0;
    ended ? expect_as_reference(out) : expect_comes_back(out);
  });
  EXPECT_GT(kills, 0u);
  EXPECT_GT(errors, 0u);
  const char* const outcome = "two generations good; went on to the same files";
  record_faults("killed or cut with incremental snapshots beside", kills, outcome);
  record_faults("operations fail with incremental snapshots beside", errors, outcome);
}

#endif

}  // namespace crash_test
}  // namespace soilvdb::test
