// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/cell/fit_cache.h"

#include <bit>
#include <cstddef>

#include "core/constants.h"
#include "core/lattice/splitmix64.h"

namespace soilvdb::inline v0 {
namespace {

/// A value for a sum in which its place matters. All bits of the value are mixed, else changes of
/// two words' last samples would cancel.
std::uint64_t mixed(std::uint64_t value, int place) {
  constexpr std::uint64_t kGolden = 0x9e3779b97f4a7c15u;
  return splitmix64(value + static_cast<std::uint64_t>(place + 1) * kGolden);
}

/// A key of a cell's place and all words that fit_plane() and solve_crease() use; never 0.
std::uint64_t key_of(const CellGrid& grid, int id) {
  const int steps[3] = {grid.step(0), grid.step(1), grid.step(2)};
  std::uint64_t sum = 0;
  for (int k = 0; k < 27; ++k) sum += mixed(grid.word(grid.beside(id, k)), k);
  // Cells one farther on each side enter by their counts.
  for (int side = 0; side < 6; ++side) {
    const int axis = side / 2, middle = id + (side % 2 * 4 - 2) * steps[axis];
    const int u = steps[(axis + 1) % 3], v = steps[(axis + 2) % 3];
    std::uint64_t counts = 0;
    for (int k = 0; k < 9; ++k)
      counts = counts << 7 |
               static_cast<std::uint64_t>(grid.count(middle + (k / 3 - 1) * u + (k % 3 - 1) * v));
    sum += mixed(counts, 27 + side);
  }
  const Coord3 cell = grid.first() + grid.at(id);
  for (int a = 0; a < 3; ++a) sum += mixed(static_cast<std::uint32_t>(cell[a]), 33 + a);
  return splitmix64(sum) | 1;
}

}  // namespace

FitCache::FitCache() : fits_(kMemoFits), creases_(kMemoCreases) {}

PlaneFit FitCache::fit(const CellGrid& grid, int id) {
  const std::uint64_t key = key_of(grid, id);
  Entry<PlaneFit>& entry = fits_[key >> 1 & (kMemoFits - 1)];
  if (entry.key != key) entry = {key, fit_plane(grid, id)};
  return entry.value;
}

CellModel FitCache::crease(const CellGrid& grid, int id, const Candidates& candidates) {
  std::uint64_t sum = key_of(grid, id);
  int place = 0;
  for (const CellPlane& p : candidates.planes()) {
    for (const float value : {p.nx, p.ny, p.nz, p.d})
      sum += mixed(std::bit_cast<std::uint32_t>(value), place++);
  }
  const std::uint64_t key = splitmix64(sum) | 1;
  Entry<CellModel>& entry = creases_[key >> 1 & (kMemoCreases - 1)];
  if (entry.key != key) entry = {key, solve_crease(grid, id, candidates)};
  return entry.value;
}

}  // namespace soilvdb::inline v0
