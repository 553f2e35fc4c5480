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
#include <utility>

#include "soilvdb/io/motion_rows.h"
#include "tests/io/journal_fixture.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::io {
namespace journal_test {

using ::testing::HasSubstr;

TEST_F(Journal, GivesBackEveryRecordToTheLastBit) {
  write(20, 3);
  const Motion way = motion(20);
  JournalReader reader(folder_ / "journal");
  EXPECT_EQ(as_text(reader.next().value()), "0 configuration");
  for (int i = 0; i < 20; ++i) {
    EXPECT_EQ(as_text(reader.next().value()), as_text(update(way, i))) << i;
    if (i != 10) continue;
    EXPECT_EQ(std::get<JournalFile>(reader.next().value()).crc, 0x1234567890abcdef);
  }
  EXPECT_TRUE(std::holds_alternative<JournalEnd>(reader.next().value()));
  EXPECT_FALSE(reader.next());
  EXPECT_EQ(reader.torn_bytes(), 0u);
  EXPECT_FALSE(reader.damaged());
}

TEST_F(Journal, PoursHaveNoRowsAndSoilThatCameDownIsThere) {
  const Motion way = motion(6);
  const auto file = folder_ / "journal";
  std::vector<std::string> written;
  {
    JournalWriter writer(file, begin_journal(file, {"configuration"}), {}, 3600);
    for (int i = 0; i < 6; ++i) {
      JournalUpdate next = update(way, 2 * i);
      if (i % 2 == 1)
        next = {.machine = 7,
                .begin_s = 0.1 * i,
                .end_s = 0.1 * (i + 1),
                .ns = 12,
                .kind = JournalUpdate::Kind::kPour};
      next.slid = i * std::int64_t{1'000'000'007};
      next.spilled = i == 4 ? 0 : i;
      writer.add(next);
      written.push_back(as_text(next));
    }
  }
  Reading read = reading(file);
  ASSERT_EQ(read.records.size(), written.size() + 1);
  for (std::size_t i = 1; i < written.size(); i += 2) EXPECT_EQ(read.records[i + 1], written[i]);
  JournalReader reader(file);
  reader.next();
  for (int i = 0; i < 6; ++i) {
    const JournalUpdate back = std::get<JournalUpdate>(*reader.next());
    EXPECT_EQ(back.slid, i * std::int64_t{1'000'000'007});
    EXPECT_EQ(back.spilled, i == 4 ? 0 : i);
  }
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
  for (int i = 0; i < 1000; ++i) writer.add(update(way, 2 * i));
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
  JournalUpdate move;
  move.rows.columns = 1;
  move.begin_s = 0;
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
  const auto back = std::get<JournalUpdate>(reader.next().value());
  EXPECT_FALSE(back.ends_update);
  EXPECT_EQ(back.end_s, 12345);
  ASSERT_EQ(back.rows.times_s, move.rows.times_s);
  ASSERT_EQ(back.rows.values.size(), numbers.size());
  for (std::size_t i = 0; i < numbers.size(); ++i)
    ASSERT_TRUE(same_bits(back.rows.values[i], numbers[i])) << i << ": " << numbers[i];
}

TEST_F(Journal, KnowsWhatWasFedByATimeAlsoWhereAClockWasAhead) {
  constexpr double kSet = -1, kRest = -2;  // a clock is; all comes to rest
  constexpr std::uint32_t kPours = 99;
  struct Fed {
    std::uint32_t machine;
    double time_s;
  };
  const auto until = [&](const std::vector<Fed>& all, double time_s,
                         std::optional<std::uint32_t> machine = {}) {
    const auto file = folder_ / "journal";
    JournalWriter writer(file, begin_journal(file, {"configuration"}), {}, 3600);
    for (const Fed& fed : all) {
      JournalUpdate update{.machine = fed.machine, .kind = JournalUpdate::Kind::kClock};
      if (fed.time_s == kRest) {
        update.kind = JournalUpdate::Kind::kRest;
        update.end_s = 3600;
      } else if (fed.machine == kPours) {
        update.kind = JournalUpdate::Kind::kPours;
        update.machine = 0;
        update.end_s = fed.time_s;
      } else if (fed.time_s != kSet) {
        update.kind = JournalUpdate::Kind::kMove;
        update.end_s = fed.time_s;
        update.rows = {false, 1, {fed.time_s}, {7}};
      }
      writer.add(update);
    }
    writer.flush();
    return updates_until(file, time_s, machine);
  };
  // Clocks that differ a little: up to the first state that is later.
  const std::vector<Fed> sound = {{0, 1}, {1, 0.9}, {0, 2}, {1, 1.9}, {0, 3}, {1, 2.9}};
  EXPECT_EQ(until(sound, 0.5), 0u);
  EXPECT_EQ(until(sound, 1), 2u);
  EXPECT_EQ(until(sound, 1.95), 2u);
  EXPECT_EQ(until(sound, 2), 4u);
  EXPECT_EQ(until(sound, 9), 6u);
  // Machine 0 is an hour ahead from 2 s on, machine 1 isn't; then it is set.
  const std::vector<Fed> ahead = {{0, 1}, {1, 1},    {0, 3602}, {1, 2}, {0, 3603},
                                  {1, 3}, {0, kSet}, {0, 4},    {1, 4}, {0, 5}};
  EXPECT_EQ(until(ahead, 1.5), 2u);
  EXPECT_EQ(until(ahead, 2.5), 4u) << "what is before a state that isn't later isn't, either";
  EXPECT_EQ(until(ahead, 3), 7u);
  EXPECT_EQ(until(ahead, 4), 9u);
  EXPECT_EQ(until(ahead, 9), 10u);
  // All came to rest, and pours came down, by the clock of a machine that was ahead.
  const std::vector<Fed> others = {{0, 1},    {1, 3600},     {0, kRest}, {kPours, 3600},
                                   {1, kSet}, {kPours, 1.5}, {0, 2},     {1, 2}};
  EXPECT_EQ(until(others, 1.7), 6u);
  EXPECT_EQ(until(others, 2), 8u);
  // The very first was.
  const std::vector<Fed> first = {{0, 3600}, {0, kSet}, {0, 1}, {0, 2}};
  EXPECT_EQ(until(first, 0.5), 0u);
  EXPECT_EQ(until(first, 1), 3u);
  EXPECT_EQ(until(first, 2), 4u);
  // Of one machine.
  EXPECT_EQ(until(sound, 0.95, 0), 0u);
  EXPECT_EQ(until(sound, 0.95, 1), 3u);
  EXPECT_EQ(until(sound, 2.9, 1), 6u) << "none is later";
  EXPECT_EQ(until(ahead, 2.5, 0), 2u);
  EXPECT_EQ(until(ahead, 4.5, 0), 9u) << "its clock was set since";
  EXPECT_EQ(until(ahead, 2.5, 1), 5u);
  EXPECT_EQ(until(others, 1.7, 0), 6u) << "pours and rest are of no machine";
}

TEST_F(Journal, ALaterConfigurationTakesThePlaceOfTheFirst) {
  const auto file = folder_ / "journal";
  const Motion way = motion(4);
  {
    JournalWriter writer(file, begin_journal(file, {"first"}), {}, 3600);
    for (int i = 0; i < 2; ++i) writer.add(update(way, i));
    writer.add(JournalConfig{"second"});
    for (int i = 2; i < 4; ++i) writer.add(update(way, i));
    writer.flush();
  }
  const JournalContent content = read_journal(file);
  EXPECT_EQ(content.config.text, "second");
  EXPECT_EQ(content.done.updates, 4u);
  EXPECT_EQ(updates_until(file, 1e9), 4u);
}

/// As sessions are fed: poses and joints in turn, times known or not, clocks that are set.
TEST_F(Journal, KeepsUpdatesOfEveryKindToTheLastBit) {
  using Kind = JournalUpdate::Kind;
  constexpr std::size_t kMachines = 3;
  std::mt19937_64 random(12);
  const auto file = folder_ / "journal";
  std::uint64_t size = begin_journal(file, {"configuration"});
  std::vector<std::string> made;
  struct Row {
    double time_s = std::numeric_limits<double>::quiet_NaN();
    std::vector<double> values;
  };
  std::vector<Row> last(kMachines);
  std::vector<bool> joints(kMachines);
  for (int writers = 0; writers < 3; ++writers) {  // as when it is gone on with
    JournalWriter writer(file, size, {}, 3600);
    for (int i = 0; i < 500; ++i) {
      JournalUpdate update{.machine = static_cast<std::uint32_t>(random() % kMachines)};
      if (random() % 4 == 0) update.kind = static_cast<Kind>(random() % 5);
      Row& before = last[update.machine];
      if (random() % 9 != 0) update.end_s = 0.01 * i;
      if (update.kind == Kind::kClock) before = {};
      if (update.kind == Kind::kMove) {
        const bool in_joints = random() % 5 == 0 ? !joints[update.machine] : joints[update.machine];
        Row now{update.end_s, {}};
        for (std::size_t k = 0; k < (in_joints ? 4 : 7); ++k)
          now.values.push_back(random() % 9 == 0 ? std::bit_cast<double>(random() >> 2)
                                                 : std::round(static_cast<double>(i)) / 1000);
        const bool goes_on = now.time_s > before.time_s;
        if (goes_on) update.begin_s = before.time_s;
        update.rows = {in_joints, now.values.size(), {}, {}};
        const auto add = [&](const Row& row) {
          update.rows.times_s.push_back(row.time_s);
          update.rows.values.insert(update.rows.values.end(), row.values.begin(), row.values.end());
        };
        if (goes_on && in_joints == joints[update.machine]) add(before);
        add(now);
        joints[update.machine] = in_joints;
        before.values = now.values;
        if (std::isfinite(now.time_s)) before.time_s = now.time_s;
      }
      for (std::int64_t* value :
           {&update.cut_samples, &update.bucket_samples, &update.ns, &update.spilled, &update.slid})
        *value = static_cast<std::int64_t>(random()) >> (11 + random() % 50);
      if (random() % 3 == 0)
        update.hauled = static_cast<std::int64_t>(random()) >> (11 + random() % 50);
      writer.add(update);
      made.push_back(as_text(update));
    }
    writer.flush();
    size = std::filesystem::file_size(file);
  }
  JournalReader reader(file);
  reader.next();
  for (const std::string& update : made) ASSERT_EQ(as_text(*reader.next()), update);
  EXPECT_FALSE(reader.next());
  EXPECT_EQ(read_journal(file).done.updates, made.size());
}

TEST_F(Journal, AMoveWithoutRowsIsNonsense) {
  const auto file = folder_ / "journal";
  {
    JournalWriter writer(file, begin_journal(file, {"configuration"}), {}, 3600);
    writer.add(JournalUpdate{.end_s = 1});
  }
  EXPECT_THAT(test::message_of(folder_, [&] { read_journal(file); }),
              HasSubstr("journal: has an invalid record before byte"));
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
      writer.add(JournalUpdate{.begin_s = begin_s,
                               .end_s = end_s,
                               .cut_samples = cut,
                               .bucket_samples = bucket += cut,
                               .ns = 50'000 + i,
                               .rows = rows_between(motion, begin_s, end_s)});
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
    for (int i = 20; i < 30; ++i) writer.add(update(way, i));
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

TEST_F(Journal, SomethingElseIsRefused) {
  for (const char* text :
       {"", "time,x,y,z\n", "SVJ3", "SVJ3aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa"})
    EXPECT_THAT(test::message_of(folder_, [&] { JournalReader reader(folder_.write("no", text)); }),
                HasSubstr("no: is not a journal"));
  for (const char* former : {"SVJ1", "SVJ2"})
    EXPECT_THAT(
        test::message_of(folder_, [&] { JournalReader reader(folder_.write("old", former)); }),
        HasSubstr("old: is a journal of an older version, which isn't read any more: dig"));
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

}  // namespace journal_test
}  // namespace soilvdb::io
