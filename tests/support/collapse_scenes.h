// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Grounds for tests of collapse, and how far one is from another. Lengths in columns' sides but for
// what SoilColumns holds: the tests' sides are kSide.
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "tests/support/collapse.h"

namespace soilvdb::test {

inline constexpr double kSide = 0.05, kDegree = std::numbers::pi / 180;

struct Layers {
  double base, bank, top;
};

/// Columns that hold the mean of what is at their points. @param at Layers of a point, from the
/// middle of the grid @tparam kPoints a column's, along each axis
template <int kPoints = 8, class F>
SoilColumns sampled(int nx, int ny, const F& at) {
  SoilColumns columns{nx, ny, kSide, {}, {}, {}, {}};
  for (int y = 0; y < ny; ++y) {
    for (int x = 0; x < nx; ++x) {
      Layers mean{0, 0, 0};
      for (int i = 0; i < kPoints * kPoints; ++i) {
        const Layers l = at(x + (i % kPoints + 0.5) / kPoints - nx / 2.0,
                            y + (i / kPoints + 0.5) / kPoints - ny / 2.0);
        constexpr double kShare = 1.0 / (kPoints * kPoints);
        mean.base += kShare * l.base;
        mean.bank += kShare * l.bank;
        mean.top += kShare * l.top;
      }
      columns.base_m.push_back(mean.base * kSide);
      columns.bank_m.push_back(mean.bank * kSide);
      columns.top_m.push_back(mean.top * kSide);
    }
  }
  return columns;
}

/// The ground after a collapse: the same base, with what is left of the bank.
inline SoilColumns after(SoilColumns columns, const Collapse& collapse) {
  columns.top_m = collapse.top_m;
  columns.bank_m = collapse.bank_m;
  return columns;
}

struct Error {
  double rms = 0, p99 = 0, max = 0;
};
inline Error error_of(std::vector<double> differences) {
  Error e;
  if (differences.empty()) return e;
  for (double& d : differences) {
    e.rms += d * d;
    d = std::abs(d);
  }
  std::sort(differences.begin(), differences.end());
  e.rms = std::sqrt(e.rms / static_cast<double>(differences.size()));
  e.p99 = differences[differences.size() * 99 / 100];
  e.max = differences.back();
  return e;
}

/// Differences of heights from a truth, sides, where soil moved or should have. @param truth height
/// at a point from the middle of the grid; NaN: not known
template <class F>
Error off(const SoilColumns& before, const Collapse& collapse, const F& truth) {
  constexpr double kMoved = 0.01;
  const SoilColumns exact = sampled(before.nx, before.ny, [&](double x, double y) {
    const double z = truth(x, y);
    return Layers{z, z, z};
  });
  std::vector<double> all;
  for (std::size_t c = 0; c < exact.top_m.size(); ++c) {
    const double was = before.top_m[c], is = collapse.top_m[c], ought = exact.top_m[c];
    if (std::isnan(ought) || std::max(std::abs(is - was), std::abs(ought - was)) < kMoved * kSide)
      continue;
    all.push_back((is - ought) / kSide);
  }
  return error_of(all);
}

/// How much steeper than repose soil is down from each column that holds some, degrees: the
/// steepest plane through it and a neighbour along each axis. @param least depth of soil that
/// counts, sides
inline std::vector<double> steepness(const SoilColumns& columns, double slope, double least) {
  std::vector<double> all;
  const auto c = [&](int x, int y) { return static_cast<std::size_t>(y * columns.nx + x); };
  const auto there = [&](int x, int y) {
    return x >= 0 && y >= 0 && x < columns.nx && y < columns.ny &&
           (columns.missing.empty() || !columns.missing[c(x, y)]);
  };
  for (int y = 0; y < columns.ny; ++y) {
    for (int x = 0; x < columns.nx; ++x) {
      const double top = columns.top_m[c(x, y)];
      if (!there(x, y) || top - columns.base_m[c(x, y)] < least * kSide) continue;
      double down[4] = {0, 0, 0, 0};
      const int to[4][2] = {{1, 0}, {-1, 0}, {0, 1}, {0, -1}};
      for (int n = 0; n < 4; ++n) {
        const int u = x + to[n][0], v = y + to[n][1];
        if (there(u, v)) down[n] = std::max(0.0, top - columns.top_m[c(u, v)]) / kSide;
      }
      const double steepest = std::hypot(std::max(down[0], down[1]), std::max(down[2], down[3]));
      all.push_back((std::atan(steepest) - std::atan(slope)) / kDegree);
    }
  }
  std::sort(all.begin(), all.end());
  return all;
}

/// Waves in all directions, of slopes that are normally distributed with this root mean square.
class Waves {
 public:
  Waves(unsigned seed, double rms_slope, double shortest, double longest) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> unit(0, 1);
    constexpr int kWaves = 24;
    for (int i = 0; i < kWaves; ++i) {
      const double length = shortest * std::pow(longest / shortest, unit(random));
      const double turn = 2 * std::numbers::pi * unit(random), k = 2 * std::numbers::pi / length;
      waves_.push_back({rms_slope / k * std::sqrt(2.0 / kWaves), k * std::cos(turn),
                        k * std::sin(turn), 2 * std::numbers::pi * unit(random)});
    }
  }
  double operator()(double x, double y) const {
    double z = 0;
    for (const Wave& w : waves_) z += w.height * std::sin(w.x * x + w.y * y + w.phase);
    return z;
  }

 private:
  struct Wave {
    double height, x, y, phase;
  };
  std::vector<Wave> waves_;
};

/// Rough ground of bank and loose soil that fails down to a base of its own. @param fine columns to
/// a side, whose own sides heights are then in
inline SoilColumns rough(unsigned seed, int nx, int ny, double base_slope, double top_slope,
                         int fine = 1) {
  const Waves base(seed, base_slope, 8, 48), bank(seed + 1, 0.3, 6, 24),
      top(seed + 2, top_slope, 8, 48);
  return sampled<1>(fine * nx, fine * ny, [&](double u, double v) {
    const double x = u / fine, y = v / fine;
    const double b = base(x, y), m = std::max(b, b + 1 + bank(x, y));
    return Layers{fine * b, fine * m, fine * std::max(m, top(x, y))};
  });
}

}  // namespace soilvdb::test
