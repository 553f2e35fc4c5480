// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Transforms of which some are late, lost, or told ahead of their time: where the bucket isn't
// known, no row says that it is.
#include <functional>

#include "tests/support/mcap_fixture.h"

namespace soilvdb::io {
namespace mcap_frames_test {

using ::testing::HasSubstr;

/// A base that drives at 0.4 m/s on a map, and a bucket that goes up and down on it, each at 10 Hz.
class Frames : public RecordedMotion {
 protected:
  using Told = std::function<bool(double)>;
  static bool always(double) { return true; }

  /// @param base @param bucket when each is told, 0 to 6 s
  std::filesystem::path drive(const Told& base, const Told& bucket = always,
                              const std::function<void(Recording&, double)>& more = {}) const {
    return record("drive.mcap", [&](Recording& r) {
      for (int i = 0; i <= 60; ++i) {
        const double s = 0.1 * i;
        if (bucket(s)) r.transform(s, "base", "bucket", {0, 0, height(s)});
        if (base(s)) r.transform(s, "map", "base", {0.4 * s, 0, 0});
        if (more) more(r, s);
      }
    });
  }
  static double height(double s) { return -0.1 * s; }
  static MotionSource source(const std::filesystem::path& file) {
    return {file, {"/tf", "bucket"}};
  }
  void expect_right(const Read& read) const {
    for (std::size_t i = 0; i < read.times_s.size(); ++i) {
      const double s = read.times_s[i];
      EXPECT_LT((read.positions[i] - Vec3(0.4 * s, 0, height(s))).norm(), 1e-9) << s;
    }
  }
};

TEST_F(Frames, ThatAreAllToldMakeARowForEachOfTheBuckets) {
  const Read all = read(source(drive(always)));
  EXPECT_EQ(all.times_s.size(), 61U);
  EXPECT_EQ(all.bad.count, 0);
  EXPECT_TRUE(all.warnings.empty());
  expect_right(all);
}

TEST_F(Frames, ThatAreLostMakeBadRowsFromThenOn) {
  const Read lost = read(source(drive([](double s) { return s < 2.05; })));
  EXPECT_EQ(lost.times_s.size(), 21U);
  EXPECT_EQ(lost.bad.count, 40);
  EXPECT_EQ(lost.bad.good_s, 2);
  EXPECT_THAT(lost.bad.first,
              HasSubstr("drive.mcap:43: frame 'base' isn't known from 2 to 6 s, where the motion "
                        "ends; at most 0.25 s are bridged"));
  expect_right(lost);
}

TEST_F(Frames, ThatHaveAGapMakeBadRowsInIt) {
  const auto gap = [](double begin, double end) {
    return [=](double s) { return s < begin + 0.05 || s > end - 0.05; };
  };
  const Read wide = read(source(drive(gap(1, 5))));
  EXPECT_EQ(wide.bad.count, 39);
  EXPECT_THAT(wide.bad.first, HasSubstr("frame 'base' isn't known from 1 to 5 s, a gap; at most 1 "
                                        "s are bridged"));
  expect_right(wide);
  // It drives on through a short one.
  const Read narrow = read(source(drive(gap(1, 1.9))));
  EXPECT_EQ(narrow.bad.count, 0);
  EXPECT_EQ(narrow.times_s.size(), 61U);
  expect_right(narrow);
}

TEST_F(Frames, ThatComeLateMakeBadRowsBefore) {
  const auto file = drive([](double s) { return s > 2.95; });
  const Read late = read(source(file));
  EXPECT_EQ(late.bad.count, 30);
  EXPECT_EQ(late.times_s.front(), 3);
  EXPECT_THAT(late.bad.first,
              HasSubstr("drive.mcap:1: frame 'base' isn't known from 0 to 3 s, where it begins"));
  expect_right(late);
  EXPECT_THAT(error(source(file)), HasSubstr("frame 'base' isn't known from 0 to 3 s"));
}

TEST_F(Frames, ThatAreToldSeldomAreBridgedForThreeOfTheirIntervals) {
  const auto seldom = [](double s) { return std::abs(s - std::round(s)) < 0.01; };
  EXPECT_EQ(read(source(drive(seldom))).bad.count, 0);
  const auto without = [&](double begin, double end) {
    return [=](double s) { return seldom(s) && (s < begin + 0.5 || s > end - 0.5); };
  };
  const Read bridged = read(source(drive(without(1, 4))));
  EXPECT_EQ(bridged.bad.count, 0);
  expect_right(bridged);
  EXPECT_EQ(read(source(drive(without(1, 5)))).bad.count, 39);
}

TEST_F(Frames, OfTheBucketItselfThatAreLostAreTold) {
  const Read gap = read(source(drive(always, [](double s) { return s < 2.05 || s > 4.95; })));
  EXPECT_EQ(gap.bad.count, 1);
  EXPECT_EQ(gap.bad.good_s, 2);
  EXPECT_THAT(gap.bad.first, HasSubstr("frame 'bucket' isn't known from 2 to 5 s, a gap"));
  const Read lost = read(source(drive(always, [](double s) { return s < 2.05; })));
  EXPECT_EQ(lost.bad.count, 1);
  EXPECT_THAT(lost.bad.first,
              HasSubstr("frame 'bucket' isn't known from 2 to 6 s, where others go on"));
}

TEST_F(Frames, OffTheWayAreNoneOfTheBucketsBusiness) {
  const Read all = read(source(drive(always, always, [](Recording& r, double s) {
    if (s < 1) r.transform(s, "base", "camera", {s, 0, 0});
    if (s > 3) r.transform(s, s < 4 ? "camera" : "map", "dog", {100 * s, 0, 0});
    r.transform(2, "map", "cat", {s, s, s}, s);
    r.transform(s, "cat", "mouse", {std::nan(""), 0, 0});
  })));
  EXPECT_EQ(all.bad.count, 0);
  EXPECT_EQ(all.times_s.size(), 61U);
  EXPECT_THAT(error(source(drive(always, always,
                                 [](Recording& r, double s) {
                                   if (s > 4) r.transform(s, "odom", "base", Vec3::Zero());
                                 }))),
              HasSubstr("frame 'base' has the parent 'map', and later 'odom'"));
}

TEST_F(Frames, ThatStandStillAndAreToldAheadOfTheirTimeAreFixed) {
  for (const double ahead_s : {0.5, 20.0}) {
    const auto file = record("fixed.mcap", [&](Recording& r) {
      for (int i = 0; i <= 60; ++i) {
        const double s = 0.1 * i;
        r.transform(s, "base", "arm", {0, 0, height(s)});
        r.transform(s, "map", "base", {0.4 * s, 0, 0});
        if (i % 20 == 5) r.transform(s + ahead_s, "arm", "bucket", {0, 0, 1}, s);
        if (i % 20 == 5) r.transform(s + ahead_s, "earth", "map", {0, 5, 0}, s);
      }
    });
    const Read all = read(source(file));
    EXPECT_EQ(all.bad.count, 0);
    ASSERT_EQ(all.times_s.size(), 61U);
    for (std::size_t i = 0; i < all.times_s.size(); ++i)
      EXPECT_LT(
          (all.positions[i] - Vec3(0.4 * all.times_s[i], 5, 1 + height(all.times_s[i]))).norm(),
          1e-9);
  }
}

TEST_F(Frames, ThatContradictThemselvesAreTold) {
  const Read twice = read(source(drive(always, always, [](Recording& r, double s) {
    if (std::abs(s - 3) < 0.01) r.transform(s, "map", "base", {1.2, 0, 0});
    if (std::abs(s - 4) < 0.01) r.transform(s, "map", "base", {1.7, 0, 0});
  })));
  EXPECT_EQ(twice.bad.count, 1);
  EXPECT_THAT(twice.bad.first,
              HasSubstr("has other values of frame 'base' at 4 s than a message before it"));
  EXPECT_EQ(twice.times_s.size(), 61U);
  expect_right(twice);
}

TEST_F(Frames, AreTheSameInPartsAsOnTheWhole) {
  const auto file = record("long.mcap", [&](Recording& r) {
    for (int i = 0; i <= 3000; ++i) {
      const double s = 0.01 * i;
      if (i % 100 == 50) r.chunk();
      r.transform(s, "base", "bucket", {0, 0, height(s)}, s + 0.3 * (i % 3));
      if (i % 10 == 3 && (s < 10 || s > 14)) r.transform(s, "map", "base", {0.4 * s, 0, 0});
    }
  });
  const Motion whole = [&] {
    MotionReader reader(source(file), {});
    return reader.next(10000);
  }();
  EXPECT_EQ(whole.times_s().size(), 2592U);
  MotionReader reader(source(file), {});
  std::vector<RowMark> marks{reader.mark()};
  for (int i = 0; i < 25; ++i) {
    reader.next(100);
    marks.push_back(reader.mark());
  }
  MotionReader again(reader.source(), {});
  for (std::size_t i = marks.size(); i-- > 0;) {
    again.go_to(marks[i]);
    const Motion part = again.next(99);
    ASSERT_EQ(part.times_s().size(), i == 25 ? 92U : 100U);
    for (std::size_t k = 0; k < part.times_s().size(); ++k) {
      EXPECT_EQ(part.times_s()[k], whole.times_s()[100 * i + k]);
      EXPECT_EQ(part.row(k).position, whole.row(100 * i + k).position);
    }
  }
}

TEST_F(Frames, ThatContradictThemselvesBeforeAMarkAreNotToldAgainAfterIt) {
  const auto file = record("odds.mcap", [&](Recording& r) {
    for (int i = 0; i <= 600; ++i) {
      const double s = 0.01 * i;
      if (i % 50 == 25) r.chunk();
      r.transform(s, "base", "bucket", {0, 0, height(s)});
      r.transform(s, "map", "base", {0.4 * s, 0, 0});
      if (i == 180 || i == 420) r.transform(s, "map", "base", {7, 0, 0});
    }
  });
  MotionReader reader(source(file), {});
  reader.next(200);
  EXPECT_EQ(reader.bad_rows().count, 1);
  const RowMark mark = reader.mark();
  reader.next(1000);
  EXPECT_EQ(reader.bad_rows().count, 2);
  MotionReader again(reader.source(), {});
  again.go_to(mark);
  EXPECT_EQ(again.next(1000).times_s().size(), 401U);
  EXPECT_EQ(again.bad_rows().count, 1);
}

}  // namespace mcap_frames_test
}  // namespace soilvdb::io
