// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Journals that lost their end, or have flipped bits or pages of zeros or rubbish: read up to
// there.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <random>
#include <string>
#include <vector>

#include "soilvdb/io/journal.h"
#include "tests/io/journal_fixture.h"
#include "tests/support/faults.h"

namespace soilvdb::io {
namespace journal_damage_test {

bool is_prefix(const std::vector<std::string>& part, const std::vector<std::string>& all) {
  return part.size() <= all.size() && std::equal(part.begin(), part.end(), all.begin());
}

TEST_F(Journal, CutOffAnywhereItHoldsWhatCameBefore) {
  const std::string bytes = write(12, 2);
  const std::vector<std::string> all = reading(folder_ / "journal").records;
  std::size_t least = all.size();
  for (std::size_t size = bytes.size(); size-- > 0;) {
    std::filesystem::resize_file(folder_ / "journal", size);
    const Reading part = reading(folder_ / "journal");
    EXPECT_TRUE(is_prefix(part.records, all)) << size;
    EXPECT_FALSE(part.damaged) << size;
    EXPECT_LT(part.records.size(), all.size()) << size;
    EXPECT_LE(part.records.size(), least) << size;
    EXPECT_GE(part.records.size() + 3, least) << size;  // at most a frame less
    least = part.records.size();
  }
  EXPECT_EQ(least, 0u);
  test::record_faults("journals cut off at each length", bytes.size(), "read up to there");
}

TEST_F(Journal, FlippedBitsAreNeverAcceptedAndSaidWhereTheyWereSynced) {
  const std::string bytes = write(30, 2);
  const auto file = folder_ / "journal";
  const std::vector<std::string> all = reading(file).records;
  const std::size_t last_frame = bytes.size() - 33;  // 32 bytes of head, a tag
  std::mt19937 random(7);
  std::size_t damaged = 0, refused = 0;
  const std::size_t count = test::faults(1000, 10'000, 100'000);
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t at = random() % bytes.size();
    poke(file, at, std::string(1, static_cast<char>(bytes[at] ^ (1 << random() % 8))));
    const Reading part = reading(file);
    poke(file, at, bytes.substr(at, 1));
    ASSERT_TRUE(is_prefix(part.records, all)) << at;
    ASSERT_LT(part.records.size(), all.size()) << at;
    ASSERT_EQ(part.damaged || part.refused, at < last_frame) << at;
    ASSERT_LE(part.good_bytes, at);
    damaged += part.damaged;
    refused += part.refused;
  }
  EXPECT_GT(damaged, count * 8 / 10);
  EXPECT_GT(refused, 0u);  // where the configuration is hit
  EXPECT_EQ(reading(file).records, all);
  test::record_faults("journals with a flipped bit", count, "read up to there");
}

TEST_F(Journal, ZeroedPagesAndRubbishAreFoundToo) {
  const std::string bytes = write(400, 5);
  const auto file = folder_ / "journal";
  const std::vector<std::string> all = reading(file).records;
  std::mt19937 random(11);
  const std::size_t count = test::faults(200, 1000, 10'000);
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t at = random() % (bytes.size() - 512);
    const std::size_t size = std::min<std::size_t>(bytes.size() - at, i % 2 ? 512 : 4096);
    std::string page(size, '\0');
    if (i % 3 == 0)
      for (char& c : page) c = static_cast<char>(random());
    poke(file, at, page);
    const Reading part = reading(file);
    poke(file, at, bytes.substr(at, size));
    ASSERT_TRUE(is_prefix(part.records, all)) << at;
    ASSERT_LT(part.records.size(), all.size()) << at;
  }
  test::record_faults("journals with a page of zeros or rubbish", count, "read up to there");
}

/// Frames that the disk wrote in another order before the power went are no damage.
TEST_F(Journal, AFrameThatWasNeverSyncedMayBeMissing) {
  const auto file = folder_ / "journal";
  const Motion way = motion(8000);
  std::uint64_t synced = 0;
  {
    JournalWriter writer(file, begin_journal(file, {"configuration"}), {}, 3600);
    writer.add(update(way, 0));
    writer.flush();
    synced = std::filesystem::file_size(file);
    for (int i = 2; i < 15'000; i += 2)
      writer.add(update(way, i));  // frames without a sync between
  }
  std::string bytes = content(file);
  ASSERT_GT(bytes.size(), synced + 300'000);
  for (std::size_t k = synced; k < synced + 100; ++k) bytes[k] = '\0';
  const Reading part = reading(folder_.write("bad", bytes));
  EXPECT_FALSE(part.damaged);
  EXPECT_EQ(part.good_bytes, synced);
}

TEST(JournalFrames, AHeadThatLiesAcrossABorderOfBlocksIsFound) {
  const test::TempFolder folder;
  const auto file = folder / "journal";
  constexpr std::size_t kBlock = std::size_t{1} << 20, kHead = 32;
  for (const std::size_t before : {1u, 8u, 31u, 32u}) {  // bytes of the head in the first block
    const std::uint64_t place = io::begin_journal(file, {"configuration"});
    {
      io::JournalWriter writer(file, place, {}, 3600);
      const std::size_t numbers = 1 + 3 * 8 + 4 + 4;
      writer.add(io::JournalFile{std::string(kBlock - before - kHead - numbers, 'a')});
      writer.flush();
      writer.add(io::JournalRemoval{"b"});
      writer.flush();
    }
    std::fstream(file, std::ios::in | std::ios::out | std::ios::binary)
        .seekp(static_cast<std::streamoff>(place + 1000))
        .put('b');
    const io::JournalContent journal = io::read_journal(file);
    EXPECT_EQ(journal.good_bytes, place);
    EXPECT_TRUE(journal.damaged) << before;
  }
}

}  // namespace journal_damage_test
}  // namespace soilvdb::io
