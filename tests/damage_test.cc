// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Files of a run that lost their end, or have flipped bits or zeroed pages, and other programs'
// .vdb files that have: found and said, never taken for what they are not, never a crash.
// journal_test.cc has the same for journals.
#include <sys/resource.h>

#include <cstdint>
#include <cstring>
#include <ctime>
#include <random>

#include "soilvdb/io/checksum.h"
#include "soilvdb/io/journal.h"
#include "soilvdb/io/snapshot.h"
#include "tests/faults.h"
#include "tests/program.h"
#include "tests/sanitized.h"
#include "tests/spheres.h"

namespace soilvdb::testing {
namespace {

constexpr double kHang_s = 2;

/// A file's bytes, damaged in one way or another so that they differ.
class Damage {
 public:
  explicit Damage(unsigned seed) : random_(seed) {}

  std::string cut_off(const std::string& good) { return good.substr(0, below(good.size())); }
  std::string flipped(std::string bytes) {
    const std::size_t at = below(bytes.size());
    bytes[at] = static_cast<char>(bytes[at] ^ (1 << below(8)));
    return bytes;
  }
  /// A page or a sector of zeros.
  std::string zeroed(const std::string& good) {
    for (;;) {
      const std::size_t size = below(2) ? 4096 : 512;
      const std::size_t at = below(good.size()) / size * size;
      std::string bytes = good;
      std::fill_n(bytes.begin() + static_cast<std::ptrdiff_t>(at),
                  std::min(size, bytes.size() - at), '\0');
      if (bytes != good) return bytes;
    }
  }
  /// One of the numbers that may be the size of a part, as another one.
  std::string resized(std::string bytes) {
    std::vector<std::size_t> places;
    std::int64_t number = 0;
    for (std::size_t at = 0; at + sizeof number <= bytes.size(); ++at) {
      std::memcpy(&number, bytes.data() + at, sizeof number);
      if (number > 0 && number < (1 << 16)) places.push_back(at);
    }
    const std::size_t at = places[below(places.size())];
    std::memcpy(&number, bytes.data() + at, sizeof number);
    const std::int64_t numbers[] = {-number, number + 1, number - 1, std::int64_t{1} << 40,
                                    -2056,   -(1 << 16), 2049,       number ^ (-1ll << 62)};
    std::memcpy(bytes.data() + at, &numbers[below(std::size(numbers))], sizeof number);
    return bytes;
  }
  /// Eight bytes of which a reader may think that they are a number.
  std::string overwritten(std::string bytes) {
    const std::uint64_t numbers[] = {0, ~0ull, 1ull << 63, (1ull << 31) - 1, random_()};
    std::memcpy(bytes.data() + below(bytes.size() - 8), &numbers[below(5)], 8);
    return bytes;
  }
  std::string any(const std::string& good) {
    const std::size_t kind = below(3);
    return kind == 0 ? cut_off(good) : kind == 1 ? flipped(good) : zeroed(good);
  }
  std::size_t below(std::size_t end) { return static_cast<std::size_t>(random_() % end); }

 private:
  std::mt19937_64 random_;
};

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
    const std::string text = half_sine_scenario(
        "{plane: {z: 5}}", "dig.csv",
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
  const std::pair<std::string, std::size_t> steps[] = {{chain_.front(), faults(32, 8, 1)},
                                                       {chain_.back(), faults(32, 1, 1)}};
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

/// A level set that OpenVDB wrote, of which nothing vouches for the bytes.
class DamagedForeign : public ProgramTest, public ::testing::WithParamInterface<const char*> {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    openvdb::initialize();
    const auto sphere = test::level_set_sphere(0.6f, {0.5f, 0, -0.6f}, 0.05f);
    openvdb::io::File vdb((folder() / "ball.vdb").string());
    const std::string compression = GetParam();
    vdb.setCompression(openvdb::io::COMPRESS_ACTIVE_MASK |
                       (compression == "blosc" ? openvdb::io::COMPRESS_BLOSC
                        : compression == "zip" ? openvdb::io::COMPRESS_ZIP
                                               : openvdb::io::COMPRESS_NONE));
    vdb.write({sphere});
    vdb.close();
    write_file(folder() / "dig.csv", HalfSine{}.csv(5));
    std::string text = half_sine_scenario("{level_set: ball.vdb}");
    text.replace(text.find("0.025"), 5, "0.1");
    write_file(folder() / "dig.yaml", text);
  }

  /// What a command says of the file, but for how long it took.
  std::string said(const Result& result) const {
    const fs::path summary = folder() / "out/summary.json";
    return fs::exists(summary) ? read_json(summary)["state_hash"].get<std::string>() : result.out;
  }
};

INSTANTIATE_TEST_SUITE_P(Compressions, DamagedForeign, ::testing::Values("blosc", "zip", "none"),
                         [](const auto& test) { return std::string(test.param); });

TEST_P(DamagedForeign, IsReadInAChildThatMayBreak) {
  const std::string good = read_file(folder() / "ball.vdb");
  const char* const commands[] = {"info ball.vdb", "run dig.yaml --no-snapshots --out out",
                                  "export ball.vdb --to ball.ply"};
  std::map<std::string, std::string> expected;
  for (const char* command : commands) {
    fs::remove_all(folder() / "out");
    const Result result = run(command);
    // Only what soilvdb wrote is exported.
    EXPECT_EQ(result.status, command == commands[2] ? 2 : 0) << result.err;
    expected[command] = said(result);
  }
  const std::size_t count = faults(4, 12, 1000);
  std::size_t refused = 0, broke = 0, same = 0, other = 0;
  Damage damage(10);
  double slowest_s = 0;
  for (std::size_t i = 0; i < count && !HasFailure(); ++i) {
    const std::string head = good.substr(0, 2000);  // names, types and sizes
    const std::size_t kind = damage.below(5);
    const std::string bad = kind == 0   ? damage.cut_off(good)
                            : kind == 1 ? damage.flipped(good)
                            : kind == 2 ? damage.overwritten(good)
                            : kind == 3 ? damage.flipped(head) + good.substr(head.size())
                                        : damage.resized(good);
    write_file(folder() / "ball.vdb", bad);
    // Most often what reads it all.
    const char* command = commands[i % 8 == 7 ? 2 : i % 2];
    SCOPED_TRACE(fmt::format("case {}: {}", i, command));
    fs::remove_all(folder() / "out");
    rusage before{}, after{};
    getrusage(RUSAGE_CHILDREN, &before);
    const Result result =
        shell(fmt::format("timeout -s KILL 60 '{}' {}", SOILVDB_PROGRAM, command));
    getrusage(RUSAGE_CHILDREN, &after);
    const auto seconds = [](const rusage& r) {
      return static_cast<double>(r.ru_utime.tv_sec + r.ru_stime.tv_sec) +
             1e-6 * static_cast<double>(r.ru_utime.tv_usec + r.ru_stime.tv_usec);
    };
    slowest_s = std::max(slowest_s, seconds(after) - seconds(before));
    if (result.status == 0) {
      ++(said(result) == expected[command] ? same : other);
      continue;
    }
    EXPECT_EQ(result.status, 2) << result.err;
    EXPECT_TRUE(result.err.starts_with("soilvdb: ball.vdb: ")) << result.err;
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
    EXPECT_FALSE(fs::exists(folder() / "out"));
    const bool child = result.err.find("memory or time than") != std::string::npos;
    ++(child ? broke : refused);
  }
  // The child and then the program itself read it, within what tools/app/child.cc gives them.
  EXPECT_LT(slowest_s, 3 * kHang_s);
  rusage all{};
  getrusage(RUSAGE_CHILDREN, &all);
  if (!test::kSanitized) {
    EXPECT_LT(all.ru_maxrss, 1 << 20) << "kB";
  }
  EXPECT_EQ(refused + broke + same + other, count);
  const std::string kind = fmt::format("{}: damaged .vdb of another program", GetParam());
  record_faults(kind, refused, "refused");
  record_faults(kind, broke, "broke the child; refused");
  record_faults(kind, same, "accepted and the same result");
  record_faults(kind, other, "accepted and another result: nothing vouches for it");
}

}  // namespace
}  // namespace soilvdb::testing
