// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Runs that are killed, lose their power or their disk at any operation on any file.
#pragma once

#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <atomic>
#include <map>
#include <string>
#include <thread>
#include <vector>

#include "soilvdb/io/journal.h"
#include "tests/support/faults.h"
#include "tests/support/program.h"

namespace soilvdb::test {

#ifdef SOILVDB_IO_SHIM

inline constexpr int kKilled = 128 + SIGKILL;

/// A row of updates.csv without its fifth field, the time it took.
inline std::string without_time(const std::string& line) {
  std::size_t from = 0;
  for (int i = 0; i < 4; ++i) from = line.find(',', from) + 1;
  const std::size_t to = line.find(',', from);
  return line.substr(0, from) + (to == std::string::npos ? "" : line.substr(to));
}

/// A file as it must be again: without how long things took.
inline std::string essence(const fs::path& file) {
  std::string text = read_file(file);
  if (file.filename() == "updates.csv") {
    std::istringstream lines(text);
    text.clear();
    for (std::string line; std::getline(lines, line);) text += without_time(line) + "\n";
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

inline std::map<std::string, std::string> essence_of_run(const fs::path& folder) {
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
    write_scenario("dig.yaml", "every: 2", "always", 3.5);
    write_scenario("lazy.yaml", "every: 2", "0.01", 3.5);
    write_scenario("beside.yaml", "every: 0.6, incremental: true, keep: 2", "0.01", 0.3);
    const Result result = launch(run_, "ref", "");
    ASSERT_EQ(result.status, 0) << result.err;
    reference_ = essence_of_run(folder() / "ref");
    operations_ = operations("ref");
  }

  /// A bucket that fills up and spills, pours on the ground, from a time to 3.5 s, and into a
  /// hopper.
  void write_scenario(const std::string& name, const std::string& snapshots,
                      const std::string& sync, double pour_s) const {
    write_file(folder() / name,
               fmt::format(
                   "soilvdb: 1\nname: dig\nvoxel_size: 0.05\nterrain: {{plane: {{z: 0}}}}\n"
                   "soil: {{repose_angle: 0.61, swell: 0.25}}\nmachines:\n  - name: digger\n"
                   "    bucket: {{width: 0.2, height: 0.3, profile: [[0, 0], [-0.2, 0.1], "
                   "[0, 0.3]]}}\n    motion: dig.csv\n"
                   "pours:\n  - {{name: truck, at: [0.5, 0.2, 1], time: [{}, 3.5], volume: 0.01}}\n"
                   "  - {{name: tip, at: [2, 0, 1], time: [4.5, 4.5], volume: 0.01}}\n"
                   "hoppers:\n  - {{name: bed, box: [1.5, -1, 3, 1], top: 0.5}}\n"
                   "output: {{snapshots: {{{}}}, mesh: ply, journal: {{sync: {}}}{}}}\n",
                   pour_s, snapshots, sync, more_output_));
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
    write_scenario("old.yaml", "every: 1.5", "always", 3.5);
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

  /// Whatever is done at each operation is done at every so many-th.
  static std::size_t step() { return fault_step(19, 3); }

  /// One operation after the other, always in the same order.
  std::string more_output_;  // of all scenarios
  std::string run_ = "run dig.yaml --threads 1";
  std::map<std::string, std::string> reference_;
  std::vector<std::string> operations_;
};

#endif

}  // namespace soilvdb::test
