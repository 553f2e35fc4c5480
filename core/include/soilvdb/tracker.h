// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The update loop: a machine state updates ground and volumes.
#pragma once

#include <cstdint>
#include <functional>
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
#include "soilvdb/survey.h"
#include "soilvdb/survey_heights.h"

namespace soilvdb::inline v0 {

/// Ledger of one machine, or the total. cut = captured + displaced, volumes in place. Counts are
/// integers, so sums are exact in any order.
struct Ledger {
  std::int64_t captured = 0, displaced = 0;  ///< samples
  std::int64_t load = 0;                     ///< mass in the bucket, units of mass
  std::int64_t spilled = 0, dumped = 0;      ///< mass that left it; the part dumped by dump_angle
  MassUnits units;
  double sample_m3 = 0;

  std::int64_t cut() const { return captured + displaced; }  ///< samples
  double cut_m3() const { return static_cast<double>(cut()) * sample_m3; }
  double captured_m3() const { return static_cast<double>(captured) * sample_m3; }
  double displaced_m3() const { return static_cast<double>(displaced) * sample_m3; }
  /// Loose volumes in the bucket and out of it.
  double bucket_m3() const { return units.loose_samples(load) * sample_m3; }
  /// The load as bank soil.
  double bank_m3() const {
    return static_cast<double>(load) / static_cast<double>(units.bank) * sample_m3;
  }
  double spilled_m3() const { return units.loose_samples(spilled) * sample_m3; }
  double dumped_m3() const { return units.loose_samples(dumped) * sample_m3; }
};

/// Mass balance of a site with moving soil, without its machines, in units of mass.
struct MassBalance {
  std::int64_t ground = 0;  ///< change of the ground's mass, counted anew
  /// Soil that was pushed, that left a bucket or goes on before it, and has not come down (at rest
  /// < 1 sample for each machine), plus lost_off_terrain.
  std::int64_t pending = 0;
  std::int64_t lost_off_terrain = 0;  ///< part of `pending` that fell beyond the terrain
  std::int64_t poured = 0;            ///< brought by pours
  std::int64_t hauled = 0;            ///< received by hoppers
  std::int64_t slid = 0;              ///< moved by slope failures
  std::int64_t fill_samples = 0;      ///< added to the ground
  std::int64_t failed_samples = 0;    ///< removed from the ground by slope failures
  std::int64_t surveyed = 0;          ///< added by scans and surveys, less what they removed
  MassUnits units;
};

/// What scans and surveys corrected so far: no machine did it.
struct Surveyed {
  std::int64_t removed = 0, added = 0;  ///< samples
  std::int64_t mass = 0;                ///< added less removed, units of mass
};

/// Result of one update.
struct Update {
  double cut_m3 = 0;      ///< removed from the ground, in place
  double bucket_m3 = 0;   ///< in the bucket afterwards, loose
  double spilled_m3 = 0;  ///< left the bucket, loose
  double slid_m3 = 0;     ///< moved by slope failures, loose
  double us = 0;          ///< duration, with its share of work for several updates, us
};

/// A machine's next move: straight to a pose or along a motion from the current `begin_s` to
/// `end_s`.
struct Move {
  std::size_t machine = 0;
  Pose to;
  const Motion* motion = nullptr;
  double begin_s = 0, end_s = 0;
};

/// An invalid move and its reason.
struct InvalidMove {
  std::size_t move = 0;    ///< index among the given moves
  bool no_ground = false;  ///< the bucket reaches ground without a height; else the move is invalid
  std::string why;
};

struct ColumnEdit;  // core/settle/column_samples.h
class Machine;      // core/site/machine.h
class Settler;      // core/settle/settler.h
struct SettleTotals;
class TileSet;          // core/settle/tile_set.h
class SurveyedSamples;  // core/survey/surveyed_samples.h

/// Tracks the ground and the loads of a site's machines.
///
/// Updates throw std::invalid_argument for a pose that is not finite, has no unit rotation or is
/// more than 2^23 voxels from the ground's origin, for times that are not finite or not in order,
/// and for an unknown machine. Ground and tracker are then unchanged. With
/// Ground::set_memory_limit() updates throw std::runtime_error if the store fails: before digging
/// the ground stays complete (Ground::evict()); during digging the ground becomes unusable.
///
/// ```
/// Ground ground(0.05, origin, make_plane(0, {0, 0}));
/// Tracker tracker(ground, {bucket});
/// for (const Pose& world_from_bucket : poses)
///   load = tracker.update(0, world_from_bucket).bucket_m3;
/// ```
class Tracker {
 public:
  /// @param ground must outlive the tracker. @throw std::invalid_argument for an invalid bucket
  Tracker(Ground& ground, std::vector<Bucket> buckets);
  /// A tracker with moving soil: soil fills a bucket to its capacity, spills, piles up and slides.
  /// @throw std::invalid_argument for invalid properties
  Tracker(Ground& ground, std::vector<Bucket> buckets, Earthmoving earthmoving);
  /// An independent tracker that continues as the other would, to the last bit. The other may be
  /// destroyed first; both may run concurrently. Takes some microseconds per machine.
  /// @param clone Ground::clone() of the other's ground, made after the other's last update; must
  ///        outlive this
  /// @throw std::invalid_argument for a ground with another initial terrain, voxel size or origin
  Tracker(Ground& clone, const Tracker& other);
  ~Tracker();

  /// Moves a machine's bucket to a pose, straight and by slerp from the last pose. The first update
  /// of a machine places its bucket. @throw NoGroundError
  Update update(std::size_t machine, const Pose& world_from_bucket);
  /// Moves it along a motion from `begin_s`, the end of the previous update, to `end_s`. A
  /// machine's first update may begin at any time. @throw NoGroundError
  Update update(std::size_t machine, const Motion& motion, double begin_s, double end_s);
  /// Applies many moves, one update each. Machines that are far apart move in parallel; the result
  /// is bitwise that of sequential moves.
  /// @throw NoGroundError; with rigid soil other machines may then have moved further than this one
  std::vector<Update> update(std::span<const Move> moves);

  /// Why a machine can't be placed at a pose; empty if it can. @throw as update()
  std::string misplaced(std::size_t machine, const Pose& world_from_bucket) const;
  /// Takes a machine to a pose without digging on its way, as if it were lifted off. Soil that it
  /// pushed or held up comes to rest; its load stays as far as the bucket holds it there.
  /// @param world_from_bucket not misplaced(), but for soil that a pour has brought since
  /// @param time_s selects the hoppers that are present; unset: all
  Update place(std::size_t machine, const Pose& world_from_bucket,
               std::optional<double> time_s = {});

  /// Batches of moves with moving soil that were made at once, and those that were set back, and
  /// made in turn, because soil of one machine might have met that of another. Not part of the
  /// state.
  struct BatchCounts {
    std::size_t apart = 0, set_back = 0;
  };
  const BatchCounts& batch_counts() const { return batch_counts_; }

  /// The first of these moves that update() would refuse, if any; nothing moves.
  /// @throw as update(), except for the reported errors
  std::optional<InvalidMove> first_invalid(std::span<const Move> moves);

  /// Lets the due parts of a pour (constructor's index) fall. The result does not depend on the
  /// number of calls. @throw std::invalid_argument for an unknown pour
  Update pour(std::size_t pour, double until_s);
  /// Brings all moving soil to rest, as at the next standstill. @param time_s selects the hoppers
  /// that are present; unset: all
  Update come_to_rest(std::optional<double> time_s = {});

  /// Changes columns as scans say. Added soil is loose where soil moves. It stays as it is, however
  /// steep, until something else changes the ground there.
  void correct(std::span<const ScanChange> changes);
  /// Gives columns the heights of a survey, to the sample. Where it has none, and where the ground
  /// has none, nothing changes. Soil above a gap that it sees into goes, caves below it stay. Added
  /// soil is as that of correct(). @return number of the columns that changed
  /// @throw std::invalid_argument as SurveyHeights::validate()
  std::int64_t survey(const SurveyHeights& survey);
  const Surveyed& surveyed() const { return surveyed_; }
  const SurveyedSamples& surveyed_samples() const { return *surveyed_samples_; }  ///< by columns

  const Ledger& ledger(std::size_t machine) const;
  /// Mass of the soil outside of the ground and the buckets; zeros if soil does not move.
  MassBalance mass_balance() const;
  /// mass_balance() without `ground`, which needs a count over all chunks; takes microseconds.
  MassBalance mass_balance_without_ground() const;
  Ledger total() const;

  /// Bound over the bucket on the distance between the dug path and the machine's own path, m.
  double tolerance_m() const;

  /// Serialized state for the next update, without the ground. A tracker of the same buckets on the
  /// same ground then continues as this one.
  std::string state() const;
  /// @throw std::invalid_argument if the bytes are of other buckets, or not from state()
  void restore(std::string_view state);
  /// As above, of a tracker of the first `count` machines, to which the others came.
  void restore(std::string_view state, std::size_t count);

 private:
  Machine& at(std::size_t machine) const;
  void check(const Move& move) const;
  std::int64_t mass_of(const Pour& pour) const;
  std::int64_t poured(const Pour& pour, std::int64_t parts) const;
  bool moves_soil() const { return !settlers_.empty(); }
  Settler* settler(std::size_t machine) const;
  SettleTotals settled() const;
  struct Group;
  std::vector<Group> apart(std::span<const Move> moves) const;
  using Run = std::function<void(std::size_t)>;
  bool may_run_apart();
  bool run_apart(std::span<const Group> groups, std::span<const Move> moves, const Run& run);
  void others_forget_changes(std::size_t settler);
  SurveyedSamples& own_samples();
  void make(std::span<const ColumnEdit> corrections);
  void raise_walls();
  Ground& ground_;
  Earthmoving earthmoving_;
  std::vector<std::unique_ptr<Machine>> machines_;
  std::vector<std::unique_ptr<Settler>> settlers_;  // of machines, then of pours; empty: rigid soil
  std::vector<std::int64_t> poured_parts_;          // per pour
  Surveyed surveyed_;
  std::shared_ptr<SurveyedSamples> surveyed_samples_;
  BatchCounts batch_counts_;
  int in_turn_ = 0, last_in_turn_ = 0;  // batches to be made in turn; the same after the last one
  std::unique_ptr<TileSet> pours_may_slide_;  // where poured soil may be too steep
};

}  // namespace soilvdb::inline v0
