// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Bank soil that becomes loose where it stands or hangs.
#include <algorithm>
#include <cmath>

#include "core/constants.h"
#include "core/lattice/chunk_math.h"
#include "core/settle/settler.h"
#include "core/settle/whole_samples.h"

namespace soilvdb::inline v0 {

/// Makes what is in columns loose: it is taken out, and put back where it falls to.
void Settler::loosen(Loosening& loosening) {
  take_out(loosening.from);
  double whole = 0;
  for (const double weight : loosening.weights) whole += weight;
  WholeSamples share(static_cast<double>(totals_.pending / units_.loose) / whole);
  for (std::size_t i = 0; i < loosening.to.size(); ++i)
    loosening.to[i].samples = share.next(loosening.weights[i]);
  put_in(loosening.to);
}

/// Does a tool stand in the ground below a piece of soil, which then lies on that?
bool Settler::lies_on_tool(const Coord2& cell, double ground) const {
  return std::any_of(walls_.begin(), walls_.end(), [&](const Obstacle* tool) {
    return tool->blocks(cell.x(), cell.y(), ground, 0);
  });
}

/// What hangs on nothing falls straight down, and so do overhangs that are too long.
void Settler::break_overhangs(const Eigen::AlignedBox3d& around_m) {
  if (around_m.isEmpty()) return;
  const Eigen::AlignedBox3i around = cells_of(around_m);
  for (int margin = kLedgeMargin, depth = kLedgeDepth;;) {
    refresh();
    Eigen::AlignedBox3i box(around.min() - Coord3(margin, margin, depth),
                            around.max() + Coord3(margin, margin, kLedgeHeadroom));
    columns_.each({Coord2(box.min().head<2>()), Coord2(box.max().head<2>())},
                  [&](const Coord2&, const GroundColumn& c) {
                    if (!c.known) return;
                    box.max().z() = std::max(box.max().z(), cell_of(c.top) + kLedgeHeadroom);
                  });
    BoundaryContact contact;
    Loosening falls;
    for (const UnsupportedPiece& piece :
         find_overhangs(ground_, box, strength_ ? &overhang_strength_ : nullptr, contact)) {
      const auto holds = [&](const Obstacle* tool) {
        return tool->blocks(piece.cell.x(), piece.cell.y(), piece.high, kObstacleClearance);
      };
      if (std::any_of(walls_.begin(), walls_.end(), holds)) continue;
      falls.from.push_back(ColumnEdit::all(piece.cell, piece.low, piece.high));
      falls.to.push_back(
          {.cell = piece.cell, .low = piece.ground, .high = piece.high + kFillCells});
      falls.weights.push_back(static_cast<double>(piece.bank * units_.bank) /
                                  static_cast<double>(units_.loose) +
                              static_cast<double>(piece.loose));
    }
    if (!falls.from.empty()) {
      loosen(falls);
    } else if (contact.holds && box.sizes().head<2>().maxCoeff() < kMaxWindowCells - 1) {
      margin *= 2;
    } else if (contact.ground && depth < kMaxWindowCells) {
      depth *= kLedgeDepthFactor;
    } else {
      return;
    }
  }
}

/// Lets cuts in and around columns of cells fail, each once. @param changed grows by what fails
/// @return whether all stood
bool Settler::fail_banks(Eigen::AlignedBox2i& changed) {
  int axis;
  if (changed.sizes().maxCoeff(&axis) > kMaxWindowCells / 2) {
    Eigen::AlignedBox2i low = changed, high = changed;
    low.max()[axis] = changed.center()[axis];
    high.min()[axis] = low.max()[axis] + 1;
    const bool low_stood = fail_banks(low), high_stood = fail_banks(high);
    changed.extend(low).extend(high);
    return low_stood && high_stood;
  }
  for (int margin = kWindowMargin;; margin *= 2) {
    const Coord2 wide = Coord2::Constant(margin);
    const Coord2 first = floor_to(changed.min() - wide, kChunkSide);
    const Coord2 end = floor_to(changed.max() + wide, kChunkSide) + Coord2::Constant(kChunkSide);
    const Coord2 size = end - first;
    look_at(first, size);
    read_columns({first, first + size - Coord2::Ones()});
    if (const auto failed = fail_bank(changed, size.maxCoeff() >= kMaxWindowCells)) return !*failed;
  }
}

/// Height of a column of cells before anything was dug. Of one that a cliff's edge goes through
/// that at the cliff's foot: what is cut off the edge is no depth that was dug there.
double Settler::height_before(const Coord2& cell) {
  const double here = columns_.base().height(cell);
  double before = here;
  for (int x = -1; x <= 1; ++x) {
    for (int y = -1; y <= 1; ++y) {
      const double beside = columns_.base().height(cell + Coord2(x, y));
      if (here - beside > kMaxPartialCells) before = std::min(before, beside);
    }
  }
  return before;
}

/// Makes bank loose in window_ that stands too high for its cohesion. @param feet columns of cells
/// at which something changed; grows by what fails
/// @return whether some failed; nothing if the window is too small to know
std::optional<bool> Settler::fail_bank(Eigen::AlignedBox2i& feet, bool last) {
  const Columns& ground = window_.columns;
  const Eigen::AlignedBox2i all(Coord2::Zero(), Coord2(ground.nx - 1, ground.ny - 1));
  const Eigen::AlignedBox2i inside(feet.min() - window_.first, feet.max() - window_.first);
  const WallFailure failure =
      find_wedge_failure(ground, inside.intersection(all), *strength_, [&](int x, int y) {
        const Coord2 cell = window_.first + Coord2(x, y);
        const GroundColumn& c = columns_.column(cell);
        // Where a column is partly of one height and partly of another its mean is no ground.
        if (c.bank - c.bank_full > kMaxPartialCells) return 0.0;
        const double depth = height_before(cell) - c.bank;
        return depth > kMinDugDepth ? depth : 0;
      });
  if (failure.at_border && !last) return std::nullopt;
  if (failure.failed.isEmpty()) return false;
  Loosening wedge;
  for (int x = failure.failed.min().x(); x <= failure.failed.max().x(); ++x) {
    for (int y = failure.failed.min().y(); y <= failure.failed.max().y(); ++y) {
      const WallFailure::Column& found =
          failure.columns[static_cast<std::size_t>(ground.index(x, y))];
      const Coord2 cell = window_.first + Coord2(x, y);
      const GroundColumn& c = columns_.column(cell);
      const double left = window_.zero + found.height;
      const auto samples = static_cast<std::int64_t>(std::llround(64 * (c.top - left)));
      if (found.height >= ground.firm_at(ground.index(x, y)) || samples == 0) continue;
      const double rise = (c.bank - left) * (1 + properties_.swell) + c.top - c.bank;
      const int low = cell_of(left) - kFillCells;
      // Where a cut went through the column, what is left of it stands far above its mean.
      wedge.from.push_back({.cell = cell,
                            .low = low,
                            .high = cell_of(c.surface),
                            .samples = samples,
                            .a = static_cast<float>(found.slope.x()),
                            .b = static_cast<float>(found.slope.y())});
      wedge.to.push_back({.cell = cell, .low = low, .high = cell_of(left + rise) + kFillCells});
      wedge.weights.push_back(64 * rise);
      feet.extend(cell);
    }
  }
  if (wedge.from.empty()) return false;
  loosen(wedge);
  return true;
}

}  // namespace soilvdb::inline v0
