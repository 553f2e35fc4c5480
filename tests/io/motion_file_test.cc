// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Motions that are read part by part are the same as in one piece.
#include "soilvdb/io/motion_file.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <sstream>

#include "soilvdb/io/motion_csv.h"
#include "soilvdb/io/swept_boxes.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::io {
namespace motion_file_test {

using test::TempFolder;

constexpr std::int64_t kSteps = MotionFile::kPartSteps;

std::string rows(std::int64_t count) {
  std::string text = "time,x,y,z,yaw\n";
  for (std::int64_t i = 0; i < count; ++i)
    text += fmt::format("{:.2f},{:.4f},0,{:.4f},{:.4f}\n", 0.01 * static_cast<double>(i),
                        std::sin(1e-3 * static_cast<double>(i)), -0.25,
                        std::cos(1e-3 * static_cast<double>(i)));
  return text;
}

MotionFile open(const std::filesystem::path& file, OnBadRow on_bad_row = OnBadRow::kStop) {
  std::vector<std::string> warnings;
  return MotionFile(
      file, std::nullopt, AngleUnit::kRadians, on_bad_row, [](const Motion&, std::int64_t) {},
      warnings);
}

TEST(MotionFile, PartsJoinAndHoldTheRowsOfTheWholeFile) {
  const TempFolder folder;
  const std::vector<std::int64_t> counts = {
      1, 2, kSteps, kSteps + 1, kSteps + 2, 2 * kSteps + 1, 3 * kSteps - 7};
  for (const std::int64_t count : counts) {
    const auto file = folder.write("m.csv", rows(count));
    const Motion whole = read_motion(file, std::nullopt).motion;
    const MotionFile motion = open(file);
    EXPECT_EQ(motion.rows(), count);
    EXPECT_EQ(motion.begin_s(), whole.begin_s());
    EXPECT_EQ(motion.end_s(), whole.end_s());
    EXPECT_EQ(motion.parts(), std::max<std::size_t>(1, (count - 1 + kSteps - 1) / kSteps)) << count;
    std::size_t row = 0;
    for (std::size_t i = 0; i < motion.parts(); ++i) {
      const auto part = motion.part(i);
      for (std::size_t k = i == 0 ? 0 : 1; k < part->times_s().size(); ++k, ++row) {
        ASSERT_EQ(part->times_s()[k], whole.times_s()[row]);
        ASSERT_EQ(part->row(k).position, whole.row(row).position);
        ASSERT_EQ(part->row(k).rotation.coeffs(), whole.row(row).rotation.coeffs());
      }
      if (i > 0) {
        EXPECT_EQ(part->begin_s(), motion.part(i - 1)->end_s());
      }
    }
    EXPECT_EQ(row, whole.times_s().size());
  }
}

TEST(MotionFile, BadRowsAreFoundBeforeAnythingIsDoneAndLeftOut) {
  const TempFolder folder;
  const std::string good = rows(2 * kSteps + 10);
  const auto file = folder.write("m.csv", good);
  const MotionFile clean = open(file);
  EXPECT_EQ(clean.bad_rows().count, 0);
  EXPECT_FALSE(clean.stops());
  // In the first part, where two parts meet, and at the end.
  std::string text;
  std::istringstream lines(good);
  long number = 0, first = 0;
  for (std::string line; std::getline(lines, line); ++number) {
    text += line + '\n';
    if (number != 700 && number != kSteps + 1 && number != 2 * kSteps + 10) continue;
    if (first == 0) first = number + 2;
    text += line.substr(0, line.find(',')) + "5,0,0,nonsense,0\n";
  }
  const MotionFile stopping = open(folder.write("bad.csv", text));
  EXPECT_TRUE(stopping.stops());
  EXPECT_EQ(stopping.bad_rows().count, 3);
  EXPECT_EQ(stopping.bad_rows().first, fmt::format("{}:{}: z is 'nonsense'; it must be a number",
                                                   (folder / "bad.csv").string(), first));
  EXPECT_EQ(stopping.bad_rows().good_s, 6.99);
  const MotionFile skipping = open(folder / "bad.csv", OnBadRow::kSkip);
  EXPECT_FALSE(skipping.stops());
  for (const MotionFile* motion : {&stopping, &skipping}) {
    EXPECT_EQ(motion->rows(), clean.rows());
    ASSERT_EQ(motion->parts(), clean.parts());
    for (std::size_t i = 0; i < clean.parts(); ++i) {
      const auto part = motion->part(i), expected = clean.part(i);
      ASSERT_EQ(part->times_s(), expected->times_s());
      for (std::size_t k = 0; k < part->times_s().size(); ++k)
        ASSERT_EQ(part->row(k).position, expected->row(k).position);
    }
  }
}

TEST(MotionFile, AFileThatChangesMeanwhileIsNoticedWhereItIsReadAgain) {
  const TempFolder folder;
  const auto file = folder.write("m.csv", rows(2 * kSteps + 10));
  const MotionFile motion = open(file);
  const auto said = [&](std::size_t part) {
    return test::message_of(folder, [&] { motion.part(part); });
  };
  std::ofstream(file, std::ios::app) << "1e6,0,0,0,0\n";
  EXPECT_EQ(motion.part(2)->times_s().size(), 10u) << "rows that came later are not part of it";
  std::string text = rows(2 * kSteps + 10);
  text[text.find("-0.25", text.size() / 4) + 1] = '7';  // as long as before, in the first part
  folder.write("m.csv", text);
  EXPECT_EQ(said(0), "m.csv: changed while it was being read");
  EXPECT_NO_THROW(motion.part(1));
  std::filesystem::resize_file(file, text.size() / 4);
  EXPECT_EQ(said(1), "m.csv: changed while it was being read");
  std::filesystem::remove(file);
  EXPECT_EQ(said(2), "m.csv: changed while it was being read");
}

Bucket bucket() {
  Bucket b;
  b.width_m = 1;
  b.height_m = 0.5;
  b.profile = {{0, 0}, {-0.4, 0.1}, {0, 0.5}};
  return b;
}

TEST(SweptBoxes, ItsBlocksHoldAllOfTheBucketAtAnyTime) {
  const TempFolder folder;
  const Motion motion = read_motion(folder.write("m.csv", rows(1000)), std::nullopt).motion;
  SweptBoxes way;
  way.add(motion, bucket());
  ASSERT_EQ(way.blocks().size(), (999 + SweptBoxes::kStepsPerBox - 1) / SweptBoxes::kStepsPerBox);
  const Corners corners = bucket_corners(bucket());
  for (std::size_t i = 0; i < 9990; ++i) {
    const Pose pose = motion.pose(1e-3 * static_cast<double>(i));
    const Box3& block = way.blocks()[i / 10 / SweptBoxes::kStepsPerBox];
    for (const auto& p : corners.colwise())
      EXPECT_LT(block.exteriorDistance(pose * Vec3(p)), 1e-12);
  }
}

TEST(SweptBoxes, AWholeTurnOfAJointGoesAllTheWayRound) {
  Chain chain;
  chain.joints = {{"q", Joint::Type::kContinuous, {}, Vec3::UnitZ(), 0, 0}};
  chain.link_from_bucket = {{0, -3, -1}, Eigen::Quaterniond::Identity()};
  const Motion motion({0, 1}, std::vector<double>{0, 6.283185307179586}, chain);
  SweptBoxes way;
  way.add(motion, bucket());
  const Corners corners = bucket_corners(bucket());
  for (double t = 0; t < 1; t += 1e-3) {
    for (const auto& p : corners.colwise())
      EXPECT_EQ(way.whole().exteriorDistance(motion.pose(t) * Vec3(p)), 0);
  }
}

std::string rows(std::int64_t from, std::int64_t to) {
  std::string text;
  for (std::int64_t i = from; i < to; ++i)
    text += fmt::format("{:.2f},{:.4f},0,0\n", 0.01 * static_cast<double>(i),
                        1e-4 * static_cast<double>(i));
  return text;
}
TEST(MotionFileRows, PartsAfterALineThatIsTooLongAreFound) {
  const test::TempFolder folder;
  constexpr std::int64_t kPart = MotionFile::kPartSteps;
  const auto file =
      folder.write("m.csv", "time,x,y,z\n" + rows(0, 100) + std::string(150'000, '1') + '\n' +
                                rows(100, 2 * kPart + 10));
  const MotionFile motion = open(file, OnBadRow::kSkip);
  EXPECT_EQ(motion.bad_rows().count, 1);
  ASSERT_EQ(motion.parts(), 3u);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_NO_THROW(motion.part(i)) << i;
}
TEST(MotionFileRows, OddRowsHereAndThereAreCountedBetweenGoodOnes) {
  const test::TempFolder folder;
  const std::string odd = "0,0,0,0\n";
  const auto file = folder.write("m.csv", "time,x,y,z\n" + rows(0, 4) + odd + odd + odd +
                                              rows(4, 5) + odd + odd + odd + rows(5, 60));
  const MotionFile motion = open(file, OnBadRow::kStop);
  EXPECT_TRUE(motion.stops());
  EXPECT_EQ(motion.bad_rows().good_s, 0.03);
  EXPECT_EQ(motion.bad_rows().count, 6);
}

}  // namespace motion_file_test
}  // namespace soilvdb::io
