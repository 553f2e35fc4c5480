// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a journal calls acknowledged, and vouches for, is on disk: against a disk that keeps nothing
// but what was synced.
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <map>
#include <mutex>
#include <sstream>
#include <thread>

#include "soilvdb/io/journal.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::test {
namespace journal_power_test {

/// How much of each file would be left if the power went now.
class Disk {
 public:
  void synced(int descriptor) {
    struct stat status {};
    if (fstat(descriptor, &status) != 0) return;
    const std::lock_guard lock(mutex_);
    size_[status.st_ino] = status.st_size;
  }
  /// A new file may have the number of one that was deleted.
  void forget(const std::filesystem::path& file) {
    struct stat status {};
    const std::lock_guard lock(mutex_);
    if (stat(file.c_str(), &status) == 0) size_.erase(status.st_ino);
  }
  std::int64_t size(const std::filesystem::path& file) const {
    struct stat status {};
    if (stat(file.c_str(), &status) != 0) return -1;
    const std::lock_guard lock(mutex_);
    const auto at = size_.find(status.st_ino);
    return at == size_.end() ? 0 : at->second;
  }

 private:
  mutable std::mutex mutex_;
  std::map<ino_t, std::int64_t> size_;
};

Disk& disk() {
  static Disk one;
  return one;
}

}  // namespace journal_power_test
}  // namespace soilvdb::test

// In the place of the C library's.
extern "C" int fsync(int descriptor) {
  soilvdb::test::journal_power_test::disk().synced(descriptor);
  return static_cast<int>(syscall(SYS_fsync, descriptor));
}
extern "C" int fdatasync(int descriptor) {
  soilvdb::test::journal_power_test::disk().synced(descriptor);
  return static_cast<int>(syscall(SYS_fdatasync, descriptor));
}

namespace soilvdb::test {
namespace journal_power_test {

constexpr double kNever_s = 3600;  // until a sync that nobody asks for

/// @param rows in (i, i + 1]
io::JournalUpdate move(int i, int rows = 1) {
  io::JournalUpdate move;
  move.begin_s = i;
  move.end_s = i + 1;
  move.rows.columns = 1;
  for (int k = 0; k <= rows; ++k) {
    move.rows.times_s.push_back(i + static_cast<double>(k) / rows);
    move.rows.values.push_back(std::sin(k));
  }
  return move;
}

class JournalPower : public ::testing::Test {
 protected:
  const test::TempFolder folder_;
  const std::filesystem::path file_ = folder_ / "journal";

  static std::string content(const std::filesystem::path& file) {
    std::ostringstream text;
    text << std::ifstream(file, std::ios::binary).rdbuf();
    return text.str();
  }
  /// The journal as a power cut now would leave it.
  io::JournalContent after_a_cut() const {
    const auto size = static_cast<std::size_t>(disk().size(file_));
    return io::read_journal(folder_.write("cut", content(file_).substr(0, size)));
  }
  /// Adds more than is kept waiting for a sync, and returns when that is written.
  void add_much(io::JournalWriter& writer, int i) const {
    constexpr int kRows = 40'000;
    const auto size = std::filesystem::file_size(file_) + kRows * sizeof(double);
    writer.add(move(i, kRows));
    while (std::filesystem::file_size(file_) < size)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
};

TEST_F(JournalPower, WhatIsWrittenForItsSizeIsNotAcknowledgedBeforeItIsSynced) {
  io::JournalWriter writer(file_, io::begin_journal(file_, {"configuration"}), {}, kNever_s);
  for (int i = 0; i < 7; ++i) writer.add(move(i));
  writer.flush();
  for (int i = 7; i < 10; ++i) {
    add_much(writer, i);
    EXPECT_EQ(writer.acknowledged().updates, 7u);
    EXPECT_EQ(after_a_cut().done.updates, 7u);
  }
  // Nothing is left to write.
  writer.flush();
  EXPECT_EQ(writer.acknowledged().updates, 10u);
  EXPECT_EQ(after_a_cut().done.updates, 10u);
}

TEST_F(JournalPower, WhatIsNotSyncedIsNotVouchedFor) {
  io::JournalWriter writer(file_, io::begin_journal(file_, {"configuration"}), {}, kNever_s);
  add_much(writer, 0);
  const auto first = std::filesystem::file_size(file_);
  add_much(writer, 1);
  // Pages go to the disk in any order: of the two frames it has the second alone.
  std::string bytes = content(file_);
  std::fill_n(bytes.begin() + disk().size(file_), first - disk().size(file_), '\0');
  const io::JournalContent left = io::read_journal(folder_.write("left", bytes));
  EXPECT_EQ(left.done.updates, 0u);
  EXPECT_FALSE(left.damaged);
}

TEST_F(JournalPower, AcknowledgedWithinAnIntervalIsWhatIsOnDisk) {
  io::JournalWriter writer(file_, io::begin_journal(file_, {"configuration"}), {}, 0.002);
  for (int next = 0; next < 20'000;) {
    for (int i = 0; i < 400; ++i) writer.add(move(next++));
    const std::uint64_t acknowledged = writer.acknowledged().updates;
    EXPECT_GE(after_a_cut().done.updates, acknowledged);
  }
}

TEST_F(JournalPower, TheEndVouchesForAllBeforeIt) {
  {
    io::JournalWriter writer(file_, io::begin_journal(file_, {"configuration"}), {}, kNever_s);
    for (int i = 0; i < 50; ++i) writer.add(move(i));
    writer.add(io::JournalEnd{});
  }
  const io::JournalContent whole = io::read_journal(file_);
  ASSERT_TRUE(whole.ended);
  // The end is a frame of its own, a head and a letter; whatever is wrong before it is damage.
  const std::string bytes = content(file_);
  for (std::size_t at = 100; at + 33 < bytes.size(); at += 97) {
    std::string wrong = bytes;
    wrong[at] = static_cast<char>(wrong[at] ^ 8);
    EXPECT_TRUE(io::read_journal(folder_.write("wrong", wrong)).damaged) << at;
  }
}

TEST_F(JournalPower, WhatAProcessBeforeLeftUnsyncedIsOnDiskBeforeItCounts) {
  {
    io::JournalWriter writer(file_, io::begin_journal(file_, {"configuration"}), {}, kNever_s);
    for (int i = 0; i < 5; ++i) writer.add(move(i));
  }
  // As a kill leaves it: in the system's memory alone.
  const auto file = folder_.write("killed", content(file_));
  disk().forget(file);
  const io::JournalContent known = io::read_journal(file);
  ASSERT_EQ(known.done.updates, 5u);
  ASSERT_EQ(disk().size(file), 0);
  io::JournalWriter writer(file, known.good_bytes, known.done, kNever_s);
  EXPECT_EQ(writer.acknowledged().updates, known.done.updates);
  EXPECT_EQ(disk().size(file), static_cast<std::int64_t>(known.good_bytes));
}

}  // namespace journal_power_test
}  // namespace soilvdb::test
