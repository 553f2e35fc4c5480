// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What depth cameras and lidars see corrects the ground that machines are known to have dug.
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "soilvdb/bucket.h"
#include "soilvdb/ground.h"
#include "soilvdb/kinematics.h"
#include "soilvdb/survey_heights.h"

namespace soilvdb::inline v0 {

/// A depth camera or a lidar. Sigmas are standard deviations.
struct Sensor {
  std::string name = "sensor";  ///< scans of one name share the errors of one mount
  Pose pose = {};               ///< world_from_sensor
  double range_sigma_m = 0.02;  ///< of a ray: range_sigma_m + range_squared_sigma_per_m * R^2
  double range_squared_sigma_per_m = 0;  ///< more than 0: stereo, whose neighbours err alike
  double mount_height_sigma_m = 0.01;
  double mount_tilt_sigma_rad = 0.002;  ///< about each horizontal axis
  double mount_scale_sigma = 0.002;     ///< of range
  /// Of each scan's pose, along each axis and about it, of a sensor that moves. Its pose is fitted
  /// to ground that nobody touched, if the scan sees enough of it. 0: a fixed mount.
  double pose_shift_sigma_m = 0, pose_turn_sigma_rad = 0;
  /// Points that are farther are not used: those of a lidar lie far apart, and make the ground that
  /// scans see large.
  double max_range_m = std::numeric_limits<double>::infinity();

  /// @throw std::invalid_argument with the field, its value and the allowed values
  void validate() const;
};

/// Standard deviation of a ray of R metres: sigma_m + squared_per_m * R^2.
struct RangeNoise {
  double sigma_m = 0, squared_per_m = 0;
};
/// That of a sensor on the market, as its maker has it: "ouster_os1", "realsense_d435",
/// "realsense_d455". @throw std::invalid_argument for another
RangeNoise noise_of(std::string_view model);

/// What the rays of scans were used for.
struct RayCounts {
  std::int64_t used = 0;     ///< met the ground about where it was expected
  std::int64_t masked = 0;   ///< met a machine
  std::int64_t through = 0;  ///< went through soil that is expected there
  std::int64_t added = 0;    ///< met new ground: many of them at one height
  std::int64_t dropped = 0;  ///< met nothing that others met too, as dust, or no ground at all
  std::int64_t far = 0;      ///< ended beyond the sensor's max_range_m

  /// Says so if most rays did not meet the ground about where it was expected, as with a wrong
  /// place of the sensor, or if all were too far; else empty.
  std::string doubt() const;
};

/// An estimate.
struct Estimate {
  double mean = 0, sigma = 0;
};

/// What scans changed, since the last time that they were applied.
struct Survey {
  double removed_m3 = 0, added_m3 = 0;
  double sigma_m3 = 0;  ///< of the volume of columns that were seen and are not as the terrain
  std::vector<Estimate> lip_errors_m;  ///< of each machine: its lip's height as told, less the true
  RayCounts rays;
};

/// Samples to be removed from a column, or added to it, in the shape of the ground's slope.
struct ScanChange {
  Coord2 cell;               ///< x, y
  double top = 0;            ///< height of the column, index space
  std::int64_t samples = 0;  ///< to be added; negative: to be removed
  Vec2 slope = {0, 0};
};

/// A heap of loose soil, by scans and by what the ledger knows was put down there.
struct Heap {
  Estimate loose_m3;    ///< above the terrain, as scans saw it
  Estimate bank_m3;     ///< put down there, less what was taken: as bank soil, without scans
  Estimate swell;       ///< loose over bank volume, less 1
  Estimate repose_rad;  ///< slope of its flanks
};

struct ScanState;       // core/survey/scan_state.h
class SurveyedSamples;  // core/survey/surveyed_samples.h

/// Corrections of columns of voxels by scans, with their sigmas.
///
/// Of each column it is asked by how much its true height differs from the ground's. Ground that
/// nobody touched is the datum. Ground that a machine dug errs by that machine's lip, all alike.
/// Ground as a survey left it errs by itself, and tells of no lip and no mount.
/// Scans err by their mount: height, two tilts and scale, all alike. These common errors and the
/// corrections are one linear problem, solved in closed form for all scans since a column last
/// changed. Of its columns those are corrected that scans told something of since the last time,
/// and those that the common errors move. See tools/guide/sensing.md.
///
/// Sums are integers: the result is the same for any order of scans and any split of a scan between
/// two changes of the ground. Of a sensor that moves, each call of scan() has a pose of its own, so
/// parts of a scan are other scans.
class GroundScans {
 public:
  /// @param ground must outlive it @param buckets of the machines
  /// @param lip_sigmas_m of each machine: standard deviation of its lip's height as told
  /// @param surveyed what surveys told and will tell, as Tracker::survey(); null: there are none
  GroundScans(Ground& ground, std::vector<Bucket> buckets, std::vector<double> lip_sigmas_m,
              std::shared_ptr<const SurveyedHeights> surveyed = nullptr);
  /// Of a clone of the other's ground. @param surveyed of the clone
  GroundScans(Ground& clone, const GroundScans& other,
              std::shared_ptr<const SurveyedHeights> surveyed = nullptr);
  ~GroundScans();

  enum class Work { kCut, kSurvey, kOther };
  /// What changed since the last call is this machine's work; unset: that of no machine.
  void worked(std::optional<std::size_t> machine, Work how);
  /// Did scans come since solve()?
  bool has_news() const;
  /// Takes a scan. @param points_m where its rays ended, world
  /// @param buckets poses of the machines that have one; rays that meet a bucket are not used
  /// @param bodies other parts of machines, the same
  /// @throw std::invalid_argument for a bad sensor or point, with its number; nothing is taken
  void scan(const Sensor& sensor, std::span<const Vec3> points_m,
            std::span<const Pose* const> buckets, std::span<const PlacedBoxes> bodies = {});
  /// What all scans so far say. @return changes of the ground that are worth it; the caller makes
  /// them, and calls applied()
  std::vector<ScanChange> solve();
  /// After the changes of solve() were made. Its volumes are left to the caller.
  Survey applied();

  /// Of each machine, as last solved.
  std::vector<Estimate> lip_errors_m() const;
  /// Sigma of the heights of the columns at places, m; NaN without ground.
  /// @param seen unless empty: 1 where a scan or survey saw the ground as it is, else 0; NaN
  /// without
  void sigmas(std::span<const Vec2> xy_m, std::span<double> sigmas_m, std::span<double> seen = {});
  /// The lowest columns of squares of 8 x 8, in order: beyond them no column was seen.
  std::vector<Coord2> seen_squares() const;
  /// Sigma of the change of volume inside a boundary, against the terrain.
  double volume_sigma_m3(const std::vector<Vec2>& boundary);
  /// Of each machine, and then of those that are not known: by how much more it cut than its poses
  /// say, by the errors of lips.
  /// @param samples what surveys and scans changed
  /// @param cut_m3 by each machine, also of soil that had been cut before; empty if soil is rigid
  std::vector<Estimate> cut_errors_m3(const SurveyedSamples& samples,
                                      std::span<const double> cut_m3);
  /// The heap inside a boundary. @param samples what surveys and scans changed
  /// @param swell by which the ledger converts @param bank_error standard deviation of the bank
  /// volume put down, as a share of it
  /// @throw std::invalid_argument with one line if there is no answer
  Heap heap(const std::vector<Vec2>& boundary, const SurveyedSamples& samples, double swell,
            double bank_error);

  /// Adds all that is known.
  void save(std::string& out) const;
  /// Adds what changed from one correction, of solve() with news and applied(), to the last one:
  /// for a survey that has heard of the same work, and loaded what was added at those before.
  void save_changes(std::string& out) const;
  /// Takes what save() or save_changes() added. @throw std::invalid_argument if it is of another
  /// site or of another past; what is known is then of no use
  void load(std::string_view& in);

 private:
  std::unique_ptr<ScanState> state_;
};

}  // namespace soilvdb::inline v0
