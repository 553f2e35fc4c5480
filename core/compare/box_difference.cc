// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/compare/box_difference.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <vector>

#include "core/compare/changed_area.h"
#include "core/constants.h"
#include "core/lattice/chunk_math.h"
#include "soilvdb/volume_changes.h"

namespace soilvdb::inline v0 {
namespace {

using Box = VolumeBins::Box;

const Ground& coarsest(const Ground& a, const Ground& b) {
  const Ground* found = &a;
  for (const Ground* top : {&a, &b})
    for (const Ground* ground = top; ground != nullptr; ground = ground->terrain().ground())
      if (ground->voxel_size_m() > found->voxel_size_m()) found = ground;
  return *found;
}

/// Gains of two grounds in a box against the terrain beneath both.
struct Change {
  Box box;
  double before_m3 = 0, after_m3 = 0, variance = 0;

  double m3() const { return after_m3 - before_m3; }
  bool certain() const { return std::abs(m3()) > kCertainSigmas * std::sqrt(variance); }
  /// Largest volume that may be both cut and filled beside the net gain.
  double hidden_m3(double box_m3) const {
    const double a = std::abs(before_m3), b = std::abs(after_m3);
    return std::max(0.0, std::min({a, b, box_m3 - a, box_m3 - b}));
  }
};

/// Changes of boxes from x = `first` on, in order.
std::vector<Change> changes(const Ground& before, const Ground& after, const VolumeBins& bins,
                            int first, int last) {
  const std::array<double, 2> range = {bins.origin.x() + (first - 0.5) * bins.side_m.x(),
                                       bins.origin.x() + (last - 0.5) * bins.side_m.x()};
  std::vector<Change> all;
  for (const bool is_after : {false, true}) {
    for (const Ground* ground = is_after ? &after : &before; ground != nullptr;
         ground = ground->terrain().ground()) {
      for_each_volume_change(
          *ground, bins,
          [&](const Box& box, const VolumeChange& gain) {
            if (box[0] < first || box[0] >= last) return;
            all.push_back({box, is_after ? 0 : gain.m3, is_after ? gain.m3 : 0, gain.variance});
          },
          range);
    }
  }
  std::stable_sort(all.begin(), all.end(),
                   [](const Change& a, const Change& b) { return a.box < b.box; });
  std::size_t size = 0;
  for (const Change& change : all) {
    if (size == 0 || all[size - 1].box != change.box) {
      all[size++] = change;
      continue;
    }
    Change& sum = all[size - 1];
    sum.before_m3 += change.before_m3;
    sum.after_m3 += change.after_m3;
    sum.variance += change.variance;
  }
  all.resize(size);
  return all;
}

/// The smaller of the certain cut and the certain fill in a box and the boxes around it.
double both_m3(const std::vector<Change>& all, const Box& box) {
  double cut = 0, fill = 0;
  for (int x = -1; x <= 1; ++x)
    for (int y = -1; y <= 1; ++y) {
      const Box low = {box[0] + x, box[1] + y, box[2] - 1};
      auto at = std::lower_bound(all.begin(), all.end(), low,
                                 [](const Change& c, const Box& b) { return c.box < b; });
      for (; at != all.end() && at->box <= Box{low[0], low[1], box[2] + 1}; ++at)
        if (at->certain()) (at->m3() < 0 ? cut : fill) += std::abs(at->m3());
    }
  return std::min(cut, fill);
}

/// The changes of the boxes of a column.
ColumnChange in_column(const Change* first, const Change* last, double box_m3) {
  double certain = 0, uncertain = 0, net = 0, variance = 0, most = 0;
  int levels = 0;
  for (const Change* c = first; c != last; ++c) {
    net += c->m3();
    variance += c->variance;
    if (!c->certain()) {
      uncertain += c->m3();
      continue;
    }
    certain += std::abs(c->m3());
    most = std::max(most, std::abs(c->m3()));
    ++levels;
  }
  const double thick = certain + (net < 0 ? -uncertain : uncertain);
  return changed_column(thick / box_m3, most / box_m3, levels,
                        thick > kCertainSigmas * std::sqrt(variance));
}

/// Slabs of boxes in which there may be changes.
std::set<int> slabs(const Ground& before, const Ground& after, const VolumeBins& bins) {
  std::set<int> all;
  const auto slab = [&](const Ground& ground, const Vec3& index) {
    const double x = bins.at(ground.world_from_index(index))[0];
    return static_cast<int>(std::floor(x / kSlabBoxes));
  };
  for (const Ground* top : {&before, &after})
    for (const Ground* ground = top; ground != nullptr; ground = ground->terrain().ground())
      for (const Chunk* chunk : ground->chunks()) {
        const Vec3 low = chunk->origin.cast<double>() - Vec3::Constant(0.5);
        const int last = slab(*ground, low + Vec3::Constant(kChunkSide));
        for (int n = slab(*ground, low); n <= last; ++n) all.insert(n);
      }
  return all;
}

}  // namespace

Difference box_difference(const Ground& before, const Ground& after) {
  const Ground& coarse = coarsest(before, after);
  const double side_m = coarse.voxel_size_m(), box_m3 = side_m * side_m * side_m;
  const VolumeBins bins{coarse.origin(), Vec3::Constant(side_m)};
  Difference d;
  double variance = 0;
  ColumnChanges columns;
  for (const int slab : slabs(before, after, bins)) {
    const int first = slab * kSlabBoxes;
    // With one more box on either side, which the boxes at the sides need.
    const std::vector<Change> all = changes(before, after, bins, first - 1, first + kSlabBoxes + 1);
    for (std::size_t i = 0, next = 0; i < all.size(); i = next) {
      const auto [x, y, z] = all[i].box;
      for (next = i; next < all.size() && all[next].box[0] == x && all[next].box[1] == y;) ++next;
      if (x < first || x >= first + kSlabBoxes) continue;
      for (std::size_t k = i; k < next; ++k) {
        const Change& c = all[k];
        (c.m3() < 0 ? d.cut_m3 : d.fill_m3) += std::abs(c.m3());
        d.net_m3 += c.m3();
        variance += c.variance;
        if (!c.certain()) d.error_m3 += std::sqrt(c.variance);
        const double hidden_m3 = c.hidden_m3(box_m3);
        if (hidden_m3 > 0) d.error_m3 += std::min(hidden_m3, both_m3(all, c.box));
      }
      const ColumnChange change = in_column(&all[i], &all[i] + (next - i), box_m3);
      columns[{floor_to(x, 8), floor_to(y, 8)}][static_cast<std::size_t>((x & 7) * 8 + (y & 7))] =
          change;
      if (!change.certain) continue;
      const Vec2 middle = bins.origin.head<2>() + side_m * Vec2(x, y);
      const Vec2 half = Vec2::Constant(side_m / 2);
      d.box.extend(Eigen::AlignedBox2d(middle - half, middle + half));
    }
  }
  d.error_m3 += kErrorSigmas * std::sqrt(variance);
  d.area_m2 = changed_columns(columns) * side_m * side_m;
  return d;
}

}  // namespace soilvdb::inline v0
