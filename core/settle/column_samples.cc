// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/settle/column_samples.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "core/constants.h"
#include "core/ground/ground_writer.h"
#include "core/lattice/affine.h"
#include "core/lattice/chunk_math.h"
#include "core/lattice/lanes.h"
#include "core/settle/sample_ranking.h"

namespace soilvdb::inline v0 {
namespace {

std::size_t number_of(const ColumnEdit& c, int z) {
  return static_cast<std::size_t>(cell_number({c.cell.x(), c.cell.y(), z}));
}

/// Samples of a chunk.
struct ChosenSamples {
  SampleWords words;
  std::array<std::uint64_t, kChunkVoxels / 64> cells;  // bits of those with some
  std::int64_t samples;

  /// Calls f(n, word) for each cell with some.
  template <typename F>
  SOILVDB_INLINE void each(const F& f) const {
    for (std::size_t g = 0; g < cells.size(); ++g)
      for (std::uint64_t left = cells[g]; left != 0; left &= left - 1) {
        const std::size_t n = 64 * g + static_cast<std::size_t>(std::countr_zero(left));
        f(static_cast<int>(n), words[n]);
      }
  }
};

/// The chunks over and under each other in which some columns change, and what does. Chunks are
/// read when a column first comes to them.
class SampleStack {
 public:
  /// @param bank also bank is removed
  SampleStack(const Ground& ground, std::span<const ColumnEdit> changes, bool bank)
      : ground_(&ground), changes_(changes), bank_(bank) {
    int low = changes_.front().low, high = changes_.front().high;
    for (const ColumnEdit& c : changes_) {
      low = std::min(low, c.low);
      high = std::max({high, c.low, c.high});
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
  const ChosenSamples* chosen(std::size_t i) const {
    return pieces_[i] && pieces_[i]->chosen.samples > 0 ? &pieces_[i]->chosen : nullptr;
  }

  /// The soil of a chunk of which something was chosen; null: its loose soil alone was read.
  const SampleWords* soil(std::size_t i) const { return bank_ ? &pieces_[i]->samples : nullptr; }

  /// @param taken receives the number of samples of each column
  void choose(float slope, std::int64_t* taken) {
    for (const ColumnEdit& c : changes_) *taken++ = choose(c, slope);
  }

 private:
  struct Piece {
    SampleWords samples;  // as they are; loose ones alone without bank
    ChosenSamples chosen;
  };

  Piece& piece(int z) {
    const auto i = static_cast<std::size_t>((z - first_.z()) / kChunkSide);
    return pieces_[i] ? *pieces_[i] : read(i);
  }
  Piece& read(std::size_t i) {
    pieces_[i] = std::make_unique_for_overwrite<Piece>();
    Piece& p = *pieces_[i];
    bank_ ? ground_->read_samples(origin(i), p.samples) : ground_->read_loose(origin(i), p.samples);
    p.chosen.words.fill(0);
    p.chosen.cells.fill(0);
    p.chosen.samples = 0;
    return p;
  }
  /// Samples that may change.
  std::uint64_t may(const ColumnEdit& c, int z) {
    const std::uint64_t samples = piece(z).samples[number_of(c, z)];
    return c.rises ? ~samples : samples;
  }
  /// @return number of samples
  SOILVDB_INLINE int take(const ColumnEdit& c, int z, std::uint64_t samples) {
    if (samples == 0) return 0;
    const std::size_t n = number_of(c, z);
    ChosenSamples& chosen = piece(z).chosen;
    chosen.samples += std::popcount(samples & ~chosen.words[n]);
    chosen.words[n] |= samples;
    chosen.cells[n / 64] |= std::uint64_t{1} << n % 64;
    return std::popcount(samples);
  }

  /// Takes the column's samples in their order from one end: cell by cell while all of a cell come
  /// before any that could be left, then one by one.
  /// @return their number
  SOILVDB_FOR_CPUS std::int64_t choose(const ColumnEdit& c, float slope) {
    if (c.samples <= 0 || c.low > c.high) return 0;
    const int step = c.rises ? 1 : -1;
    const int from = c.rises ? c.low : c.high, to = c.rises ? c.high : c.low;
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
    for (; step * (last - z) > unsure; z += step) left -= take(c, z, may(c, z));
    const int end = step * (to - last) > unsure ? last + step * unsure : to;
    const int low = std::min(z, end), high = std::max(z, end);
    const ColumnSurface surface{c.cone, c.a, c.b, slope, c.rises ? 1.0f : -1.0f};
    ranking_.clear();
    for (z = low; z <= high; ++z)
      ranking_.add(sample_points({c.cell.x(), c.cell.y(), z}), static_cast<float>(z - c.low),
                   surface, may(c, z));
    const std::span<const std::uint64_t> first = ranking_.first(left);
    for (z = low; z <= high; ++z) left -= take(c, z, first[static_cast<std::size_t>(z - low)]);
    return c.samples - left;
  }

  const Ground* ground_;
  std::span<const ColumnEdit> changes_;
  bool bank_;
  Coord3 first_;
  std::vector<std::unique_ptr<Piece>> pieces_;  // by chunks upwards
  SampleRanking ranking_;
};

/// Chooses what changes, in stacks of chunks side by side.
class Stacks {
 public:
  Stacks(const Ground& ground, std::span<const ColumnEdit> changes, double slope, bool bank)
      : taken_(changes.size()) {
    order_.reserve(changes.size());
    for (std::size_t i = 0; i < changes.size(); ++i) {
      const Coord2 corner = floor_to(changes[i].cell, kChunkSide);
      order_.push_back({{corner.x(), corner.y()}, i});
    }
    std::sort(order_.begin(), order_.end());
    sorted_.reserve(changes.size());
    for (const auto& [corner, i] : order_) sorted_.push_back(changes[i]);
    std::vector<std::size_t> firsts;
    for (std::size_t from = 0, to = 0; from < order_.size(); from = to) {
      while (to < order_.size() && order_[to].first == order_[from].first) ++to;
      firsts.push_back(from);
      stacks_.emplace_back(ground, std::span(sorted_).subspan(from, to - from), bank);
    }
    const auto run = [&](std::size_t i) {
      stacks_[i].choose(static_cast<float>(slope), &taken_[firsts[i]]);
    };
    if (changes.size() >= kParallelFillColumns) {
      tbb::parallel_for(std::size_t{0}, stacks_.size(), run);
    } else {
      for (std::size_t i = 0; i < stacks_.size(); ++i) run(i);
    }
    for (const SampleStack& stack : stacks_)
      for (std::size_t i = 0; i < stack.chunks(); ++i)
        if (const ChosenSamples* some = stack.chosen(i))
          chosen_.push_back({stack.origin(i), some, stack.soil(i)});
  }

  /// Chunks of which something was chosen, and what.
  struct Chosen {
    Coord3 origin;
    const ChosenSamples* samples;
    const SampleWords* soil;  // before; null: not known
  };
  const std::vector<Chosen>& chosen() const { return chosen_; }
  /// Their number by change.
  std::vector<std::int64_t> by_change() const {
    std::vector<std::int64_t> by(taken_.size());
    for (std::size_t i = 0; i < by.size(); ++i) by[order_[i].second] = taken_[i];
    return by;
  }

 private:
  /// The columns of chunks that the changes are in, and their numbers, as they are sorted.
  std::vector<std::pair<std::pair<int, int>, std::size_t>> order_;
  std::vector<ColumnEdit> sorted_;
  std::vector<std::int64_t> taken_;  // by these
  std::vector<SampleStack> stacks_;
  std::vector<Chosen> chosen_;
};

/// What a change of a chunk did.
struct Done {
  ChangedSamples samples;
  ColumnCounts counts;
};

/// Turns samples of a chunk: air becomes soil, and soil air. @param adds_loose the former is loose
SOILVDB_FOR_CPUS void turn(const ChosenSamples& chosen, bool adds_loose, Samples& soil,
                           Samples& loose, Done& done) {
  chosen.each([&](int n, std::uint64_t samples) {
    const std::uint64_t before = soil.word(n), loose_before = loose.word(n);
    const std::uint64_t added = samples & ~before, after = before ^ samples;
    const std::uint64_t loose_after = (loose_before & after) | (adds_loose ? added : 0);
    soil.set_word(n, after);
    if (loose_after != loose_before) loose.set_word(n, loose_after);
    const int more = std::popcount(added), taken = std::popcount(samples & loose_before);
    const int taken_bank = std::popcount(samples & before & ~loose_before);
    done.samples.added += more;
    done.samples.taken.loose += taken;
    done.samples.taken.bank += taken_bank;
    const auto column = static_cast<std::size_t>(n / kChunkSide);
    done.counts.loose[column] += (adds_loose ? more : 0) - taken;
    done.counts.bank[column] += (adds_loose ? 0 : more) - taken_bank;
  });
}

/// Changes what was chosen. @param adds_loose what is added is loose
ChangedSamples edit(Ground& ground, const Stacks& stacks, GroundWriter::Operation operation,
                    bool adds_loose, const CountReceiver& receiver = {}) {
  const std::vector<Stacks::Chosen>& chosen = stacks.chosen();
  std::vector<GroundWriter::Edit> edits;
  for (const Stacks::Chosen& c : chosen) edits.push_back({.origin = c.origin, .soil = c.soil});
  std::vector<Done> done(chosen.size());
  GroundWriter(ground).edit(operation, edits, kParallelFillChunks,
                            [&](std::size_t i, Samples& soil, Samples& loose) {
                              turn(*chosen[i].samples, adds_loose, soil, loose, done[i]);
                              return true;
                            });
  ChangedSamples all;
  for (std::size_t i = 0; i < done.size(); ++i) {
    const ChangedSamples& some = done[i].samples;
    all.added += some.added;
    all.taken.bank += some.taken.bank;
    all.taken.loose += some.taken.loose;
    if (receiver) receiver(chosen[i].origin, done[i].counts);
  }
  return all;
}

}  // namespace

std::int64_t add_samples(Ground& ground, std::span<const ColumnEdit> changes, double slope) {
  std::vector<ColumnEdit> rising(changes.begin(), changes.end());
  for (ColumnEdit& change : rising) change.rises = true;
  const Stacks stacks(ground, rising, slope, /*bank=*/true);
  return edit(ground, stacks, GroundWriter::Operation::kAdd, /*adds_loose=*/true).added;
}

Taken remove_top(Ground& ground, std::span<const ColumnEdit> changes, double slope) {
  const Stacks stacks(ground, changes, slope, /*bank=*/true);
  return edit(ground, stacks, GroundWriter::Operation::kRemove, false).taken;
}

std::vector<std::int64_t> remove_loose(Ground& ground, std::span<const ColumnEdit> changes,
                                       double slope) {
  const Stacks stacks(ground, changes, slope, /*bank=*/false);
  edit(ground, stacks, GroundWriter::Operation::kRemove, false);
  return stacks.by_change();
}

ChangedSamples change_samples(Ground& ground, std::span<const ColumnEdit> changes, bool loose,
                              const CountReceiver& receiver) {
  const Stacks stacks(ground, changes, 0, /*bank=*/true);
  return edit(ground, stacks, GroundWriter::Operation::kAdd, loose, receiver);
}

}  // namespace soilvdb::inline v0
