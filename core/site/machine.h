// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// One machine of a site: its bucket, its pose and its load.
#pragma once

#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/cut/excavator.h"
#include "core/settle/settler.h"
#include "soilvdb/bucket.h"
#include "soilvdb/capacity.h"
#include "soilvdb/motion.h"
#include "soilvdb/tracker.h"

namespace soilvdb::inline v0 {

/// Pose and load of a bucket. A move is planned, dug and booked. Soil moves at stations: places a
/// fixed travel apart, independent of the updates.
class Machine {
 public:
  /// @param settler null for rigid soil; otherwise it must outlive the machine
  /// @throw std::invalid_argument for a bad bucket.
  Machine(Bucket bucket, const Ground& ground, Settler* settler);
  /// A copy for a clone. @param settler of the clone
  Machine(const Machine& other, Settler* settler) : Machine(other) { settler_ = settler; }

  const Bucket& bucket() const { return bucket_; }
  double radius_m() const { return radius_m_; }  ///< of the bucket about its frame's origin
  const Ledger& ledger() const { return ledger_; }

  static double tolerance_m(const Ground& ground);

  /// As Tracker::update(). @throw NoGroundError
  Update move(Ground& ground, const Pose& to);
  Update move(Ground& ground, const Motion& motion, double begin_s, double end_s);
  /// @return why it can't be placed at a pose; empty if it can
  std::string misplaced(const Ground& ground, const Pose& at) const;
  /// As Tracker::place(). @pre it can
  Update place(Ground& ground, const Pose& at, double time_s);
  /// Traces the same path without digging. Afterwards restore() must set its state back.
  /// @throw NoGroundError if move() would
  void require_ground(const Ground& ground, const Pose& to);
  void require_ground(const Ground& ground, const Motion& motion, double begin_s, double end_s);
  /// Since when a bucket has stayed about where it was, and the ticks since then.
  struct Standing {
    Pose at;
    double since_s = std::numeric_limits<double>::infinity();
    std::int64_t ticks = 0;
  };
  struct KinematicState {
    bool placed = false;
    Pose current;
    double since_station_m = 0;
    Standing standing;
  };
  KinematicState kinematic_state() const {
    return {placed_, current_, since_station_m_, standing_};
  }
  void restore(const KinematicState& state) {
    placed_ = state.placed;
    current_ = state.current;
    since_station_m_ = state.since_station_m;
    standing_ = state.standing;
  }
  /// Brings pushed soil, excess load and soil left behind to rest. Cuts may fail here in any case;
  /// during work they fail only with the bucket out of the ground, because it props them.
  void come_to_rest(Ground& ground, double time_s) {
    begin_update();
    pass_station(ground, time_s, Rest::kEnd);
  }
  /// To a pile of another source that may grow to it the bucket is a wall.
  /// @param at_m, reach_m where the pile is in plan @param clearance over the ground, cells
  void meet(const Ground& ground, const Vec2& at_m, double reach_m, float clearance);
  /// Soil that was pushed or spilled and has not dropped, and what goes on before the mouth, units
  /// of mass.
  std::int64_t pending() const { return pushed_ + in_flight_ + heaped_; }

  /// A box in index space: moves along these poses change nothing outside it. Of soil that moves
  /// it has what may begin to, and most of where it may go.
  Eigen::AlignedBox3d workspace(const Ground& ground, std::span<const Pose> path) const;

  /// Appends the state that the next move depends on, without the ground.
  void save(std::string& out) const;
  /// It as a wall to soil: valid while the machine lives, and always of now.
  const Obstacle& wall() const { return obstacle_; }
  /// Takes it off again. @throw std::invalid_argument if the bytes are not from save()
  void load(std::string_view& in, const Ground& ground);

 private:
  Machine(const Machine&) = default;
  bool plan(const Ground& ground, const Pose& to);
  bool plan(const Ground& ground, const Motion& motion, double begin_s, double end_s);
  bool stays_in_air(const Ground& ground, std::span<const Pose> path, double bend_m) const;
  void approach(const Ground& ground, bool digs);
  std::vector<Pose> stations_to(const Ground& ground, const Pose& to);
  void follow(Ground& ground, bool digs, double time_s);
  void dig(Ground& ground, double time_s);
  void book(const Cut& cut);
  void dump(const Ground& ground, const Pose& at, double time_s);
  Update since(const Ledger& before, std::int64_t slid_before) const;
  /// How much of its way to rest soil goes at a station. At the end cuts fail in any case.
  enum class Rest { kSome, kAll, kEnd };
  void pass_station(Ground& ground, double time_s, Rest rest);
  bool fail();
  void set_wall(const Ground& ground, const Pose& at, float clearance = kObstacleClearance);
  void stand(const Ground& ground, float clearance);
  double hold_m3(double held_m) const;
  std::int64_t surplus(double held_m) const;
  void spill(double held_m, double share = 1);
  void spill_here(double time_s, double held_m, double share = 1);
  std::int64_t begin_update();
  void end_update();
  double held_m() const;
  void pass_turn(Ground& ground, double time_s);
  void pass_tick(Ground& ground, double time_s, int ticks);
  bool drops_now(const Ground& ground) const;
  void drop(const Ground& ground, double time_s, bool all);
  double travel_m(const Pose& from, const Pose& to) const;
  /// Where soil moves along a motion.
  struct Event {
    double time_s;
    enum class Kind { kStation, kStandstill, kTurn, kTick } kind;
    int ticks = 0;
  };
  std::vector<Event> events(const Ground& ground, const Motion& motion, double begin_s,
                            double end_s);
  void pass_rows(const Motion& motion, double begin_s, double end_s);
  double station_spacing_m(const Ground& ground) const;
  Settler::Line spill_line(const Ground& ground, const Pose& at) const;
  Vec2 push_way(const Pose& at) const;
  Settler::Line push_line(const Pose& at, const Vec2& way) const;
  Eigen::AlignedBox3d box_around(std::span<const Pose> path) const;

  Bucket bucket_;
  Excavator excavator_;
  std::vector<Vec3> extremes_;  // points of the bucket that bound it, bucket frame
  double radius_m_ = 0;         // largest distance of them from the frame's origin
  Ledger ledger_;
  bool placed_ = false;
  Pose current_;
  std::vector<Pose> path_;  // of the next move; scratch

  // For moving soil.
  Settler* settler_;
  std::optional<Capacity> capacity_;
  double since_station_m_ = 0;  // travel from the last station to the last row or pose
  Standing standing_;           // at the last row
  Pose last_station_;
  Eigen::AlignedBox3d swept_box_;      // of the bucket in plan since it, at stations and rows
  std::int64_t cut_before_ = 0;        // samples, up to the last station
  std::int32_t stations_ = 0;          // counted round: what is done at some goes by it
  std::int64_t pushed_ = 0;            // by the body since the last station, units of mass
  std::int64_t in_flight_ = 0;         // spilled and not dropped, units of mass
  std::int64_t heaped_ = 0;            // before the mouth, more than it holds, units of mass
  double held_m_ = 0;                  // held_m() at the last station
  double hold_gain_ = 0;               // more held for what dropped at the last ones, m^3 per m^3
  std::optional<Pose> spilled_from_;   // of the bucket, when in_flight_ began
  double spilled_s_ = 0;               // then
  TileSet may_slide_;                  // where loose soil may be too steep
  std::optional<Pose> wall_;           // of the bucket when it became a wall to soil
  Obstacle obstacle_;                  // the same as columns
  Eigen::AlignedBox3d unsettled_box_;  // where soil may hang
  Eigen::AlignedBox3d propped_box_;    // where bank may be too steep once the bucket has left
};

}  // namespace soilvdb::inline v0
