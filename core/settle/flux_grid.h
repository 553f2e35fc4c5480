// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Soil that flows between columns until nothing is steeper than it may be.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "core/settle/flux_row.h"
#include "soilvdb/types.h"

namespace soilvdb::inline v0 {

/// 8 x 8 columns before soil flows, heights in sides, column (x, y) as entry y * 8 + x. From below:
/// ground that stands at any slope up to `base`, then bank soil and loose soil, as loose volume in
/// `soil`. Bank soil fills less room than it has as loose soil.
struct FluxTile {
  static constexpr double kMissing = -1e9;  ///< as `soil`: gives and takes nothing, like a wall

  std::array<double, 64> base, bank, soil;

  void set(std::size_t column, double base_height, double bank_soil, double all_soil) {
    base[column] = base_height;
    bank[column] = bank_soil;
    soil[column] = all_soil;
  }
  void set_missing(std::size_t column) { set(column, kMissingBase, 0, kMissing); }

 private:
  // So that a missing column is higher than all others and never free to give.
  static constexpr double kMissingBase = 4e9;
};

/// Columns, and the soil that flowed between them. Heights and drops are in sides of the columns.
///
/// A column has four quadrants, each with one neighbour along x and one along y: the lower x if
/// t & 1, the lower y if t & 2. Its drops to both, where positive, may come to `limit` together
/// (root of the sum of squares). What keeps it so are two fluxes >= 0 per quadrant, 2 t along x and
/// 2 t + 1 along y: Lagrange's multipliers, and the soil that flowed.
///
/// The plane is in tiles of 8 x 8 columns. Soil leaves active tiles only. A tile becomes active
/// when it gets soil. Tiles are loaded when a tile beside them becomes active, so the cost goes
/// with the ground that soil flows over.
class FluxGrid {
 public:
  /// Fills a tile. @param tile column (0, 0) of it, over 8
  using Load = std::function<void(const Coord2& tile, FluxTile& columns)>;

  /// @param slope largest between neighbours @param swell loose volume over bank volume
  FluxGrid(double slope, double swell);

  /// Forgets all tiles and keeps the memory.
  void begin(Load load);
  /// Lets soil leave a tile.
  void activate(const Coord2& tile);

  /// Lets soil flow if some is steeper by more than kCollapseStartRad, until all is at rest to
  /// kRestToleranceRad: projected gradient steps on the fluxes with momentum (Beck and Teboulle
  /// 2009) that starts again where it leads uphill (O'Donoghue and Candes 2015).
  /// @return steps; 0: nothing was too steep
  int relax(int most);

  /// A column whose soil changed.
  struct Change {
    Coord2 column;
    double before, after;  ///< soil
  };
  /// No column has less than nothing, and their sum is 0 to rounding.
  std::vector<Change> changes();

  /// Of loaded columns, after relax(). Columns that aren't loaded are missing.
  double top(const Coord2& column) const { return double{arrays_[kTop][at(column)]}; }
  bool missing(const Coord2& column) const { return missing(at(column)); }

 private:
  enum Array {
    kBase,
    kBank,
    kSoil,
    kTop,
    kDepth,
    kFlux,
    kAhead = kFlux + 8,
    kBrink = kAhead + 8,
    kOut = kBrink + 4,
    kArrays = kOut + 4
  };
  enum TileState : std::uint8_t { kUnknown, kLoaded, kActive };

  std::size_t at(const Coord2& column) const {
    return static_cast<std::size_t>((column.y() - kTileSide * first_.y() + 1) * stride_ +
                                    kTileSide + column.x() - kTileSide * first_.x());
  }
  std::size_t number(const Coord2& tile) const {
    return static_cast<std::size_t>((tile.y() - first_.y()) * size_.x() + tile.x() - first_.x());
  }
  bool missing(std::size_t i) const { return arrays_[kSoil][i] < FluxTile::kMissing / 2; }
  void make_room(const Coord2& tile);
  void load(const Coord2& tile);
  bool is_gentle(const Coord2& tile) const;
  float brink(std::size_t i, std::ptrdiff_t to) const;
  void activate_reached();
  void find_rows();
  void settle_by(Array fluxes);
  Unrest unrest();
  double step(float momentum);
  static float value_of_nothing(int array);
  using Flows = std::array<double, 4>;  ///< out, in the order of FluxRow::out
  Flows flows_out(std::size_t i) const;
  struct Balance {
    double in, had, out;
  };
  Balance balance(std::size_t i) const;
  void share_out(std::vector<std::size_t> columns);
  bool is_still(std::size_t first) const;

  static constexpr int kTileSide = 8;  // lanes, so that rows begin where vectors do

  float limit_, swell_;
  float start_, tolerance_;  // how much steeper than the limit
  Load load_;
  Coord2 first_{0, 0}, size_{0, 0};  // of the tiles that there is room for
  std::ptrdiff_t stride_ = 0;
  std::vector<TileState> tiles_;
  std::vector<Coord2> loaded_, active_;  // active ones are loaded, too
  std::array<std::vector<float>, kArrays> arrays_;
  std::vector<double> given_, share_;                // soil; share of its flux that a column gives
  std::vector<Flows> flows_out_;                     // in changes(), of columns that aren't still
  std::vector<std::uint8_t> flows_, awake_, moved_;  // by eight columns
  std::vector<FluxRow> active_rows_, rows_;          // with active tiles; and with those beside
  std::vector<float> uphill_;                        // by rows, eight parts of each
};

}  // namespace soilvdb::inline v0
