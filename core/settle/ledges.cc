// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/settle/ledges.h"

#include <algorithm>
#include <cmath>
#include <deque>

#include "core/lattice/cell_counts.h"

namespace soilvdb::inline v0 {
namespace {

int chunk_floor(int cell) { return cell & ~(kChunkSide - 1); }

constexpr int kNone = -1, kBeyond = -2;

/// Soil of a column without a gap.
struct Run {
  int low, high;
  int bank_low = 0, bank_high = -1;  ///< cells of it with bank soil
  std::int64_t bank = 0, loose = 0;
  int root = kNone;  ///< the column with ground below that it hangs on
};

/// A box of soil as runs of its columns, from below.
class Runs {
 public:
  Runs(const Soil& soil, const Eigen::AlignedBox3i& cells)
      : box_(cells),
        nx_(cells.sizes().x() + 1),
        ny_(cells.sizes().y() + 1),
        columns_(static_cast<std::size_t>(nx_ * ny_)) {
    for (int x = chunk_floor(box_.min().x()); x <= box_.max().x(); x += kChunkSide)
      for (int y = chunk_floor(box_.min().y()); y <= box_.max().y(); y += kChunkSide)
        for (int z = chunk_floor(box_.min().z()); z <= box_.max().z(); z += kChunkSide)
          read(soil, {x, y, z});
  }

  int columns() const { return nx_ * ny_; }
  Coord2 cell(int c) const { return box_.min().head<2>() + Coord2(c / ny_, c % ny_); }
  const std::vector<Run>& of(int c) const { return columns_[static_cast<std::size_t>(c)]; }
  bool any_hang() const { return any_hang_; }

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
  void read(const Soil& soil, const Coord3& origin) {
    SampleWords words, loose;
    CellCounts counts, loose_counts;
    soil.read_samples(origin, words);
    soil.read_loose(origin, loose);
    count_cells(words, counts);
    count_cells(loose, loose_counts);
    for (int n = 0; n < kChunkVoxels; ++n) {
      const Coord3 at = origin + Coord3(n >> 6, n >> 3 & 7, n & 7);
      const int all = counts[static_cast<std::size_t>(n)];
      const int bank = all - loose_counts[static_cast<std::size_t>(n)];
      if (all == 0 || !box_.contains(at)) continue;
      std::vector<Run>& runs = columns_[static_cast<std::size_t>(
          column(at.x() - box_.min().x(), at.y() - box_.min().y()))];
      if (runs.empty() || runs.back().high < at.z() - 1) {
        runs.push_back({at.z(), at.z()});
        any_hang_ = any_hang_ || at.z() > box_.min().z();
      }
      Run& run = runs.back();
      run.high = at.z();
      run.loose += all - bank;
      if (bank == 0) continue;
      if (run.bank == 0) run.bank_low = at.z();
      run.bank_high = at.z();
      run.bank += bank;
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
  int nx_, ny_;
  bool any_hang_ = false;
  std::vector<std::vector<Run>> columns_;
  std::deque<std::pair<int, std::size_t>> next_;
};

/// What hangs on one column: how far out, and how thick it is.
struct Ledge {
  double reach = 0;
  double samples = 0;
  int runs = 0;

  bool stands(const LedgeStrength& strength) const {
    const double thickness = samples / 64 / std::max(1, runs);
    return reach <= std::min(strength.shear, std::sqrt(strength.bending * thickness));
  }
};

}  // namespace

std::vector<Loosened> find_ledges(const Soil& soil, const Eigen::AlignedBox3i& cells,
                                  const LedgeStrength* strength, BeyondBox& beyond) {
  std::vector<Loosened> found;
  Runs runs(soil, cells);
  if (!runs.any_hang()) return found;
  runs.hold_from_ground();
  beyond.holds = runs.hold_from_sides();
  std::vector<Ledge> ledges(static_cast<std::size_t>(runs.columns()));
  const auto each_hanging = [&](const auto& f) {
    for (int c = 0; c < runs.columns(); ++c)
      for (std::size_t r = 0; r < runs.of(c).size(); ++r)
        if (const Run& run = runs.of(c)[r]; run.low > cells.min().z()) f(c, r, run);
  };
  each_hanging([&](int c, std::size_t, const Run& run) {
    if (run.root < 0) return;
    Ledge& ledge = ledges[static_cast<std::size_t>(run.root)];
    const double reach = (runs.cell(c) - runs.cell(run.root)).cast<double>().norm();
    ledge.reach = std::max(ledge.reach, reach);
    ledge.samples += static_cast<double>(run.bank + run.loose);
    ++ledge.runs;
  });
  each_hanging([&](int c, std::size_t r, const Run& run) {
    const bool stands =
        run.root == kBeyond ||
        (run.root >= 0 &&
         (strength == nullptr || ledges[static_cast<std::size_t>(run.root)].stands(*strength)));
    if (stands) return;
    if (r == 0) {
      beyond.ground = true;
      return;
    }
    found.push_back({runs.cell(c), run.low, run.high, runs.of(c)[r - 1].high, run.bank, run.loose});
  });
  return found;
}

}  // namespace soilvdb::inline v0
