// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The state of GroundScans.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "core/constants.h"
#include "core/surface/height_reader.h"
#include "core/survey/common_errors.h"
#include "core/survey/ground_view.h"
#include "core/survey/scan_tiles.h"
#include "core/survey/sensor_model.h"
#include "soilvdb/height_map.h"
#include "soilvdb/survey.h"

namespace soilvdb::inline v0 {

/// Units of integers: residuals and heights, m; levers of tilts, m. And how many are a metre.
inline constexpr double kScanUnit_m = 1e-5, kScanLever_m = 1e-3;
inline constexpr double kScanUnitsPerM = 1e5, kScanLeversPerM = 1e3;
inline std::int64_t levers(double value_m) { return std::lrint(value_m * kScanLeversPerM); }
/// Of a residual or a height; what is farther is no residual.
inline std::int64_t height_units(double height_m) {
  return std::lrint(std::clamp(height_m, -kMostScanHeightM, kMostScanHeightM) * kScanUnitsPerM);
}
template <typename T>
std::int64_t ray_weight(T sigma_m) {
  return std::max<std::int64_t>(1, std::lrint(1 / (sigma_m * sigma_m)));
}

/// Of a sensor: height, tilts, scale.
inline constexpr int kOfSensor = 4;

inline constexpr double kSamplesOfCell = 64;

inline double square(double value) { return value * value; }

/// Sigmas of a sensor's height and tilts: of its mount, and of the poses of its scans.
inline double height_sigma_m(const Sensor& sensor) {
  return std::hypot(sensor.mount_height_sigma_m, sensor.pose_shift_sigma_m);
}
inline double tilt_sigma_rad(const Sensor& sensor) {
  return std::hypot(sensor.mount_tilt_sigma_rad, sensor.pose_turn_sigma_rad);
}
inline bool is_moving(const Sensor& sensor) {
  return sensor.pose_shift_sigma_m > 0 || sensor.pose_turn_sigma_rad > 0;
}

/// What is known, apart from the ground.
struct ScanRecord {
  using Tiles = std::set<std::pair<int, int>>;  // their lowest cells
  struct BlockState {
    BlockResidual retired = {};          // of columns of which the ground has changed since
    std::optional<BlockSums> sums = {};  // of its tiles' parts, if it has some
    BlockResidual known = {};            // by both, as last summed up
    /// The errors since which its columns were corrected; empty: none was yet.
    Eigen::VectorXd solved = {};
    double solved_alike = 0;  // what was alike in it then

    BlockResidual told() const {
      BlockResidual all = retired;
      if (sums) all.add(sums->told);
      return all;
    }
  };
  std::vector<Bucket> buckets;
  std::vector<double> lip_sigmas_m;  // of machines, then of a tool that is not known
  std::unordered_map<std::uint64_t, ScanTile, PlanHash> tiles;
  Tiles stale;     // where the ground has changed since they were read
  Tiles news;      // of which scans told something since solve()
  Tiles unsummed;  // that changed since their parts were made
  Tiles untold;    // that changed since telling was set
  /// How often a machine began to cut a tile that another had cut before, or a scan or survey had
  /// changed. The first time counts.
  struct Turns {
    std::uint16_t origin = kUnknownTool;
    std::uint32_t count = 0;
  };
  struct Work {
    std::uint16_t origin = kUnknownTool;  // whose machine was the last in a tile
    std::uint32_t time = 0;               // when the tile changed
    /// Whose cut was the last; kSurveyed: a scan or survey changed the tile since.
    std::uint16_t turn = kUnknownTool;
    bool was_cut_since = false;     // by a machine, since the first of these
    std::vector<Turns> turns = {};  // in the order of the machines' first

    void cut_by(std::uint16_t origin_of_cut);
  };
  std::unordered_map<std::uint64_t, Work, PlanHash> work;  // by tile
  std::uint32_t time = 1;                                  // counts changes of the ground
  std::uint32_t solutions = 0;                             // counts corrections
  std::vector<Sensor> sensors;  // by name, so that the order of their first scans does not show
  std::map<Block, BlockState> blocks;
  std::set<Block> untold_blocks;
  /// What save_changes() tells of: what changed from one correction to the next.
  struct Telling {
    bool all = true;
    Tiles tiles = {};
    std::set<Block> blocks = {};
  } telling;
  bool has_corrected = false;              // solve() had news since scans were applied
  bool is_first = true;                    // nothing was told yet
  CommonErrors errors{Eigen::VectorXd()};  // as last solved
  RayCounts rays;
  std::vector<ThroughRay> through;  // since scans were applied
  bool is_solved = true;            // no scan came since
  double sigma_m3 = 0;              // of the last solution
};

struct ScanState : ScanRecord {
  ScanState(Ground& g, std::vector<Bucket> all_buckets, std::vector<double> lip_sigmas_m,
            std::shared_ptr<const SurveyedHeights> all_surveyed);
  ScanState(Ground& clone, const ScanState& other,
            std::shared_ptr<const SurveyedHeights> all_surveyed);

  double voxel_m() const { return ground.voxel_size_m(); }
  /// The height from which a column's residuals and votes are counted, world.
  double first_m(const ScanColumn& column) const {
    return ground.origin().z() + voxel_m() * column.first;
  }
  /// The tile of a lowest cell, as the ground is.
  ScanTile& tile(const Coord2& cell);
  ScanTile& tile_of(const Coord2& column) { return tile(floor_to(column, kChunkSide)); }
  static std::size_t number_of(const Coord2& column) {
    const Coord2 in = column - floor_to(column, kChunkSide);
    return static_cast<std::size_t>(in.x() * kChunkSide + in.y());
  }
  static std::pair<int, int> mark(const Coord2& cell) { return {cell.x(), cell.y()}; }
  ScanTile& marked(const std::pair<int, int>& cell) {
    return tiles.at(plan_key({cell.first, cell.second}));
  }
  /// Tells that the ground of a tile changed.
  void has_changed(const Coord2& cell);
  /// Tells that scans or a survey changed it.
  void was_surveyed(const Coord2& cell);
  Vec2 index_of(const Vec2& place_m) const {
    return (place_m - ground.origin().head<2>()) / voxel_m();
  }
  /// The box about places in index space.
  Eigen::AlignedBox2d index_box(const std::vector<Vec2>& places_m) const;
  static bool meets(const Eigen::AlignedBox2d& box, const Coord2& cell);  ///< of a tile
  /// Tiles in which the ground was changed.
  Tiles changed_within(const Eigen::AlignedBox2d& box) const;
  /// Did scans or a survey see a column as it is?
  bool is_seen(const ScanTile& tile, std::size_t i) const;
  /// Share of a column that is inside a boundary, by parts of it.
  double share_inside(const std::vector<Vec2>& boundary, const Coord2& column) const;
  /// Reads tiles anew where the ground changed. @param own by applied()
  void refresh(bool own);
  /// Why a tile is read: the ground changed, or by applied(), or for a look that changes nothing.
  enum class How { kChanged, kOwn, kLook };
  void read(ScanTile& tile, How how);
  static ScanTile new_tile(const Coord2& cell);
  /// A tile as the ground is, and changes nothing. @param own storage for one that is not known
  const ScanTile& look(const Coord2& cell, std::optional<ScanTile>& own);
  /// @param around_m the points @throw std::invalid_argument if too many tiles would be seen
  void require_room(const Eigen::AlignedBox2d& around_m, std::span<const Vec3> points_m) const;
  /// The number that a sensor has or would have, and whether there was a scan of it.
  /// @throw std::invalid_argument if it may not scan
  std::pair<int, bool> find(const Sensor& sensor) const;
  /// A sensor's number, which may change when others come.
  int sensor_of(const Sensor& sensor);

  // scan_rays.cc
  /// The rays that do not end at a machine; counts the others.
  ScanRays unmasked(const Sensor& sensor, std::span<const Vec3> points_m,
                    std::span<const Pose* const> poses, std::span<const PlacedBoxes> links);
  void add_rays(const Sensor& sensor, int number, const ScanRays& ends);

  // scan_pose.cc
  /// The pose of a scan by the ground that nobody touched; none if it sees too little of that.
  /// @param ends are turned with the pose
  std::optional<Pose> fit_pose(const Sensor& sensor, ScanRays& ends);

  // scan_votes.cc
  /// Rays that ended in a column and those beside it near a height, world, and not as expected.
  /// @param enough they are counted until there are so many
  std::int64_t rays_about(const Coord2& cell, double height_m, std::int64_t enough) const;
  /// Do enough rays end about where a ray does?
  bool is_met(const Vec3& end) const;
  void see_through();
  void take_votes();
  struct Heights {
    double low, high;
  };
  /// What stands upright beside a column and no ray went through: rays that end on its face or rim
  /// are of no new ground. Heights above the column's `first`, m.
  std::optional<Heights> wall_at(const ScanTile& tile, std::size_t i) const;
  /// Do more rays say that a column is another than that it is as expected, if too few to say how?
  static bool is_contested(const ScanTile& tile, std::size_t i);

  // scan_solution.cc
  /// Variance of a column's height before any scan, with its lip's, and with what its slope and
  /// its bend let rays err, m^2.
  double expected_variance(const ScanTile& tile, std::size_t i) const;
  /// Of what a scan's rays say of a column: what repeats does not average out.
  /// @param slope of the ground, where the sensor's place counts
  static double weight_of(const ScanSums& sums, const Sensor& sensor, const Vec2& slope);
  /// A column as one residual. @param sees a, of all sensors
  ColumnResidual residual_of(const ScanTile& tile, std::size_t i,
                             Eigen::Ref<Eigen::VectorXd> sees) const;
  /// The only common error on which a column's predicted height depends, one to one; -1: none.
  Eigen::Index lip_of(const ScanColumn& column) const { return lip_of(column.origin); }
  Eigen::Index lip_of(std::uint16_t origin) const;
  /// Does a column that rays met tell of the errors that it shares?
  bool tells_of_errors(const ScanTile& tile, std::size_t i, const ColumnResidual& residual) const;
  Eigen::VectorXd prior() const;
  Eigen::Index error_count() const;
  /// The first of a sensor's common errors.
  Eigen::Index place_of(std::size_t sensor) const {
    return std::ssize(lip_sigmas_m) + kOfSensor * static_cast<Eigen::Index>(sensor);
  }
  /// Values for each common error with room for `count` that came, from number `at` on.
  static Eigen::VectorXd widened(const Eigen::VectorXd& values, Eigen::Index at,
                                 Eigen::Index count);
  void widen_errors(Eigen::Index at, Eigen::Index count);
  /// Is a column of a wall, whose height rays do not tell?
  static bool is_wall(const ScanTile& tile, std::size_t i) {
    return tile.slopes[i].squaredNorm() >= square(kScanWallSlope);
  }
  /// A column's correction by what it and the errors that it shares are known to be.
  void correct(const ScanTile& tile, std::size_t i, ColumnResidual residual,
               const BlockError& block, const Eigen::Ref<const Eigen::VectorXd>& sees,
               CommonErrors::Correction& to) const;
  BlockError error_of(const Block& block) const;
  /// Variance of a column's height, m^2.
  double height_variance(const ScanTile& tile, std::size_t i) const;
  /// Do scans say that a column is other than its errors explain?
  static bool is_other(const ScanColumn& column);
  /// Is a column as the terrain, and nothing speaks against that?
  static bool is_datum(const ScanColumn& column);
  /// Keeps what a column says of the common errors when its ground has changed.
  void retire(const ScanTile& tile, std::size_t i);
  /// Of blocks of which no column is left, those in a square become one.
  void retire_blocks();
  std::vector<ScanChange> solve();  // of news

  /// The square of a side in which a column is, along an axis.
  static int square_of(int at, int side) { return at >= 0 ? at / side : -1 - (-1 - at) / side; }
  int block_side() const {
    return std::max(1, static_cast<int>(std::lround(kScanBlockM / voxel_m())));
  }
  Block block_of(const ScanTile& tile, std::size_t i) const;
  /// A column's place from its block's corner.
  Eigen::Vector2d place_in(const Block& block, const ScanTile& tile, std::size_t i) const;
  /// The tiles that a block reaches into, by their cells.
  std::vector<ScanTile*> tiles_of(const Block& block);
  /// Columns of some tiles that scans told something of.
  class SeenColumns;
  CommonErrors estimate() const;
  /// Tiles of the blocks whose corrections would be others with the present common errors.
  Tiles moved();
  /// Adds an area of a column to the error of a volume. @param correction as correct() has it
  void add_volume(BlockSums& to, const ScanTile& tile, std::size_t i,
                  const ColumnResidual& residual, const BlockError& block,
                  const CommonErrors::Correction& correction, double area_m2,
                  bool is_corrected) const;
  /// Of the columns around one in its tile, the share of those that scans only say are others.
  static double untold_about(const ScanTile& tile, std::size_t i);
  /// Sigma of the volume of all columns that were added. Each block at most once.
  class VolumeError {
   public:
    explicit VolumeError(const CommonErrors& errors)
        : errors_(errors), on_(Eigen::VectorXd::Zero(errors.mean().size())) {}
    void add(const BlockSums& sums, const BlockError& block) {
      on_ += sums.volume_on + sums.alike_m3 * block.on;
      off_m3_ += sums.off_m3 - sums.alike_m3 * block.mean;
      variance_ += sums.apart + sums.alike_m3 * sums.alike_m3 * block.variance +
                   sums.untold_m3 * sums.untold_m3;
    }
    double sigma_m3() const;

   private:
    const CommonErrors& errors_;
    Eigen::VectorXd on_;
    double off_m3_ = 0, variance_ = 0;
  };

  std::shared_ptr<const SurveyedHeights> surveyed;  // null: there are no surveys
  Ground& ground;
  HeightMap map;
  GroundView view;
  ChangeFollower changes;
};

}  // namespace soilvdb::inline v0
