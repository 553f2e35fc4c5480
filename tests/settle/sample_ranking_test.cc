// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The samples that come first above a surface, against sorting them.
#include "core/settle/sample_ranking.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <tuple>

namespace soilvdb {
namespace sample_ranking_test {

struct Cell {
  CellPoints points;
  std::uint64_t may;
};

/// Heights in the same fixed point, one by one; then by cell and sample.
std::vector<std::uint64_t> by_sorting(const std::vector<Cell>& cells, const ColumnSurface& s,
                                      std::int64_t count) {
  std::vector<std::tuple<std::int32_t, std::size_t, std::size_t>> all;
  for (std::size_t z = 0; z < cells.size(); ++z) {
    const CellPoints& p = cells[z].points;
    for (std::size_t i = 0; i < 64; ++i) {
      if ((cells[z].may >> i & 1) == 0) continue;
      const float x = p.x[i] - s.a, y = p.y[i] - s.b;
      const float surface =
          s.cone ? -s.slope * std::sqrt(x * x + y * y) : s.a * p.x[i] + s.b * p.y[i];
      const float height = s.up * (static_cast<float>(z) + p.z[i] - surface);
      all.emplace_back(static_cast<std::int32_t>(height * 65536.0f), z, i);
    }
  }
  std::sort(all.begin(), all.end());
  std::vector<std::uint64_t> words(cells.size());
  for (std::int64_t n = 0; n < std::min(count, static_cast<std::int64_t>(all.size())); ++n) {
    const auto& [height, z, i] = all[static_cast<std::size_t>(n)];
    words[z] |= std::uint64_t{1} << i;
  }
  return words;
}

TEST(SampleRanking, IsThatOfSortingWithTiesAndWhateverCounts) {
  std::mt19937_64 random(1);
  const auto draw = [&](int n) { return static_cast<int>(random() % static_cast<unsigned>(n)); };
  SampleRanking ranking;
  for (int round = 0; round < 2000; ++round) {
    std::vector<Cell> cells(static_cast<std::size_t>(1 + draw(5)));
    for (Cell& cell : cells) {
      cell.points = sample_points({draw(1000), draw(1000), draw(1000)});
      cell.may = draw(5) == 0 ? 0 : draw(2) == 0 ? kAllSoil : random() & random();
      // All of one height: only ties tell them apart.
      if (draw(4) == 0) std::fill_n(cell.points.z, 64, 0.5f);
    }
    ColumnSurface surface{draw(2) == 0, 0, 0, 0.7f, draw(2) == 0 ? 1.0f : -1.0f};
    if (draw(3) != 0) {
      surface.a = static_cast<float>(draw(2001) - 1000) / (surface.cone ? 50.0f : 1000.0f);
      surface.b = static_cast<float>(draw(2001) - 1000) / (surface.cone ? 50.0f : 1000.0f);
    }
    const std::int64_t count = draw(400) - 20;
    ranking.clear();
    for (std::size_t z = 0; z < cells.size(); ++z)
      ranking.add(cells[z].points, static_cast<float>(z), surface, cells[z].may);
    const auto first = ranking.first(count);
    ASSERT_EQ(std::vector<std::uint64_t>(first.begin(), first.end()),
              by_sorting(cells, surface, count))
        << round;
  }
}

}  // namespace sample_ranking_test
}  // namespace soilvdb
