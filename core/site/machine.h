// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// One machine of a site: its bucket, where that is, and its load.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/cut/excavator.h"
#include "core/settle/earthworks.h"
#include "soilvdb/bucket.h"
#include "soilvdb/capacity.h"
#include "soilvdb/motion.h"
#include "soilvdb/tracker.h"

namespace soilvdb::inline v0 {

/// Where a bucket is and what it holds, brought from pose to pose: a move is planned, dug and
/// booked. Where soil moves, it does so at stations: places a fixed travel apart, whatever the
/// updates are.
class Machine {
 public:
  /// @param works null where soil doesn't move; else it outlives the machine
  /// @throw std::invalid_argument for a bad bucket.
  Machine(Bucket bucket, const Soil& soil, Earthworks* works);
  /// The same on another's clone. @param works those of the clone
  Machine(const Machine& other, Earthworks* works) : Machine(other) { works_ = works; }

  const Bucket& bucket() const { return bucket_; }
  double radius_m() const { return radius_m_; }  ///< of the bucket about its frame's origin
  const Ledger& ledger() const { return ledger_; }

  static double tolerance_m(const Soil& soil);

  /// As Tracker::update(). @throw NoGroundError
  Update move(Soil& soil, const Pose& to);
  Update move(Soil& soil, const Motion& motion, double begin_s, double end_s);
  /// Goes the same ways without digging, to find out whether there is ground to dig everywhere.
  /// Where it is then is to be put back.
  /// @throw NoGroundError if move() would
  void require_ground(const Soil& soil, const Pose& to);
  void require_ground(const Soil& soil, const Motion& motion, double begin_s, double end_s);
  struct Place {
    bool placed = false;
    Pose current;
    double travel_m = 0;
  };
  Place place() const { return {placed_, current_, travel_m_}; }
  void put_back(const Place& place) {
    placed_ = place.placed;
    current_ = place.current;
    travel_m_ = place.travel_m;
  }
  /// What the bucket pushes, holds too much of or leaves behind comes to rest.
  /// Cuts fail once the bucket is out of the ground: while it works in them it props them, and they
  /// are seen whole; here they do in any case.
  void come_to_rest(Soil& soil, double time_s) { stop(soil, time_s, true, true); }
  /// Pushed by the body or let go, and not yet come down, units of mass.
  std::int64_t in_flight() const { return pushed_ + falling_; }

  /// A box of index space beyond which moving on past these poses changes nothing.
  Eigen::AlignedBox3d workspace(const Soil& soil, std::span<const Pose> path) const;

  /// Appends all that the next move depends on besides the soil.
  void save(std::string& out) const;
  /// Takes it off again. @throw std::invalid_argument if the bytes are not what save() wrote
  void load(std::string_view& in, const Soil& soil);

 private:
  Machine(const Machine&) = default;
  bool plan(const Soil& soil, const Pose& to);
  bool plan(const Soil& soil, const Motion& motion, double begin_s, double end_s);
  bool stays_in_air(const Soil& soil, std::span<const Pose> path, double bend_m) const;
  void approach(const Soil& soil, bool digs);
  std::vector<Pose> stations(const Soil& soil, const Pose& to);
  void follow(Soil& soil, bool digs, double time_s);
  void dig(Soil& soil, double time_s);
  void book(const Cut& cut);
  void dump(const Soil& soil, const Pose& at, double time_s);
  Update since(const Ledger& before, std::int64_t slid_before) const;
  void stop(Soil& soil, double time_s, bool rests, bool ends = false);
  void let_go();
  void pass_turn(Soil& soil, double time_s);
  void drop_falling(double time_s, const Obstacle& obstacle);
  std::int64_t slid() const;
  double travel_m(const Pose& from, const Pose& to) const;
  struct Stop {
    double time_s;
    enum class Kind { kStation, kStandstill, kTurn } kind;
  };
  std::vector<Stop> stops(const Soil& soil, const Motion& motion, double begin_s, double end_s);
  void note_leaning(const Soil& soil, const Pose& at);
  void pass_rows(const Motion& motion, double begin_s, double end_s);
  double station_travel_m(const Soil& soil) const;
  Vec3 spill_point(const Pose& at) const;
  Vec3 push_point(const Pose& at) const;
  Eigen::AlignedBox3d box_around(std::span<const Pose> path) const;

  Bucket bucket_;
  Excavator excavator_;
  std::vector<Vec3> extremes_;  // points of the bucket that bound it, bucket frame
  double radius_m_ = 0;         // of the farthest of them from the frame's origin
  Ledger ledger_;
  bool placed_ = false;
  Pose current_;
  std::vector<Pose> path_;  // of the next move; scratch

  // Where soil moves.
  Earthworks* works_;
  std::optional<Capacity> capacity_;
  double travel_m_ = 0;              // from the last station to the last row or pose
  Pose station_;                     // the last one
  Eigen::AlignedBox3d way_m_;        // of the bucket in plan since then, at stations and rows
  std::int64_t cut_before_ = 0;      // samples, up to the last station
  std::int32_t stations_ = 0;        // since soil came to rest
  std::int64_t pushed_ = 0;          // by the body since then, units of mass
  std::int64_t falling_ = 0;         // let go and not yet come down, units of mass
  Eigen::AlignedBox3d unsettled_m_;  // where soil may stand too steep
  Eigen::AlignedBox3d propped_m_;    // where bank may, once the bucket has left it
};

}  // namespace soilvdb::inline v0
