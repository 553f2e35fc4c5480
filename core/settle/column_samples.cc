// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/settle/column_samples.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <memory>
#include <numeric>
#include <vector>

#include "core/constants.h"
#include "core/ground/ground_writer.h"
#include "core/lattice/affine.h"
#include "core/lattice/cell_counts.h"
#include "core/lattice/chunk_math.h"
#include "core/settle/sample_ranking.h"

namespace soilvdb::inline v0 {
namespace {

std::size_t number_of(const ColumnEdit& c, int z) {
  return static_cast<std::size_t>(cell_number({c.cell.x(), c.cell.y(), z}));
}

/// The chunks over and under each other in which some columns change, and what does. Chunks are
/// read when a column first comes to them.
class SampleStack {
 public:
  SampleStack(const Ground& ground, std::span<const ColumnEdit> changes, bool adds, bool bank)
      : ground_(&ground), changes_(changes), adds_(adds), bank_(bank) {
    int low = changes_.front().low, high = changes_.front().high;
    for (const ColumnEdit& c : changes_) {
      low = std::min(low, c.low);
      high = std::max(high, c.high);
    }
    const Coord2& cell = changes_.front().cell;
    first_ = floor_to(Coord3(cell.x(), cell.y(), low), kChunkSide);
    pieces_.resize(static_cast<std::size_t>((high - first_.z()) / kChunkSide + 1));
  }

  std::size_t chunks() const { return pieces_.size(); }
  Coord3 origin(std::size_t i) const {
    return first_ + Coord3(0, 0, static_cast<int>(i) * kChunkSide);
  }
  /// What changes of a chunk, null if nothing does.
  const SampleWords* chosen(std::size_t i) const {
    return pieces_[i] && pieces_[i]->some ? &pieces_[i]->chosen : nullptr;
  }

  void choose(float slope) {
    for (const ColumnEdit& c : changes_) choose(c, slope);
  }

 private:
  struct Piece {
    SampleWords may, chosen;  // what may change, what does
    bool some;
  };

  Piece& piece(int z) {
    const auto i = static_cast<std::size_t>((z - first_.z()) / kChunkSide);
    if (!pieces_[i]) {
      pieces_[i] = std::make_unique_for_overwrite<Piece>();
      Piece& p = *pieces_[i];
      adds_ || bank_ ? ground_->read_samples(origin(i), p.may)
                     : ground_->read_loose(origin(i), p.may);
      if (adds_)
        for (std::uint64_t& word : p.may) word = ~word;
      p.chosen.fill(0);
      p.some = false;
    }
    return *pieces_[i];
  }
  std::uint64_t may(const ColumnEdit& c, int z) { return piece(z).may[number_of(c, z)]; }
  void take(const ColumnEdit& c, int z, std::uint64_t samples) {
    Piece& p = piece(z);
    p.chosen[number_of(c, z)] |= samples;
    p.some |= samples != 0;
  }

  /// Takes the column's samples in their order from one end: cell by cell while all of a cell come
  /// before any that could be left, then one by one.
  SOILVDB_FOR_CPUS void choose(const ColumnEdit& c, float slope) {
    if (c.samples <= 0) return;
    const int step = adds_ ? 1 : -1, from = adds_ ? c.low : c.high, to = adds_ ? c.high : c.low;
    std::int64_t sum = 0;
    int last = from;  // cell in which the count is reached
    for (int z = from;; z += step) {
      sum += std::popcount(may(c, z));
      last = z;
      if (sum >= c.samples || z == to) break;
    }
    // The surface is so much higher or lower over the column's corners than over its middle.
    const float tilt = c.cone ? 0.70711f * slope : 0.5f * (std::abs(c.a) + std::abs(c.b));
    // So what is more cells than twice that before the last one comes before all of that, and what
    // is more cells behind it comes after.
    const int unsure = static_cast<int>(std::ceil(2 * tilt + kTiltRounding));
    std::int64_t left = c.samples;
    int z = from;
    for (; step * (last - z) > unsure; z += step) {
      const std::uint64_t all = may(c, z);
      take(c, z, all);
      left -= std::popcount(all);
    }
    const int end = step * (to - last) > unsure ? last + step * unsure : to;
    const int low = std::min(z, end), high = std::max(z, end);
    const ColumnSurface surface{c.cone, c.a, c.b, slope, adds_ ? 1.0f : -1.0f};
    ranking_.clear();
    for (z = low; z <= high; ++z)
      ranking_.add(sample_points({c.cell.x(), c.cell.y(), z}), static_cast<float>(z - c.low),
                   surface, may(c, z));
    const std::span<const std::uint64_t> first = ranking_.first(left);
    for (z = low; z <= high; ++z) take(c, z, first[static_cast<std::size_t>(z - low)]);
  }

  const Ground* ground_;
  std::span<const ColumnEdit> changes_;
  bool adds_, bank_;
  Coord3 first_;
  std::vector<std::unique_ptr<Piece>> pieces_;  // by chunks upwards
  SampleRanking ranking_;
};

/// Chooses what changes, in stacks of chunks side by side.
class Stacks {
 public:
  Stacks(const Ground& ground, std::span<const ColumnEdit> changes, double slope, bool adds,
         bool bank)
      : sorted_(changes.begin(), changes.end()) {
    const auto corner = [](const ColumnEdit& c) {
      return std::pair(floor_to(c.cell.x(), kChunkSide), floor_to(c.cell.y(), kChunkSide));
    };
    std::stable_sort(sorted_.begin(), sorted_.end(),
                     [&](const auto& a, const auto& b) { return corner(a) < corner(b); });
    for (auto from = sorted_.begin(); from != sorted_.end();) {
      const auto to = std::find_if(from, sorted_.end(),
                                   [&](const auto& c) { return corner(c) != corner(*from); });
      stacks_.emplace_back(ground, std::span<const ColumnEdit>(from, to), adds, bank);
      from = to;
    }
    const auto run = [&](std::size_t i) { stacks_[i].choose(static_cast<float>(slope)); };
    if (changes.size() >= kParallelFillColumns) {
      tbb::parallel_for(std::size_t{0}, stacks_.size(), run);
    } else {
      for (std::size_t i = 0; i < stacks_.size(); ++i) run(i);
    }
    for (const SampleStack& stack : stacks_)
      for (std::size_t i = 0; i < stack.chunks(); ++i)
        if (const SampleWords* words = stack.chosen(i)) chosen_.push_back({stack.origin(i), words});
  }

  /// Chunks of which something was chosen, and what.
  struct Chosen {
    Coord3 origin;
    const SampleWords* words;
  };
  const std::vector<Chosen>& chosen() const { return chosen_; }

 private:
  std::vector<ColumnEdit> sorted_;
  std::vector<SampleStack> stacks_;
  std::vector<Chosen> chosen_;
};

/// Adds samples, or removes them.
void apply(GroundWriter::Operation operation, const SampleWords& chosen, Samples& to) {
  SampleWords words;
  to.expand(words);
  for (std::size_t n = 0; n < words.size(); ++n)
    words[n] =
        operation == GroundWriter::Operation::kAdd ? words[n] | chosen[n] : words[n] & ~chosen[n];
  to.assign(words);
}

/// Adds or removes what was chosen. @param and_loose also of the loose samples
void edit(Ground& ground, const Stacks& stacks, GroundWriter::Operation operation, bool and_loose) {
  std::vector<GroundWriter::Edit> edits;
  for (const Stacks::Chosen& c : stacks.chosen()) edits.push_back({c.origin});
  GroundWriter(ground).edit(operation, edits, kParallelFillChunks,
                            [&](std::size_t i, Samples& samples, Samples& loose) {
                              const SampleWords& chosen = *stacks.chosen()[i].words;
                              apply(operation, chosen, samples);
                              if (and_loose) apply(operation, chosen, loose);
                              return true;
                            });
}

std::int64_t count(const SampleWords& words) {
  CellCounts counts;
  count_cells(words, counts);
  return std::accumulate(counts.begin(), counts.end(), std::int64_t{0});
}

}  // namespace

std::int64_t add_samples(Ground& ground, std::span<const ColumnEdit> changes, double slope,
                         bool loose, const ChunkReceiver& added) {
  const Stacks stacks(ground, changes, slope, true, false);
  edit(ground, stacks, GroundWriter::Operation::kAdd, loose);
  std::int64_t sum = 0;
  for (const Stacks::Chosen& c : stacks.chosen()) {
    sum += count(*c.words);
    if (added) added(c.origin, *c.words, loose);
  }
  return sum;
}

Taken remove_top(Ground& ground, std::span<const ColumnEdit> changes, double slope, bool bank,
                 const ChunkReceiver& removed) {
  const Stacks stacks(ground, changes, slope, false, bank);
  Taken taken;
  SampleWords loose;
  for (const Stacks::Chosen& c : stacks.chosen()) {
    ground.read_loose(c.origin, loose);
    for (std::size_t n = 0; n < loose.size(); ++n) loose[n] &= (*c.words)[n];
    const std::int64_t loose_samples = count(loose);
    taken.loose += loose_samples;
    taken.bank += count(*c.words) - loose_samples;
    if (!removed) continue;
    removed(c.origin, loose, true);
    for (std::size_t n = 0; n < loose.size(); ++n) loose[n] ^= (*c.words)[n];
    removed(c.origin, loose, false);
  }
  edit(ground, stacks, GroundWriter::Operation::kRemove, true);
  return taken;
}

}  // namespace soilvdb::inline v0
