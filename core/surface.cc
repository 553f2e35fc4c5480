// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/surface.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <memory>

#include "core/chunk_range.h"

namespace soilvdb {
namespace {

constexpr int kHalo = kLeafSide + 2;

/// Counts of soil in a chunk's cells and those around it, and whether they are the base surface's.
struct Window {
  std::array<std::uint8_t, kHalo * kHalo * kHalo> count;
  std::array<bool, kHalo * kHalo * kHalo> same;
  static int at(int x, int y, int z) { return ((x + 1) * kHalo + y + 1) * kHalo + z + 1; }

  Window(const Soil& soil, const Soil& untouched, const Coord3& origin) {
    SampleWords now, base;
    for (int c = 0; c < 27; ++c) {
      const Coord3 step(c / 9 - 1, c / 3 % 3 - 1, c % 3 - 1);
      const Coord3 chunk = origin + kLeafSide * step;
      soil.read_samples(chunk, now);
      base = now;
      if (soil.find(chunk) != nullptr) untouched.read_samples(chunk, base);
      const auto first = [&](int a) { return step[a] < 0 ? -1 : step[a] > 0 ? kLeafSide : 0; };
      const auto last = [&](int a) { return step[a] == 0 ? kLeafSide - 1 : first(a); };
      for (int x = first(0); x <= last(0); ++x)
        for (int y = first(1); y <= last(1); ++y)
          for (int z = first(2); z <= last(2); ++z) {
            const auto n = static_cast<std::size_t>((x & 7) * 64 + (y & 7) * 8 + (z & 7));
            const auto i = static_cast<std::size_t>(at(x, y, z));
            count[i] = static_cast<std::uint8_t>(std::popcount(now[n]));
            same[i] = now[n] == base[n];
          }
    }
  }
};

}  // namespace

void surface_distance(const Soil& soil, const Coord3& chunk_origin, float* phi_m) {
  const double h = soil.voxel_size_m(), band = soil.band_m();
  const Vec3 first = soil.world_from_index(chunk_origin.cast<double>());
  soil.base().distance(first, h, band, phi_m);
  if (soil.find(chunk_origin) == nullptr) return;
  const Soil untouched(h, soil.origin(), soil.shared_base());
  const Window w(soil, untouched, chunk_origin);
  for (int n = 0; n < kLeafSize; ++n) {
    const int x = n >> 6, y = n >> 3 & 7, z = n & 7;
    double sum = 0;
    Vec3 gradient = Vec3::Zero();
    bool same = true;
    for (int c = 0; c < 27; ++c) {
      const Coord3 step(c / 9 - 1, c / 3 % 3 - 1, c % 3 - 1);
      const auto i = static_cast<std::size_t>(Window::at(x + step.x(), y + step.y(), z + step.z()));
      const double f = w.count[i] / 64.0;
      sum += f;
      gradient += f * (8 >> step.cwiseAbs().sum()) * step.cast<double>();
      same &= w.same[i];
    }
    if (same) continue;
    const double own = w.count[static_cast<std::size_t>(Window::at(x, y, z))] / 64.0;
    const double length = gradient.norm(), wide = gradient.cwiseAbs().sum();
    double phi = (0.5 - own) * h * (length > 0 ? wide / length : 1);
    if (own == 0) phi = sum == 0 ? band : std::max(0.5 * h, (0.5 - sum / 27) * 3 * h);
    if (own == 1) phi = sum == 27 ? -band : std::min(-0.5 * h, (0.5 - sum / 27) * 3 * h);
    phi_m[n] = static_cast<float>(std::clamp(phi, -band, band));
  }
}

std::optional<double> surface_height(const Soil& soil, double x, double y) {
  const std::optional<double> base = soil.base().height(x, y);
  if (!base) return std::nullopt;
  const Vec3 top = soil.index_from_world({x, y, *base});
  Coord3 cell = (top + Vec3::Constant(0.5)).array().floor().matrix().cast<int>();
  SampleWords words;
  const auto chunk_at = [](const Coord3& c) { return Coord3(c.x() & ~7, c.y() & ~7, c.z() & ~7); };
  for (const Chunk* above; (above = soil.find(chunk_at(cell))) != nullptr && above->now > 0;)
    cell.z() = (cell.z() | 7) + 1;
  bool changed = false;
  double part = 0;  // of cells, in soil above the first full one
  for (;; cell.z() -= kLeafSide) {
    const Coord3 origin = chunk_at(cell);
    const Chunk* chunk = soil.find(origin);
    if (chunk == nullptr) {
      if (origin.z() > top.z()) continue;
      if (!changed) return base;
      return soil.world_from_index({0, 0, origin.z() + kLeafSide - 0.5 + part}).z();
    }
    changed |= chunk->now != chunk->base;
    if (chunk->now == 0) continue;
    soil.read_samples(origin, words);
    for (int z = kLeafSide - 1; z >= 0; --z) {
      const auto n = static_cast<std::size_t>((cell.x() & 7) * 64 + (cell.y() & 7) * 8 + z);
      if (words[n] == kAllSoil)
        return changed ? soil.world_from_index({0, 0, origin.z() + z + 0.5 + part}).z() : *base;
      part += std::popcount(words[n]) / 64.0;
    }
  }
}

}  // namespace soilvdb
