// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Collapse on gentle support by another way: plain, slow, in double, without fluxes.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "tests/support/collapse.h"

namespace soilvdb::test {

/// Minimises the sum over columns of the integral of (mass - mass before) over height, with each
/// right-angled triangle of columns held to the repose slope where it goes down from its corner.
/// Consensus by the alternating direction method of multipliers: each triangle keeps heights of its
/// own, projected onto what it allows, columns keep what all agree on.
class ConvexHeights {
 public:
  ConvexHeights(const SoilColumns& columns, const Repose& repose)
      : nx_(columns.nx), ny_(columns.ny), slope_(repose.slope), swell_(repose.swell) {
    for (std::size_t c = 0; c < columns.top_m.size(); ++c) {
      bank_.push_back(columns.bank_m[c] / columns.side_m);
      before_.push_back(columns.top_m[c] / columns.side_m);
    }
    for (int y = 0; y < ny_; ++y) {
      for (int x = 0; x < nx_; ++x) {
        for (int t = 0; t < 4; ++t) {
          const int u = x + (t & 1 ? -1 : 1), v = y + (t & 2 ? -1 : 1);
          const bool in_x = u >= 0 && u < nx_, in_y = v >= 0 && v < ny_;
          const int here = y * nx_ + x;
          triangles_.push_back({{here, in_x ? y * nx_ + u : -1, in_y ? v * nx_ + x : -1}, {}, {}});
        }
      }
    }
  }

  /// Heights, sides. Rounds until no column and its triangles differ by more than a tolerance.
  std::vector<double> solve(int most_rounds, double tolerance) {
    std::vector<double> z = before_, sum(z.size());
    std::vector<int> count(z.size());
    for (Triangle& t : triangles_) {
      for (int k = 0; k < 3; ++k) {
        if (t.column[k] < 0) continue;
        t.height[k] = z[at(t, k)];
        ++count[at(t, k)];
      }
    }
    for (int round = 0; round < most_rounds; ++round) {
      std::fill(sum.begin(), sum.end(), 0.0);
      for (Triangle& t : triangles_) {
        for (int k = 0; k < 3; ++k) {
          if (t.column[k] >= 0) t.height[k] = z[at(t, k)] - t.price[k];
        }
        project(t);
        for (int k = 0; k < 3; ++k) {
          if (t.column[k] >= 0) sum[at(t, k)] += t.height[k] + t.price[k];
        }
      }
      double moved = 0, apart = 0;
      for (std::size_t c = 0; c < z.size(); ++c) {
        const double next = agreed(c, sum[c] / count[c], kWeight * count[c]);
        moved = std::max(moved, std::abs(next - z[c]));
        z[c] = next;
      }
      for (Triangle& t : triangles_) {
        for (int k = 0; k < 3; ++k) {
          if (t.column[k] < 0) continue;
          t.price[k] += t.height[k] - z[at(t, k)];
          apart = std::max(apart, std::abs(t.height[k] - z[at(t, k)]));
        }
      }
      if (std::max(moved, apart) < tolerance) break;
    }
    return z;
  }

 private:
  struct Triangle {
    int column[3];  // the corner, along x, along y; -1: beyond the grid
    double height[3], price[3];
  };
  static constexpr double kWeight = 1;  // of agreement against mass

  std::size_t at(const Triangle& t, int k) const { return static_cast<std::size_t>(t.column[k]); }

  /// Of mass(z) - mass_before + weight (z - wish) = 0: mass has slope 1 above the bank's top, swell
  /// below.
  double agreed(std::size_t c, double wish, double weight) const {
    const double above = (before_[c] + weight * wish) / (1 + weight);
    if (above >= bank_[c]) return above;
    return (before_[c] - bank_[c] + swell_ * bank_[c] + weight * wish) / (swell_ + weight);
  }

  /// The nearest heights whose drops from the corner, where positive, make no more than repose.
  void project(Triangle& t) const {
    const double high = t.height[0];
    const double drop[2] = {t.column[1] < 0 ? -1 : high - t.height[1],
                            t.column[2] < 0 ? -1 : high - t.height[2]};
    if (std::hypot(std::max(drop[0], 0.0), std::max(drop[1], 0.0)) <= slope_) return;
    // The drops that are left for a force m times each: both, or one and the other isn't down.
    double left[2];
    const auto pulled = [&](double m) {
      const double det = (1 + 2 * m) * (1 + 2 * m) - m * m;
      left[0] = ((1 + 2 * m) * drop[0] - m * drop[1]) / det;
      left[1] = ((1 + 2 * m) * drop[1] - m * drop[0]) / det;
      if (left[0] <= 0 || left[1] <= 0) {
        left[0] = std::max(0.0, drop[0] > drop[1] ? drop[0] / (1 + 2 * m) : 0.0);
        left[1] = std::max(0.0, drop[0] > drop[1] ? 0.0 : drop[1] / (1 + 2 * m));
      }
      return std::hypot(left[0], left[1]);
    };
    double low = 0, enough = 1;
    while (pulled(enough) > slope_) enough *= 2;
    for (int i = 0; i < 40; ++i) {
      const double middle = (low + enough) / 2;
      (pulled(middle) > slope_ ? low : enough) = middle;
    }
    pulled(enough);
    t.height[0] -= enough * (left[0] + left[1]);
    t.height[1] += enough * left[0];
    t.height[2] += enough * left[1];
  }

  int nx_, ny_;
  double slope_, swell_;
  std::vector<double> bank_, before_;
  std::vector<Triangle> triangles_;
};

}  // namespace soilvdb::test
