// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// One machine of a site: its bucket, its load, and as much of its path as phi still needs.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/bucket.h"
#include "core/cut_surface.h"
#include "core/excavate.h"
#include "core/motion.h"
#include "core/tracker.h"

namespace soilvdb {

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
  Eigen::AlignedBox3d reach(const Soil& soil, std::span<const Pose> path) const;

  /// Carves all that has been swept so far, until take_back().
  void carve_ahead(Soil& soil);
  void take_back(Soil& soil);
  bool is_ahead() const { return !ahead_.empty(); }

  /// Appends all that the next move depends on besides the soil.
  void save(std::string& out) const;
  /// Takes it off again. @throw std::invalid_argument if the bytes are not what save() wrote
  void load(std::string_view& in, const Soil& soil);

 private:
  /// What a surface cut is made from.
  struct Stretch {
    std::vector<Pose> path;
    std::size_t fresh = 0;
    bool begins = true, mouth = false, body = false;
  };
  /// phi of a chunk before it was carved ahead.
  struct Before {
    Coord3 origin;
    bool resident = false, air = false;
    PackedPhi phi;
  };

  Update dig_along(Soil& soil, std::span<const Pose> path);
  bool stays_in_air(const Soil& soil, std::span<const Pose> path, double bend_m) const;
  Update fly(Soil& soil, const Pose& to);
  void place(Soil& soil, const Pose& pose);
  void dig(Soil& soil, std::span<const Pose> path);
  void keep_up(const Pose& pose, double voxel_size_m);
  bool bends(const Corners& to, double tolerance_m) const;
  void carve(Soil& soil);
  void carve_part(Soil& soil, double left);
  std::optional<Stretch> stretch() const;
  void begin_carving(const Soil& soil);
  void forget(double length_m);
  Update booked(std::int64_t cut_before) const;

  Bucket bucket_;
  Excavator excavator_;
  std::vector<Vec3> extremes_;  // points of the bucket that bound it, bucket frame
  double radius_m_ = 0;         // of the farthest of them from the frame's origin
  Ledger ledger_;
  bool placed_ = false;
  Pose current_;
  Corners at_;                                 // of the mouth there
  std::vector<Pose> traced_;                   // scratch
  std::vector<Pose> kept_;                     // the path before `current`, thinned
  Corners kept_at_;                            // at the last of those
  std::vector<Corners> between_;               // at some poses since
  std::size_t fresh_ = 0;                      // the first kept pose that no surface cut has seen
  bool begins_ = true;                         // kept reaches back to where the path starts
  bool mouth_cut_ = false, body_cut_ = false;  // soil, since the last surface cut
  bool mouth_stood_ = false;                   // in soil it had cut, at the last surface cut
  double moved_m_ = 0;                         // since the last surface cut
  Stretch carved_;                             // of the path before `fresh`
  std::optional<SurfaceCut> carving_;          // the same, on its way out of phi
  std::size_t carving_chunks_ = 0;
  std::vector<Before> ahead_;  // what flush() changed, to be undone by the next update
};

}  // namespace soilvdb
