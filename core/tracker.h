// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The update loop: a new machine state in, ground and volumes brought up to date.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/bucket.h"
#include "core/soil.h"

namespace soilvdb {

/// Volumes booked for one machine, or for all. cut = captured + displaced. Kept as counts of
/// samples, so sums are exact in any order.
struct Ledger {
  std::int64_t captured = 0, displaced = 0, dumped = 0;  ///< samples
  double sample_m3 = 0;

  double cut_m3() const { return static_cast<double>(captured + displaced) * sample_m3; }
  double captured_m3() const { return static_cast<double>(captured) * sample_m3; }
  double displaced_m3() const { return static_cast<double>(displaced) * sample_m3; }
  double dumped_m3() const { return static_cast<double>(dumped) * sample_m3; }
  /// What the bucket holds.
  double bucket_m3() const { return static_cast<double>(captured - dumped) * sample_m3; }
};

/// What one update did.
struct Update {
  double cut_m3 = 0;     ///< removed from the ground by this update
  double bucket_m3 = 0;  ///< in the bucket after it
};

/// Tracks the ground and the loads of a site's machines.
///
/// ```
/// Soil soil(0.05, origin, make_plane(0, {0, 0}));
/// Tracker tracker(soil, {bucket});
/// for (const Pose& world_from_bucket : poses)
///   load = tracker.update(0, world_from_bucket).bucket_m3;
/// tracker.flush();   // before reading phi
/// ```
class Tracker {
 public:
  /// @param soil outlives the tracker. @throw std::invalid_argument for a bad bucket.
  Tracker(Soil& soil, std::vector<Bucket> buckets);
  ~Tracker();

  /// Moves a machine's bucket on to a pose, in a straight line and by slerp from the last one. The
  /// first update of a machine places its bucket.
  Update update(std::size_t machine, const Pose& world_from_bucket);

  /// Moves it along a path, as from Motion::trace(), whose first pose is the last of the update
  /// before (for a machine's first update: where it starts).
  Update update(std::size_t machine, std::span<const Pose> path);

  /// Brings phi up to date with the samples. Updates do so by themselves, a part each, and are
  /// never more than eight voxels of travel behind.
  void flush();

  const Ledger& ledger(std::size_t machine) const;
  Ledger total() const;
  /// Origins of the chunks whose phi changed since the last call, sorted; calls flush() first.
  std::vector<Coord3> take_changed();

  /// How far apart poses on a path may be (Motion::trace's tolerance and stride).
  double tolerance_m() const;
  double stride_m() const;

 private:
  struct Machine;
  void compact_changed();
  Soil& soil_;
  std::vector<std::unique_ptr<Machine>> machines_;
  std::vector<Coord3> changed_;     // with repeats
  std::size_t changed_unique_ = 0;  // of those, when they were last counted
};

}  // namespace soilvdb
