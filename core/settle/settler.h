// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Soil that falls, piles up and slides on a site's ground, and the books of it.
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
/// Guarantees: mass is neither made nor lost: what doesn't make a whole sample is in flight and
/// comes down with what falls next; what finds no ground is booked as lost off the terrain. The
/// same bits for any number of threads. Calls cost what they move and what is near it, whatever the
/// site's size.
class Settler {
 public:
  /// What became of soil besides the ground and the buckets, in units of mass, but for samples.
  struct SettleTotals {
    std::int64_t pending = 0;
    std::int64_t hauled = 0;            ///< into hoppers
    std::int64_t lost_off_terrain = 0;  ///< fell where the terrain has no ground
    std::int64_t slid = 0;              ///< moved because it stood too steep
    std::int64_t fill_samples = 0;      ///< added to the ground, that which slid among them
    std::int64_t failed_samples = 0;    ///< that slopes lost, in place

    /// Changes whenever soil moves.
    std::int64_t moved() const { return fill_samples + failed_samples; }

    /// @throw std::invalid_argument if the bytes are not what Settler::save() wrote
    void load(std::string_view& in);
  };

  /// @param ground outlives it
  Settler(Ground& ground, const SoilProperties& properties, std::vector<Hopper> hoppers);
  /// The same on a clone of the other's soil.
  Settler(Ground& ground, const Settler& other);

  const SoilProperties& properties() const { return properties_; }
  const MassUnits& units() const { return units_; }
  double slope() const { return slope_; }  ///< tangent of the angle of repose
  const SettleTotals& totals() const { return totals_; }

  /// Soil falls straight down: into a hopper, else onto the ground, which it makes a pile on. Where
  /// an obstacle or no ground is below, beside that.
  void drop(const Vec3& from_m, std::int64_t mass, double time_s, const Obstacle& obstacle);
  /// Soil in and around a box comes to rest: overhangs break off, cuts that are too high for the
  /// bank's cohesion fail, and loose soil that stands too steep slides.
  /// @param bank_fails false: cuts stay as they are for now, however high
  /// @return false if some of it isn't at rest yet: it is to be called again
  bool settle(const Eigen::AlignedBox3d& around_m, const Obstacle& obstacle, bool bank_fails);

  void save(std::string& out) const;
  void restore(const SettleTotals& totals) { totals_ = totals; }

 private:
  /// Columns of soil that become loose.
  struct Loosening {
    std::vector<ColumnEdit> from, to;
    std::vector<double> weights;  ///< samples that come of it, about
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
  std::optional<BankStrength> strength_;  // where bank can fail
  OverhangStrength overhang_strength_;    // then
  SettleTotals totals_;
  BaseColumns base_;
  Pourer pourer_;
};

}  // namespace soilvdb::inline v0
