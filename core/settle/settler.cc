// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/settle/settler.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <utility>

#include "core/constants.h"
#include "core/lattice/bytes.h"
#include "core/lattice/chunk_math.h"
#include "core/settle/whole_samples.h"

namespace soilvdb::inline v0 {
namespace {

/// All of them, in the order of a state.
constexpr std::int64_t SettleTotals::*kTotals[] = {
    &SettleTotals::pending, &SettleTotals::hauled,       &SettleTotals::lost_off_terrain,
    &SettleTotals::slid,    &SettleTotals::fill_samples, &SettleTotals::failed_samples};

}  // namespace

Settler::Settler(Ground& ground, const SoilProperties& properties, std::vector<Hopper> hoppers)
    : ground_(ground),
      properties_(properties),
      hoppers_(std::move(hoppers)),
      units_(properties),
      // Rounded, as C libraries differ in the last bits.
      slope_(static_cast<float>(std::tan(properties.repose_rad))),
      columns_(ground),
      flux_(slope_ + kRestSlopeMargin, 1 + properties.swell) {
  const SoilProperties& p = properties_;
  if (!p.cohesion_pa) return;
  const double friction_rad = p.friction_rad.value_or(p.repose_rad);
  const double friction = static_cast<float>(std::tan(friction_rad));
  const double cohesion = *p.cohesion_pa / (p.density_kg_m3 * kGravity * ground_.voxel_size_m());
  strength_ = BankStrength{cohesion, friction, 1 + p.swell};
  // What pulls it apart, by Mohr's circle: 2 c cos(phi) / (1 + sin(phi)).
  overhang_strength_ = {cohesion, 2 * cohesion / (3 * (friction + std::hypot(1, friction)))};
}

Settler::Settler(Ground& ground, const Settler& other)
    : ground_(ground),
      properties_(other.properties_),
      hoppers_(other.hoppers_),
      units_(other.units_),
      slope_(other.slope_),
      strength_(other.strength_),
      overhang_strength_(other.overhang_strength_),
      totals_(other.totals_),
      columns_(ground, other.columns_),
      changes_to_take_(other.changes_to_take_),
      flux_(slope_ + kRestSlopeMargin, 1 + properties_.swell) {}

/// To be called before columns are looked at.
void Settler::refresh() {
  for (const Coord2& tile : columns_.take_changes())
    if (columns_.reaches(tile)) changes_to_take_.add(tile);
}

void Settler::forget_changes() {
  columns_.take_changes();
  changes_to_take_.clear();
}

bool Settler::has_changes() {
  refresh();
  return !changes_to_take_.empty();
}

/// Makes window_ one of unread columns, each of which is read when it is asked for: of all that
/// soil might come to it comes to little.
void Settler::look_at(const Coord2& first, const Coord2& size) {
  refresh();
  window_.first = first;
  window_.walls.emplace(columns_, walls_, clearance_);
  Columns& to = window_.columns;
  to.nx = size.x();
  to.ny = size.y();
  to.side_m = 1;
  const auto n = static_cast<std::size_t>(to.nx * to.ny);
  to.height_m.resize(n);
  to.firm_m.resize(n);
  to.rigid.assign(n, Columns::kUnread);
  window_.full.resize(n);
  to.read = [this](int column) {
    const Coord2 cell =
        window_.first + Coord2(column / window_.columns.ny, column % window_.columns.ny);
    Coord2 low = cell, high = cell;
    low.y() = std::max(floor_to(cell.y(), kChunkSide), window_.first.y());
    high.y() = std::min(floor_to(cell.y(), kChunkSide) + kChunkSide,
                        window_.first.y() + window_.columns.ny) -
               1;
    read_columns({low, high});
  };
  // Heights are above that of the first column with ground.
  window_.zero = std::numeric_limits<double>::quiet_NaN();
  const Eigen::AlignedBox2i cells(first, first + size - Coord2::Ones());
  const Coord2 corner = floor_to(first, kChunkSide);
  for (int cx = corner.x(); cx <= cells.max().x(); cx += kChunkSide) {
    for (int cy = corner.y(); cy <= cells.max().y() && std::isnan(window_.zero); cy += kChunkSide) {
      const Coord2 tile(cx, cy);
      const Eigen::AlignedBox2i all(tile, tile + Coord2::Constant(kChunkSide - 1));
      columns_.each(all.intersection(cells), [&](const Coord2&, const GroundColumn& c) {
        if (c.known && std::isnan(window_.zero)) window_.zero = std::floor(c.bank);
      });
    }
  }
}

/// Reads columns of window_.
void Settler::read_columns(const Eigen::AlignedBox2i& cells) {
  Columns& to = window_.columns;
  columns_.each(cells, [&](const Coord2& cell, const GroundColumn& c) {
    const Coord2 in = cell - window_.first;
    const auto i = static_cast<std::size_t>(to.index(in.x(), in.y()));
    to.height_m[i] = c.known ? c.top - window_.zero : 0;
    to.firm_m[i] = c.known ? c.bank - window_.zero : 0;
    to.rigid[i] = !c.known || (*window_.walls)(cell);
    window_.full[i] = c.known ? c.full : 0;
  });
}

void Settler::take_changes(TileSet& may_slide) {
  refresh();
  changes_to_take_.each([&](const Coord2& tile) { may_slide.add(tile); });
  changes_to_take_.clear();
}

/// Takes samples of any soil out of columns, which are then pending.
void Settler::take_out(std::span<const ColumnEdit> changes) {
  const Taken taken = remove_top(ground_, changes, slope_);
  totals_.pending += taken.loose * units_.loose + taken.bank * units_.bank;
  totals_.failed_samples += taken.loose + taken.bank;
}

/// The same of loose soil alone, which slides. @return number of samples by column
std::vector<std::int64_t> Settler::let_slide(std::span<const ColumnEdit> changes) {
  const std::vector<std::int64_t> by_column = remove_loose(ground_, changes, slope_);
  const std::int64_t samples = std::accumulate(by_column.begin(), by_column.end(), std::int64_t{0});
  totals_.pending += samples * units_.loose;
  totals_.slid += samples * units_.loose;
  totals_.failed_samples += samples;
  return by_column;
}

/// Makes what is pending samples of columns, as many as find room.
void Settler::put_in(std::span<const ColumnEdit> changes) {
  const std::int64_t added = add_samples(ground_, changes, slope_);
  totals_.pending -= added * units_.loose;
  totals_.fill_samples += added;
}

double Settler::mean_height(const Line& line_m, const Vec2& ahead,
                            const std::array<double, 2>& low_m,
                            const std::array<double, 2>& high_m) {
  refresh();
  const double h = ground_.voxel_size_m();
  const int steps = std::max(1, static_cast<int>(std::ceil((line_m[1] - line_m[0]).norm() / h)));
  double sum = 0;
  for (int i = 0; i < steps; ++i) {
    const double share = (i + 0.5) / steps;
    const auto between = [&](const auto& ends) { return ends[0] + share * (ends[1] - ends[0]); };
    const double low = between(low_m), high = between(high_m);
    const auto height_m = [&](const Coord2& cell) {
      const GroundColumn& column = columns_.column(cell);
      return column.known ? std::clamp(ground_.origin().z() + h * column.top, low, high) : low;
    };
    const Vec3 at = ground_.index_from_world(line_m[0] + share * (line_m[1] - line_m[0]));
    for (int k = 0; k < kColumnsBefore; ++k) {
      // Between columns that the line does not cut, so that no step comes with each column.
      const Vec2 place = at.head<2>() + (k + kFirstBefore) * ahead, corner = place.array().floor();
      const Vec2 in = place - corner;
      for (const int x : {0, 1})
        for (const int y : {0, 1})
          sum += (x == 1 ? in.x() : 1 - in.x()) * (y == 1 ? in.y() : 1 - in.y()) *
                 height_m(corner.cast<int>() + Coord2(x, y));
    }
  }
  return sum / (steps * kColumnsBefore);
}

Eigen::AlignedBox3i Settler::cells_of(const Eigen::AlignedBox3d& box_m) const {
  return {ground_.index_from_world(box_m.min()).unaryExpr(&cell_of),
          ground_.index_from_world(box_m.max()).unaryExpr(&cell_of)};
}

bool Settler::fail(Eigen::AlignedBox3d& around_m) {
  if (around_m.isEmpty() || !strength_) return true;
  const Eigen::AlignedBox3i around = cells_of(around_m);
  Eigen::AlignedBox2i changed(around.min().head<2>(), around.max().head<2>());
  if (fail_banks(changed)) return true;
  const double z = around.min().z();
  around_m.extend(ground_.world_from_index({changed.min().x() + 0.0, changed.min().y() + 0.0, z}));
  around_m.extend(ground_.world_from_index({changed.max().x() + 0.0, changed.max().y() + 0.0, z}));
  return false;
}

bool Settler::settle(Eigen::AlignedBox3d around_m, bool bank_fails, TileSet& may_slide) {
  for (int round = 0; round < kMaxRestRounds; ++round) {
    break_overhangs(around_m);
    bool stands = !bank_fails || fail(around_m);
    for (int failures = 1; !stands && failures < kMaxBankFailures; ++failures) {
      slide(may_slide, kMaxFluxSteps);
      stands = fail(around_m);
    }
    const std::int64_t moved = totals_.moved();
    fall_below_tools(may_slide);
    if (slide(may_slide, kMaxFluxSteps) && stands) return true;
    // What the solver can't bring to rest stays.
    if (stands && totals_.moved() == moved) return true;
  }
  return false;
}

void Settler::save(std::string& out) const {
  for (const auto total : kTotals) put(out, totals_.*total);
}

void Settler::restore(const SettleTotals& totals) {
  totals_ = totals;
  forget_changes();
}

SettleTotals& SettleTotals::operator+=(const SettleTotals& other) {
  for (const auto total : kTotals) this->*total += other.*total;
  return *this;
}

void SettleTotals::load(std::string_view& in, std::size_t settlers) {
  for (const auto total : kTotals)
    take_amount(in, this->*total, kMostAmount / static_cast<std::int64_t>(settlers));
}

}  // namespace soilvdb::inline v0
