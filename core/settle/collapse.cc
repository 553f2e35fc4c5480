// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/settle/collapse.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>

#include "core/constants.h"
#include "core/settle/flux_grid.h"

namespace soilvdb::inline v0 {
namespace {

// Angles by + - * / and sqrt alone, whose bits are the same on any build and CPU: continued
// fractions, to 1e-9 up to 1 rad.
double tangent(double rad) {
  const double a2 = rad * rad;
  return rad / (1 - a2 / (3 - a2 / (5 - a2 / (7 - a2 / 9))));
}
/// Slope beyond another that is steeper by an angle.
float slope_beyond(double slope, double rad) {
  const double t = tangent(rad), rest = 1 - slope * t;
  return rest <= 0 ? std::numeric_limits<float>::max()
                   : static_cast<float>(t * (1 + slope * slope) / rest);
}

/// What a column holds above what stands, in its sides: depths, and soil as loose volume.
class SoilStack {
 public:
  SoilStack(double base, double bank, double top, double swell)
      : base_(base), bank_(bank - base), loose_(top - bank), swell_(swell) {}

  double base() const { return base_; }
  double bank_soil() const { return swell_ * bank_; }
  double soil() const { return bank_soil() + loose_; }
  double bank_depth(double soil) const { return std::min(soil / swell_, bank_); }
  double depth(double soil) const {
    return soil < bank_soil() ? soil / swell_ : bank_ + (soil - bank_soil());
  }

 private:
  double base_, bank_, loose_, swell_;
};

/// The columns that are there, from the lowest top upwards: soil never leaves a column without a
/// lower neighbour, so how far down it goes there doesn't matter.
class StackedGround {
 public:
  StackedGround(const SoilColumns& columns, double swell) : columns_(columns) {
    zero_m_ = std::numeric_limits<double>::infinity();
    for (std::size_t c = 0; c < columns.top_m.size(); ++c) {
      if (!missing(c)) zero_m_ = std::min(zero_m_, columns.top_m[c]);
    }
    for (std::size_t c = 0; c < columns.top_m.size(); ++c) {
      const auto height = [&](const std::vector<double>& of) {
        return missing(c) ? 0 : std::max((of[c] - zero_m_) / columns.side_m, -1.0);
      };
      const double top = height(columns.top_m), base = std::min(height(columns.base_m), top);
      stacks_.emplace_back(base, std::clamp(height(columns.bank_m), base, top), top, swell);
    }
  }

  bool missing(std::size_t c) const { return !columns_.missing.empty() && columns_.missing[c]; }
  const SoilStack& operator[](std::size_t c) const { return stacks_[c]; }
  double top_m(std::size_t c, double soil) const {
    return zero_m_ + columns_.side_m * (stacks_[c].base() + stacks_[c].depth(soil));
  }
  /// Calls f(c, i) for each column that is there with its places in the lists and in a grid.
  template <class F>
  void each(const FluxGrid& grid, const F& f) const {
    std::size_t c = 0;
    for (int y = 0; y < columns_.ny; ++y) {
      for (int x = 0; x < columns_.nx; ++x, ++c) {
        if (!missing(c)) f(c, grid.at(x, y));
      }
    }
  }

 private:
  const SoilColumns& columns_;
  double zero_m_;
  std::vector<SoilStack> stacks_;
};

/// Grids with columns twice as wide each, until they are few.
std::deque<FluxGrid> coarser_grids(const FluxGrid& grid) {
  std::deque<FluxGrid> all;
  for (const FluxGrid* g = &grid; std::max(g->nx(), g->ny()) >= kMinColumnsToCoarsen;
       g = &all.back()) {
    all.push_back(g->coarser());
  }
  return all;
}

/// Soil of each column after what flowed. Fluxes are floats, but what one column gives another
/// gets, so sums in double hold the mass.
///
/// Where they aren't quite at rest a column may give a little more than it has. It then gives as
/// much less, to all alike, and so do those that got it and passed it on; those that soil went
/// round in circles between give nothing.
std::vector<double> soil_after(const StackedGround& ground, const FluxGrid& grid,
                               std::size_t size) {
  std::vector<double> soil(size), share(grid.size(), 1.0), next;
  bool again = true;
  for (int round = 0; again; ++round) {
    again = false;
    next = share;
    ground.each(grid, [&](std::size_t c, std::size_t i) {
      const FluxGrid::Flow flow = grid.flow(i, share);
      const double had = ground[c].soil() + flow.in;
      soil[c] = had - share[i] * flow.out;
      if (soil[c] >= -kMaxOwedShare * had) return;
      next[i] = round < kMaxOwedRounds ? had / flow.out : 0;
      again = true;
    });
    share.swap(next);
  }
  return soil;
}

/// Lets soil flow until it is at rest, or for long enough. @param columns then hold what came of it
/// @return steps on the columns themselves; 0: nothing was too steep
int flow(SoilColumns& columns, const Repose& repose) {
  const StackedGround ground(columns, repose.swell);
  FluxGrid grid(columns.nx, columns.ny, static_cast<float>(repose.slope),
                static_cast<float>(repose.swell));
  ground.each(grid, [&](std::size_t c, std::size_t i) {
    const SoilStack& s = ground[c];
    grid.set_column(i, static_cast<float>(s.base()), static_cast<float>(s.bank_soil()),
                    static_cast<float>(s.soil()));
  });
  grid.find_brinks();
  const auto beyond = [&](double rad) { return slope_beyond(repose.slope, rad); };
  if (grid.unrest().steep <= beyond(kCollapseStartRad)) return 0;

  std::deque<FluxGrid> coarse = coarser_grids(grid);
  for (std::size_t k = coarse.size(); k-- > 0;) {
    const auto sides = static_cast<float>(2 << k);  // of ours in one of theirs
    coarse[k].relax(kMaxCoarseSteps, sides * beyond(kCoarseToleranceRad));
    (k > 0 ? coarse[k - 1] : grid).start_from(coarse[k]);
  }
  const int steps = grid.relax(kMaxFluxSteps, beyond(kRestToleranceRad));

  const std::vector<double> soil = soil_after(ground, grid, columns.top_m.size());
  ground.each(grid, [&](std::size_t c, std::size_t) {
    const double after = std::max(soil[c], 0.0);
    if (after == ground[c].soil()) return;
    columns.top_m[c] = std::max(ground.top_m(c, after), columns.base_m[c]);
    columns.bank_m[c] = std::min(columns.bank_m[c], columns.top_m[c]);
  });
  return steps;
}

}  // namespace

Collapse collapse(const SoilColumns& columns, const Repose& repose) {
  SoilColumns now = columns;
  Collapse result;
  for (int tries = 0; tries < kMaxCollapseTries; ++tries) {
    const int steps = flow(now, repose);
    result.iterations += steps;
    if (steps < kMaxFluxSteps) break;
  }
  result.top_m = std::move(now.top_m);
  result.bank_m = std::move(now.bank_m);
  for (std::size_t c = 0; c < columns.top_m.size(); ++c) {
    if (!columns.missing.empty() && columns.missing[c]) continue;
    const int x = static_cast<int>(c) % columns.nx, y = static_cast<int>(c) / columns.nx;
    const bool edge = x == 0 || y == 0 || x == columns.nx - 1 || y == columns.ny - 1;
    result.at_edge |=
        edge && std::abs(result.top_m[c] - columns.top_m[c]) > kMinEdgeChange * columns.side_m;
  }
  return result;
}

}  // namespace soilvdb::inline v0
