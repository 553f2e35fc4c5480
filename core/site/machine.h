// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// One machine of a site: its bucket, where that is, and its load.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/cut/excavator.h"
#include "soilvdb/bucket.h"
#include "soilvdb/motion.h"
#include "soilvdb/tracker.h"

namespace soilvdb::inline v0 {

/// Where a bucket is and what it holds, brought from pose to pose: a move is planned, dug and
/// booked.
class Machine {
 public:
  /// @throw std::invalid_argument for a bad bucket.
  Machine(Bucket bucket, const Soil& soil);

  const Bucket& bucket() const { return bucket_; }
  double radius_m() const { return radius_m_; }  ///< of the bucket about its frame's origin
  const Ledger& ledger() const { return ledger_; }

  static double tolerance_m(const Soil& soil);

  /// As Tracker::update(). @throw NoGroundError
  Update move(Soil& soil, const Pose& to);
  Update move(Soil& soil, const Motion& motion, double begin_s, double end_s);
  /// A box of index space beyond which moving on past these poses changes nothing.
  Eigen::AlignedBox3d workspace(const Soil& soil, std::span<const Pose> path) const;

  /// Appends all that the next move depends on besides the soil.
  void save(std::string& out) const;
  /// Takes it off again. @throw std::invalid_argument if the bytes are not what save() wrote
  void load(std::string_view& in);

 private:
  bool plan(const Soil& soil, const Pose& to);
  bool plan(const Soil& soil, const Motion& motion, double begin_s, double end_s);
  bool stays_in_air(const Soil& soil, std::span<const Pose> path, double bend_m) const;
  Update follow(Soil& soil, bool digs);
  void dig(Soil& soil);
  void book(const Cut& cut);

  Bucket bucket_;
  Excavator excavator_;
  std::vector<Vec3> extremes_;  // points of the bucket that bound it, bucket frame
  double radius_m_ = 0;         // of the farthest of them from the frame's origin
  Ledger ledger_;
  bool placed_ = false;
  Pose current_;
  std::vector<Pose> path_;  // of the next move; scratch
};

}  // namespace soilvdb::inline v0
