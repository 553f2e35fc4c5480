// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/settle/column_samples.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <vector>

#include "core/constants.h"
#include "core/ground/soil_writer.h"
#include "core/lattice/cell_counts.h"

namespace soilvdb::inline v0 {
namespace {

constexpr int kSideMask = kChunkSide - 1;

int cell_number(const ColumnChange& c, int z) {
  return (c.cell.x() & kSideMask) << 6 | (c.cell.y() & kSideMask) << 3 | (z & kSideMask);
}

/// The chunks over and under each other in which some columns change, and what does.
class Stack {
 public:
  Stack(const Soil& soil, std::vector<ColumnChange> changes, bool adds, bool bank)
      : changes_(std::move(changes)), adds_(adds) {
    int low = changes_.front().low, high = changes_.front().high;
    for (const ColumnChange& c : changes_) {
      low = std::min(low, c.low);
      high = std::max(high, c.high);
    }
    const Coord2 corner = changes_.front().cell.unaryExpr([](int v) { return v & ~kSideMask; });
    first_ = {corner.x(), corner.y(), low & ~kSideMask};
    const auto chunks = static_cast<std::size_t>((high - first_.z()) / kChunkSide + 1);
    may_.resize(chunks);
    counts_.resize(chunks);
    chosen_.resize(chunks);
    for (std::size_t i = 0; i < chunks; ++i) {
      adds || bank ? soil.read_samples(origin(i), may_[i]) : soil.read_loose(origin(i), may_[i]);
      if (adds)
        for (std::uint64_t& word : may_[i]) word = ~word;
      count_cells(may_[i], counts_[i]);
      chosen_[i].fill(0);
    }
  }

  std::size_t chunks() const { return may_.size(); }
  Coord3 origin(std::size_t i) const {
    return first_ + Coord3(0, 0, static_cast<int>(i) * kChunkSide);
  }
  const SampleWords& chosen(std::size_t i) const { return chosen_[i]; }

  void choose(float slope) {
    for (const ColumnChange& c : changes_) choose(c, slope);
  }

 private:
  std::uint64_t& word(std::vector<SampleWords>& of, const ColumnChange& c, int z) const {
    return of[static_cast<std::size_t>((z - first_.z()) / kChunkSide)]
             [static_cast<std::size_t>(cell_number(c, z))];
  }

  int count(const ColumnChange& c, int z) const {
    return counts_[static_cast<std::size_t>((z - first_.z()) / kChunkSide)]
                  [static_cast<std::size_t>(cell_number(c, z))];
  }

  /// Takes the column's samples in their order from one end: cell by cell while all of a cell come
  /// before any that could be left, then one by one.
  void choose(const ColumnChange& c, float slope) {
    const int step = adds_ ? 1 : -1, from = adds_ ? c.low : c.high, to = adds_ ? c.high : c.low;
    std::int64_t sum = 0;
    int last = from;  // cell in which the count is reached
    for (int z = from;; z += step) {
      sum += count(c, z);
      last = z;
      if (sum >= c.samples || z == to) break;
    }
    if (c.samples <= 0) return;
    // The surface is so much higher or lower over the column's corners than over its middle.
    const float tilt = c.cone ? 0.70711f * slope : 0.5f * (std::abs(c.a) + std::abs(c.b));
    // So what is more cells than twice that before the last one comes before all of that, and what
    // is more cells behind it comes after.
    constexpr float kRounding = 1e-3f;
    const int unsure = static_cast<int>(std::ceil(2 * tilt + kRounding));
    std::int64_t left = c.samples;
    keys_.clear();
    for (int z = from; step * (z - to) <= 0 && step * (z - last) <= unsure; z += step) {
      const std::uint64_t may = word(may_, c, z);
      if (may == 0) continue;
      if (step * (last - z) > unsure) {
        word(chosen_, c, z) = may;
        left -= count(c, z);
      } else {
        add_keys(c, slope, z, may);
      }
    }
    const auto end = keys_.begin() + std::min(left, static_cast<std::int64_t>(keys_.size()));
    if (end != keys_.end()) std::nth_element(keys_.begin(), end, keys_.end());
    for (auto key = keys_.begin(); key != end; ++key) {
      const auto sample = static_cast<std::uint32_t>(*key);
      word(chosen_, c, c.low + static_cast<int>(sample >> 6)) |= std::uint64_t{1} << (sample & 63);
    }
  }

  /// Height above the surface in fixed point, so that it orders the same however it was computed;
  /// then which sample it is.
  void add_keys(const ColumnChange& c, float slope, int z, std::uint64_t may) {
    const CellPoints& points = sample_points({c.cell.x(), c.cell.y(), z});
    const float low = static_cast<float>(z - c.low);
    std::array<std::int32_t, 64> above;
    for (std::size_t i = 0; i < 64; ++i) {
      float surface;
      if (c.cone) {
        const float x = points.x[i] - c.a, y = points.y[i] - c.b;
        surface = -slope * std::sqrt(x * x + y * y);
      } else {
        surface = c.a * points.x[i] + c.b * points.y[i];
      }
      const float height = low + points.z[i] - surface;
      above[i] = static_cast<std::int32_t>((adds_ ? height : -height) * 65536.0f);
    }
    const auto cell = static_cast<std::int64_t>(z - c.low) << 6;
    for (; may != 0; may &= may - 1) {
      const int i = std::countr_zero(may);
      keys_.push_back(std::int64_t{above[static_cast<std::size_t>(i)]} * (std::int64_t{1} << 32) +
                      (cell | i));
    }
  }

  std::vector<ColumnChange> changes_;
  bool adds_;
  Coord3 first_;
  std::vector<CellCounts> counts_;
  std::vector<SampleWords> may_, chosen_;  // by chunks upwards: what may change, what does
  std::vector<std::int64_t> keys_;
};

/// Chooses what changes, in stacks of chunks side by side.
std::vector<Stack> choose(const Soil& soil, std::span<const ColumnChange> changes, double slope,
                          bool adds, bool bank) {
  std::vector<ColumnChange> sorted(changes.begin(), changes.end());
  const auto corner = [](const ColumnChange& c) {
    return std::pair(c.cell.x() & ~kSideMask, c.cell.y() & ~kSideMask);
  };
  std::stable_sort(sorted.begin(), sorted.end(),
                   [&](const auto& a, const auto& b) { return corner(a) < corner(b); });
  std::vector<Stack> stacks;
  for (auto from = sorted.begin(); from != sorted.end();) {
    const auto to =
        std::find_if(from, sorted.end(), [&](const auto& c) { return corner(c) != corner(*from); });
    stacks.emplace_back(soil, std::vector<ColumnChange>(from, to), adds, bank);
    from = to;
  }
  const auto run = [&](std::size_t i) { stacks[i].choose(static_cast<float>(slope)); };
  if (changes.size() >= kParallelColumns) {
    tbb::parallel_for(std::size_t{0}, stacks.size(), run);
  } else {
    for (std::size_t i = 0; i < stacks.size(); ++i) run(i);
  }
  return stacks;
}

/// Calls f(words, samples, loose) for each chunk of which something was chosen.
template <typename F>
void edit(Soil& soil, const std::vector<Stack>& stacks, SoilWriter::Operation operation,
          const F& f) {
  std::vector<SoilWriter::Edit> edits;
  std::vector<const SampleWords*> chosen;
  for (const Stack& stack : stacks) {
    for (std::size_t i = 0; i < stack.chunks(); ++i) {
      const SampleWords& words = stack.chosen(i);
      if (std::all_of(words.begin(), words.end(), [](auto word) { return word == 0; })) continue;
      edits.push_back({stack.origin(i)});
      chosen.push_back(&words);
    }
  }
  SoilWriter(soil).edit(operation, edits, kParallelFill,
                        [&](std::size_t i, Samples& samples, Samples& loose) {
                          f(*chosen[i], samples, loose);
                          return true;
                        });
}

std::int64_t count(const SampleWords& words) {
  CellCounts counts;
  count_cells(words, counts);
  std::int64_t sum = 0;
  for (const int n : counts) sum += n;
  return sum;
}

}  // namespace

std::int64_t add_loose(Soil& soil, std::span<const ColumnChange> changes, double slope) {
  const std::vector<Stack> stacks = choose(soil, changes, slope, true, false);
  const auto add = [](const SampleWords& more, Samples& to) {
    SampleWords words;
    to.expand(words);
    for (std::size_t n = 0; n < words.size(); ++n) words[n] |= more[n];
    to.assign(words);
  };
  edit(soil, stacks, SoilWriter::Operation::kAdd,
       [&](const SampleWords& more, Samples& samples, Samples& loose) {
         add(more, samples);
         add(more, loose);
       });
  std::int64_t added = 0;
  for (const Stack& stack : stacks)
    for (std::size_t i = 0; i < stack.chunks(); ++i) added += count(stack.chosen(i));
  return added;
}

Taken remove_top(Soil& soil, std::span<const ColumnChange> changes, double slope, bool bank) {
  const std::vector<Stack> stacks = choose(soil, changes, slope, false, bank);
  Taken taken;
  SampleWords loose;
  for (const Stack& stack : stacks) {
    for (std::size_t i = 0; i < stack.chunks(); ++i) {
      soil.read_loose(stack.origin(i), loose);
      for (std::size_t n = 0; n < loose.size(); ++n) loose[n] &= stack.chosen(i)[n];
      taken.loose += count(loose);
      taken.bank += count(stack.chosen(i)) - count(loose);
    }
  }
  const auto remove = [](const SampleWords& gone, Samples& from) {
    SampleWords words;
    from.expand(words);
    for (std::size_t n = 0; n < words.size(); ++n) words[n] &= ~gone[n];
    from.assign(words);
  };
  edit(soil, stacks, SoilWriter::Operation::kRemove,
       [&](const SampleWords& gone, Samples& samples, Samples& loose_samples) {
         remove(gone, samples);
         remove(gone, loose_samples);
       });
  return taken;
}

}  // namespace soilvdb::inline v0
