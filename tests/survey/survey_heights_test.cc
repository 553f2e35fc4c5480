// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The ground takes over a survey's heights: laws over random ground that machines dug.
#include "soilvdb/survey_heights.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <random>

#include "core/constants.h"
#include "core/ground/ground_writer.h"
#include "soilvdb/height_map.h"
#include "soilvdb/site.h"
#include "tests/support/earthmoving_fixture.h"

namespace soilvdb::test {
namespace survey_heights_test {

constexpr double kVoxel_m = 0.1;

/// Heights at random, bilinear between posts; with voids if asked for.
class RandomPosts final : public HeightSource {
 public:
  RandomPosts(std::uint64_t seed, double spacing_m, double half_m, double level_m,
              double roughness_m, double voids = 0) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> unit(0, 1);
    grid.nx = grid.ny = static_cast<int>(2 * half_m / spacing_m) + 1;
    grid.first = Vec2(-half_m, -half_m) + spacing_m * Vec2(unit(random), unit(random));
    grid.spacing = Vec2::Constant(spacing_m);
    const double a = unit(random) - 0.5, b = unit(random) - 0.5;
    for (int j = 0; j < grid.ny; ++j)
      for (int i = 0; i < grid.nx; ++i) {
        const double z = level_m + 0.1 * spacing_m * (a * i + b * j) + roughness_m * unit(random);
        values.push_back(unit(random) < voids ? std::nanf("") : static_cast<float>(z));
      }
  }
  void read(int x0, int y0, int nx, int ny, float* out) const override {
    for (int y = y0; y < y0 + ny; ++y)
      for (int x = x0; x < x0 + nx; ++x) *out++ = post(x, y);
  }
  float post(int x, int y) const { return values[static_cast<std::size_t>(y * grid.nx + x)]; }
  /// As a height field has it, but written anew. NaN where it has none.
  double height(const Vec2& at) const {
    const Vec2 in = (at - grid.first).cwiseQuotient(grid.spacing);
    if (in.minCoeff() < 0 || in.x() >= grid.nx - 1 || in.y() >= grid.ny - 1) return std::nan("");
    const int x = static_cast<int>(in.x()), y = static_cast<int>(in.y());
    const double u = in.x() - x, v = in.y() - y;
    return (1 - u) * (1 - v) * post(x, y) + u * (1 - v) * post(x + 1, y) +
           (1 - u) * v * post(x, y + 1) + u * v * post(x + 1, y + 1);
  }

  HeightGrid grid;
  std::vector<float> values;
};

struct Surface {
  explicit Surface(RandomPosts all)
      : posts(std::make_shared<RandomPosts>(std::move(all))),
        terrain(make_height_field(posts->grid, posts)) {}
  std::shared_ptr<RandomPosts> posts;
  std::shared_ptr<const InitialTerrain> terrain;
};

SurveyHeights heights_of(const Surface& surface, const Ground& like, const Coord2& first,
                         const Coord2& size) {
  return column_heights(Ground(like.voxel_size_m(), like.origin(), surface.terrain), first, size);
}

std::int64_t residual_with_surveys(const Tracker& tracker) {
  return residual(tracker) - tracker.mass_balance().surveyed;
}

/// A scene: machines at work on rough ground, and a survey over a part of it.
struct Scene {
  explicit Scene(std::uint64_t seed, double voids = 0)
      : before(RandomPosts(seed, 0.7, 9, 0, 0.3)),
        survey(RandomPosts(seed + 1000, 0.45, 8, -0.2, 0.5, voids)),
        work(before.terrain, seed) {
    for (int i = 0; i < 40; ++i) work.step();
    const int odd = static_cast<int>(seed % 7);
    heights = heights_of(survey, work.ground, {-50 - odd, -43 + odd}, {101, 90 + odd});
  }
  Surface before, survey;
  Work work;
  SurveyHeights heights;
};

/// Calls f(cell, height of the survey) for its columns.
template <typename F>
void each_column(const SurveyHeights& heights, const F& f) {
  for (int x = 0; x < heights.size.x(); ++x)
    for (int y = 0; y < heights.size.y(); ++y)
      f(Coord2(heights.first + Coord2(x, y)), heights.heights[heights.number(x, y)]);
}

/// Air below soil in columns that have a cell without any below some, or more than a cell of it.
double hollow_m3(const Ground& ground, const SurveyHeights& heights) {
  constexpr int kLow = -64, kHigh = 64;
  std::int64_t missing = 0;
  each_column(heights, [&](const Coord2& cell, std::int32_t height) {
    const Coord2 corner = floor_to(cell, kChunkSide), in = cell - corner;
    std::int64_t soil = 0;
    bool some = false, empty = false;
    SampleWords words;
    for (int z = kHigh - kChunkSide; z >= kLow; z -= kChunkSide) {
      ground.read_samples({corner.x(), corner.y(), z}, words);
      for (int k = kChunkSide - 1; k >= 0; --k) {
        const int count = std::popcount(
            words[static_cast<std::size_t>((in.x() * kChunkSide + in.y()) * kChunkSide + k)]);
        empty |= some && count == 0;
        some |= count > 0;
        soil += count;
      }
    }
    if (height == SurveyHeights::kNone) return;
    const std::int64_t below = height - 64 * kLow + 32 - soil;
    if (empty || below > 64) missing += below;
  });
  return static_cast<double>(missing) * ground.sample_m3();
}

class Surveys : public ::testing::TestWithParam<std::uint64_t> {};

TEST_P(Surveys, GiveEachColumnTheirHeightToTheSample) {
  Scene scene(GetParam(), 0.02);
  const SurveyHeights before =
      column_heights(scene.work.ground, scene.heights.first, scene.heights.size);
  ASSERT_GT(scene.work.tracker.survey(scene.heights), 1000);
  const SurveyHeights after =
      column_heights(scene.work.ground, scene.heights.first, scene.heights.size);
  int known = 0, kept = 0;
  for (std::size_t i = 0; i < after.heights.size(); ++i) {
    const std::int32_t wanted = scene.heights.heights[i];
    const bool takes = wanted != SurveyHeights::kNone && before.heights[i] != SurveyHeights::kNone;
    EXPECT_EQ(after.heights[i], takes ? wanted : before.heights[i]) << i;
    takes ? ++known : ++kept;
  }
  EXPECT_GT(known, 1000);
  EXPECT_GT(kept, 50);  // under its voids
}

// What a viewer reads is the survey, and not only what this code counts.
TEST_P(Surveys, ShowInTheHeightsThatOthersRead) {
  Scene scene(GetParam());
  scene.work.tracker.survey(scene.heights);
  HeightMap map(scene.work.ground);
  const double h = kVoxel_m;
  double off_m = 0, most_m = 0;
  int count = 0;
  each_column(scene.heights, [&](const Coord2& cell, std::int32_t wanted) {
    if (wanted == SurveyHeights::kNone) return;
    const Vec2 at = scene.work.ground.origin().head<2>() + h * cell.cast<double>();
    double z = 0;
    map.at({&at, 1}, {&z, 1}).check();
    const double off = z - scene.survey.posts->height(at);
    off_m += std::abs(off);
    most_m = std::max(most_m, std::abs(off));
    ++count;
  });
  ASSERT_GT(count, 1000);
  // A column's mean is not the height at its middle where posts bend the surface within it: by half
  // a voxel times the change of slope, 2 * 0.5 m / 0.45 m at most, over four.
  EXPECT_LT(most_m, h / 2);
  EXPECT_LT(off_m / count, h / 20);
}

TEST_P(Surveys, ChangeTheGroundByTheIntegralOfTheDifference) {
  Scene scene(GetParam());
  const Ground& ground = scene.work.ground;
  const Surveyed none = scene.work.tracker.surveyed();
  const double dug_m3 = ground.change_m3();
  // Where all work was, so that the ground is then the survey, whatever it was before.
  const SurveyHeights heights = heights_of(scene.survey, ground, {-70, -70}, {140, 140});
  const GroundWindow all = all_of(ground);
  ASSERT_TRUE(all.nx() == 1 || (all.first().minCoeff() >= -70 && all.first().x() + all.nx() <= 70 &&
                                all.first().y() + all.ny() <= 70));
  scene.work.tracker.survey(heights);
  const Surveyed& made = scene.work.tracker.surveyed();
  const double booked_m3 =
      static_cast<double>(made.added - made.removed - none.added + none.removed) *
      ground.sample_m3();
  EXPECT_NEAR(ground.change_m3() - dug_m3, booked_m3, 1e-9);
  // The oracle: the two surfaces' difference over the columns, integrated from the posts.
  const SurveyHeights now = column_heights(ground, heights.first, heights.size);
  double wanted_m3 = 0;
  std::int64_t columns = 0;
  constexpr int kParts = 16;
  each_column(heights, [&](const Coord2& cell, std::int32_t height) {
    const Coord2 in = cell - heights.first;
    if (height == SurveyHeights::kNone ||
        now.heights[now.number(in.x(), in.y())] == SurveyHeights::kNone)
      return;
    ++columns;
    for (int u = 0; u < kParts; ++u)
      for (int v = 0; v < kParts; ++v) {
        const Vec2 part((u + 0.5) / kParts - 0.5, (v + 0.5) / kParts - 0.5);
        const Vec2 at = ground.origin().head<2>() + kVoxel_m * (cell.cast<double>() + part);
        wanted_m3 += (scene.survey.posts->height(at) - scene.before.posts->height(at)) * kVoxel_m *
                     kVoxel_m / (kParts * kParts);
      }
  });
  ASSERT_GT(columns, 2000);
  // Each surface is counted in the cells that it passes, some three of a column here; their errors
  // are independent. What buckets left hollow below a roof stays so.
  const double sigma_m3 =
      kWorstCountError * std::sqrt(2 * 3.0 * static_cast<double>(columns)) * std::pow(kVoxel_m, 3);
  EXPECT_NEAR(ground.change_m3() + hollow_m3(ground, heights), wanted_m3, 4 * sigma_m3);
}

TEST_P(Surveys, ChangeNothingTheSecondTime) {
  Scene scene(GetParam(), 0.02);
  scene.work.tracker.survey(scene.heights);
  const std::uint64_t hash = scene.work.ground.state_hash();
  const std::string state = scene.work.tracker.state();
  EXPECT_EQ(scene.work.tracker.survey(scene.heights), 0);
  EXPECT_EQ(scene.work.ground.state_hash(), hash);
  EXPECT_EQ(scene.work.tracker.state(), state);
}

TEST_P(Surveys, LeaveAllElseAsItWas) {
  Scene scene(GetParam(), 0.02);
  const std::unique_ptr<Ground> before = scene.work.ground.clone();
  std::vector<std::int64_t> loads;
  for (std::size_t i = 0; i < 4; ++i) loads.push_back(scene.work.tracker.ledger(i).load);
  const std::int64_t cut = scene.work.tracker.total().cut();
  ASSERT_EQ(residual_with_surveys(scene.work.tracker), 0);
  scene.work.tracker.survey(scene.heights);
  EXPECT_EQ(residual_with_surveys(scene.work.tracker), 0);
  EXPECT_EQ(scene.work.tracker.total().cut(), cut);
  for (std::size_t i = 0; i < 4; ++i) EXPECT_EQ(scene.work.tracker.ledger(i).load, loads[i]);
  const SurveyHeights& heights = scene.heights;
  std::int64_t others = 0;
  for (const Coord3& origin : scene.work.ground.origins()) {
    SampleWords now, then, loose_now, loose_then;
    scene.work.ground.read_samples(origin, now);
    before->read_samples(origin, then);
    scene.work.ground.read_loose(origin, loose_now);
    before->read_loose(origin, loose_then);
    for (int c = 0; c < kChunkSide * kChunkSide; ++c) {
      const Coord2 in =
          Coord2(origin.head<2>()) + Coord2(c / kChunkSide, c % kChunkSide) - heights.first;
      const bool inside = in.minCoeff() >= 0 && (heights.size - in).minCoeff() > 0 &&
                          heights.heights[heights.number(in.x(), in.y())] != SurveyHeights::kNone;
      if (inside) continue;
      ++others;
      for (int k = 0; k < kChunkSide; ++k) {
        const auto n = static_cast<std::size_t>(c * kChunkSide + k);
        ASSERT_EQ(now[n], then[n]);
        ASSERT_EQ(loose_now[n], loose_then[n]);
      }
    }
  }
  EXPECT_GT(others, 1000);
}

TEST_P(Surveys, AreTheSameForAnyNumberOfThreads) {
  Scene scene(GetParam());
  Work other(scene.work);
  {
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    scene.work.tracker.survey(scene.heights);
  }
  const tbb::global_control four(tbb::global_control::max_allowed_parallelism, 4);
  other.tracker.survey(scene.heights);
  EXPECT_EQ(other.ground.state_hash(), scene.work.ground.state_hash());
  EXPECT_EQ(other.tracker.state(), scene.work.tracker.state());
}

// Machines go on as on any other ground, and nothing is lost.
TEST_P(Surveys, AreGroundThatMachinesDig) {
  Scene scene(GetParam());
  scene.work.tracker.survey(scene.heights);
  for (int i = 0; i < 20; ++i) scene.work.step();
  scene.work.tracker.come_to_rest();
  EXPECT_EQ(residual_with_surveys(scene.work.tracker), 0);
}

INSTANTIATE_TEST_SUITE_P(Random, Surveys, ::testing::Range<std::uint64_t>(1, 9));

TEST(SurveysOfTheTerrain, ChangeNothing) {
  const Surface surface(RandomPosts(5, 0.7, 9, 0, 0.3));
  Ground ground(kVoxel_m, Vec3::Zero(), surface.terrain);
  Tracker tracker(ground, {digger()}, loam());
  EXPECT_EQ(tracker.survey(heights_of(surface, ground, {-60, -60}, {120, 120})), 0);
  EXPECT_EQ(ground.chunk_count(), 0u);
}

/// Ground of 3 m with a cave below a roof: a box without soil.
class UnderARoof : public ::testing::TestWithParam<bool> {
 protected:
  static constexpr int kFloor = 5, kCeiling = 20;  // cells
  UnderARoof()
      : ground(kVoxel_m, Vec3::Zero(), make_plane(3, {0, 0})),
        tracker(ground, {digger()}, GetParam() ? loam() : Earthmoving()) {
    std::vector<GroundWriter::Edit> edits;
    for (int x = 0; x < 16; x += kChunkSide)
      for (int y = 0; y < 16; y += kChunkSide)
        for (int z = 0; z <= kCeiling; z += kChunkSide) edits.push_back({{x, y, z}});
    GroundWriter(ground).edit(GroundWriter::Operation::kRemove, edits, 64,
                              [&](std::size_t i, Samples& samples, Samples& loose) {
                                SampleWords words;
                                samples.expand(words);
                                for (int n = 0; n < kChunkVoxels; ++n) {
                                  const int z = edits[i].origin.z() + n % kChunkSide;
                                  if (z > kFloor && z < kCeiling)
                                    words[static_cast<std::size_t>(n)] = 0;
                                }
                                samples.assign(words);
                                loose = Samples();
                                return true;
                              });
  }
  /// All columns over the cave at a height of so many cells.
  SurveyHeights at(double cells) const {
    SurveyHeights heights{{0, 0}, {16, 16}, {}};
    heights.heights.assign(256, static_cast<std::int32_t>(std::lround(64 * cells)));
    return heights;
  }
  std::int64_t soil(int low, int high) const {
    std::int64_t sum = 0;
    SampleWords words;
    for (int x = 0; x < 16; x += kChunkSide)
      for (int y = 0; y < 16; y += kChunkSide)
        for (int z = floor_to(low, kChunkSide); z < high; z += kChunkSide) {
          ground.read_samples({x, y, z}, words);
          for (int n = 0; n < kChunkVoxels; ++n)
            if (const int cell = z + n % kChunkSide; low <= cell && cell < high)
              sum += std::popcount(words[static_cast<std::size_t>(n)]);
        }
    return sum;
  }

  Ground ground;
  Tracker tracker;
};

TEST_P(UnderARoof, ThatStaysTheCaveStays) {
  for (const double cells : {28.0, 33.25, 25.5}) {
    tracker.survey(at(cells));
    EXPECT_EQ(soil(kFloor + 1, kCeiling), 0) << cells;
    EXPECT_EQ(soil(kCeiling, 50), 256 * std::lround(64 * (cells - kCeiling + 0.5))) << cells;
  }
}

TEST_P(UnderARoof, ThatTheSurveySeesThroughAllAboveIsGone) {
  for (const double cells : {12.0, 3.5}) {
    Ground other(kVoxel_m, Vec3::Zero(), make_plane(kVoxel_m * cells, {0, 0}));
    tracker.survey(at(cells));
    EXPECT_EQ(column_heights(ground, {0, 0}, {16, 16}).heights, at(cells).heights);
    EXPECT_EQ(soil(0, 50), 256 * std::lround(64 * (cells + 0.5))) << cells;
    EXPECT_EQ(tracker.survey(at(cells)), 0);
    const Surveyed& made = tracker.surveyed();
    EXPECT_NEAR(static_cast<double>(made.added - made.removed) * ground.sample_m3(),
                256 * kVoxel_m * kVoxel_m * kVoxel_m * (cells - 30) +
                    256 * kVoxel_m * kVoxel_m * kVoxel_m * (kCeiling - kFloor - 1),
                256 * kVoxel_m * kVoxel_m * kVoxel_m / 10);
  }
}

INSTANTIATE_TEST_SUITE_P(RigidOrMoving, UnderARoof, ::testing::Bool());

TEST(SurveyRecords, GiveACopyOfASiteTheSameBits) {
  const Surface surface(RandomPosts(7, 0.45, 8, -0.2, 0.5, 0.01));
  for (const bool scans : {false, true}) {
    Site site(std::make_shared<Ground>(kVoxel_m, Vec3::Zero(), make_plane(0, {0.02, 0})),
              {{{"digger", digger()}}, loam()});
    const auto dig = [](Site& to, double x) {
      for (const Pose& pose : cycle({x, 0, 0}, 0.4, 20))
        ASSERT_TRUE(to.update({.machine = 0, .pose = pose}).ok());
    };
    dig(site, -3);
    if (scans) {
      const Sensor sensor{.name = "above", .pose = {{0, 0, 6}, {0, 1, 0, 0}}};
      std::vector<Vec3> points;
      for (int i = -30; i < 30; ++i)
        for (int j = -30; j < 30; ++j) points.emplace_back(0.1 * i, 0.1 * j, -0.1);
      ASSERT_TRUE(site.scan(sensor, points).ok());
      Survey survey;
      ASSERT_TRUE(site.apply_scans(survey).ok());
    }
    Site copy(site);
    SurveyVolumes volumes;
    std::string record;
    ASSERT_TRUE(
        site.survey(heights_of(surface, site.ground(), {-40, -30}, {80, 61}), volumes, &record)
            .ok());
    EXPECT_GT(volumes.changed, 1000);
    EXPECT_GT(volumes.added_m3, 1);
    EXPECT_GT(volumes.removed_m3, 0.1);
    EXPECT_FALSE(Site::is_of_scans(record));
    copy.repeat_survey(record);
    EXPECT_EQ(copy.ground().state_hash(), site.ground().state_hash());
    EXPECT_EQ(copy.progress(), site.progress());
    for (Site* each : {&site, &copy}) dig(*each, -2.5);
    EXPECT_EQ(copy.ground().state_hash(), site.ground().state_hash());
    EXPECT_EQ(copy.progress(), site.progress());
  }
}

TEST(SurveyRecords, ThatAreImpossibleAreRefusedAndChangeNothing) {
  Site site(std::make_shared<Ground>(kVoxel_m, Vec3::Zero(), make_plane(0, {0, 0})),
            {{{"digger", digger()}}});
  const auto refused = [&](const SurveyHeights& heights) {
    SurveyVolumes volumes;
    const StepResult made = site.survey(heights, volumes);
    EXPECT_EQ(made.status, Status::kBadState);
    EXPECT_FALSE(made.why.empty());
    EXPECT_EQ(site.ground().chunk_count(), 0u);
  };
  refused({{0, 0}, {4, 4}, std::vector<std::int32_t>(15, 0)});
  refused({{0, 0}, {-4, -4}, std::vector<std::int32_t>(16, 0)});
  refused({{(1 << 23) - 2, 0}, {4, 4}, std::vector<std::int32_t>(16, 0)});
  refused({{0, 0}, {1, 1}, {1 << 30}});
  SurveyVolumes volumes;
  std::string record;
  ASSERT_TRUE(
      site.survey({{0, 0}, {8, 8}, std::vector<std::int32_t>(64, 100)}, volumes, &record).ok());
  for (std::size_t length = 0; length < record.size(); length += 7) {
    Site other(std::make_shared<Ground>(kVoxel_m, Vec3::Zero(), make_plane(0, {0, 0})),
               {{{"digger", digger()}}});
    if (length == 0) continue;  // of scans that told nothing
    EXPECT_THROW(other.repeat_survey(record.substr(0, length)), std::invalid_argument);
    EXPECT_EQ(other.ground().chunk_count(), 0u);
  }
  EXPECT_THROW(site.repeat_survey(record + 'x'), std::invalid_argument);
}

}  // namespace survey_heights_test
}  // namespace soilvdb::test
