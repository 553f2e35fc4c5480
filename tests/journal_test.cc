// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/io/journal.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>
#include <random>
#include <sstream>
#include <utility>

#include "soilvdb/io/error.h"
#include "soilvdb/io/motion_rows.h"
#include "tests/faults.h"
#include "tests/temp_folder.h"

namespace soilvdb::io {
namespace {

using test::TempFolder;
using ::testing::HasSubstr;

constexpr double kEvery_s = 0.1;  // between rows

Pose pose(int i) {
  return {{512340.0 + 0.1 * i, 5403640.0 - 0.03 * i * i, std::sin(i)},
          from_rpy(0.1 * i, -0.4, 0.2)};
}

Motion motion(int rows) {
  std::vector<double> times_s;
  std::vector<Pose> poses;
  for (int i = 0; i < rows; ++i) {
    times_s.push_back(kEvery_s * i);
    poses.push_back(pose(i));
  }
  return {times_s, poses};
}

/// The record of update i of two machines, which take turns.
JournalMove move(const Motion& motion, int i) {
  const double begin_s = kEvery_s * std::max(0, i / 2 - 1), end_s = kEvery_s * (i / 2);
  return {static_cast<std::uint32_t>(i % 2),
          true,
          begin_s,
          end_s,
          i * std::int64_t{1'000'003},
          (5 - i) * std::int64_t{70'001},
          5500 + i,
          rows_between(motion, begin_s, end_s)};
}

std::string as_text(const JournalRecord& record) {
  std::ostringstream text;
  text << std::hexfloat << record.index() << ' ';
  if (const auto* config = std::get_if<JournalConfig>(&record)) {
    text << config->text;
  } else if (const auto* m = std::get_if<JournalMove>(&record)) {
    text << m->machine << ' ' << m->ends_update;
    text << ' ' << m->cut_samples << ' ' << m->bucket_samples << ' ' << m->ns;
    for (const double v : {m->begin_s, m->end_s}) text << ' ' << v;
    for (const double v : m->rows.times_s) text << ' ' << v;
    for (const double v : m->rows.values) text << ' ' << v;
  } else if (const auto* f = std::get_if<JournalFile>(&record)) {
    text << f->name << ' ' << f->updates << ' ' << f->size << ' ' << f->crc;
  }
  return text.str();
}

/// All that can be read of a journal, and whether it was called damaged; a refusal reads as
/// nothing.
struct Reading {
  std::vector<std::string> records;
  bool damaged = false, refused = false;
  std::uint64_t good_bytes = 0;
};

Reading reading(const std::filesystem::path& file) {
  Reading result;
  try {
    JournalReader reader(file);
    while (const auto record = reader.next()) result.records.push_back(as_text(*record));
    result.damaged = reader.damaged();
    result.good_bytes = reader.good_bytes();
  } catch (const InputError&) {
    result.refused = true;
  }
  return result;
}

bool is_prefix(const std::vector<std::string>& part, const std::vector<std::string>& all) {
  return part.size() <= all.size() && std::equal(part.begin(), part.end(), all.begin());
}

class Journal : public ::testing::Test {
 protected:
  /// A journal of `count` updates, `per_frame` of them in each frame, and its end.
  std::string write(int count, int per_frame, bool end = true) const {
    const Motion way = motion(count);
    const auto file = folder_ / "journal";
    JournalWriter writer(file, begin_journal(file, {"configuration"}), {}, 3600);
    for (int i = 0; i < count; ++i) {
      writer.add(move(way, i));
      if (i == count / 2) writer.add(JournalFile{"soil_1.vdb", 5, 12345, 0x1234567890abcdef});
      if ((i + 1) % per_frame == 0) writer.flush();
    }
    if (end) writer.add(JournalEnd{});
    writer.flush();
    return content(file);
  }
  static std::string content(const std::filesystem::path& file) {
    std::ostringstream text;
    text << std::ifstream(file, std::ios::binary).rdbuf();
    return text.str();
  }
  /// Writes bytes into a file that stays as long as it is.
  static void poke(const std::filesystem::path& file, std::size_t at, std::string_view bytes) {
    std::fstream(file, std::ios::binary | std::ios::in | std::ios::out)
        .seekp(static_cast<std::streamoff>(at))
        .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  }
  TempFolder folder_;
};

TEST_F(Journal, GivesBackEveryRecordToTheLastBit) {
  write(20, 3);
  const Motion way = motion(20);
  JournalReader reader(folder_ / "journal");
  EXPECT_EQ(as_text(reader.next().value()), "0 configuration");
  for (int i = 0; i < 20; ++i) {
    EXPECT_EQ(as_text(reader.next().value()), as_text(move(way, i))) << i;
    if (i != 10) continue;
    EXPECT_EQ(std::get<JournalFile>(reader.next().value()).crc, 0x1234567890abcdef);
  }
  EXPECT_TRUE(std::holds_alternative<JournalEnd>(reader.next().value()));
  EXPECT_FALSE(reader.next());
  EXPECT_EQ(reader.torn_bytes(), 0u);
  EXPECT_FALSE(reader.damaged());
}

TEST_F(Journal, RowsGiveTheSamePosesToTheLastBitAtAnyTime) {
  const Motion whole = motion(30);
  std::mt19937 random(5);
  std::uniform_real_distribution<double> time(-0.05, whole.end_s() + 0.05);
  for (int i = 0; i < 2000; ++i) {
    double begin_s = std::max(0.0, time(random)), end_s = time(random);
    if (i % 3 == 0) begin_s = whole.times_s()[random() % 30];
    if (i % 4 == 0) end_s = whole.times_s()[random() % 30];
    if (end_s < begin_s) std::swap(begin_s, end_s);
    const MotionRows rows = rows_between(whole, begin_s, end_s);
    const Motion part = motion_of(rows, {});
    for (int k = 0; k <= 4; ++k) {
      const double t = k == 4 ? end_s : begin_s + (end_s - begin_s) * k / 4;
      const Pose a = whole.pose(t), b = part.pose(t);
      ASSERT_EQ(a.position, b.position) << begin_s << ' ' << end_s << ' ' << t;
      ASSERT_EQ(a.rotation.coeffs(), b.rotation.coeffs()) << begin_s << ' ' << end_s << ' ' << t;
    }
    ASSERT_LE(rows.times_s.size(), 3 + (end_s - begin_s) / kEvery_s);
  }
}

TEST_F(Journal, ARowIsWrittenOnce) {
  const Motion way = motion(1000);
  const auto file = folder_ / "journal";
  JournalWriter writer(file, begin_journal(file, {"configuration"}), {}, 3600);
  for (int i = 0; i < 1000; ++i) writer.add(move(way, 2 * i));
  writer.flush();
  EXPECT_LT(std::filesystem::file_size(file), 1000 * (8 * sizeof(double) + 20));
}

TEST_F(Journal, NumbersOfEveryKindComeBackToTheLastBit) {
  std::mt19937_64 random(3);
  std::vector<double> numbers = {0.0,
                                 -0.0,
                                 0.1,
                                 -0.1,
                                 0.30000000000000004,
                                 1e-9,
                                 1e-10,
                                 1e300,
                                 -1e300,
                                 5e-324,
                                 0x1p53,
                                 0x1p62,
                                 -0x1p63,
                                 0x1p64,
                                 0x1.fffffffffffffp52,
                                 -0.0,
                                 9007.199254740993,
                                 -9007199.254740993,
                                 std::numeric_limits<double>::infinity(),
                                 -std::numeric_limits<double>::infinity()};
  for (int i = 0; i < 20'000; ++i) {
    const auto digits = static_cast<int>(random() % 12);
    switch (random() % 4) {
      case 0:  // as a file gives it
        numbers.push_back(std::stod(
            fmt::format("{:.{}f}", std::uniform_real_distribution(-1e3, 1e3)(random), digits)));
        break;
      case 1:
        numbers.push_back(std::bit_cast<double>(random()));  // anything
        break;
      case 2:
        numbers.push_back(numbers.back());
        break;
      default:
        numbers.push_back(std::ldexp(1, static_cast<int>(random() % 128) - 64));
    }
  }
  JournalMove move;
  move.rows.columns = 1;
  move.rows.values = numbers;
  for (std::size_t i = 0; i < numbers.size(); ++i)
    move.rows.times_s.push_back(static_cast<double>(i) / 100);
  move.end_s = 12345;
  move.ends_update = false;
  const auto file = folder_ / "journal";
  JournalWriter writer(file, begin_journal(file, {"configuration"}), {}, 3600);
  writer.add(move);
  writer.flush();
  JournalReader reader(file);
  reader.next();
  const auto back = std::get<JournalMove>(reader.next().value());
  EXPECT_FALSE(back.ends_update);
  EXPECT_EQ(back.end_s, 12345);
  ASSERT_EQ(back.rows.times_s, move.rows.times_s);
  ASSERT_EQ(back.rows.values.size(), numbers.size());
  for (std::size_t i = 0; i < numbers.size(); ++i)
    ASSERT_TRUE(same_bits(back.rows.values[i], numbers[i])) << i << ": " << numbers[i];
}

/// It was three times as large once: 123 MB for a motion of 41 MB.
TEST_F(Journal, IsAboutAsLargeAsTheMotionAsText) {
  constexpr int kRows = 5000;
  std::vector<double> times_s, angles;
  std::vector<Pose> poses;
  std::size_t poses_text = 0, joints_text = 0;
  const auto decimal = [](double value, int decimals, std::string& line) {
    const std::string text = fmt::format("{:.{}f}", value, decimals);
    line += text + ',';
    return std::stod(text);
  };
  for (int i = 0; i < kRows; ++i) {
    std::string line, joints;
    times_s.push_back(decimal(i / 100.0, 2, line));
    joints = line;
    const double x = decimal(512340 + 0.013 * i, 3, line), y = decimal(5403640, 3, line),
                 z = decimal(std::sin(0.01 * i), 3, line),
                 pitch = decimal(0.4 * std::sin(0.02 * i), 4, line);
    poses.push_back({{x, y, z}, from_rpy(0, pitch, 0)});
    for (int joint = 1; joint <= 4; ++joint)
      angles.push_back(decimal(std::sin(0.001 * i * joint), 4, joints));
    poses_text += line.size();
    joints_text += joints.size();
  }
  Chain chain;
  for (const char* name : {"swing", "boom", "stick", "bucket"}) {
    Joint joint;
    joint.name = name;
    joint.type = Joint::Type::kContinuous;
    chain.joints.push_back(joint);
  }
  const auto size_of = [&](const Motion& motion) {
    const auto file = folder_ / "journal";
    JournalWriter writer(file, begin_journal(file, {"configuration"}), {}, 3600);
    std::int64_t bucket = 0;
    for (int i = 1; i < kRows; ++i) {
      const std::int64_t cut = 20'000 + i % 1000;
      const double begin_s = motion.times_s()[static_cast<std::size_t>(i - 1)],
                   end_s = motion.times_s()[static_cast<std::size_t>(i)];
      writer.add(JournalMove{0, true, begin_s, end_s, cut, bucket += cut, 50'000 + i,
                             rows_between(motion, begin_s, end_s)});
    }
    writer.flush();
    return static_cast<double>(std::filesystem::file_size(file));
  };
  EXPECT_LT(size_of(Motion(times_s, angles, chain)), static_cast<double>(joints_text));
  // Rotations are no decimals: two of four numbers, eight bytes more each than the angle as text.
  EXPECT_LT(size_of(Motion(times_s, poses)), 1.2 * static_cast<double>(poses_text));
}

TEST_F(Journal, GoesOnAfterWhatIsGood) {
  const std::string bytes = write(20, 3, false);
  const auto file = folder_.write("journal", bytes + "a frame that never became wh");
  const JournalContent before = read_journal(file);
  EXPECT_EQ(before.torn_bytes, 28u);
  EXPECT_EQ(before.done.updates, 20u);
  EXPECT_FALSE(before.damaged);
  {
    const Motion way = motion(30);
    JournalWriter writer(file, before.good_bytes, before.done, 3600);
    for (int i = 20; i < 30; ++i) writer.add(move(way, i));
    writer.flush();
    EXPECT_EQ(writer.acknowledged().updates, 30u);
  }
  const Reading both = reading(file);
  write(30, 30, false);
  Reading whole = reading(folder_ / "journal");
  const auto is_file = [](const std::string& text) { return text.starts_with("2 "); };
  std::vector<std::string> moves = both.records;
  std::erase_if(moves, is_file);
  std::erase_if(whole.records, is_file);
  EXPECT_EQ(moves, whole.records);
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
  testing::record_faults("journals cut off at each length", bytes.size(), "read up to there");
}

TEST_F(Journal, FlippedBitsAreNeverAcceptedAndSaidWhereTheyWereSynced) {
  const std::string bytes = write(30, 2);
  const auto file = folder_ / "journal";
  const std::vector<std::string> all = reading(file).records;
  const std::size_t last_frame = bytes.size() - 33;  // 32 bytes of head, a tag
  std::mt19937 random(7);
  std::size_t damaged = 0, refused = 0;
  const std::size_t count = testing::faults(1000, 10'000, 100'000);
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
  testing::record_faults("journals with a flipped bit", count, "read up to there");
}

TEST_F(Journal, ZeroedPagesAndRubbishAreFoundToo) {
  const std::string bytes = write(400, 5);
  const auto file = folder_ / "journal";
  const std::vector<std::string> all = reading(file).records;
  std::mt19937 random(11);
  const std::size_t count = testing::faults(200, 1000, 10'000);
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
  testing::record_faults("journals with a page of zeros or rubbish", count, "read up to there");
}

/// Frames that the disk wrote in another order before the power went are no damage.
TEST_F(Journal, AFrameThatWasNeverSyncedMayBeMissing) {
  const auto file = folder_ / "journal";
  const Motion way = motion(8000);
  std::uint64_t synced = 0;
  {
    JournalWriter writer(file, begin_journal(file, {"configuration"}), {}, 3600);
    writer.add(move(way, 0));
    writer.flush();
    synced = std::filesystem::file_size(file);
    for (int i = 2; i < 15'000; i += 2) writer.add(move(way, i));  // frames without a sync between
  }
  std::string bytes = content(file);
  ASSERT_GT(bytes.size(), synced + 300'000);
  for (std::size_t k = synced; k < synced + 100; ++k) bytes[k] = '\0';
  const Reading part = reading(folder_.write("bad", bytes));
  EXPECT_FALSE(part.damaged);
  EXPECT_EQ(part.good_bytes, synced);
}

TEST_F(Journal, SomethingElseIsRefused) {
  for (const char* text :
       {"", "time,x,y,z\n", "SVJ2", "SVJ2aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa"})
    EXPECT_THAT(test::message_of(folder_, [&] { JournalReader reader(folder_.write("no", text)); }),
                HasSubstr("no: is not a journal"));
  EXPECT_THAT(
      test::message_of(folder_, [&] { JournalReader reader(folder_.write("old", "SVJ1")); }),
      HasSubstr("old: is a journal of an older format, which isn't read any more"));
  EXPECT_THAT(test::message_of(folder_, [&] { JournalReader reader(folder_ / "none"); }),
              HasSubstr("none: no such file"));
}

TEST_F(Journal, WhatCannotBeWrittenIsSaidAndStaysSaid) {
  if (!std::filesystem::exists("/dev/full")) GTEST_SKIP();
  write(4, 1, false);
  std::filesystem::create_symlink("/dev/full", folder_ / "full");
  EXPECT_THAT(test::message_of(folder_, [&] { JournalWriter writer(folder_ / "full", 0, {}, 1); }),
              HasSubstr("full: can't be written"));
}

}  // namespace
}  // namespace soilvdb::io
