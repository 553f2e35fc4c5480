// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/settle/overhangs.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <deque>

#include "core/lattice/chunk_math.h"
#include "soilvdb/chunk_range.h"

namespace soilvdb::inline v0 {
namespace {

constexpr int kNone = -1, kBeyond = -2;

/// Soil of a column without a gap.
struct Run {
  int low, high;
  int bank_low = 0, bank_high = -1;  ///< cells of it with bank soil
  std::int64_t bank = 0, loose = 0;
  int root = kNone;  ///< the column with ground below that it hangs on
};

/// Which cells of a chunk's columns hold soil, from below: eight bits each.
using Rows = std::array<std::uint8_t, kChunkVoxels / kChunkSide>;

Rows rows_with_soil(const Ground& ground, const Coord3& origin) {
  Rows rows{};
  const Chunk* chunk = ground.find(origin);
  if (chunk != nullptr && chunk->swap_record == 0) {
    for (std::size_t i = 0; i < rows.size(); ++i)
      rows[i] =
          static_cast<std::uint8_t>(chunk->samples.any_of_row(kChunkSide * static_cast<int>(i)));
    return rows;
  }
  SampleWords words;
  ground.read_samples(origin, words);
  for (std::size_t n = 0; n < words.size(); ++n)
    rows[n / kChunkSide] |= static_cast<std::uint8_t>((words[n] != 0) << n % kChunkSide);
  return rows;
}

/// Columns of a box, by x then y.
class ColumnSet {
 public:
  explicit ColumnSet(const Eigen::AlignedBox3i& box)
      : nx_(box.sizes().x() + 1),
        ny_(box.sizes().y() + 1),
        has_(static_cast<std::size_t>(nx_ * ny_)) {}

  bool has(int x, int y) const { return has_[static_cast<std::size_t>(x * ny_ + y)]; }
  bool empty() const { return empty_; }
  /// With its neighbours.
  void add(int x, int y) {
    empty_ = false;
    for (const auto& [dx, dy] : {std::pair(0, 0), {-1, 0}, {1, 0}, {0, -1}, {0, 1}})
      if (x + dx >= 0 && y + dy >= 0 && x + dx < nx_ && y + dy < ny_)
        has_[static_cast<std::size_t>((x + dx) * ny_ + y + dy)] = true;
  }

 private:
  int nx_, ny_;
  bool empty_ = true;
  std::vector<bool> has_;
};

/// Columns with soil above air, which are few, and those beside them, which that may hang on.
ColumnSet hanging_columns(const Ground& ground, const Eigen::AlignedBox3i& box) {
  ColumnSet hanging(box);
  const Coord3 first = floor_to(box.min(), kChunkSide);
  for (int x = first.x(); x <= box.max().x(); x += kChunkSide) {
    for (int y = first.y(); y <= box.max().y(); y += kChunkSide) {
      std::array<bool, std::tuple_size_v<Rows>> air{};  // of columns, somewhere below
      for (int z = first.z(); z <= box.max().z(); z += kChunkSide) {
        const Rows rows = rows_with_soil(ground, {x, y, z});
        const int low = std::max(box.min().z() - z, 0);
        const unsigned all = 0xffu >> (low + std::max(z + kChunkSide - 1 - box.max().z(), 0));
        for (std::size_t c = 0; c < rows.size(); ++c) {
          const Coord3 at(x + static_cast<int>(c) / kChunkSide,
                          y + static_cast<int>(c) % kChunkSide, z + low);
          const unsigned cells = (unsigned{rows[c]} >> low) & all;
          if (cells != 0 && (air[c] || (cells & (cells + 1)) != 0) && box.contains(at))
            hanging.add(at.x() - box.min().x(), at.y() - box.min().y());
          air[c] = air[c] || cells != all;
        }
      }
    }
  }
  return hanging;
}

/// Columns of a box of soil as runs, from below.
class Runs {
 public:
  Runs(const Ground& ground, const Eigen::AlignedBox3i& cells, const ColumnSet& wanted)
      : box_(cells),
        wanted_(wanted),
        nx_(cells.sizes().x() + 1),
        ny_(cells.sizes().y() + 1),
        columns_(static_cast<std::size_t>(nx_ * ny_)) {
    for_each_chunk(floor_to(box_.min(), kChunkSide), box_.max(),
                   [&](const Coord3& origin) { read(ground, origin); });
  }

  int columns() const { return nx_ * ny_; }
  Coord2 cell(int c) const { return box_.min().head<2>() + Coord2(c / ny_, c % ny_); }
  const std::vector<Run>& of(int c) const { return columns_[static_cast<std::size_t>(c)]; }

  /// Whatever bank hangs on a column that has ground below gets it as its root.
  void hold_from_ground() {
    for (int c = 0; c < columns(); ++c)
      if (!of(c).empty() && of(c).front().low == box_.min().z()) hold(c, 0, c);
    spread();
  }
  /// What is left and comes to the sides may hang on something beyond. @return whether any does
  bool hold_from_sides() {
    for (int c = 0; c < columns(); ++c) {
      const int x = c / ny_, y = c % ny_;
      if (x > 0 && y > 0 && x < nx_ - 1 && y < ny_ - 1) continue;
      for (std::size_t r = 0; r < of(c).size(); ++r)
        if (of(c)[r].root == kNone && of(c)[r].bank > 0) hold(c, r, kBeyond);
    }
    const bool any = !next_.empty();
    spread();
    return any;
  }

 private:
  void read(const Ground& ground, const Coord3& origin) {
    std::vector<std::size_t> rows;
    const Coord3 corner = origin - box_.min();
    for (int i = 0; i < kChunkSide; ++i) {
      for (int j = 0; j < kChunkSide; ++j) {
        const int x = corner.x() + i, y = corner.y() + j;
        if (x >= 0 && y >= 0 && x < nx_ && y < ny_ && wanted_.has(x, y))
          rows.push_back(static_cast<std::size_t>(kChunkSide * i + j));
      }
    }
    if (rows.empty()) return;
    SampleWords words, loose;
    ground.read_samples(origin, words);
    ground.read_loose(origin, loose);
    for (const std::size_t row : rows) {
      std::vector<Run>& runs = columns_[static_cast<std::size_t>(
          column(corner.x() + static_cast<int>(row) / kChunkSide,
                 corner.y() + static_cast<int>(row) % kChunkSide))];
      for (int k = 0; k < kChunkSide; ++k) {
        const std::size_t n = kChunkSide * row + static_cast<std::size_t>(k);
        const int z = origin.z() + k;
        if (words[n] == 0 || z < box_.min().z() || z > box_.max().z()) continue;
        if (runs.empty() || runs.back().high < z - 1) runs.push_back({z, z});
        Run& run = runs.back();
        run.high = z;
        run.loose += std::popcount(loose[n]);
        const int bank = std::popcount(words[n] & ~loose[n]);
        if (bank == 0) continue;
        if (run.bank == 0) run.bank_low = z;
        run.bank_high = z;
        run.bank += bank;
      }
    }
  }

  int column(int x, int y) const { return x * ny_ + y; }

  void hold(int c, std::size_t run, int root) {
    columns_[static_cast<std::size_t>(c)][run].root = root;
    next_.emplace_back(c, run);
  }

  /// From what is held outwards, the nearest first.
  void spread() {
    for (; !next_.empty(); next_.pop_front()) {
      const auto [c, r] = next_.front();
      const Run& from = of(c)[r];
      for (const auto& [dx, dy] : {std::pair(-1, 0), {1, 0}, {0, -1}, {0, 1}}) {
        const int x = c / ny_ + dx, y = c % ny_ + dy;
        if (x < 0 || y < 0 || x >= nx_ || y >= ny_) continue;
        for (std::size_t n = 0; n < of(column(x, y)).size(); ++n) {
          const Run& to = of(column(x, y))[n];
          const bool meet = to.bank > 0 && from.bank > 0 && to.bank_low <= from.bank_high &&
                            to.bank_high >= from.bank_low;
          if (meet && to.root == kNone) hold(column(x, y), n, from.root);
        }
      }
    }
  }

  Eigen::AlignedBox3i box_;
  const ColumnSet& wanted_;
  int nx_, ny_;
  std::vector<std::vector<Run>> columns_;
  std::deque<std::pair<int, std::size_t>> next_;
};

/// What hangs on one column: how far out, and how thick it is.
struct Overhang {
  double reach = 0;
  double samples = 0;
  int runs = 0;

  bool stands(const OverhangStrength& strength) const {
    const double thickness = samples / 64 / std::max(1, runs);
    return reach <= std::min(strength.shear, std::sqrt(strength.bending * thickness));
  }
};

}  // namespace

std::vector<UnsupportedPiece> find_overhangs(const Ground& ground, const Eigen::AlignedBox3i& cells,
                                             const OverhangStrength* strength,
                                             BoundaryContact& contact) {
  std::vector<UnsupportedPiece> found;
  const ColumnSet hanging = hanging_columns(ground, cells);
  if (hanging.empty()) return found;
  Runs runs(ground, cells, hanging);
  runs.hold_from_ground();
  contact.holds = runs.hold_from_sides();
  std::vector<Overhang> overhangs(static_cast<std::size_t>(runs.columns()));
  const auto each_hanging = [&](const auto& f) {
    for (int c = 0; c < runs.columns(); ++c)
      for (std::size_t r = 0; r < runs.of(c).size(); ++r)
        if (const Run& run = runs.of(c)[r]; run.low > cells.min().z()) f(c, r, run);
  };
  each_hanging([&](int c, std::size_t, const Run& run) {
    if (run.root < 0) return;
    Overhang& overhang = overhangs[static_cast<std::size_t>(run.root)];
    const double reach = (runs.cell(c) - runs.cell(run.root)).cast<double>().norm();
    overhang.reach = std::max(overhang.reach, reach);
    overhang.samples += static_cast<double>(run.bank + run.loose);
    ++overhang.runs;
  });
  each_hanging([&](int c, std::size_t r, const Run& run) {
    const bool stands =
        run.root == kBeyond ||
        (run.root >= 0 &&
         (strength == nullptr || overhangs[static_cast<std::size_t>(run.root)].stands(*strength)));
    if (stands) return;
    if (r == 0) {
      contact.ground = true;
      return;
    }
    found.push_back({runs.cell(c), run.low, run.high, runs.of(c)[r - 1].high, run.bank, run.loose});
  });
  return found;
}

}  // namespace soilvdb::inline v0
