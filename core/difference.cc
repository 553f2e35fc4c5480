// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/difference.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <map>
#include <utility>
#include <vector>

#include "core/chunk_range.h"
#include "core/column_difference.h"
#include "core/column_gains.h"
#include "core/lattice.h"

namespace soilvdb {
namespace {

/// Two soils of one lattice, in the index space of the first.
class Pair {
 public:
  Pair(const Soil& a, const Soil& b, const Coord3& shift) : a_(a), b_(b), shift_(shift) {}

  const Soil& first() const { return a_; }
  std::vector<Coord3> chunks() const {
    std::vector<Coord3> all;
    for (const Chunk* chunk : a_.chunks()) all.push_back(chunk->origin);
    for (const Chunk* chunk : b_.chunks()) all.push_back(chunk->origin + shift_);
    std::sort(all.begin(), all.end(), before);
    all.erase(std::unique(all.begin(), all.end()), all.end());
    return all;
  }
  /// With other origins the base surface may fall on the other side of a sample by rounding: what
  /// neither has changed is the same.
  void read(const Coord3& origin, SampleWords& a, SampleWords& b) const {
    a_.read_samples(origin, a);
    b_.read_samples(origin - shift_, b);
    if (shift_ == Coord3::Zero()) return;
    SampleWords base_a, base_b;
    a_.read_base(origin, base_a);
    b_.read_base(origin - shift_, base_b);
    for (std::size_t n = 0; n < a.size(); ++n)
      b[n] = a[n] ^ ((a[n] ^ b[n]) & ((a[n] ^ base_a[n]) | (b[n] ^ base_b[n])));
  }

 private:
  const Soil &a_, &b_;
  Coord3 shift_;
};

/// Which columns changed of the chunks that stand above each other; bit x * 8 + y.
struct Stack {
  std::uint64_t changed = 0;
  std::vector<Coord3> chunks;  ///< upwards
};
using Stacks = std::map<std::pair<int, int>, Stack>;

/// Columns of a stack that changed and have a neighbour that did not.
std::uint64_t rim(const Stacks& stacks, int x0, int y0) {
  std::array<std::uint64_t, 9> around{};
  for (int s = 0; s < 9; ++s) {
    const auto at = stacks.find({x0 + (s / 3 - 1) * kLeafSide, y0 + (s % 3 - 1) * kLeafSide});
    if (at != stacks.end()) around[static_cast<std::size_t>(s)] = at->second.changed;
  }
  const auto changed = [&](int x, int y) {
    const int stack = (x + kLeafSide) / kLeafSide * 3 + (y + kLeafSide) / kLeafSide;
    return around[static_cast<std::size_t>(stack)] >> ((x & 7) * 8 + (y & 7)) & 1;
  };
  std::uint64_t bits = 0;
  for (int n = 0; n < 64; ++n) {
    const int x = n >> 3, y = n & 7;
    if (!changed(x, y)) continue;
    bool inside = true;
    for (int d = 0; d < 9; ++d) inside &= changed(x + d / 3 - 1, y + d % 3 - 1) != 0;
    bits |= std::uint64_t{!inside} << n;
  }
  return bits;
}

/// What part of a column changed: the share of its 4 x 4 parts in which the highest sample of soil,
/// before or after, did; of fewer and larger ones where few samples changed, for then these are
/// nearer to the surface than the highest sample of a small part.
class ColumnPart {
 public:
  void add(const CellPoints& points, int z, std::uint64_t a, std::uint64_t b) {
    changed_ += std::popcount(a ^ b);
    if (filled_ == 0xffff) return;
    for (std::uint64_t soil = a | b; soil != 0; soil &= soil - 1) {
      const int i = std::countr_zero(soil);
      const auto part = static_cast<std::size_t>(static_cast<int>(points.x[i] * kSide) * kSide +
                                                 static_cast<int>(points.y[i] * kSide));
      const double top = z + double{points.z[i]};
      filled_ |= 1u << part;
      if (top <= top_[part]) continue;
      top_[part] = top;
      is_changed_[part] = ((a ^ b) >> i & 1) != 0;
    }
  }
  double fraction() const {
    const int across = changed_ >= 64 ? kSide : changed_ >= 8 ? 2 : 1;
    const int each = kSide / across;
    int sum = 0;
    for (int n = 0; n < across * across; ++n) {
      std::size_t highest = 0;
      double top = -std::numeric_limits<double>::infinity();
      for (int m = 0; m < each * each; ++m) {
        const auto part = static_cast<std::size_t>((n / across * each + m / each) * kSide +
                                                   n % across * each + m % each);
        if (top_[part] > top) top = top_[highest = part];
      }
      sum += std::isfinite(top) && is_changed_[highest];
    }
    return static_cast<double>(sum) / (across * across);
  }

 private:
  static constexpr int kSide = 4;
  std::array<double, kSide* kSide> top_ = filled();
  std::array<bool, kSide * kSide> is_changed_{};
  std::uint32_t filled_ = 0;
  int changed_ = 0;

  static std::array<double, kSide * kSide> filled() {
    std::array<double, kSide * kSide> low;
    low.fill(-std::numeric_limits<double>::infinity());
    return low;
  }
};

/// Columns of a stack that changed, those at the rim by their part.
double columns(const Pair& soils, const Stacks& stacks, const Stack& stack) {
  const Coord3& at = stack.chunks.front();
  const std::uint64_t at_rim = rim(stacks, at.x(), at.y());
  double sum = std::popcount(stack.changed & ~at_rim);
  if (at_rim == 0) return sum;
  std::array<ColumnPart, 64> parts;
  SampleWords a, b;
  for (auto chunk = stack.chunks.rbegin(); chunk != stack.chunks.rend(); ++chunk) {
    soils.read(*chunk, a, b);
    for (std::uint64_t left = at_rim; left != 0; left &= left - 1) {
      const int n = std::countr_zero(left);
      for (int z = kLeafSide - 1; z >= 0; --z) {
        const auto cell = static_cast<std::size_t>(n * 8 + z);
        if ((a[cell] | b[cell]) == 0) continue;
        const Coord3 voxel = *chunk + Coord3(n >> 3, n & 7, z);
        parts[static_cast<std::size_t>(n)].add(sample_points(voxel), voxel.z(), a[cell], b[cell]);
      }
    }
  }
  for (std::uint64_t left = at_rim; left != 0; left &= left - 1)
    sum += parts[static_cast<std::size_t>(std::countr_zero(left))].fraction();
  return sum;
}

Difference by_samples(const Pair& soils) {
  const std::vector<Coord3> origins = soils.chunks();
  struct Part {
    std::int64_t cut = 0, fill = 0, mixed = 0;
    std::uint64_t columns = 0;
  };
  std::vector<Part> parts(origins.size());
  tbb::parallel_for(std::size_t{0}, origins.size(), [&](std::size_t i) {
    SampleWords a, b;
    soils.read(origins[i], a, b);
    const auto mixed = [](std::uint64_t word) { return word != 0 && word != kAllSoil; };
    for (std::size_t n = 0; n < a.size(); ++n) {
      if (a[n] == b[n]) continue;
      parts[i].cut += std::popcount(a[n] & ~b[n]);
      parts[i].fill += std::popcount(b[n] & ~a[n]);
      parts[i].mixed += mixed(a[n]) + mixed(b[n]);
      parts[i].columns |= std::uint64_t{1} << (n >> 3);
    }
  });
  std::int64_t cut = 0, fill = 0, mixed = 0;
  Stacks stacks;
  for (std::size_t i = 0; i < origins.size(); ++i) {
    cut += parts[i].cut;
    fill += parts[i].fill;
    mixed += parts[i].mixed;
    Stack& stack = stacks[{origins[i].x(), origins[i].y()}];
    stack.chunks.push_back(origins[i]);
    stack.changed |= parts[i].columns;
  }
  const Soil& soil = soils.first();
  const double h = soil.voxel_size_m();
  std::vector<const Stack*> changed;
  Difference d;
  for (const auto& [at, stack] : stacks) {
    if (stack.changed == 0) continue;
    changed.push_back(&stack);
    for (int n = 0; n < 64; ++n) {
      if ((stack.changed >> n & 1) == 0) continue;
      const Vec3 low(at.first + (n >> 3) - 0.5, at.second + (n & 7) - 0.5, 0);
      d.box.extend(soil.world_from_index(low).head<2>());
      d.box.extend(soil.world_from_index(low + Vec3::Ones()).head<2>());
    }
  }
  std::vector<double> areas(changed.size());
  tbb::parallel_for(std::size_t{0}, changed.size(),
                    [&](std::size_t i) { areas[i] = columns(soils, stacks, *changed[i]); });
  for (const double area : areas) d.area_m2 += area * h * h;
  d.cut_m3 = static_cast<double>(cut) * soil.sample_m3();
  d.fill_m3 = static_cast<double>(fill) * soil.sample_m3();
  d.net_m3 = static_cast<double>(fill - cut) * soil.sample_m3();
  d.error_m3 = 2 * kCountError * h * h * h * std::sqrt(static_cast<double>(mixed));
  d.exact = true;
  return d;
}

}  // namespace

Difference difference(const Soil& before, const Soil& after, bool same_base) {
  if (same_base) {
    if (const auto shift = lattice_shift(before, after))
      return by_samples(Pair(before, after, *shift));
  }
  return column_difference(before, after);
}

void for_each_gain(const Soil& before, const Soil& after, bool same_base, const ColumnGrid& grid,
                   const GainFunction& f) {
  const auto shift = same_base ? lattice_shift(before, after) : std::nullopt;
  if (shift) {
    const Pair pair(before, after, *shift);
    return for_each_gain(
        before, pair.chunks(),
        [&](const Coord3& origin, SampleWords& a, SampleWords& b) { pair.read(origin, a, b); },
        grid, f);
  }
  // Against the ground that is no soil's, which is beneath both.
  for (const double sign : {1.0, -1.0}) {
    const Soil* soil = sign > 0 ? &after : &before;
    for (; soil != nullptr; soil = soil->base().soil())
      for_each_gain(*soil, grid, [&](const ColumnGrid::Column& column, const Gain& gain) {
        f(column, {sign * gain.m3, gain.variance});
      });
  }
}

}  // namespace soilvdb
