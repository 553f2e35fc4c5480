// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Soil that flows between columns until nothing is steeper than it may be.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/settle/flux_row.h"

namespace soilvdb::inline v0 {

/// Columns, and the soil that flowed between them. Heights and drops are in sides of the finest
/// columns, soil is loose and in those of its own columns' area.
///
/// A column has four quadrants, each with one neighbour along x and one along y: the lower x if
/// t & 1, the lower y if t & 2. Its drops to both, where positive, may come to `limit` together
/// (root of the sum of squares). What keeps it so are two fluxes >= 0 per quadrant, 2 t along x and
/// 2 t + 1 along y: Lagrange's multipliers, and the soil that flowed.
///
/// All arrays have a frame of columns that are missing.
class FluxGrid {
 public:
  /// All columns are missing. @param limit largest drop between neighbours
  FluxGrid(int nx, int ny, float limit, float swell);

  int nx() const { return nx_; }
  int ny() const { return ny_; }
  /// Of the arrays, and places in them.
  std::size_t size() const { return base_.size(); }
  std::size_t at(int x, int y) const {
    return static_cast<std::size_t>((y + 1) * stride_ + kFrame + x);
  }
  /// Distances in the arrays to a quadrant's neighbours.
  std::ptrdiff_t along_x(int t) const { return t & 1 ? -1 : 1; }
  std::ptrdiff_t along_y(int t) const { return t & 2 ? -stride_ : stride_; }

  /// @param soil in it, of which `bank` swelled already: it is thinner by that, and lies below
  void set_column(std::size_t i, float base, float bank, float soil);
  bool missing(std::size_t i) const { return soil_[i] < kMissingSoil / 2; }
  /// To be called when all columns are set.
  void find_brinks();
  /// What flowed into a column and out of it, where each gave a share of what its fluxes say.
  struct Flow {
    double in, out;
  };
  Flow flow(std::size_t i, const std::vector<double>& share) const;

  /// Columns twice as wide, each with the mean of four; and their flux as a start for ours.
  FluxGrid coarser() const;
  void start_from(const FluxGrid& coarse);

  Unrest unrest() { return unrest(true); }

  /// Projected gradient steps on the fluxes with momentum (Beck and Teboulle 2009) that starts
  /// again where it leads uphill (O'Donoghue and Candes 2015), until at rest to a tolerance.
  /// @return steps
  int relax(int most, float tolerance);

 private:
  static constexpr int kFrame = 8;  // lanes, so that rows begin where vectors do
  // So that a missing column is higher than all others and never free to give.
  static constexpr float kMissingBase = 4e9f, kMissingSoil = -1e9f;

  using Array = std::vector<float>;
  float brink(std::size_t i, std::ptrdiff_t to) const;
  FluxRow row(int y);
  int count_bands() const;
  template <class F>
  void in_bands(const F& band) const;
  void settle_by(const Array* fluxes, bool all);
  Unrest unrest(bool all);
  void note_flows();
  double step(float momentum);

  int nx_, ny_, stride_;
  float limit_, swell_;
  Array base_, bank_, soil_;  // given
  Array top_, depth_;         // made of them and the fluxes
  Array flux_[8], ahead_[8];  // ahead: with momentum
  // To higher x, lower x, higher y, lower y: soil that a brink there holds back, what flows.
  Array brink_[4], out_[4];
  std::vector<std::uint8_t> flows_;  // by eight columns
  Array uphill_;                     // by rows, eight parts of each
};

}  // namespace soilvdb::inline v0
