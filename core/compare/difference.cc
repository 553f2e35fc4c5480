// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/difference.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <stdexcept>
#include <utility>
#include <vector>

#include "core/compare/box_difference.h"
#include "core/compare/changed_area.h"
#include "core/constants.h"
#include "core/lattice/chunk_math.h"
#include "core/tool/polygon.h"
#include "soilvdb/chunk_range.h"
#include "soilvdb/lattice.h"
#include "soilvdb/volume_changes.h"

namespace soilvdb::inline v0 {
namespace {

/// Two grounds of one lattice, in the index space of the first.
class Pair {
 public:
  Pair(const Ground& a, const Ground& b, const Coord3& shift) : a_(a), b_(b), shift_(shift) {}

  const Ground& first() const { return a_; }
  std::vector<Coord3> chunks() const {
    std::vector<Coord3> all = a_.origins();
    for (const Chunk* chunk : b_.chunks()) all.push_back(chunk->origin + shift_);
    sort_once(all);
    return all;
  }
  /// With different origins, rounding may put the terrain on different sides of a sample. Samples
  /// that neither ground has changed are therefore equal.
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
  const Ground &a_, &b_;
  Coord3 shift_;
};

/// The changes in the chunks of a column.
struct Stack {
  std::int64_t cut = 0, fill = 0, mixed = 0;
  ChangedColumns columns;
};

/// The samples of a ground inside a boundary.
class Inside {
 public:
  /// @param boundary null: all samples are inside
  Inside(const Ground& ground, const std::vector<Vec2>* boundary) {
    if (boundary == nullptr) return;
    for (const Vec2& corner : *boundary)
      polygon_.push_back(ground.index_from_world({corner.x(), corner.y(), 0}).head<2>());
  }

  /// Samples of a column of chunks: all, none, or those of at().
  enum class Part { kAll, kNone, kSome };
  Part part(const Coord3& chunk) const {
    if (polygon_.empty()) return Part::kAll;
    const Vec2 low = chunk.head<2>().cast<double>() - Vec2::Constant(0.5);
    const Eigen::AlignedBox2d box(low, low + Vec2::Constant(kChunkSide));
    for (std::size_t i = 0, j = polygon_.size() - 1; i < polygon_.size(); j = i++)
      if (Eigen::AlignedBox2d(polygon_[i].cwiseMin(polygon_[j]), polygon_[i].cwiseMax(polygon_[j]))
              .intersects(box))
        return Part::kSome;
    return inside(polygon_, box.center()) ? Part::kAll : Part::kNone;
  }

  std::uint64_t at(const Coord3& voxel, std::uint64_t samples) const {
    const CellPoints& points = sample_points(voxel);
    std::uint64_t in = 0;
    for (std::uint64_t rest = samples; rest != 0; rest &= rest - 1) {
      const int i = std::countr_zero(rest);
      const Vec2 p(voxel.x() - 0.5 + double{points.x[i]}, voxel.y() - 0.5 + double{points.y[i]});
      if (inside(polygon_, p)) in |= std::uint64_t{1} << i;
    }
    return in;
  }

 private:
  std::vector<Vec2> polygon_;  // in index space
};

Stack compare(const Pair& soils, const Inside& boundary, const Coord3* first, const Coord3* last) {
  Stack stack;
  const Inside::Part part = boundary.part(*first);
  if (part == Inside::Part::kNone) return stack;
  SampleWords a, b;
  std::array<int, 64> count{}, levels{}, most{};
  const auto mixed = [](std::uint64_t word) { return word != 0 && word != kAllSoil; };
  for (; first != last; ++first) {
    soils.read(*first, a, b);
    for (std::size_t n = 0; n < a.size(); ++n) {
      if (a[n] == b[n]) continue;
      if (part == Inside::Part::kSome) {
        const int i = static_cast<int>(n);
        const std::uint64_t in = boundary.at(*first + numbered_voxel(i), a[n] ^ b[n]);
        b[n] = a[n] ^ in;
      }
      const int cut = std::popcount(a[n] & ~b[n]), fill = std::popcount(b[n] & ~a[n]);
      stack.cut += cut;
      stack.fill += fill;
      stack.mixed += mixed(a[n]) + mixed(b[n]);
      count[n >> 3] += cut + fill;
      most[n >> 3] = std::max(most[n >> 3], cut + fill);
      ++levels[n >> 3];
    }
  }
  for (std::size_t n = 0; n < count.size(); ++n)
    stack.columns[n] = changed_column(count[n] / 64.0, most[n] / 64.0, levels[n], count[n] > 0);
  return stack;
}

Difference by_samples(const Pair& soils, const std::vector<Vec2>* boundary = nullptr) {
  const Inside in(soils.first(), boundary);
  const std::vector<Coord3> origins = soils.chunks();
  std::vector<std::size_t> firsts;  // of each stack
  for (std::size_t i = 0; i < origins.size(); ++i)
    if (i == 0 || origins[i].head<2>() != origins[i - 1].head<2>()) firsts.push_back(i);
  std::vector<Stack> stacks(firsts.size());
  firsts.push_back(origins.size());
  tbb::parallel_for(std::size_t{0}, stacks.size(), [&](std::size_t i) {
    stacks[i] = compare(soils, in, &origins[firsts[i]], origins.data() + firsts[i + 1]);
  });
  std::int64_t cut = 0, fill = 0, mixed = 0;
  const Ground& ground = soils.first();
  const double h = ground.voxel_size_m();
  Difference d;
  ColumnChanges changes;
  for (std::size_t i = 0; i < stacks.size(); ++i) {
    const Stack& stack = stacks[i];
    if (stack.cut + stack.fill == 0) continue;
    cut += stack.cut;
    fill += stack.fill;
    mixed += stack.mixed;
    const Coord3& at = origins[firsts[i]];
    changes.emplace(std::pair(at.x(), at.y()), stack.columns);
    for (int n = 0; n < 64; ++n) {
      if (!stack.columns[static_cast<std::size_t>(n)].certain) continue;
      const Vec3 low(at.x() + (n >> 3) - 0.5, at.y() + (n & 7) - 0.5, 0);
      d.box.extend(ground.world_from_index(low).head<2>());
      d.box.extend(ground.world_from_index(low + Vec3::Ones()).head<2>());
    }
  }
  d.area_m2 = changed_columns(changes) * h * h;
  d.cut_m3 = static_cast<double>(cut) * ground.sample_m3();
  d.fill_m3 = static_cast<double>(fill) * ground.sample_m3();
  d.net_m3 = static_cast<double>(fill - cut) * ground.sample_m3();
  d.error_m3 = kErrorSigmas * kWorstCountError * h * h * h * std::sqrt(static_cast<double>(mixed));
  d.exact = true;
  return d;
}

}  // namespace

Difference difference(const Ground& before, const Ground& after, bool same_base) {
  if (same_base) {
    if (const auto shift = lattice_shift(before, after))
      return by_samples(Pair(before, after, *shift));
  }
  return box_difference(before, after);
}

Difference difference(const Ground& before, const Ground& after,
                      const std::vector<Vec2>& boundary) {
  if (crosses_itself(boundary))
    throw std::invalid_argument(
        "the boundary crosses itself; its corners must be in order around what it encloses");
  const auto shift = lattice_shift(before, after);
  if (!shift)
    throw std::invalid_argument("grounds of two lattices can't be compared inside a boundary");
  Difference d = by_samples(Pair(before, after, *shift), &boundary);
  d.area_m2 = area_of(boundary);
  return d;
}

void for_each_volume_change(const Ground& before, const Ground& after, bool same_base,
                            const VolumeBins& bins, const VolumeChangeFunction& f) {
  const auto shift = same_base ? lattice_shift(before, after) : std::nullopt;
  if (shift) {
    const Pair pair(before, after, *shift);
    return for_each_volume_change(
        before, pair.chunks(),
        [&](const Coord3& origin, SampleWords& a, SampleWords& b) { pair.read(origin, a, b); },
        bins, f);
  }
  // Against the terrain beneath both, which is not the surface of a ground.
  for (const double sign : {1.0, -1.0}) {
    const Ground* ground = sign > 0 ? &after : &before;
    for (; ground != nullptr; ground = ground->terrain().ground())
      for_each_volume_change(*ground, bins,
                             [&](const VolumeBins::Box& box, const VolumeChange& gain) {
                               f(box, {sign * gain.m3, gain.variance});
                             });
  }
}

}  // namespace soilvdb::inline v0
