// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/settle/sample_ranking.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "core/constants.h"
#include "core/lattice/affine.h"
#include "core/lattice/lanes.h"

namespace soilvdb::inline v0 {
namespace {

constexpr std::int32_t kNever = std::numeric_limits<std::int32_t>::max();
constexpr std::size_t kSamples = 64;  // of a cell

struct Range {
  std::int32_t lowest, highest;
};

/// Eight samples at once: they are as wide as a row of voxels.
constexpr std::size_t kRow = kChunkSide;

SOILVDB_INLINE LaneMask heights_at(const std::int32_t* from) {
  LaneMask v;
  __builtin_memcpy(&v, from, sizeof(v));
  return v;
}

SOILVDB_FOR_CPUS Range heights_of(const CellPoints& points, float low, const ColumnSurface& surface,
                                  std::uint64_t may, std::int32_t* out) {
  constexpr LaneMask kBit = {1, 2, 4, 8, 16, 32, 64, 128};
  constexpr std::int32_t kFirst = std::numeric_limits<std::int32_t>::min();
  const float slope = surface.slope, a = surface.a, b = surface.b;
  const float scale = surface.up * kHeightUnits;
  LaneMask lowest = LaneMask{} + kNever, highest = LaneMask{} + kFirst;
  for (std::size_t i = 0; i < kSamples; i += kRow, may >>= kRow) {
    const Lanes x = lanes_at(&points.x[i]), y = lanes_at(&points.y[i]);
    const Lanes z = lanes_at(&points.z[i]);
    Lanes above;
    if (surface.cone) {
      const Lanes east = x - a, north = y - b;
      above = low + z - -slope * sqrt(east * east + north * north);
    } else {
      above = low + z - (a * x + b * y);
    }
    const LaneMask height = __builtin_convertvector(above * scale, LaneMask);
    const LaneMask counts = ((LaneMask{} + static_cast<std::int32_t>(may & 0xff)) & kBit) != 0;
    const LaneMask or_never = counts ? height : LaneMask{} + kNever;
    const LaneMask or_first = counts ? height : LaneMask{} + kFirst;
    lowest = lowest < or_never ? lowest : or_never;
    highest = highest > or_first ? highest : or_first;
    __builtin_memcpy(out + i, &or_never, sizeof(or_never));
  }
  Range range{kNever, kFirst};
  for (std::size_t k = 0; k < kRow; ++k) {
    range.lowest = std::min(range.lowest, lowest[k]);
    range.highest = std::max(range.highest, highest[k]);
  }
  return range;
}

SOILVDB_FOR_CPUS int count_up_to(const std::int32_t* heights, std::size_t n, std::int32_t most) {
  LaneMask counts{};
  for (std::size_t i = 0; i < n; i += kRow) counts -= heights_at(heights + i) <= most;
  int count = 0;
  for (std::size_t k = 0; k < kRow; ++k) count += counts[k];
  return count;
}

SOILVDB_FOR_CPUS void mark_up_to(const std::int32_t* heights, std::int32_t most,
                                 std::span<std::uint64_t> words) {
  for (std::uint64_t& word : words) {
    word = 0;
    for (std::size_t i = 0; i < kSamples; i += kRow, heights += kRow)
      word |= std::uint64_t{bits(heights_at(heights) <= most)} << i;
  }
}

}  // namespace

void SampleRanking::clear() {
  heights_.clear();
  samples_ = 0;
  lowest_ = kNever;
  highest_ = std::numeric_limits<std::int32_t>::min();
}

void SampleRanking::add(const CellPoints& points, float low, const ColumnSurface& surface,
                        std::uint64_t may) {
  heights_.resize(heights_.size() + kSamples, kNever);
  if (may == 0) return;
  const Range range = heights_of(points, low, surface, may, &heights_.back() + 1 - kSamples);
  lowest_ = std::min(lowest_, range.lowest);
  highest_ = std::max(highest_, range.highest);
  samples_ += std::popcount(may);
}

std::span<const std::uint64_t> SampleRanking::first(std::int64_t count) {
  words_.assign(heights_.size() / kSamples, 0);
  count = std::min(count, samples_);
  if (count <= 0) return words_;
  // Samples are spread evenly, so the height up to which there are so many is nearly linear.
  std::int64_t low = std::int64_t{lowest_} - 1, high = highest_, at_low = 0, at_high = samples_;
  for (int n = 0; at_high != count && high - low > 1; ++n) {
    const std::int64_t linear = low + (high - low) * (count - at_low) / (at_high - at_low);
    const std::int64_t at = n % kBisectEvery == kBisectEvery - 1
                                ? (low + high) / 2
                                : std::clamp(linear, low + 1, high - 1);
    const int here = count_up_to(heights_.data(), heights_.size(), static_cast<std::int32_t>(at));
    (here < count ? low : high) = at;
    (here < count ? at_low : at_high) = here;
  }
  const auto most = static_cast<std::int32_t>(high);
  mark_up_to(heights_.data(), most, words_);
  // Of those that are equal the last stay.
  for (std::size_t i = heights_.size(); at_high > count;) {
    if (heights_[--i] != most) continue;
    words_[i / kSamples] &= ~(std::uint64_t{1} << i % kSamples);
    --at_high;
  }
  return words_;
}

}  // namespace soilvdb::inline v0
