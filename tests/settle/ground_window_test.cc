// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Heights of columns against a count of every sample below them.
#include "tests/support/ground_window.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <functional>
#include <limits>
#include <random>

#include "core/ground/ground_writer.h"

namespace soilvdb::test {
namespace ground_window_test {

constexpr double kVoxel = 0.1;
constexpr int kLow = -64, kHigh = 64;  // of all that these soils hold or lack
// A column of untouched ground is as high as the base surface in its middle. Its count differs by
// about 2 samples for each cell that the surface passes through, three of them at these slopes, and
// all three together hardly by more than twice as many.
constexpr double kCountNoise = 3 * 4.0 / 64;
// The same where patches are twisted and bend at posts within a column.
constexpr double kFieldNoise = 0.3;

class Posts final : public HeightSource {
 public:
  explicit Posts(std::function<double(int, int)> z) : z_(std::move(z)) {}
  void read(int x0, int y0, int nx, int ny, float* out) const override {
    for (int y = y0; y < y0 + ny; ++y)
      for (int x = x0; x < x0 + nx; ++x) *out++ = static_cast<float>(z_(x, y));
  }

 private:
  std::function<double(int, int)> z_;
};

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

/// Posts one metre apart from (-4, -4), 9 x 9.
std::shared_ptr<const InitialTerrain> field(std::function<double(int, int)> z) {
  return make_height_field({9, 9, {-4, -4}, {1, 1}}, std::make_shared<Posts>(std::move(z)));
}

using Words = std::vector<std::uint64_t>;

/// All samples of a column of cells, from kLow up.
Words column_of(const Ground& ground, int x, int y, bool loose) {
  Words all;
  for (int z = kLow; z < kHigh; z += 8) {
    SampleWords words;
    const Coord3 origin(x & ~7, y & ~7, z);
    if (loose) {
      ground.read_loose(origin, words);
    } else {
      ground.read_samples(origin, words);
    }
    const auto first = static_cast<std::size_t>((x & 7) << 6 | (y & 7) << 3);
    all.insert(all.end(), words.begin() + first, words.begin() + first + 8);
  }
  return all;
}

/// The topmost full cell of a column.
int topmost_full(const Words& words) {
  for (int k = static_cast<int>(words.size()) - 1; k >= 0; --k)
    if (words[static_cast<std::size_t>(k)] == kAllSoil) return k;
  ADD_FAILURE() << "no full cell";
  return 0;
}

/// Height that soil above a cell comes to, index space.
double height_above(const Words& words, int cell) {
  double above = 0;
  for (auto k = static_cast<std::size_t>(cell) + 1; k < words.size(); ++k)
    above += std::popcount(words[k]);
  return kLow + cell + 0.5 + above / 64;
}

struct Found {
  double top_off = 0, bank_off = 0, full_off = 0;
  int loose_columns = 0, known = 0, pores = 0;
};

/// Compares a window with the count of all its columns.
Found compare(const Ground& ground, const Coord2& first, int nx, int ny) {
  const GroundWindow window(ground, first, nx, ny);
  Found found;
  for (int x = 0; x < nx; ++x) {
    for (int y = 0; y < ny; ++y) {
      const GroundWindow::Column& c = window.at(x, y);
      const Vec3 middle = ground.world_from_index(Vec3(first.x() + x, first.y() + y, 0));
      const auto covered = [&](double reach) {
        bool all = true;
        for (const double u : {-reach, 0.0, reach})
          for (const double v : {-reach, 0.0, reach})
            all &= ground.terrain()
                       .height(middle.x() + u * kVoxel, middle.y() + v * kVoxel)
                       .has_value();
        return all;
      };
      if (c.known) {
        EXPECT_TRUE(covered(0.498));
      } else {
        EXPECT_FALSE(covered(0.502));
      }
      if (!covered(0.502)) continue;
      ++found.known;
      const Words all = column_of(ground, first.x() + x, first.y() + y, false);
      const Words loose = column_of(ground, first.x() + x, first.y() + y, true);
      Words bank = all;
      for (std::size_t k = 0; k < bank.size(); ++k) bank[k] &= ~loose[k];
      const int solid = topmost_full(bank);
      int full = solid;
      while (all[static_cast<std::size_t>(full) + 1] == kAllSoil) ++full;
      found.top_off = std::max(found.top_off, std::abs(c.top - height_above(all, solid)));
      found.bank_off = std::max(found.bank_off, std::abs(c.bank - height_above(bank, solid)));
      found.full_off = std::max({found.full_off, static_cast<double>(kLow + full - c.full),
                                 std::abs(static_cast<double>(kLow + solid - c.bank_full))});
      found.pores = std::max(found.pores, c.full - kLow - full);
      found.loose_columns += c.top > c.bank;
      EXPECT_LE(c.bank, c.top);
      EXPECT_LT(c.full + 0.5, c.top + 1.001);
    }
  }
  return found;
}

/// Makes a chunk resident, as it is.
void touch(Ground& ground, const Coord3& origin) {
  SampleWords words;
  ground.read_samples(origin, words);
  GroundWriter(ground).remove(origin, words);
  GroundWriter(ground).add(origin, words);
}

/// Heaps and pits at random, with loose soil on bank soil and bank soil on air. What is above is
/// resident: a crust of less than a cell isn't seen where it is the base surface's.
void disturb(Ground& ground, std::mt19937_64& random, int times) {
  GroundWriter writer(ground);
  for (int i = 0; i < times; ++i) {
    const auto at = [&] { return static_cast<int>(random() % 8) * 8 - 32; };
    const Coord3 origin(at(), at(), static_cast<int>(random() % 8) * 8 - 32);
    SampleWords set;
    const std::uint64_t kind = random() % 4;
    for (std::size_t n = 0; n < set.size(); ++n) {
      const std::uint64_t r = random() % 4;
      set[n] = r == 0 ? 0 : r < 3 ? kAllSoil : random() & random();
    }
    for (int z = origin.z() + 8; z < 40; z += 8) {
      if (ground.find({origin.x(), origin.y(), z}) == nullptr)
        touch(ground, {origin.x(), origin.y(), z});
    }
    if (kind < 2) writer.remove(origin, set);
    if (kind == 2) writer.add(origin, set, GroundWriter::Kind::kLoose);
    if (kind == 3) writer.add(origin, set);
  }
}

std::vector<std::shared_ptr<const InitialTerrain>> bases() {
  std::vector<std::shared_ptr<const InitialTerrain>> all;
  all.push_back(make_plane(0.013, {0, 0}));
  all.push_back(make_plane(0.23, {0.31, -0.22}));
  all.push_back(make_plane(-0.1, {-0.9, 0.4}));
  all.push_back(field([](int x, int y) { return 0.5 * std::sin(2.1 * x) * std::cos(1.3 * y); }));
  return all;
}

TEST(GroundWindow, HasTheHeightsOfUntouchedGround) {
  for (const auto& base : bases()) {
    const Ground ground(kVoxel, {0.02, -0.03, 0.01}, base);
    const Found found = compare(ground, {-37, -29}, 61, 66);
    EXPECT_EQ(found.known, 61 * 66);
    EXPECT_LE(found.top_off, kCountNoise);
    EXPECT_EQ(found.loose_columns, 0);
  }
}

TEST(GroundWindow, CountsDisturbedGroundExactly) {
  const auto all = bases();
  for (const auto& base : all) {
    for (const bool resident : {false, true}) {
      for (std::uint64_t seed = 0; seed < 3; ++seed) {
        std::mt19937_64 random(seed);
        Ground ground(kVoxel, Vec3::Zero(), base);
        for (int x = -32; resident && x < 32; x += 8)
          for (int y = -32; y < 32; y += 8)
            for (int z = kLow; z < kHigh; z += 8) touch(ground, {x, y, z});
        disturb(ground, random, 200);
        const Found found = compare(ground, {-32, -32}, 64, 64);
        // Chunks that hold no sample aren't resident, though posts may stick out into them.
        const bool exact = resident && base != all.back();
        EXPECT_LE(found.top_off, exact ? 0 : kFieldNoise);
        EXPECT_LE(found.bank_off, exact ? 0 : kFieldNoise);
        EXPECT_LE(found.full_off, exact ? 0 : 3);  // lower where it may slope
        // What isn't resident is taken for solid up to the soil on it.
        EXPECT_TRUE(!exact || found.pores == 0);
        EXPECT_GT(found.loose_columns, 500);
      }
    }
  }
}

TEST(GroundWindow, SeesAPitThatGoesBelowTheBaseAndALedgeOverIt) {
  Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
  SampleWords all;
  all.fill(kAllSoil);
  for (int z = -48; z <= 0; z += 8) GroundWriter(ground).remove({0, 0, z}, all);
  const auto top = [&] { return GroundWindow(ground, {3, 3}, 1, 1).at(0, 0); };
  EXPECT_EQ(top().top, -48.5);
  SampleWords cell{};
  cell[3 << 6 | 3 << 3 | 2] = kAllSoil;  // a cell of soil that hangs in the air
  GroundWriter(ground).add({0, 0, -16}, cell, GroundWriter::Kind::kLoose);
  EXPECT_EQ(top().top, -47.5) << "what soil there is, wherever it hangs";
  EXPECT_LE(top().full, -49);
  EXPECT_EQ(top().bank, -48.5);
}

/// The ground below is in another chunk, where nobody touched it.
TEST(GroundWindow, TellsWhatHangsOverUntouchedGround) {
  for (const double height : {-9.0, -3.1, -2.9, -2.2, -1.8, -1.2, -0.7}) {  // voxels
    Ground ground(kVoxel, Vec3::Zero(), make_plane(kVoxel * height, {0, 0}));
    SampleWords cell{};
    cell[3 << 6 | 3 << 3] = kAllSoil;  // down to -0.5, over a voxel down to -1.5
    GroundWriter(ground).add({0, 0, 0}, cell, GroundWriter::Kind::kLoose);
    const GroundWindow window(ground, {3, 3}, 1, 1);
    const bool hangs = height < -1.5;
    EXPECT_EQ(window.has_hanging(), hangs) << height;
    EXPECT_EQ(window.at(0, 0).hangs, hangs ? 64 : 0) << height;
  }
}

/// Ground that reaches into a chunk by less than a sample, and is dug away below that.
TEST(GroundWindow, SeesAPitWhoseRimIsAHairAboveChunks) {
  Ground ground(kVoxel, Vec3::Zero(), make_plane(-0.05 + 0.0002, {0, 0}));
  EXPECT_NEAR(GroundWindow(ground, {3, 3}, 1, 1).at(0, 0).top, -0.498, kCountNoise);
  SampleWords all;
  all.fill(kAllSoil);
  GroundWriter(ground).remove({0, 0, -8}, all);
  GroundWriter(ground).remove({0, 0, 0}, all);
  EXPECT_NEAR(GroundWindow(ground, {3, 3}, 1, 1).at(0, 0).top, -8.5, 0.01);
}

TEST(GroundWindow, KnowsNothingBeyondARaster) {
  Ground ground(kVoxel, Vec3::Zero(),
                field([](int x, int y) { return x == 2 && y == 3 ? kNone : 0.2 * x - 0.1 * y; }));
  const Found found = compare(ground, {-60, -50}, 110, 105);
  EXPECT_EQ(found.known, 79 * 79 - 21 * 21);  // columns that end at posts aside
  EXPECT_LE(found.top_off, kCountNoise);
}

/// Posts 0.3 m apart where a chunk is 0.8 m wide: islands and cliffs within one.
TEST(GroundWindow, SeesIslandsAndCliffsAmongHolesOfOneChunk) {
  const auto heights = std::make_shared<Posts>([](int x, int y) {
    if (y > 1) return kNone;
    return x < 2 ? 0.0 : x == 2 ? kNone : 2.5;
  });
  const Ground ground(kVoxel, Vec3::Zero(),
                      make_height_field({5, 4, {0.1, 0.1}, {0.3, 0.3}}, heights));
  EXPECT_LE(compare(ground, {-8, -8}, 32, 32).top_off, 0.6);
}

/// Cells that a raster ends in would never be full.
TEST(GroundWindow, LeavesColumnsOutThatARasterEndsIn) {
  const auto heights = std::make_shared<Posts>([](int, int) { return 0.0; });
  Ground ground(kVoxel, Vec3::Zero(), make_height_field({5, 5, {0.02, 0.02}, {1, 1}}, heights));
  const auto column = [&](int x) { return GroundWindow(ground, {x, 8}, 1, 1).at(0, 0); };
  EXPECT_TRUE(ground.terrain().height(4.0, 0.8));
  EXPECT_FALSE(column(40).known);
  SampleWords one{};
  one[7 << 6 | 5] = 1;
  for (const int z : {-8, -16}) GroundWriter(ground).remove({32, 8, z}, one);
  EXPECT_TRUE(column(39).known);
  EXPECT_EQ(column(39).top, 0);
}

}  // namespace ground_window_test
}  // namespace soilvdb::test
