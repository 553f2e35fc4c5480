// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Files of a run that lost their end, or have flipped bits or zeroed pages: found and said, never
// taken for what they are not, never a crash. journal_damage_test.cc has the same for journals,
// foreign_damage_test.cc for other programs' .vdb files.
#include <ctime>

#include "soilvdb/io/journal.h"
#include "soilvdb/io/snapshot.h"
#include "tests/program/damage_fixture.h"
#include "tests/support/faults.h"
#include "tests/support/program.h"

namespace soilvdb::test {
namespace damage_test {

/// A dig with incremental snapshots, and what is left of it when it is interrupted.
class DamagedRun : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    // A long trench, of which each snapshot adds a short part, where one node of the tree holds
    // all.
    std::string rows = "time,x,y,z\n";
    for (int i = 0; i <= 40; ++i) rows += fmt::format("{},{},5,{}\n", 0.1 * i, 5 + 0.1 * i, 4.85);
    write_file(folder() / "dig.csv", rows);
    // Soil that moves, so that some of it is loose.
    const std::string text = half_sine_scenario(
        "{plane: {z: 5}}\nsoil: {repose_angle: 0.6, swell: 0.2}\n"
        "pours: [{name: heap, at: [8, 5.1, 6], time: [0.1, 0.1], volume: 0.005}]",
        "dig.csv",
        "{snapshots: {every: 0.4, incremental: true}, mesh: ply, journal: {sync: always}}");
    write_file(folder() / "dig.yaml", text);
    const Result result = run("run dig.yaml --threads 1 --out whole");
    ASSERT_EQ(result.status, 0) << result.err;
    hash_ = read_json(folder() / "whole/summary.json")["state_hash"];
    const std::string journal = read_file(folder() / "whole/journal");
    fs::copy(folder() / "whole", folder() / "ended");
    for (const char* name : {"summary.json", "soil_final.vdb", "soil_final.ply", "updates.csv"})
      fs::remove(folder() / "ended" / name);
    fs::resize_file(folder() / "ended/journal", journal.size() * 9 / 10);
    files_ = io::read_journal(folder() / "ended/journal").files;
    for (std::string name = files_.back().name; !name.empty(); name = find(name).parent)
      chain_.insert(chain_.begin(), name);
    ASSERT_GE(chain_.size(), 3u);
    ASSERT_GT(files_.size(), chain_.size());
  }

  const io::JournalFile& find(const std::string& name) const {
    return *std::find_if(files_.begin(), files_.end(),
                         [&](const io::JournalFile& file) { return file.name == name; });
  }
  fs::path ended(const std::string& name) const { return folder() / "ended" / name; }

  /// Reads the snapshot at `newest`, which needs what is damaged.
  void expect_refused_in_time(const fs::path& newest) {
    const std::clock_t begin = std::clock();
    try {
      io::read_snapshot(newest);
      ADD_FAILURE() << newest << " was accepted";
    } catch (const io::InputError&) {
    }
    const double took_s = static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC;
    slowest_s_ = std::max(slowest_s_, took_s);
  }

  /// Damages the whole snapshot, which is read by itself and as what others go on from, and the
  /// newest one, `count` times in all.
  template <typename F>
  void expect_refused(std::size_t count, F damaged) {
    const fs::path whole = ended(chain_.front()), newest = ended(chain_.back());
    const std::pair<fs::path, fs::path> cases[] = {
        {whole, whole}, {newest, newest}, {whole, newest}};
    for (const auto& [file, read] : cases) {
      const std::string good = read_file(file);
      for (std::size_t i = 0; i < count / std::size(cases) + 1 && !HasFailure(); ++i) {
        write_file(file, damaged(good));
        expect_refused_in_time(read);
      }
      write_file(file, good);
      EXPECT_NO_THROW(io::read_snapshot(read));
    }
    EXPECT_LT(slowest_s_, kHang_s);
  }

  std::string hash_;
  std::vector<io::JournalFile> files_;  ///< snapshots that the journal knows, oldest first
  std::vector<std::string> chain_;      ///< the newest and those it needs, a whole one first
  double slowest_s_ = 0;
};

TEST_F(DamagedRun, SnapshotsOfAnyOtherLengthAreRefused) {
  std::size_t count = 0;
  const std::pair<std::string, std::size_t> steps[] = {{chain_.front(), fault_step(32, 8)},
                                                       {chain_.back(), fault_step(32, 1)}};
  for (const auto& [name, step] : steps) {
    const fs::path file = ended(name);
    const std::string good = read_file(file);
    for (std::size_t size = good.size(); size >= step && !HasFailure(); ++count) {
      fs::resize_file(file, size -= step);
      expect_refused_in_time(file);
    }
    write_file(file, good + '\0');
    expect_refused_in_time(file);
  }
  EXPECT_LT(slowest_s_, kHang_s);
  record_faults("snapshots cut off at each length", count, "refused");
}

TEST_F(DamagedRun, SnapshotsWithAFlippedBitAreRefused) {
  const std::size_t count = faults(500, 3000, 100'000);
  Damage damage(7);
  expect_refused(count, [&](const std::string& good) { return damage.flipped(good); });
  record_faults("snapshots with a flipped bit", count, "refused");
}

TEST_F(DamagedRun, SnapshotsWithAZeroedPageAreRefused) {
  const std::size_t count = faults(200, 1000, 10'000);
  Damage damage(8);
  expect_refused(count, [&](const std::string& good) { return damage.zeroed(good); });
  record_faults("snapshots with a zeroed page or sector", count, "refused");
}

TEST_F(DamagedRun, FallsBackAGenerationSaysSoAndEndsInTheSameGround) {
  const std::size_t count = faults(8, 20, 500);
  std::size_t generations = 0, journals = 0, refused = 0;
  Damage damage(9);
  for (std::size_t i = 0; i < count && !HasFailure(); ++i) {
    fs::remove_all(folder() / "run");
    fs::copy(folder() / "ended", folder() / "run");
    const std::size_t which = damage.below(chain_.size() + 1);
    const bool is_journal = which == chain_.size();
    const fs::path file = folder() / "run" / (is_journal ? "journal" : chain_[which]);
    write_file(file, damage.any(read_file(file)));
    SCOPED_TRACE(fmt::format("case {}: {}", i, file.filename().string()));
    bool damaged = false, no_journal = false;
    if (is_journal) {
      try {
        damaged = io::read_journal(file).damaged;
      } catch (const io::InputError&) {
        no_journal = true;
      }
    }
    const auto before = content();
    const Result result = shell(fmt::format("timeout -s KILL 60 '{}' resume run", SOILVDB_PROGRAM));
    if (no_journal) {
      EXPECT_EQ(result.status, 2);
      EXPECT_NE(result.err.find("damaged at its start"), std::string::npos) << result.err;
      EXPECT_EQ(content(), before);
      ++refused;
      continue;
    }
    EXPECT_EQ(result.status, 0) << result.err;
    EXPECT_EQ(read_json(folder() / "run/summary.json")["state_hash"], hash_);
    const auto says = [](const std::string& text, const std::string& what) {
      return text.find(what) != std::string::npos;
    };
    if (is_journal) {
      EXPECT_EQ(says(result.err, "journal: is damaged at byte"), damaged) << result.err;
      ++journals;
      continue;
    }
    EXPECT_TRUE(says(result.err, file.filename().string())) << result.err;
    EXPECT_TRUE(says(result.err, "; it is made anew\n")) << result.err;
    const std::string before_it = files_[files_.size() - chain_.size() + which - 1].name;
    EXPECT_TRUE(says(result.out, "going on from " + before_it + "\n")) << result.out;
    ++generations;
  }
  record_faults("resumed beside a damaged snapshot", generations, "fell back and the same ground");
  record_faults("resumed from a damaged journal", journals, "the same ground");
  record_faults("resumed from a journal damaged at its start", refused, "refused");
}

}  // namespace damage_test
}  // namespace soilvdb::test
