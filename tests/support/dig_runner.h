// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Runs a dig through a tracker, its motion split evenly into updates.
#pragma once

#include <cmath>

#include "core/constants.h"
#include "soilvdb/tracker.h"
#include "tests/support/scenarios.h"

namespace soilvdb::test {

/// One machine digs `dig.motion` in `updates` updates.
inline void run(Tracker& tracker, const Dig& dig, int updates, std::size_t machine = 0) {
  const double begin = dig.motion.begin_s(), span = dig.motion.end_s() - begin;
  for (int i = 0; i < updates; ++i) {
    const double from = begin + span * i / updates, to = begin + span * (i + 1) / updates;
    tracker.update(machine, dig.motion, from, to);
  }
}

/// A ground in which a dig was dug.
struct Dug {
  Ground ground;
  Tracker tracker;
  Dug(const Dig& dig, double voxel_size_m, int updates)
      : ground(voxel_size_m, dig.origin, dig.terrain), tracker(ground, {dig.bucket}) {
    run(tracker, dig, updates);
  }
  double cut_m3() const { return tracker.total().cut_m3(); }
};

/// Cells that lost some of their 64 samples but not all: those that the cut's border runs through.
inline std::int64_t border_cells(const Ground& ground) {
  const Ground before(ground.voxel_size_m(), ground.origin(),
                      {std::shared_ptr<const InitialTerrain>(), &ground.terrain()});
  std::int64_t cells = 0;
  SampleWords then, now;
  for (const Chunk* chunk : ground.chunks()) {
    before.read_samples(chunk->origin, then);
    ground.read_samples(chunk->origin, now);
    for (std::size_t n = 0; n < then.size(); ++n) {
      const std::uint64_t lost = then[n] & ~now[n];
      cells += lost != 0 && lost != ~std::uint64_t{0};
    }
  }
  return cells;
}

/// Standard error of a volume counted on so many cells that surfaces cut.
/// @param error of one, as in the worst direction unless directions are many
inline double count_error_m3(double voxel_size_m, double cells, double error = kWorstCountError) {
  return error * std::pow(voxel_size_m, 3) * std::sqrt(cells);
}
/// That of what was cut from a ground.
inline double count_error_m3(const Ground& ground) {
  return count_error_m3(ground.voxel_size_m(), static_cast<double>(border_cells(ground)));
}

}  // namespace soilvdb::test
