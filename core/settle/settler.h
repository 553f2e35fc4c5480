// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Soil that falls, piles up and slides on a site's ground, with its mass.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/settle/base_columns.h"
#include "core/settle/collapse.h"
#include "core/settle/column_samples.h"
#include "core/settle/obstacle.h"
#include "core/settle/overhangs.h"
#include "core/settle/pour.h"
#include "core/settle/wall_failure.h"
#include "soilvdb/earthmoving.h"
#include "soilvdb/ground.h"
#include "soilvdb/mass.h"

namespace soilvdb::inline v0 {

/// Puts loose soil where it comes to rest.
///
/// Guarantees: mass is exact. A rest of less than a sample stays pending and falls with the next
/// soil. Soil without ground below is booked as lost off the terrain. The same bits for any number
/// of threads. The cost of a call depends on the moved soil and the ground near it, not on the
/// site.
class Settler {
 public:
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

    /// @throw std::invalid_argument if the bytes are not from Settler::save()
    void load(std::string_view& in);
  };

  /// @param ground must outlive it
  Settler(Ground& ground, const SoilProperties& properties, std::vector<Hopper> hoppers);
  /// A copy on a clone of the other's ground.
  Settler(Ground& ground, const Settler& other);

  const SoilProperties& properties() const { return properties_; }
  const MassUnits& units() const { return units_; }
  double slope() const { return slope_; }  ///< tangent of the angle of repose
  const SettleTotals& totals() const { return totals_; }

  /// Soil falls straight down, into a hopper or onto the ground, where it makes a pile. If an
  /// obstacle or no ground is below, it falls beside that.
  void drop(const Vec3& from_m, std::int64_t mass, double time_s, const Obstacle& obstacle);
  /// Brings soil in and around a box to rest: overhangs break off, cuts that are too high for the
  /// bank's cohesion fail, and loose soil that is too steep slides.
  /// @param bank_fails false: cuts of any height stay for now
  /// @return false if some soil is not at rest yet; call it again then
  bool settle(const Eigen::AlignedBox3d& around_m, const Obstacle& obstacle, bool bank_fails);

  void save(std::string& out) const;
  void restore(const SettleTotals& totals) { totals_ = totals; }

 private:
  /// Columns of soil that become loose.
  struct Loosening {
    std::vector<ColumnEdit> from, to;
    std::vector<double> weights;  ///< approximate number of its samples
  };

  void lose_off_terrain(double samples);
  int heap_radius(const Vec2& at);
  bool pour(Vec2& at, int half, bool may_run_on, const Obstacle& obstacle);
  std::int64_t raise(const Deposit& deposit, const GroundWindow& window, double zero,
                     std::int64_t samples);
  bool fall(const GroundWindow& window, const Obstacle& obstacle);
  void break_overhangs(const Eigen::AlignedBox3i& around, const Obstacle& obstacle);
  std::optional<bool> fail(const GroundWindow& window, Eigen::AlignedBox2i& feet,
                           const Obstacle& obstacle, bool last);
  void loosen(Loosening& loosening);
  bool settle_columns(Eigen::AlignedBox2i changed, const Obstacle& obstacle, bool bank_fails);
  bool slide(const GroundWindow& window, const Obstacle& obstacle, bool last,
             Eigen::AlignedBox2i& beyond);
  Eigen::AlignedBox2i move(const GroundWindow& window, const Coord2& corner,
                           const SoilColumns& before, const Collapse& after);

  Ground& ground_;
  SoilProperties properties_;
  std::vector<Hopper> hoppers_;
  MassUnits units_;
  double slope_;
  std::optional<BankStrength> strength_;  // empty: bank cannot fail
  OverhangStrength overhang_strength_;    // used with strength_
  SettleTotals totals_;
  BaseColumns base_;
  Pourer pourer_;
};

}  // namespace soilvdb::inline v0
