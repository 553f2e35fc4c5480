// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Runs that are killed, lose their power or their disk at any operation on any file, and what is
// left of them.
#include <signal.h>

#include <atomic>
#include <random>
#include <thread>

#include "soilvdb/io/journal.h"
#include "soilvdb/io/snapshot.h"
#include "tests/faults.h"
#include "tests/program.h"
#include "tests/sanitized.h"

namespace soilvdb::testing {
namespace {

#ifdef SOILVDB_IO_SHIM

constexpr int kKilled = 128 + SIGKILL;
constexpr std::size_t kEvery = test::kSanitized ? 7 : 3;

/// At random; there are more at operations in turn.
std::size_t crashes() { return faults(30, 500 / kEvery, 10'000); }

/// A file as it must be again: without how long things took.
std::string essence(const fs::path& file) {
  std::string text = read_file(file);
  if (file.filename() == "updates.csv") {
    std::istringstream lines(text);
    text.clear();
    for (std::string line; std::getline(lines, line);)
      text += line.substr(0, line.rfind(',')) + "\n";
  } else if (file.filename() == "summary.json") {
    nlohmann::json json = nlohmann::json::parse(text, nullptr, false);
    for (const char* key : {"update_us", "wall_s", "memory_bytes", "threads"}) json.erase(key);
    text = json.dump(2);
  } else if (file.filename() == "journal") {
    const io::JournalContent journal = io::read_journal(file);
    text = fmt::format("{} {} {}", journal.done.updates, journal.done.time_s, journal.ended);
  }
  return text;
}

std::map<std::string, std::string> essence_of_run(const fs::path& folder) {
  std::map<std::string, std::string> all;
  for (const auto& entry : fs::directory_iterator(folder))
    all[entry.path().filename()] = essence(entry.path());
  return all;
}

class Crash : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    write_file(folder() / "dig.csv", HalfSine{}.csv(13));
    write_scenario("dig.yaml", "every: 2", "always");
    write_scenario("lazy.yaml", "every: 2", "0.01");
    write_scenario("beside.yaml", "every: 0.6, incremental: true, keep: 2", "0.01");
    const Result result = launch(run_, "ref", "");
    ASSERT_EQ(result.status, 0) << result.err;
    reference_ = essence_of_run(folder() / "ref");
    operations_ = operations("ref");
  }

  void write_scenario(const std::string& name, const std::string& snapshots,
                      const std::string& sync) const {
    std::string text = half_sine_scenario(
        "{plane: {z: 0}}", "dig.csv",
        fmt::format("{{snapshots: {{{}}}, mesh: ply, journal: {{sync: {}}}}}", snapshots, sync));
    text.replace(text.find("0.025"), 5, "0.05");
    write_file(folder() / name, text);
  }

  /// Runs `soilvdb COMMAND` on a folder under the shim; safe to call from several threads.
  Result launch(const std::string& command, const std::string& out, const std::string& fault,
                const std::string& before = "") const {
    const fs::path base = folder() / out;
    const std::string to = command.starts_with("run") ? "--out " : "";
    const int status = std::system(
        fmt::format("cd '{}' && exec env SHIM_FOLDER='{}' SHIM_LOG='{}.log' SHIM_FAULT='{}' "
                    "LD_PRELOAD='{}' {}'{}' {} {}'{}' >'{}.out' 2>'{}.err'",
                    folder().string(), base.string(), base.string(), fault, SOILVDB_IO_SHIM, before,
                    SOILVDB_PROGRAM, command, to, base.string(), base.string(), base.string())
            .c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status),
            read_file(base.string() + ".out"), read_file(base.string() + ".err")};
  }

  /// What was done to the files of a folder, by launches since its log was removed.
  std::vector<std::string> operations(const std::string& out) const {
    std::istringstream log(read_file(folder() / (out + ".log")));
    std::vector<std::string> lines;
    for (std::string line; std::getline(log, line);) lines.push_back(line);
    return lines;
  }

  bool has_journal(const std::string& out) const { return fs::exists(folder() / out / "journal"); }

  /// Runs or goes on until it is done, and then compares.
  void expect_comes_back(const std::string& out) const {
    const bool old = has_journal(out) && is_old(out);
    const Result result = launch(has_journal(out) && !old ? "resume" : run_, out, "");
    EXPECT_EQ(result.status, 0) << result.err;
    expect_as_reference(out);
  }

  /// A finished run of other files in "old", and as it was replaced in "again".
  std::map<std::string, std::string> run_before() const {
    write_scenario("old.yaml", "every: 1.5", "always");
    EXPECT_EQ(launch("run old.yaml --voxel 0.1", "old", "").status, 0);
    std::map<std::string, std::string> old;
    for (const auto& entry : fs::directory_iterator(folder() / "old"))
      old[entry.path().filename()] = read_file(entry.path());
    EXPECT_TRUE(std::any_of(old.begin(), old.end(),
                            [&](const auto& file) { return !reference_.contains(file.first); }));
    fs::copy(folder() / "old", folder() / "again");
    EXPECT_EQ(launch(run_, "again", "").status, 0);
    expect_as_reference("again");
    return old;
  }
  /// Is it still the run of run_before()?
  bool is_old(const std::string& out) const {
    const fs::path old = folder() / "old/journal";
    return fs::exists(old) && read_file(folder() / out / "journal") == read_file(old);
  }
  /// Until the journal is the new run's, all files of the old one are there; none is ever half.
  void expect_old_or_new(const std::string& out,
                         const std::map<std::string, std::string>& old) const {
    for (const auto& [name, bytes] : old) {
      if (is_old(out)) {
        EXPECT_TRUE(read_file(folder() / out / name) == bytes) << name;
      }
    }
    for (const auto& entry : fs::directory_iterator(folder() / out)) {
      const std::string name = entry.path().filename();
      if (name == "journal" || name.ends_with(".tmp") || name.ends_with(".part")) continue;
      const auto before = old.find(name);
      const auto after = reference_.find(name);
      EXPECT_TRUE((before != old.end() && read_file(entry.path()) == before->second) ||
                  (after != reference_.end() && essence(entry.path()) == after->second))
          << name << " is neither old nor new";
    }
    EXPECT_FALSE(io::read_journal(folder() / out / "journal").damaged);
  }
  void expect_as_reference(const std::string& out) const {
    const auto run = essence_of_run(folder() / out);
    for (const auto& [name, text] : reference_) {
      ASSERT_TRUE(run.contains(name)) << out << "/" << name;
      EXPECT_TRUE(run.at(name) == text) << out << "/" << name;
    }
    EXPECT_EQ(run.size(), reference_.size());
  }

  /// Calls `f(i, out)` for i = 0, step, ... below end from two threads, each with a folder of its
  /// own.
  template <typename F>
  static void in_two_lanes(std::size_t end, std::size_t step, F f) {
    std::atomic<std::size_t> next = 0;
    const auto lane = [&](const std::string& out) {
      for (std::size_t i; (i = next.fetch_add(step)) < end && !HasFailure();) f(i, out);
    };
    std::thread other(lane, "lane1");
    lane("lane2");
    other.join();
  }

  /// Whatever is done at each operation is done at every so many-th; `tools/bench faults` does all.
  static std::size_t step() { return faults(19, kEvery, 1); }

  /// One operation after the other, always in the same order.
  std::string run_ = "run dig.yaml --threads 1";
  std::map<std::string, std::string> reference_;
  std::vector<std::string> operations_;
};

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
      acknowledged += std::holds_alternative<io::JournalMove>(reader.next().value());
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

/// Whatever operation fails, on a folder that held another run.
TEST_F(Crash, AnyOperationThatFailsIsSaidAndLeavesWhatWasThereWhole) {
  const std::map<std::string, std::string> old = run_before();
  const std::vector<std::string> all = operations("again");
  const std::vector<std::pair<int, std::string>> errors = {{ENOSPC, "No space left on device"},
                                                           {EIO, "Input/output error"},
                                                           {EROFS, "Read-only file system"}};
  std::atomic<std::size_t> failed = 0, tolerated = 0;
  in_two_lanes(all.size(), step(), [&](std::size_t i, const std::string& out) {
    const auto& [error, text] = errors[i % errors.size()];
    SCOPED_TRACE(fmt::format("operation {}: {}: {}", i + 1, all[i], text));
    fs::remove_all(folder() / out);
    fs::copy(folder() / "old", folder() / out);
    const char* kind = all[i].starts_with("write") && i % 2 ? "short" : "fail";
    const Result result = launch(run_, out, fmt::format("{} {} {}", kind, i + 1, error));
    if (result.status == 0) {
      // Nothing is at stake when a file that was read, or is synced already, is closed.
      EXPECT_TRUE(all[i].starts_with("close") || all[i].starts_with("fclose"));
      expect_as_reference(out);
      ++tolerated;
      return;
    }
    ++failed;
    EXPECT_EQ(result.status, 1);
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
    EXPECT_NE(result.err.find(text), std::string::npos) << result.err;
    EXPECT_NE(result.err.find((folder() / out).string()), std::string::npos) << result.err;
    expect_old_or_new(out, old);
    if (i % 4 == 0) expect_comes_back(out);
  });
  record_faults("each operation on a file fails", failed, "said and what was there is whole");
  record_faults("each operation on a file fails", tolerated, "nothing was at stake");
}

TEST_F(Crash, KilledWhileItReplacesARunItLeavesOneOrTheOther) {
  const std::map<std::string, std::string> old = run_before();
  const std::vector<std::string> all = operations("again");
  std::atomic<std::size_t> kills = 0;
  in_two_lanes(std::min<std::size_t>(all.size(), 30), faults(4, 1, 1),
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
      EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
      EXPECT_NE(result.err.find((folder() / out).string()), std::string::npos) << result.err;
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

TEST_F(Crash, AFullDiskAndAReadOnlyOneAreSaid) {
  const std::string mount = (folder() / "disk").string();
  fs::create_directories(mount);
  if (std::system(
          fmt::format("mount -t tmpfs -o size=64k tmpfs '{}' 2>/dev/null", mount).c_str()) != 0)
    GTEST_SKIP() << "can't mount";
  const Result full = run(fmt::format("run dig.yaml --out '{}/dig'", mount));
  EXPECT_EQ(full.status, 1);
  EXPECT_NE(full.err.find("No space left on device"), std::string::npos) << full.err;
  const bool remounted = std::system(fmt::format("mount -o remount,ro '{}'", mount).c_str()) == 0;
  const Result read_only = run(fmt::format("resume '{}/dig'", mount));
  const Result verified = run(fmt::format("verify '{}/dig'", mount));
  std::system(fmt::format("mount -o remount,rw,size=10m '{}'", mount).c_str());
  const Result resumed = run(fmt::format("resume '{}/dig'", mount));
  if (resumed.status == 0) fs::copy(mount + "/dig", folder() / "more");
  std::system(fmt::format("umount '{}'", mount).c_str());
  ASSERT_TRUE(remounted);
  EXPECT_NE(read_only.status, 0);
  EXPECT_EQ(std::count(read_only.err.begin(), read_only.err.end(), '\n'), 1) << read_only.err;
  EXPECT_EQ(verified.status, 0) << verified.err;
  EXPECT_EQ(resumed.status, 0) << resumed.err;
  expect_as_reference("more");
  record_faults("full disk and read-only disk", 2, "said; went on to the same files");
}

#endif

}  // namespace
}  // namespace soilvdb::testing
