// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Soil that falls, piles up and slides on a site's ground, with its mass.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/ground/ground_columns.h"
#include "core/settle/column_samples.h"
#include "core/settle/flux_grid.h"
#include "core/settle/obstacle.h"
#include "core/settle/overhangs.h"
#include "core/settle/pour.h"
#include "core/settle/tile_set.h"
#include "core/settle/wall_failure.h"
#include "soilvdb/earthmoving.h"
#include "soilvdb/ground.h"
#include "soilvdb/mass.h"

namespace soilvdb::inline v0 {

/// Soil outside the ground and the buckets, in units of mass, except samples.
struct SettleTotals {
  std::int64_t pending = 0;
  std::int64_t hauled = 0;            ///< into hoppers
  std::int64_t lost_off_terrain = 0;  ///< fell where the terrain has no ground
  std::int64_t slid = 0;              ///< moved because it stood too steep
  std::int64_t fill_samples = 0;      ///< added to the ground, slid soil included
  std::int64_t failed_samples = 0;    ///< lost by failed slopes, in place

  /// Changes each time soil moves.
  std::int64_t moved() const { return fill_samples + failed_samples; }

  /// @param settlers number of which the sum must be a number, too
  /// @throw std::invalid_argument if the bytes are not from Settler::save()
  void load(std::string_view& in, std::size_t settlers);
  SettleTotals& operator+=(const SettleTotals& other);
};

/// Puts loose soil where it comes to rest.
///
/// Guarantees: mass is exact. A rest of less than a sample stays pending and falls with the next
/// soil. Soil without ground below is booked as lost off the terrain. The same bits for any number
/// of threads. The cost of a call depends on the moved soil and the ground near it, not on the
/// site. Each machine has its own, so that machines that are apart move soil at once.
class Settler {
 public:
  /// @param ground must outlive it
  Settler(Ground& ground, const SoilProperties& properties, std::vector<Hopper> hoppers);
  /// A copy without walls, on the other's ground or a clone of it.
  Settler(Ground& ground, const Settler& other);

  const SoilProperties& properties() const { return properties_; }
  const MassUnits& units() const { return units_; }
  double slope() const { return slope_; }  ///< tangent of the angle of repose
  const SettleTotals& totals() const { return totals_; }

  /// Tools that stand in the ground are walls to soil.
  void set_walls(std::vector<const Obstacle*> walls) { walls_ = std::move(walls); }
  /// Until the next call it looks at and changes no columns but these, whole tiles, and throws
  /// OutOfReach where soil would move farther. Other threads may then change the ground elsewhere.
  /// @param cells empty: all
  void confine(const Eigen::AlignedBox2i& cells) { columns_.confine(cells); }
  /// What changed was the work of others: nothing may slide here because of it.
  void forget_changes();
  bool has_changes();

  using Line = std::array<Vec3, 2>;  ///< its ends, which may be one point

  /// Soil falls straight down, evenly along a line, into a hopper or onto the ground, where it
  /// makes a pile. If a tool or no ground is below, it falls beside that, to the side that `ahead`
  /// looks to if it isn't 0.
  /// @param clearance cells above the ground up to which tools block it
  void drop(const Line& from_m, const Vec2& ahead, std::int64_t mass, double time_s,
            float clearance = kObstacleClearance);
  /// The clearance for soil of another source: what half a cone of it rises against a tool.
  float clearance(std::int64_t mass) const;
  /// How far from a place, in plan, the pile there may grow by soil that rises so many cells.
  double reach_m(const Vec3& at_m, float clearance);
  /// Mean height of the ground before a line, world, between heights for its ends: lower ground
  /// counts as `low_m`, higher as `high_m`. @param ahead of unit length
  double mean_height(const Line& line_m, const Vec2& ahead, const std::array<double, 2>& low_m,
                     const std::array<double, 2>& high_m);
  /// Overhangs in and around a box break off.
  void break_overhangs(const Eigen::AlignedBox3d& around_m);
  /// Each cut in and around a box fails once that is too high for the bank's cohesion; what fails
  /// should slide before the next call. @param around_m grows by it @return whether all stood
  bool fail(Eigen::AlignedBox3d& around_m);
  /// Loose soil that is too steep slides, for some steps of the solver: in and around tiles, which
  /// then are those where some may still be too steep. @return whether all is at rest
  bool slide(TileSet& may_slide, int steps);
  /// These in turn until all is at rest. @return whether it is
  bool settle(Eigen::AlignedBox3d around_m, bool bank_fails, TileSet& may_slide);
  /// Adds the tiles in which the ground changed since the last call, or since forget_changes().
  void take_changes(TileSet& may_slide);

  void save(std::string& out) const;
  /// Goes on with a state. Nothing may slide because of what changed before then.
  void restore(const SettleTotals& totals);

 private:
  /// Columns of soil that become loose.
  struct Loosening {
    std::vector<ColumnEdit> from, to;
    std::vector<double> weights;  ///< approximate number of its samples
  };

  /// Columns over a rectangle of cells.
  struct Window {
    Coord2 first;  ///< cell of column (0, 0)
    double zero;   ///< heights are above this, index space
    Columns columns;
    std::vector<int> full;  ///< by column: all cells are full up to this one
    std::optional<BlockedColumns> walls;
  };

  void refresh();
  void look_at(const Coord2& first, const Coord2& size);
  void read_columns(const Eigen::AlignedBox2i& cells);
  BlockedColumns blocked() { return {columns_, walls_}; }
  void take_out(std::span<const ColumnEdit> changes);
  std::vector<std::int64_t> let_slide(std::span<const ColumnEdit> changes);
  void put_in(std::span<const ColumnEdit> changes);
  void lose_off_terrain(double samples);
  int heap_radius(const Vec2& at);
  void pour_line(const Line& from_m, Vec2 ahead, std::int64_t mass);
  bool pour_pending(Vec2 at, Vec2 along, const Vec2& ahead);
  void run_down(Vec2& at, int radius);
  enum class Poured { kLies, kRunsDown, kRunsOn, kNeedsRoom, kNowhere };
  Poured pour_in_window(Vec2& at, const Vec2& along, const Vec2& ahead, int half, bool has_run,
                        bool may_run_on);
  void apply_deposit(const Deposit& deposit, std::int64_t samples);
  Eigen::AlignedBox3i cells_of(const Eigen::AlignedBox3d& box_m) const;
  bool fail_banks(Eigen::AlignedBox2i& changed);
  double height_before(const Coord2& cell);
  std::optional<bool> fail_bank(Eigen::AlignedBox2i& feet, bool last);
  void loosen(Loosening& loosening);
  bool lies_on_tool(const Coord2& cell, double ground) const;
  void fall_below_tools(TileSet& may_slide);
  using Holds = std::function<bool(const Coord2&, const GroundColumn&)>;
  bool fall(const TileSet& tiles, const Holds& holds);
  TileSet steep_tiles(const TileSet& changed, BlockedColumns& blocked);
  bool slide_from(std::span<const Coord2> tiles, BlockedColumns& blocked, int steps);
  bool apply_slide(double zero);

  Ground& ground_;
  SoilProperties properties_;
  std::vector<Hopper> hoppers_;
  MassUnits units_;
  double slope_;
  std::optional<BankStrength> strength_;  // empty: bank cannot fail
  OverhangStrength overhang_strength_;    // used with strength_
  SettleTotals totals_;
  GroundColumns columns_;
  TileSet changes_to_take_;               // tiles in which the ground changed
  std::vector<const Obstacle*> walls_;    // of machines
  float clearance_ = kObstacleClearance;  // of what drops now
  Window window_;                         // the last one; keeps its memory
  Pourer pourer_;
  FluxGrid flux_;
};

}  // namespace soilvdb::inline v0
