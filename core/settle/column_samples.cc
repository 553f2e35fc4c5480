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
#include "soilvdb/chunk_range.h"

namespace soilvdb::inline v0 {
namespace {

constexpr int kSideMask = kChunkSide - 1;

/// What surfaces pass through of one chunk.
struct Part {
  Coord3 origin;
  std::span<const ColumnSurface> surfaces;
};

/// By chunks in their order, each with the surfaces over it.
class Parts {
 public:
  explicit Parts(std::span<const ColumnSurface> surfaces)
      : sorted_(surfaces.begin(), surfaces.end()) {
    const auto chunk = [](const ColumnSurface& s) {
      return std::pair(s.cell.x() & ~kSideMask, s.cell.y() & ~kSideMask);
    };
    std::sort(sorted_.begin(), sorted_.end(), [&](const auto& a, const auto& b) {
      if (chunk(a) != chunk(b)) return chunk(a) < chunk(b);
      return std::pair(a.cell.x(), a.cell.y()) < std::pair(b.cell.x(), b.cell.y());
    });
    for (auto from = sorted_.begin(); from != sorted_.end();) {
      const auto to = std::find_if(from, sorted_.end(),
                                   [&](const auto& s) { return chunk(s) != chunk(*from); });
      int low = from->low, high = from->high;
      for (auto s = from; s != to; ++s) low = std::min(low, s->low), high = std::max(high, s->high);
      const auto [x, y] = chunk(*from);
      for (int z = low & ~kSideMask; z <= high; z += kChunkSide)
        parts_.push_back({{x, y, z}, {from, to}});
      from = to;
    }
  }
  const std::vector<Part>& all() const { return parts_; }

 private:
  std::vector<ColumnSurface> sorted_;
  std::vector<Part> parts_;
};

int cell_number(const ColumnSurface& s, int z) {
  return (s.cell.x() & kSideMask) << 6 | (s.cell.y() & kSideMask) << 3 | (z & kSideMask);
}

/// Calls f(surface, z, n) for each cell of a part that a surface concerns; n: its number.
template <typename F>
void for_each_cell(const Part& part, const F& f) {
  for (const ColumnSurface& s : part.surfaces) {
    const int from = std::max(s.low, part.origin.z());
    const int to = std::min(s.high, part.origin.z() + kSideMask);
    for (int z = from; z <= to; ++z) f(s, z, cell_number(s, z));
  }
}

/// Height of a surface over a place in the column.
float height_at(const ColumnSurface& s, float slope, float x, float y) {
  if (!s.cone) return s.height + s.a * (x - 0.5f) + s.b * (y - 0.5f);
  const float dx = x - s.a, dy = y - s.b;
  return s.height - slope * (s.beyond + std::sqrt(dx * dx + dy * dy));
}

/// Most that a point of a cell in the column is higher above the surface than its middle.
float reach(const ColumnSurface& s, float slope) {
  return 0.5f + (s.cone ? 0.70711f * slope : 0.5f * (std::abs(s.a) + std::abs(s.b)));
}

float middle_above(const ColumnSurface& s, float slope, int z) {
  return static_cast<float>(z - s.low) + 0.5f - height_at(s, slope, 0.5f, 0.5f);
}

using Heights = std::array<float, 64>;

/// How far the points of a cell are above the surface.
void heights_above(const ColumnSurface& s, float slope, int z, Heights& above) {
  const CellPoints& points = sample_points({s.cell.x(), s.cell.y(), z});
  const float low = static_cast<float>(z - s.low);
  for (std::size_t i = 0; i < 64; ++i)
    above[i] = low + points.z[i] - height_at(s, slope, points.x[i], points.y[i]);
}

/// A cell of which not all points, or none, are to be filled for sure.
struct ShellCell {
  std::size_t part;
  const ColumnSurface* surface;
  int z, number;
  std::uint64_t air;
};

/// Fixed point, so that samples are ordered the same whatever made their heights.
std::int32_t key_of(float above) {
  constexpr float kMost = 1 << 14;
  return static_cast<std::int32_t>(std::clamp(above, -kMost, kMost) * 65536.0f);
}

/// Marks those of the least keys, exactly `count`. @return the marks, by the order of the keys
std::vector<bool> least(const std::vector<std::int32_t>& keys, std::int64_t count) {
  std::vector<bool> chosen(keys.size());
  if (count <= 0) return chosen;
  if (static_cast<std::size_t>(count) >= keys.size()) {
    chosen.assign(keys.size(), true);
    return chosen;
  }
  constexpr int kBins = 4096;
  const auto [low, high] = std::minmax_element(keys.begin(), keys.end());
  const std::int64_t width = (std::int64_t{*high} - *low) / kBins + 1;
  const auto bin = [&, low = *low](std::int32_t key) {
    return static_cast<std::size_t>((std::int64_t{key} - low) / width);
  };
  std::vector<std::int64_t> sizes(kBins);
  for (const std::int32_t key : keys) ++sizes[bin(key)];
  std::size_t last = 0;
  std::int64_t before = 0;
  while (before + sizes[last] < count) before += sizes[last++];
  std::vector<std::pair<std::int32_t, std::size_t>> edge;
  for (std::size_t i = 0; i < keys.size(); ++i) {
    const std::size_t b = bin(keys[i]);
    if (b < last) chosen[i] = true;
    if (b == last) edge.emplace_back(keys[i], i);
  }
  const auto end = edge.begin() + static_cast<std::ptrdiff_t>(count - before);
  std::nth_element(edge.begin(), end, edge.end());
  for (auto e = edge.begin(); e != end; ++e) chosen[e->second] = true;
  return chosen;
}

/// What is added to each part.
class Fill {
 public:
  Fill(const Soil& soil, const std::vector<Part>& parts, float slope)
      : parts_(parts), slope_(slope), air_(parts.size()), added_(parts.size()) {
    tbb::parallel_for(std::size_t{0}, parts.size(), [&](std::size_t i) {
      SampleWords words;
      soil.read_samples(parts[i].origin, words);
      air_[i].fill(0);
      for_each_cell(parts[i], [&](const ColumnSurface&, int, int n) {
        air_[i][static_cast<std::size_t>(n)] = ~words[static_cast<std::size_t>(n)];
      });
    });
  }

  /// Chooses samples, with those looked at one by one that are this near to a surface.
  /// @return whether that decided it
  bool choose(std::int64_t count, float near) {
    std::int64_t sure = 0;
    shell_.clear();
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      added_[i].fill(0);
      for_each_cell(parts_[i], [&](const ColumnSurface& s, int z, int number) {
        const auto n = static_cast<std::size_t>(number);
        const std::uint64_t air = air_[i][n];
        if (air == 0) return;
        const float middle = middle_above(s, slope_, z), r = reach(s, slope_);
        if (middle - r > near) return;
        if (middle + r >= -near) {
          shell_.push_back({i, &s, z, number, air});
          return;
        }
        added_[i][n] = air;
        sure += std::popcount(air);
      });
    }
    if (sure > count) return false;
    std::vector<std::int32_t> keys;
    Heights above;
    for (const ShellCell& cell : shell_) {
      heights_above(*cell.surface, slope_, cell.z, above);
      for (std::uint64_t left = cell.air; left != 0; left &= left - 1)
        keys.push_back(key_of(above[static_cast<std::size_t>(std::countr_zero(left))]));
    }
    const auto shell = static_cast<std::int64_t>(keys.size());
    chosen_ = sure + std::min(shell, count - sure);
    const std::vector<bool> chosen = least(keys, count - sure);
    std::size_t next = 0;
    for (const ShellCell& cell : shell_) {
      for (std::uint64_t left = cell.air; left != 0; left &= left - 1) {
        if (chosen[next++])
          added_[cell.part][static_cast<std::size_t>(cell.number)] |= left & (~left + 1);
      }
    }
    return chosen_ == count;
  }

  std::int64_t chosen() const { return chosen_; }

  void write(Soil& soil) const {
    std::vector<SoilWriter::Edit> edits;
    std::vector<const SampleWords*> added;
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      const auto some = [](std::uint64_t word) { return word != 0; };
      if (std::none_of(added_[i].begin(), added_[i].end(), some)) continue;
      edits.push_back({parts_[i].origin});
      added.push_back(&added_[i]);
    }
    const auto add = [](const SampleWords& more, Samples& to) {
      SampleWords words;
      to.expand(words);
      for (std::size_t n = 0; n < words.size(); ++n) words[n] |= more[n];
      to.assign(words);
    };
    SoilWriter(soil).edit(SoilWriter::Operation::kAdd, edits, kParallelFill,
                          [&](std::size_t i, Samples& samples, Samples& loose) {
                            add(*added[i], samples);
                            add(*added[i], loose);
                            return true;
                          });
  }

 private:
  const std::vector<Part>& parts_;
  float slope_;
  std::vector<SampleWords> air_, added_;
  std::vector<ShellCell> shell_;
  std::int64_t chosen_ = 0;
};

}  // namespace

std::int64_t fill_below(Soil& soil, std::span<const ColumnSurface> surfaces, double slope,
                        std::int64_t samples) {
  if (samples <= 0 || surfaces.empty()) return 0;
  const Parts parts(surfaces);
  Fill fill(soil, parts.all(), static_cast<float>(slope));
  for (float near = kFillNear; !fill.choose(samples, near) && near < kFillFar; near *= 4) {
  }
  fill.write(soil);
  return fill.chosen();
}

Taken remove_above(Soil& soil, std::span<const ColumnSurface> surfaces, double slope, bool bank) {
  const Parts parts(surfaces);
  std::vector<SoilWriter::Edit> edits;
  for (const Part& part : parts.all()) edits.push_back({part.origin});
  std::vector<Taken> taken(edits.size());
  const auto steep = static_cast<float>(slope);
  const auto remove = [&](std::size_t i, Samples& samples, Samples& loose) {
    Heights above;
    for_each_cell(parts.all()[i], [&](const ColumnSurface& s, int z, int n) {
      const std::uint64_t word = samples.word(n), loose_word = loose.word(n);
      const std::uint64_t may_go = bank ? word : loose_word;
      const float middle = middle_above(s, steep, z), r = reach(s, steep);
      if (may_go == 0 || middle + r < 0) return;
      std::uint64_t gone = may_go;
      if (middle - r <= 0) {
        heights_above(s, steep, z, above);
        for (std::uint64_t left = may_go; left != 0; left &= left - 1)
          if (above[static_cast<std::size_t>(std::countr_zero(left))] <= 0)
            gone ^= left & (~left + 1);
      }
      if (gone == 0) return;
      taken[i].loose += std::popcount(gone & loose_word);
      taken[i].bank += std::popcount(gone & ~loose_word);
      samples.set_word(n, word & ~gone);
      loose.set_word(n, loose_word & ~gone);
    });
    return taken[i].loose + taken[i].bank > 0;
  };
  SoilWriter(soil).edit(SoilWriter::Operation::kRemove, edits, kParallelFill, remove);
  Taken all;
  for (const Taken& part : taken) {
    all.bank += part.bank;
    all.loose += part.loose;
  }
  return all;
}

}  // namespace soilvdb::inline v0
