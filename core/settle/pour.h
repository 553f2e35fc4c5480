// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Loose soil that falls at a point and comes to rest.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "core/settle/columns.h"

namespace soilvdb::inline v0 {

/// A column that a cone raised. In it the cone's surface falls with the distance from `from_m`:
/// ways go round corners and through gaps.
struct RaisedColumn {
  int column;
  double before_m, after_m;
  Vec2 from_m;  ///< the last corner on the way from the apex, or the apex
};

/// Soil that came to rest around one point.
struct Cone {
  double volume_m3;
  std::vector<RaisedColumn> columns;  ///< each once; those nearest to the apex first, mostly
};

/// The cones of a pour: first where it fell, then where soil ran on to. They may overlap.
struct Deposit {
  std::vector<Cone> cones;
  double left_m3 = 0;  ///< without a place: all if the source is on no open column
  /// Where the rest reaches the columns' border on its way down, to run on beyond.
  std::optional<Vec2> exit_m;
};

/// Pours soil. It keeps its memory between pours. The cost of a pour depends on the columns that it
/// raises or that lie under its pile.
///
/// Soil piles up around the source to the lowest surface nowhere steeper than `slope`: max(ground,
/// level - slope * distance), with distances in plan around higher ground. Where that surface comes
/// to a drop, all further soil runs over it, down the fall line, and piles up where it comes to
/// rest, until both piles are one. Ground that no soil reaches stays, however steep.
///
/// Guarantees: the raised volume is the poured one, to rounding. No column is lowered. Pouring in
/// parts at one point gives the same ground as at once (to 1e-2 of a side rms). The same bits on
/// any CPU. Caveats: no inertia, no segregation. Steps of less than about one side count as slopes.
/// Pours in parts before a step need the columns' `firm_m`. On rough ground steeper than `slope`,
/// where a pile meets several ways down, parts may lie elsewhere, and more soil may leave single
/// columns lower.
///
///     Pourer pourer;
///     Columns ground(100, 100, 0.05);
///     pourer.pour(ground, {2.5, 2.5}, 1.0, std::tan(0.61));
class Pourer {
 public:
  Pourer();
  ~Pourer();
  Pourer(Pourer&&) noexcept;
  Pourer& operator=(Pourer&&) noexcept;

  /// @param source metres from the columns' corner
  /// @param slope tangent of the angle of repose, > 0
  /// @param along if not 0: soil falls evenly on a line from `source`, on which it rests, and makes
  /// a ridge with a level top
  /// @param leaves soil that runs down to the columns' border stays in left_m3, to run on
  Deposit pour(Columns& ground, const Vec2& source, double volume_m3, double slope,
               bool leaves = false, const Vec2& along = Vec2::Zero());
  /// Where soil that falls at a place comes to, down ground that is too steep for it.
  struct Foot {
    Vec2 at_m;
    bool at_border = false;  ///< of the columns: it may run on beyond
  };
  Foot foot(const Columns& ground, const Vec2& source, double slope);
  /// May soil lie along a line as it falls? Not where the ground under it is steeper than repose,
  /// or where some of its columns are not open.
  enum class Line { kRests, kTooSteep, kBlocked };
  static Line look_at_line(const Columns& ground, const Vec2& source, const Vec2& along,
                           double slope);

 private:
  struct Work;
  std::unique_ptr<Work> work_;
};

}  // namespace soilvdb::inline v0
