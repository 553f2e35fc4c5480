// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The update loop: a new machine state in, ground and volumes brought up to date.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "soilvdb/bucket.h"
#include "soilvdb/earthmoving.h"
#include "soilvdb/ground.h"
#include "soilvdb/mass.h"
#include "soilvdb/motion.h"

namespace soilvdb::inline v0 {

/// What is booked for one machine, or for all. cut = captured + displaced, volumes in place. Kept
/// as counts, so sums are exact in any order.
struct Ledger {
  std::int64_t captured = 0, displaced = 0;  ///< samples
  std::int64_t load = 0;                     ///< what the bucket holds, in units of mass
  std::int64_t spilled = 0, dumped = 0;      ///< the same that left it; the part by dump_angle
  MassUnits units;
  double sample_m3 = 0;

  std::int64_t cut() const { return captured + displaced; }  ///< samples
  double cut_m3() const { return static_cast<double>(cut()) * sample_m3; }
  double captured_m3() const { return static_cast<double>(captured) * sample_m3; }
  double displaced_m3() const { return static_cast<double>(displaced) * sample_m3; }
  /// Loose volumes: what the bucket holds, and what left it.
  double bucket_m3() const { return units.loose_samples(load) * sample_m3; }
  double spilled_m3() const { return units.loose_samples(spilled) * sample_m3; }
  double dumped_m3() const { return units.loose_samples(dumped) * sample_m3; }
};

/// What is booked for a site whose soil moves, besides its machines. Masses in units.
struct MassBalance {
  std::int64_t ground = 0;  ///< change of the ground's mass, counted anew
  /// Pushed, or out of a bucket, and not yet come down; or lost off the terrain. At rest less than
  /// a sample each.
  std::int64_t pending = 0;
  std::int64_t lost_off_terrain = 0;  ///< the part of it that fell where the terrain has no ground
  std::int64_t poured = 0;            ///< brought by pours
  std::int64_t hauled = 0;            ///< into hoppers
  std::int64_t slid = 0;              ///< moved because slopes failed
  /// Added to the ground, less the samples that failed slopes lost: the ground's change is this
  /// less the cut.
  std::int64_t fill_samples = 0;
  MassUnits units;
};

/// What one update did.
struct Update {
  double cut_m3 = 0;      ///< removed from the ground by this update
  double bucket_m3 = 0;   ///< in the bucket after it, loose
  double spilled_m3 = 0;  ///< that left the bucket in it, loose
  double slid_m3 = 0;     ///< of slopes that came down in it, loose
  double us = 0;          ///< it took, with its share of what was done for several at once
};

/// What a machine is to do next: go straight on to a pose or, with a motion, along that from
/// `begin_s`, where it is, to `end_s`.
struct Move {
  std::size_t machine = 0;
  Pose to;
  const Motion* motion = nullptr;
  double begin_s = 0, end_s = 0;
};

/// A move that can't be made, and why.
struct InvalidMove {
  std::size_t move = 0;    ///< which of those that were asked for
  bool no_ground = false;  ///< its bucket reaches ground without a height; else it is no move
  std::string why;
};

class Machine;  // core/site/machine.h
class Settler;  // core/settle/settler.h

/// Tracks the ground and the loads of a site's machines.
///
/// Updates throw std::invalid_argument for a pose that isn't finite, has no unit rotation or is
/// more than 2^23 voxels from the ground's origin, for times that aren't finite or in order, and
/// for a machine that isn't there; the ground and the tracker are then as they were. Where
/// Ground::set_memory_limit() is set, they throw std::runtime_error if the store fails: before
/// anything is dug the ground is whole (Ground::evict()), while it is dug it is of no use any more.
///
/// ```
/// Ground ground(0.05, origin, make_plane(0, {0, 0}));
/// Tracker tracker(ground, {bucket});
/// for (const Pose& world_from_bucket : poses)
///   load = tracker.update(0, world_from_bucket).bucket_m3;
/// ```
class Tracker {
 public:
  /// @param ground outlives the tracker. @throw std::invalid_argument for a bad bucket.
  Tracker(Ground& ground, std::vector<Bucket> buckets);
  /// The same on soil that moves: it fills a bucket to its capacity, spills, piles up and slides.
  /// @throw std::invalid_argument for properties that are none
  Tracker(Ground& ground, std::vector<Bucket> buckets, Earthmoving earthmoving);
  /// A tracker of its own that goes on as the other would, to the last bit. The other may go first,
  /// and both may go on at once. Takes some microseconds a machine.
  /// @param clone Ground::clone() of the other's, made since the other's last update; outlives this
  /// @throw std::invalid_argument for soil with another base surface, voxel size or origin
  Tracker(Ground& clone, const Tracker& other);
  ~Tracker();

  /// Moves a machine's bucket on to a pose, in a straight line and by slerp from the last one. The
  /// first update of a machine places its bucket. @throw NoGroundError
  Update update(std::size_t machine, const Pose& world_from_bucket);
  /// Moves it along a motion from one time to another. The first is that of the update before (for
  /// a machine's first update: where it starts).
  Update update(std::size_t machine, const Motion& motion, double begin_s, double end_s);
  /// The same for many moves, one update each. Machines that are far enough apart move in parallel;
  /// the result is that of the moves one after another, bit for bit.
  /// @throw NoGroundError; other machines may then have moved further than this one
  std::vector<Update> update(std::span<const Move> moves);

  /// The first of these moves that update() would refuse, if any; nothing is moved.
  /// @throw as update() does, but for what it finds
  std::optional<InvalidMove> first_invalid(std::span<const Move> moves);

  /// What of a pour, one of those that the tracker was made with, has come down by a time comes to
  /// lie. The result doesn't depend on how often this is called.
  Update pour(std::size_t pour, double until_s);
  /// All that is under way comes to rest, as at the next standstill. @param time_s says which
  /// hoppers are there; without: all
  Update come_to_rest(std::optional<double> time_s = {});

  const Ledger& ledger(std::size_t machine) const;
  /// Where soil is besides the ground and the buckets; zeros where it doesn't move.
  MassBalance mass_balance() const;
  /// The same but for `ground`, whose chunks are counted: in microseconds, however many they are.
  MassBalance mass_balance_without_ground() const;
  Ledger total() const;

  /// How far the path that is dug may be from a machine's own: no more than this over the bucket.
  double tolerance_m() const;

  /// All that the next update depends on besides the ground, as bytes. A tracker of the same
  /// buckets on the ground as it is then goes on from there as this one would.
  std::string state() const;
  /// @throw std::invalid_argument if these bytes are of other buckets, or not from state()
  void restore(std::string_view state);

 private:
  Machine& at(std::size_t machine) const;
  void check(const Move& move) const;
  std::int64_t mass_of(const Pour& pour) const;
  std::int64_t poured(const Pour& pour, std::int64_t parts) const;
  double slid_m3(std::int64_t before) const;
  std::vector<std::vector<std::size_t>> apart(std::span<const Move> moves) const;
  Ground& ground_;
  Earthmoving earthmoving_;
  std::unique_ptr<Settler> settler_;  // null: soil doesn't move
  std::vector<std::unique_ptr<Machine>> machines_;
  std::vector<std::int64_t> poured_parts_;  // of each pour
};

}  // namespace soilvdb::inline v0
