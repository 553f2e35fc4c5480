// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/settle/flux_grid.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "core/constants.h"
#include "core/settle/flux_row.h"

namespace soilvdb::inline v0 {

FluxGrid::FluxGrid(int nx, int ny, float limit, float swell)
    : nx_(nx),
      ny_(ny),
      stride_(kFrame + (nx + kFrame - 1) / kFrame * kFrame),
      limit_(limit),
      swell_(swell) {
  // One frame more behind the last row.
  const auto n = static_cast<std::size_t>((ny + 2) * stride_ + kFrame);
  base_.assign(n, kMissingBase);
  soil_.assign(n, kMissingSoil);
  top_.assign(n, kMissingBase + kMissingSoil);
  depth_.assign(n, kMissingSoil);
  bank_.assign(n, 0);
  for (Array& a : flux_) a.assign(n, 0);
  for (Array& a : ahead_) a.assign(n, 0);
  for (Array& a : out_) a.assign(n, 0);
  for (Array& a : brink_) a.assign(n, 0);
  flows_.assign(n / kFrame, 0);
  uphill_.assign(static_cast<std::size_t>(ny * kFrame), 0);
}

void FluxGrid::set_column(std::size_t i, float base, float bank, float soil) {
  base_[i] = base;
  bank_[i] = bank;
  soil_[i] = soil;
}

void FluxGrid::find_brinks() {
  for (int y = 0; y < ny_; ++y) {
    for (int x = 0; x < nx_; ++x) {
      const std::size_t i = at(x, y);
      if (missing(i)) continue;
      const int to[4] = {1, -1, stride_, -stride_};
      for (int n = 0; n < 4; ++n) brink_[n][i] = brink(i, to[n]);
    }
  }
}

/// Between the middles of two columns ground bends to something steeper than repose. Soil lies up
/// to the bend, so where the column's middle is short of it there is some, and may stay.
float FluxGrid::brink(std::size_t i, std::ptrdiff_t to) const {
  const auto drop = [&](std::size_t a, std::size_t b) {
    return missing(a) || missing(b) ? 0 : base_[a] - base_[b];
  };
  const std::size_t next = i + static_cast<std::size_t>(to);
  if (drop(i - static_cast<std::size_t>(to), i) > limit_ || missing(next)) return 0;  // slides by
  const float here = std::max(drop(i, next), 0.0f);
  const float beyond = std::max(drop(next, next + static_cast<std::size_t>(to)), 0.0f);
  const float steepest = std::max(here, beyond);
  if (steepest <= limit_) return 0;
  // Of a slope that goes on the drops say where it begins, a step is between columns.
  const float short_by = beyond > here ? 1 - here / beyond : (1 - beyond / here) / 2;
  return short_by * std::min(steepest - limit_, limit_);
}

FluxGrid FluxGrid::coarser() const {
  FluxGrid coarse((nx_ + 1) / 2, (ny_ + 1) / 2, 2 * limit_, swell_);
  for (int y = 0; y < coarse.ny_; ++y) {
    for (int x = 0; x < coarse.nx_; ++x) {
      int n = 0;
      double base = 0, bank = 0, soil = 0;  // exact, so the order doesn't matter
      for (int k = 0; k < 4; ++k) {
        const std::size_t i = at(2 * x + (k & 1), 2 * y + (k >> 1));
        if (missing(i)) continue;
        ++n;
        base += double{base_[i]};
        bank += double{bank_[i]};
        soil += double{soil_[i]};
      }
      if (n < kMinFineColumns) continue;
      coarse.set_column(coarse.at(x, y), static_cast<float>(base / n), static_cast<float>(bank / n),
                        static_cast<float>(soil / n));
    }
  }
  coarse.find_brinks();
  return coarse;
}

void FluxGrid::start_from(const FluxGrid& coarse) {
  for (int y = 0; y < ny_; ++y) {
    for (int x = 0; x < nx_; ++x) {
      const std::size_t i = at(x, y), c = coarse.at(x / 2, y / 2);
      if (missing(i)) continue;
      for (int f = 0; f < 8; ++f) {
        const int t = f / 2;
        const bool in_x = f % 2 == 0, lower = (t >> (in_x ? 0 : 1) & 1) != 0;
        const auto to = static_cast<std::size_t>(in_x ? along_x(t) : along_y(t));
        if (missing(i + to)) continue;
        // Through a side that is one of the coarse column's flows what flows there; through one in
        // its middle the mean of what flows in and out. Four times the volume, twice the length.
        float flux = coarse.flux_[f][c];
        if (((in_x ? x : y) & 1) == (lower ? 1 : 0)) {
          const auto from = static_cast<std::size_t>(in_x ? coarse.along_x(t) : coarse.along_y(t));
          flux = (flux + coarse.flux_[f][c - from]) / 2;
        }
        flux_[f][i] = 2 * flux;
      }
    }
  }
}

FluxGrid::Flow FluxGrid::flow(std::size_t i, const std::vector<double>& share) const {
  const auto to = [&](int axis, bool lower, std::size_t from) {
    const int a = axis == 0 ? (lower ? 2 : 0) : (lower ? 5 : 1), b = a + (axis == 0 ? 4 : 2);
    return double{flux_[a][from]} + double{flux_[b][from]};
  };
  double in[2], out[2];
  for (int axis = 0; axis < 2; ++axis) {
    const std::size_t next = axis == 0 ? 1 : static_cast<std::size_t>(stride_);
    out[axis] = to(axis, false, i) + to(axis, true, i);
    in[axis] =
        share[i - next] * to(axis, false, i - next) + share[i + next] * to(axis, true, i + next);
  }
  return {in[0] + in[1], out[0] + out[1]};
}

FluxRow FluxGrid::row(int y) {
  const std::size_t i = at(0, y);
  FluxRow r;
  r.columns = stride_ - kFrame;
  r.stride = stride_;
  r.limit = limit_;
  r.swell = swell_;
  r.base = &base_[i];
  r.bank = &bank_[i];
  r.soil = &soil_[i];
  r.top = &top_[i];
  r.depth = &depth_[i];
  for (int f = 0; f < 8; ++f) {
    r.flux[f] = &flux_[f][i];
    r.ahead[f] = &ahead_[f][i];
  }
  for (int n = 0; n < 4; ++n) {
    r.brink[n] = &brink_[n][i];
    r.out[n] = &out_[n][i];
  }
  r.flows = &flows_[i / kFrame];
  return r;
}

int FluxGrid::count_bands() const {
  return std::max(1, std::min(ny_ / kMinBandRows, nx_ * ny_ / kMinBandColumns));
}

template <class F>
void FluxGrid::in_bands(const F& band) const {
  const int bands = count_bands();
  if (bands == 1) return band(0, ny_);
  tbb::parallel_for(std::size_t{0}, static_cast<std::size_t>(bands), [&](std::size_t i) {
    const int b = static_cast<int>(i);
    band(b * ny_ / bands, (b + 1) * ny_ / bands);
  });
}

void FluxGrid::note_flows() {
  for (std::size_t i = 0; i < size(); ++i)
    for (const Array& flux : flux_)
      if (flux[i] != 0) flows_[i / kFrame] = 2;
}

/// @param all also where nothing flowed since it was done last
void FluxGrid::settle_by(const Array* fluxes, bool all) {
  in_bands([&](int first, int last) {
    for (std::size_t group = at(0, first), end = at(0, last); group < end; group += kFrame) {
      if (!all && flows_[group / kFrame] == 0) continue;
      for (std::size_t i = group; i < group + kFrame; ++i) {
        for (int d = 0; d < 2; ++d) {
          out_[d][i] = fluxes[2 * d][i] + fluxes[2 * d + 4][i];
          out_[2 + d][i] = fluxes[4 * d + 1][i] + fluxes[4 * d + 3][i];
        }
      }
    }
  });
  in_bands([&](int first, int last) {
    for (int y = first; y < last; ++y) settle(row(y), all);
  });
}

Unrest FluxGrid::unrest(bool all) {
  settle_by(flux_, all);
  std::vector<Unrest> rows(static_cast<std::size_t>(ny_));
  in_bands([&](int first, int last) {
    for (int y = first; y < last; ++y) rows[static_cast<std::size_t>(y)] = soilvdb::unrest(row(y));
  });
  Unrest most;
  for (const Unrest& r : rows) {
    most.steep = std::max(most.steep, r.steep);
    most.flux = std::max(most.flux, r.flux);
    most.hollow = std::max(most.hollow, r.hollow);
  }
  return most;
}

double FluxGrid::step(float momentum) {
  // Heights of a row are made when those of the next aren't needed any more, but for rows at the
  // sides of bands, which wait until all is pushed.
  in_bands([&](int first, int last) {
    for (int y = first; y < last; ++y) {
      push(row(y), momentum, &uphill_[static_cast<std::size_t>(y * kFrame)]);
      if (y - 1 > first) settle(row(y - 1), false);
    }
  });
  const int bands = count_bands();
  for (int b = 0; b < bands; ++b) {
    const int first = b * ny_ / bands, last = (b + 1) * ny_ / bands - 1;
    settle(row(first), false);
    if (last > first) settle(row(last), false);
  }
  double sum = 0;
  for (std::size_t y = 0; y < uphill_.size(); y += kFrame) {
    double row = 0;
    for (std::size_t k = 0; k < kFrame; ++k) row += double{uphill_[y + k]};
    sum += row;
  }
  return sum;
}

int FluxGrid::relax(int most, float tolerance) {
  for (int f = 0; f < 8; ++f) ahead_[f] = flux_[f];
  note_flows();
  settle_by(ahead_, true);
  double lead = 1;
  for (int done = 1; done <= most; ++done) {
    const double next = (1 + std::sqrt(1 + 4 * lead * lead)) / 2;
    const double uphill = step(static_cast<float>((lead - 1) / next));
    lead = uphill > 0 ? 1 : next;
    if (done % kRestCheckSteps != 0 && done < most) continue;
    const Unrest now = unrest(false);
    if (done == most ||
        (now.steep <= tolerance && now.flux <= kFluxTolerance * limit_ && now.hollow <= tolerance))
      return done;
    settle_by(ahead_, false);
  }
  return 0;
}

}  // namespace soilvdb::inline v0
