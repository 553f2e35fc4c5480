// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What the ground holds of memory: counted as it is, and kept to a limit without a bit of
// difference.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <tbb/global_control.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <random>

#include "io/snapshot/swap_file.h"
#include "soilvdb/io/site.h"
#include "soilvdb/surface_height.h"
#include "soilvdb/tracker.h"
#include "tests/support/sanitized.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::test {
namespace memory_test {

double resident_bytes() {
  long pages = 0, resident = 0;
  std::FILE* file = std::fopen("/proc/self/statm", "r");
  if (file == nullptr || std::fscanf(file, "%ld %ld", &pages, &resident) != 2) std::abort();
  std::fclose(file);
  return static_cast<double>(resident) * static_cast<double>(sysconf(_SC_PAGESIZE));
}

/// Waves of 0.5 m, posts 0.1 m apart.
class Waves : public HeightSource {
 public:
  void read(int x0, int y0, int nx, int ny, float* out) const override {
    for (int y = y0; y < y0 + ny; ++y)
      for (int x = x0; x < x0 + nx; ++x)
        *out++ = 0.5f * std::sin(0.02f * static_cast<float>(x)) *
                 std::cos(0.03f * static_cast<float>(y));
  }
};

std::shared_ptr<const InitialTerrain> waves() {
  HeightGrid grid;
  grid.nx = grid.ny = 2000;
  grid.spacing = {0.1, 0.1};
  return make_height_field(grid, std::make_shared<Waves>());
}

/// Memory accounted and how the resident set grew, in a process that has dug nothing before.
void dig_and_measure(int out) {
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const double before = resident_bytes();
  Ground ground(0.025, Vec3::Zero(), waves());
  Tracker tracker(ground, {Bucket{17, 0.6, {}, {}}});
  for (int lane = 0; lane < 7; ++lane) {
    const double y = 20 + 18.0 * lane;
    tracker.update(0, Pose{{10, y, 3}});
    for (int i = 0; i <= 150; ++i) {
      const double x = 10 + 0.5 * i;
      tracker.update(0, Pose{{x, y, 0.1 + 0.3 * std::sin(0.3 * i)}});
    }
  }
  const double result[] = {static_cast<double>(ground.memory_bytes()), resident_bytes() - before};
  if (write(out, result, sizeof(result)) != sizeof(result)) std::abort();
}

// First: the process hasn't had threads or memory before.
TEST(Memory, IsAccountedWithinFivePercentOfTheGrowthOfTheResidentSet) {
  if (test::kSanitized) GTEST_SKIP() << "sanitizers take memory of their own";
  int pipe_ends[2];
  ASSERT_EQ(pipe(pipe_ends), 0);
  const pid_t child = fork();
  if (child == 0) {
    dig_and_measure(pipe_ends[1]);
    _exit(0);
  }
  close(pipe_ends[1]);  // the child's is the last: what it leaves unsaid ends the pipe
  double result[2] = {};
  const ssize_t size = read(pipe_ends[0], result, sizeof(result));
  close(pipe_ends[0]);
  int status = -1;
  EXPECT_EQ(waitpid(child, &status, 0), child);
  ASSERT_EQ(status, 0) << "the child came to another end";
  ASSERT_EQ(size, static_cast<ssize_t>(sizeof(result)));
  EXPECT_GT(result[1], 100e6);
  EXPECT_NEAR(result[0] / result[1], 1, 0.05) << result[0] << " accounted, grown " << result[1];
}

TEST(Memory, SamplesAreKeptHoweverTheyShrink) {
  std::mt19937_64 random(1);
  SampleWords words, kept;
  for (std::uint64_t& word : words) {
    const std::uint64_t kind = random() % 3;
    word = kind == 0 ? 0 : kind == 1 ? kAllSoil : random();
  }
  Samples samples;
  samples.assign(words);
  for (int i = 0; i < 5000; ++i) {
    const int n = static_cast<int>(random() % kChunkVoxels);
    std::uint64_t& word = words[static_cast<std::size_t>(n)];
    EXPECT_EQ(samples.word(n), word);
    word &= random() % 8 == 0 ? 0 : random();
    samples.set_word(n, word);
    if (i % 100 == 0) samples.trim();
    samples.expand(kept);
    ASSERT_EQ(kept, words) << i;
  }
}

// A snapshot is written from a copy on another thread.
TEST(Memory, HeightsAreNotForgottenUnderACopyThatReadsThem) {
  constexpr std::uint64_t kLimit = 8 << 20;
  const test::TempFolder folder;
  io::Site site;
  site.ground = std::make_unique<Ground>(0.05, Vec3::Zero(), waves());
  Ground& ground = *site.ground;
  ground.set_memory_limit(kLimit, std::make_shared<io::SwapFile>(folder.path()));
  {
    const io::Site copy = io::undug_site(site);
    for (double x = 1; x < 199; x += 5)
      for (double y = 1; y < 199; y += 5)
        EXPECT_EQ(surface_height(ground, x, y), surface_height(*copy.ground, x, y));
    EXPECT_GT(ground.memory_bytes(), kLimit);
    EXPECT_THROW(ground.evict(), std::runtime_error);
    EXPECT_GT(ground.memory_bytes(), kLimit) << "what the copy reads is gone";
  }
  ground.evict();
  EXPECT_LE(ground.memory_bytes(), kLimit);
}

constexpr std::size_t kMachines = 5;

/// Machines that dig here and there, come back, and get in each other's way.
std::vector<std::vector<Move>> moves() {
  std::mt19937 random(7);
  std::vector<Vec2> at(kMachines, Vec2::Zero());
  std::vector<std::vector<Move>> batches(25);
  for (std::vector<Move>& batch : batches) {
    for (std::size_t m = 0; m < kMachines; ++m) {
      if (random() % 8 == 0)
        at[m] = {10.0 * static_cast<double>(random() % 3), 8.0 * static_cast<double>(random() % 3)};
      for (int i = 0; i < 8; ++i) {
        at[m] += Vec2(0.15, 0.01 * static_cast<double>(m));
        Move move;
        move.machine = m;
        move.to = {{50 + at[m].x(), 50 + at[m].y(), -0.2 - 0.2 * std::sin(2 * at[m].x())},
                   from_rpy(0, 0.2 * std::sin(at[m].x()), 0)};
        batch.push_back(move);
      }
    }
    std::shuffle(batch.begin(), batch.end(), random);
  }
  return batches;
}

struct Outcome {
  std::uint64_t hash = 0, bytes = 0;
  std::vector<double> cuts;
  double change_m3 = 0;
};

const std::vector<Bucket> kBuckets(kMachines, Bucket{1, 0.6, {{0, 0}, {-0.4, 0.1}, {0, 0.6}}, {}});

Outcome dig(std::uint64_t limit_bytes, std::size_t threads, const std::filesystem::path& folder) {
  const tbb::global_control control(tbb::global_control::max_allowed_parallelism, threads);
  Ground ground(0.05, Vec3::Zero(), waves());
  if (limit_bytes != 0)
    ground.set_memory_limit(limit_bytes, std::make_shared<io::SwapFile>(folder));
  Tracker tracker(ground, kBuckets);
  Outcome outcome;
  for (const std::vector<Move>& batch : moves()) {
    for (const Update& update : tracker.update(batch)) outcome.cuts.push_back(update.cut_m3);
    if (limit_bytes == 0) continue;
    ground.evict();
    EXPECT_LE(ground.memory_bytes(), limit_bytes);
  }
  outcome.hash = ground.state_hash();
  outcome.bytes = ground.memory_bytes();
  outcome.change_m3 = ground.change_m3();
  return outcome;
}

TEST(Memory, ALimitIsKeptAndChangesNoBitWithAnyNumberOfThreads) {
  const test::TempFolder folder;
  const Outcome free = dig(0, 1, folder.path());
  for (const std::uint64_t part : {2u, 4u}) {
    if (test::kSanitized && part == 2) continue;
    for (const std::size_t threads : {1u, 2u}) {
      const Outcome kept = dig(free.bytes / part, threads, folder.path());
      EXPECT_EQ(kept.hash, free.hash) << part;
      EXPECT_EQ(kept.cuts, free.cuts) << part;
      EXPECT_EQ(kept.change_m3, free.change_m3) << part;
      EXPECT_LT(kept.bytes, free.bytes);
    }
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

/// Ground with something in it, and its hash.
struct Dug {
  Ground ground{0.05, Vec3::Zero(), waves()};
  std::uint64_t hash = 0;
  Dug() {
    Tracker tracker(ground, kBuckets);
    for (const std::vector<Move>& batch : moves()) tracker.update(batch);
    hash = ground.state_hash();
  }
};

TEST(Memory, ALimitThatCantBeKeptIsAnErrorAndTheGroundIsWhole) {
  const test::TempFolder folder;
  Dug dug;
  dug.ground.set_memory_limit(1000, std::make_shared<io::SwapFile>(folder.path()));
  EXPECT_THROW(dug.ground.evict(), std::runtime_error);
  EXPECT_EQ(dug.ground.state_hash(), dug.hash);
}

TEST(Memory, AFullDiskIsAnErrorAndTheGroundIsWhole) {
  const test::TempFolder folder;
  Dug dug;
  dug.ground.set_memory_limit(dug.ground.memory_bytes() / 3,
                              std::make_shared<io::SwapFile>(folder.path()));
  std::signal(SIGXFSZ, SIG_IGN);
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const rlimit small{100'000, before.rlim_max};
  setrlimit(RLIMIT_FSIZE, &small);
  EXPECT_THROW(dug.ground.evict(), std::runtime_error);
  setrlimit(RLIMIT_FSIZE, &before);
  EXPECT_EQ(dug.ground.state_hash(), dug.hash);
}

TEST(Memory, GroundThatComesBackDamagedIsRefused) {
  const test::TempFolder folder;
  const auto file = std::make_shared<io::SwapFile>(folder.path());
  Dug dug;
  dug.ground.set_memory_limit(dug.ground.memory_bytes() / 2, file);
  dug.ground.evict();
  EXPECT_EQ(dug.ground.state_hash(), dug.hash);
  int flipped = 0;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) {
    std::error_code gone;
    if (!std::filesystem::read_symlink(entry, gone).string().starts_with(folder.path().string()))
      continue;
    const int descriptor = open(entry.path().c_str(), O_RDWR | O_CLOEXEC);
    char byte = 0;
    ASSERT_EQ(pread(descriptor, &byte, 1, 5000), 1);
    byte = static_cast<char>(byte ^ 4);
    ASSERT_EQ(pwrite(descriptor, &byte, 1, 5000), 1);
    close(descriptor);
    ++flipped;
  }
  EXPECT_EQ(flipped, 1);
  EXPECT_THROW(dug.ground.state_hash(), std::runtime_error);
}

}  // namespace memory_test
}  // namespace soilvdb::test
