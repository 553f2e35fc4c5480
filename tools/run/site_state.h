// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A site with the data that runs and sessions need: its terrain's source, and updates as records.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "soilvdb/height_map.h"
#include "soilvdb/io/journal.h"
#include "soilvdb/io/scenario.h"
#include "soilvdb/io/site.h"
#include "soilvdb/io/snapshot.h"
#include "soilvdb/site.h"
#include "tools/run/schedule.h"

namespace soilvdb::tools {

/// A journal's update that gives another result, or can't be repeated.
class UpdateDiffers : public std::runtime_error {
 public:
  UpdateDiffers(std::size_t i, const std::string& why) : runtime_error(why), index(i) {}
  std::size_t index;  ///< among the repeated updates
};

/// The exception's message. @param update its number, from 1
std::runtime_error differs(const std::filesystem::path& journal, std::uint64_t update,
                           double time_s, const UpdateDiffers& why);

/// The part of a site model that a scenario defines, without the ground.
SiteModel model_of(const io::Scenario& scenario);

/// Says so if volumes of a bucket will be off by percents, or show nothing of what it digs, because
/// voxels are too large; else empty.
std::string voxel_doubt(const std::string& machine, const Bucket& bucket, double voxel_size_m);

struct SiteState : Site {
  /// @throw std::invalid_argument for impossible machines or soil
  SiteState(SiteModel model, io::Site opened);
  /// A copy for a clone.
  SiteState(const SiteState& other);
  SiteState(SiteState&&) = default;
  SiteState& operator=(SiteState&&) = default;

  /// Conversions between volumes or masses and a journal's units.
  std::int64_t samples(double m3) const;
  std::int64_t mass(double loose_m3) const;
  double volume_m3(std::int64_t samples) const;
  double loose_m3(std::int64_t mass) const;
  double kg(std::int64_t mass) const;  ///< with moving soil

  /// Moves machines and lets pours fall, by the steps of a run. @return a record of each step
  std::vector<io::JournalUpdate> advance(std::span<const Step> steps);
  /// Repeats updates that follow the last one.
  /// @throw UpdateDiffers
  void redo(std::span<const io::JournalUpdate> updates);
  /// Makes an update of other ground here. @return its record; empty: a machine can't be placed
  /// there, and nothing has changed
  std::optional<io::JournalUpdate> make_anew(io::JournalUpdate update);
  /// Lets moving soil come to rest at a run's end, once.
  void rest_at_end(double time_s);
  bool rests_at_end() const { return at_rest_; }

  /// Of the present state.
  io::SnapshotInfo snapshot_info(double time_s) const;

  io::Site site;  ///< the ground, and where it comes from
  MassUnits units;
  bool records_force = false;  ///< advance() records forces of soil on buckets; not copied
  /// Scans that advance() takes, numbered after the pours; not copied.
  std::span<const io::ScanInput> scans = {};
  /// Scans whose rays are in doubt, and why the first is; not copied.
  std::int64_t doubtful_scans = 0;
  std::string doubt = {};
  /// How far a bucket has moved backwards through soil since it last caught some.
  struct Backwards {
    double way_m = 0;
    bool warned = false;
  };
  std::vector<Backwards> backwards;        ///< by machine
  std::vector<std::string> warnings = {};  ///< not yet told; not copied

 protected:
  /// Looks at an update of a bucket. @param caught, displaced did it, any soil?
  /// @return a warning if it has now moved backwards too far, once; else empty
  std::string look_backwards(std::size_t machine, const Pose& from, const Pose& to, bool caught,
                             bool displaced);

 private:
  io::JournalUpdate take_scan(const Step& step);
  void follow(const io::JournalUpdate& update);
  Pose row_pose(std::size_t machine, const io::MotionRows& rows, std::size_t row) const;
  Move move_of(const io::JournalUpdate& update,
               std::vector<std::unique_ptr<Motion>>& motions) const;
  /// Makes updates from number i on. @param end receives the number after the last that was made
  /// @return results of those that have any
  std::vector<Update> repeat(std::span<const io::JournalUpdate> updates, std::size_t i,
                             std::size_t& end);
  void require_mover(std::size_t i, const io::JournalUpdate& update) const;
  void require_same(std::size_t i, const io::JournalUpdate& update, const Update& made) const;

  std::optional<HeightMap> heights_;  // for forces
  CutGeometry cut_;
};

}  // namespace soilvdb::tools
