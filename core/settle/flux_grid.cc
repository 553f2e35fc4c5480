// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/settle/flux_grid.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "core/constants.h"
#include "core/settle/brink.h"

namespace soilvdb::inline v0 {

namespace {

// Angles by + - * / and sqrt alone, whose bits are the same on any build and CPU: continued
// fractions, to 1e-9 up to 1 rad.
double tangent(double rad) {
  const double a2 = rad * rad;
  return rad / (1 - a2 / (3 - a2 / (5 - a2 / (7 - a2 / 9))));
}

/// Slope beyond another that is steeper by an angle.
float slope_beyond(double slope, double rad) {
  const double t = tangent(rad), rest = 1 - slope * t;
  return rest <= 0 ? std::numeric_limits<float>::max()
                   : static_cast<float>(t * (1 + slope * slope) / rest);
}

/// What arrays hold where no tile is loaded.
struct Nothing {
  FluxTile tile;
  Nothing() { tile.set_missing(0); }
  float base() const { return static_cast<float>(tile.base[0]); }
  float soil() const { return static_cast<float>(tile.soil[0]); }
};

}  // namespace

float FluxGrid::value_of_nothing(int array) {
  const Nothing none;
  if (array == kBase) return none.base();
  if (array == kTop) return none.base() + none.soil();
  return array == kSoil || array == kDepth ? none.soil() : 0;
}

FluxGrid::FluxGrid(double slope, double swell)
    : limit_(static_cast<float>(slope)),
      swell_(static_cast<float>(swell)),
      start_(slope_beyond(slope, kCollapseStartRad)),
      tolerance_(slope_beyond(slope, kRestToleranceRad)) {}

void FluxGrid::begin(Load load) {
  load_ = std::move(load);
  for (const Coord2& tile : loaded_) {
    tiles_[number(tile)] = kUnknown;
    for (int y = 0; y < kTileSide; ++y) {
      const auto i = static_cast<std::ptrdiff_t>(at(kTileSide * tile + Coord2(0, y)));
      for (int a = 0; a < kArrays; ++a)
        std::fill_n(arrays_[static_cast<std::size_t>(a)].begin() + i, kTileSide,
                    value_of_nothing(a));
      for (auto* flags : {&flows_, &awake_, &moved_})
        (*flags)[static_cast<std::size_t>(i / kTileSide)] = 0;
    }
  }
  loaded_.clear();
  active_.clear();
  active_rows_.clear();
}

/// Makes room for a tile and those around it.
void FluxGrid::make_room(const Coord2& tile) {
  if (loaded_.empty()) first_ = tile - size_ / 2;
  const Coord2 low = tile - Coord2::Ones(), high = tile + Coord2::Ones();
  const Coord2 end = first_ + size_;
  if (!tiles_.empty() && (low.array() >= first_.array()).all() &&
      (high.array() < end.array()).all())
    return;
  const Coord2 spare = Coord2::Constant(kSpareTiles);
  const Coord2 old_first = first_, old_size = size_;
  const std::ptrdiff_t old_stride = stride_;
  Coord2 new_first = low - spare, new_end = high + spare + Coord2::Ones();
  if (!tiles_.empty()) {
    new_first = (low.array() < first_.array()).select(new_first, first_);
    new_end = (high.array() >= end.array()).select(new_end, end);
  }
  first_ = new_first;
  size_ = new_end - new_first;
  stride_ = kTileSide * (size_.x() + 1);
  // A frame on all sides, and one more behind the last row.
  const auto count = static_cast<std::size_t>((kTileSide * size_.y() + 2) * stride_ + kTileSide);
  const auto enlarge = [&](auto& list, int lanes, auto value) {
    std::remove_reference_t<decltype(list)> larger(count / static_cast<std::size_t>(lanes), value);
    const std::ptrdiff_t columns = kTileSide * old_size.x() / lanes;
    for (int y = 0; y < kTileSide * old_size.y(); ++y) {
      const auto from = list.begin() + ((y + 1) * old_stride + kTileSide) / lanes;
      const std::size_t to =
          at(kTileSide * old_first + Coord2(0, y)) / static_cast<std::size_t>(lanes);
      std::copy(from, from + columns, larger.begin() + static_cast<std::ptrdiff_t>(to));
    }
    list.swap(larger);
  };
  for (int a = 0; a < kArrays; ++a)
    enlarge(arrays_[static_cast<std::size_t>(a)], 1, value_of_nothing(a));
  enlarge(given_, 1, 0.0);
  enlarge(share_, 1, 1.0);
  for (auto* flags : {&flows_, &awake_, &moved_}) enlarge(*flags, kTileSide, std::uint8_t{0});
  std::vector<TileState> tiles(static_cast<std::size_t>(size_.x() * size_.y()), kUnknown);
  std::swap(tiles, tiles_);
  for (int y = 0; y < old_size.y(); ++y)
    for (int x = 0; x < old_size.x(); ++x)
      tiles_[number(old_first + Coord2(x, y))] =
          tiles[static_cast<std::size_t>(y * old_size.x() + x)];
}

void FluxGrid::load(const Coord2& tile) {
  TileState& state = tiles_[number(tile)];
  if (state != kUnknown) return;
  state = kLoaded;
  loaded_.push_back(tile);
  FluxTile columns;
  load_(tile, columns);
  for (int c = 0; c < kTileSide * kTileSide; ++c) {
    const std::size_t i = at(kTileSide * tile + Coord2(c % kTileSide, c / kTileSide));
    const auto n = static_cast<std::size_t>(c);
    given_[i] = columns.soil[n];
    const auto base = static_cast<float>(columns.base[n]);
    const auto soil = static_cast<float>(columns.soil[n]);
    const auto bank = static_cast<float>(columns.bank[n]);
    arrays_[kBase][i] = base;
    arrays_[kBank][i] = bank;
    arrays_[kSoil][i] = soil;
    arrays_[kDepth][i] = soil - (1 - 1 / swell_) * std::min(soil, bank);
    arrays_[kTop][i] = base + arrays_[kDepth][i];
  }
}

void FluxGrid::activate(const Coord2& tile) {
  make_room(tile);
  if (tiles_[number(tile)] == kActive) return;
  for (const auto& [x, y] : {std::pair(0, 0), {-1, 0}, {1, 0}, {0, -1}, {0, 1}})
    load(tile + Coord2(x, y));
  tiles_[number(tile)] = kActive;
  active_.push_back(tile);
  const bool gentle = is_gentle(tile);
  for (int c = 0; c < kTileSide * kTileSide; ++c) {
    const std::size_t i = at(kTileSide * tile + Coord2(c % kTileSide, c / kTileSide));
    if (c % kTileSide == 0) awake_[i / kTileSide] = flows_[i / kTileSide] = 1;
    if (gentle || missing(i)) continue;
    const std::ptrdiff_t to[4] = {1, -1, stride_, -stride_};
    for (std::size_t n = 0; n < 4; ++n) arrays_[kBrink + n][i] = brink(i, to[n]);
  }
  active_rows_.clear();  // to be found anew
}

/// Is what stands nowhere steeper than repose, so that a tile has no brinks?
bool FluxGrid::is_gentle(const Coord2& tile) const {
  const std::vector<float>& base = arrays_[kBase];
  float most = 0;
  for (int y = 0; y < kTileSide; ++y) {
    for (int x = -2; x < kTileSide + 1; ++x) {
      const std::size_t i = at(kTileSide * tile + Coord2(x, y)),
                        j = at(kTileSide * tile + Coord2(y, x));
      most = std::max({most, std::abs(base[i] - base[i + 1]),
                       std::abs(base[j] - base[j + static_cast<std::size_t>(stride_)])});
    }
  }
  return most <= limit_;
}

float FluxGrid::brink(std::size_t i, std::ptrdiff_t to) const {
  const std::vector<float>& base = arrays_[kBase];
  const auto drop = [&](std::size_t a, std::size_t b) {
    return missing(a) || missing(b) ? 0.0f : base[a] - base[b];
  };
  const std::size_t next = i + static_cast<std::size_t>(to);
  if (missing(next)) return 0;
  return held_at_brink(drop(i - static_cast<std::size_t>(to), i), drop(i, next),
                       drop(next, next + static_cast<std::size_t>(to)), limit_);
}

/// Activates tiles that soil flowed into.
void FluxGrid::activate_reached() {
  std::vector<Coord2> reached;
  for (const Coord2& tile : active_) {
    constexpr int kTo[4][2] = {{1, 0}, {-1, 0}, {0, 1}, {0, -1}};
    for (std::size_t side = 0; side < 4; ++side) {
      const Coord2 to(kTo[side][0], kTo[side][1]), next = tile + to;
      if (tiles_[number(next)] == kActive) continue;
      for (int k = 0; k < kTileSide; ++k) {
        // The columns at that side.
        const Coord2 in(to.x() == 0 ? k : (to.x() + 1) / 2 * (kTileSide - 1),
                        to.y() == 0 ? k : (to.y() + 1) / 2 * (kTileSide - 1));
        if (!(arrays_[kOut + side][at(kTileSide * tile + in)] > kMinReach)) continue;
        reached.push_back(next);
        break;
      }
    }
  }
  for (const Coord2& tile : reached) activate(tile);
}

/// Rows of the active tiles, and of all columns that soil of them may come to.
void FluxGrid::find_rows() {
  if (!active_rows_.empty()) return;
  rows_.clear();
  const auto row = [&](int y, int low, int high) {  // of tiles
    FluxRow r;
    const std::size_t i = at({kTileSide * low, y});
    r.columns = kTileSide * (high - low + 1);
    r.stride = stride_;
    r.limit = limit_;
    r.swell = swell_;
    const auto from = [&](int array) { return &arrays_[static_cast<std::size_t>(array)][i]; };
    r.base = from(kBase);
    r.bank = from(kBank);
    r.soil = from(kSoil);
    r.top = from(kTop);
    r.depth = from(kDepth);
    for (int f = 0; f < 8; ++f) {
      r.flux[f] = from(kFlux + f);
      r.ahead[f] = from(kAhead + f);
    }
    for (int n = 0; n < 4; ++n) {
      r.brink[n] = from(kBrink + n);
      r.out[n] = from(kOut + n);
    }
    r.flows = &flows_[i / kTileSide];
    r.awake = &awake_[i / kTileSide];
    r.moved = &moved_[i / kTileSide];
    return r;
  };
  for (int y = 0; y < size_.y(); ++y) {
    int low = size_.x(), high = -1, wide_low = size_.x(), wide_high = -1;
    for (int x = 0; x < size_.x(); ++x) {
      const auto active = [&](int i, int j) {
        return i >= 0 && j >= 0 && i < size_.x() && j < size_.y() &&
               tiles_[static_cast<std::size_t>(j * size_.x() + i)] == kActive;
      };
      if (active(x, y)) {
        low = std::min(low, x);
        high = x;
      }
      if (active(x, y) || active(x - 1, y) || active(x + 1, y) || active(x, y - 1) ||
          active(x, y + 1)) {
        wide_low = std::min(wide_low, x);
        wide_high = x;
      }
    }
    for (int k = 0; k < kTileSide; ++k) {
      const int at_y = kTileSide * (first_.y() + y) + k;
      if (high >= 0) active_rows_.push_back(row(at_y, first_.x() + low, first_.x() + high));
      if (wide_high >= 0) rows_.push_back(row(at_y, first_.x() + wide_low, first_.x() + wide_high));
    }
  }
  uphill_.assign(active_rows_.size() * kTileSide, 0);
}

/// Heights after fluxes.
void FluxGrid::settle_by(Array fluxes) {
  for (const FluxRow& r : active_rows_) {
    for (int x = 0; x < r.columns; ++x) {
      if (r.flows[x / kTileSide] == 0) continue;
      const auto flux = [&](int f) { return (fluxes == kFlux ? r.flux[f] : r.ahead[f])[x]; };
      for (int d = 0; d < 2; ++d) {
        r.out[d][x] = flux(2 * d) + flux(2 * d + 4);
        r.out[2 + d][x] = flux(4 * d + 1) + flux(4 * d + 3);
      }
    }
  }
  for (const FluxRow& r : rows_) settle(r);
}

/// How far from rest active tiles are.
Unrest FluxGrid::unrest() {
  find_rows();
  settle_by(kFlux);
  Unrest most;
  for (const FluxRow& r : active_rows_) {
    const Unrest now = soilvdb::unrest(r);
    most.steep = std::max(most.steep, now.steep);
    most.flux = std::max(most.flux, now.flux);
    most.hollow = std::max(most.hollow, now.hollow);
  }
  return most;
}

double FluxGrid::step(float momentum) {
  for (std::size_t y = 0; y < active_rows_.size(); ++y)
    push(active_rows_[y], momentum, &uphill_[y * kTileSide]);
  for (const FluxRow& r : rows_) settle(r);
  double sum = 0;
  for (std::size_t y = 0; y < uphill_.size(); y += kTileSide) {
    double row = 0;
    for (std::size_t k = 0; k < kTileSide; ++k) row += double{uphill_[y + k]};
    sum += row;
  }
  return sum;
}

int FluxGrid::relax(int most) {
  if (unrest().steep <= start_) return 0;
  double lead = kFirstLead;
  for (int done = 1; done <= most; ++done) {
    const double next = (1 + std::sqrt(1 + 4 * lead * lead)) / 2;
    const double uphill = step(static_cast<float>((lead - 1) / next));
    lead = uphill > 0 ? 1 : next;
    if (done % kActivateSteps == 0) {
      activate_reached();
      find_rows();
    }
    if (done % kRestCheckSteps != 0 && done < most) continue;
    const Unrest now = unrest();
    if (done == most || (now.steep <= tolerance_ && now.flux <= kFluxTolerance * limit_ &&
                         now.hollow <= tolerance_))
      return done;
    settle_by(kAhead);
  }
  return 0;
}

/// What flows out of a column towards higher x, lower x, higher y, lower y.
FluxGrid::Flows FluxGrid::flows_out(std::size_t i) const {
  const auto pair = [&](std::size_t a, std::size_t b) {
    return double{arrays_[kFlux + a][i]} + double{arrays_[kFlux + b][i]};
  };
  return {pair(0, 4), pair(2, 6), pair(1, 3), pair(5, 7)};
}

/// What a column has with what flows into it, and what flows out of it, as if it gave all.
FluxGrid::Balance FluxGrid::balance(std::size_t i) const {
  const auto stride = static_cast<std::size_t>(stride_);
  const Flows& to = flows_out_[i];
  const double out = (to[0] + to[1]) + (to[2] + to[3]);
  const double in = (share_[i - 1] * flows_out_[i - 1][0] + share_[i + 1] * flows_out_[i + 1][1]) +
                    (share_[i - stride] * flows_out_[i - stride][2] +
                     share_[i + stride] * flows_out_[i + stride][3]);
  return {in, given_[i] + in, out};
}

/// Does nothing flow from or to eight columns of a row?
bool FluxGrid::is_still(std::size_t first) const {
  const auto out = [&](int direction, std::size_t i) {
    return arrays_[static_cast<std::size_t>(kOut + direction)][i];
  };
  const auto stride = static_cast<std::size_t>(stride_);
  float most = 0;
  for (std::size_t i = first; i < first + kTileSide; ++i) {
    most += out(0, i) + out(1, i) + out(2, i) + out(3, i);
    most += out(0, i - 1) + out(1, i + 1) + out(2, i - stride) + out(3, i + stride);
  }
  return most == 0;
}

/// Lets columns that owe some give less. A column may give a little more than it has where fluxes
/// aren't quite at rest. It then gives as much less, to all alike, and so do those that got it and
/// passed it on; those that soil went round in circles between give nothing.
void FluxGrid::share_out(std::vector<std::size_t> columns) {
  const auto stride = static_cast<std::size_t>(stride_);
  std::vector<std::pair<std::size_t, double>> less;
  std::vector<std::uint8_t> listed;  // by column
  for (int round = 0; !columns.empty(); ++round) {
    less.clear();
    for (const std::size_t i : columns) {
      if (missing(i)) continue;
      const Balance b = balance(i);
      if (b.had - share_[i] * b.out < -kMaxOwedShare * b.had)
        less.emplace_back(i, round < kMaxOwedRounds ? b.had / b.out : 0);
    }
    columns.clear();
    listed.resize(share_.size());
    for (const auto& [i, share] : less) {
      share_[i] = share;
      for (const std::size_t n : {i - stride, i - 1, i, i + 1, i + stride})
        if (std::exchange(listed[n], std::uint8_t{1}) == 0) columns.push_back(n);
    }
    for (const std::size_t n : columns) listed[n] = 0;
  }
}

/// Fluxes are floats, but what one column gives another gets, so sums in double hold the mass.
std::vector<FluxGrid::Change> FluxGrid::changes() {
  std::vector<Coord2> columns;
  std::vector<std::size_t> numbers;
  for (const Coord2& tile : loaded_) {
    for (int y = 0; y < kTileSide; ++y) {
      if (is_still(at(kTileSide * tile + Coord2(0, y)))) continue;
      for (int x = 0; x < kTileSide; ++x) {
        const Coord2 column = kTileSide * tile + Coord2(x, y);
        if (missing(column)) continue;
        columns.push_back(column);
        numbers.push_back(at(column));
      }
    }
  }
  flows_out_.resize(share_.size());
  for (const std::size_t i : numbers) flows_out_[i] = flows_out(i);
  share_out(numbers);
  std::vector<Change> changes;
  for (std::size_t n = 0; n < columns.size(); ++n) {
    const std::size_t i = numbers[n];
    const Balance b = balance(i);
    if (b.in == 0 && b.out == 0) continue;
    changes.push_back({columns[n], given_[i], std::max(b.had - share_[i] * b.out, 0.0)});
  }
  for (const std::size_t i : numbers) {
    share_[i] = 1;
    flows_out_[i] = {};
  }
  return changes;
}

}  // namespace soilvdb::inline v0
