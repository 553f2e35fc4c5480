// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tests/support/collapse.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/constants.h"
#include "core/settle/flux_grid.h"

namespace soilvdb::test {
namespace {

constexpr int kMaxTries = 4;  // of as many steps as sliding soil may take

/// What a column holds above what stands, in its sides: depths, and soil as loose volume.
class SoilStack {
 public:
  SoilStack(double base, double bank, double top, double swell)
      : base_(base), bank_(bank - base), loose_(top - bank), swell_(swell) {}

  double base() const { return base_; }
  double bank_soil() const { return swell_ * bank_; }
  double soil() const { return bank_soil() + loose_; }
  double depth(double soil) const {
    return soil < bank_soil() ? soil / swell_ : bank_ + (soil - bank_soil());
  }

 private:
  double base_, bank_, loose_, swell_;
};

/// The columns, with heights above the lowest top: soil never leaves a column without a lower
/// neighbour, so how far down it goes there doesn't matter.
class StackedGround {
 public:
  StackedGround(const SoilColumns& columns, double swell) : columns_(columns) {
    zero_m_ = std::numeric_limits<double>::infinity();
    for (std::size_t c = 0; c < columns.top_m.size(); ++c)
      if (!missing(c)) zero_m_ = std::min(zero_m_, columns.top_m[c]);
    for (std::size_t c = 0; c < columns.top_m.size(); ++c) {
      const auto height = [&](const std::vector<double>& of) {
        return missing(c) ? 0 : std::max((of[c] - zero_m_) / columns.side_m, -1.0);
      };
      const double top = height(columns.top_m), base = std::min(height(columns.base_m), top);
      stacks_.emplace_back(base, std::clamp(height(columns.bank_m), base, top), top, swell);
    }
  }

  const SoilStack& operator[](std::size_t c) const { return stacks_[c]; }
  double top_m(std::size_t c, double soil) const {
    return zero_m_ + columns_.side_m * (stacks_[c].base() + stacks_[c].depth(soil));
  }
  std::size_t index(const Coord2& column) const {
    return static_cast<std::size_t>(column.y() * columns_.nx + column.x());
  }
  void load(const Coord2& tile, FluxTile& out) const {
    for (int i = 0; i < 64; ++i) {
      const Coord2 column = 8 * tile + Coord2(i % 8, i / 8);
      const bool inside =
          (column.array() >= 0).all() && column.x() < columns_.nx && column.y() < columns_.ny;
      if (!inside || missing(index(column))) {
        out.set_missing(static_cast<std::size_t>(i));
      } else {
        const SoilStack& s = stacks_[index(column)];
        out.set(static_cast<std::size_t>(i), s.base(), s.bank_soil(), s.soil());
      }
    }
  }

 private:
  bool missing(std::size_t c) const { return !columns_.missing.empty() && columns_.missing[c]; }

  const SoilColumns& columns_;
  double zero_m_;
  std::vector<SoilStack> stacks_;
};

/// Lets soil flow until it is at rest, or for long enough. @param columns then hold what came of it
/// @return steps; 0: nothing was too steep
int flow(SoilColumns& columns, const Repose& repose) {
  const SoilColumns before = columns;
  const StackedGround ground(before, repose.swell);
  FluxGrid grid(repose.slope, repose.swell);
  grid.begin([&](const Coord2& tile, FluxTile& out) { ground.load(tile, out); });
  for (int x = 0; 8 * x < columns.nx; ++x)
    for (int y = 0; 8 * y < columns.ny; ++y) grid.activate({x, y});
  const int steps = grid.relax(kMaxFluxSteps);
  for (const FluxGrid::Change& change : grid.changes()) {
    const std::size_t c = ground.index(change.column);
    if (change.after == change.before) continue;
    columns.top_m[c] = std::max(ground.top_m(c, change.after), columns.base_m[c]);
    columns.bank_m[c] = std::min(columns.bank_m[c], columns.top_m[c]);
  }
  return steps;
}

}  // namespace

Collapse collapse(const SoilColumns& columns, const Repose& repose) {
  SoilColumns now = columns;
  Collapse result;
  for (int tries = 0; tries < kMaxTries; ++tries) {
    const int steps = flow(now, repose);
    result.iterations += steps;
    if (steps < kMaxFluxSteps) break;
  }
  result.top_m = std::move(now.top_m);
  result.bank_m = std::move(now.bank_m);
  return result;
}

}  // namespace soilvdb::test
