// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The state of a GroundSurvey.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "core/surface/height_reader.h"
#include "core/survey/common_errors.h"
#include "core/survey/survey_tiles.h"
#include "soilvdb/height_map.h"
#include "soilvdb/survey.h"

namespace soilvdb::inline v0 {

/// Units of integers: residuals and heights, m; levers of tilts, m.
inline constexpr double kScanUnit_m = 1e-5, kScanLever_m = 1e-3;

struct SurveyState {
  SurveyState(Ground& g, std::vector<Bucket> all_buckets, std::vector<double> lip_sigmas_m);
  SurveyState(Ground& clone, const SurveyState& other);

  double voxel_m() const { return ground.voxel_size_m(); }
  /// The height from which a column's residuals and votes are counted, world.
  double first_m(const SurveyColumn& column) const {
    return ground.origin().z() + voxel_m() * column.first;
  }
  /// The tile of a lowest cell, as the ground is.
  SurveyTile& tile(const Coord2& cell);
  SurveyTile& tile_of(const Coord2& column) { return tile(floor_to(column, kChunkSide)); }
  static std::size_t number_of(const Coord2& column) {
    const Coord2 in = column - floor_to(column, kChunkSide);
    return static_cast<std::size_t>(in.x() * kChunkSide + in.y());
  }
  /// Tiles by their cells.
  std::vector<SurveyTile*> sorted();
  /// Tells that the ground of a tile changed.
  void has_changed(const Coord2& cell);
  /// Reads tiles anew where the ground changed. @param own by applied()
  void refresh(bool own);
  /// Why a tile is read: the ground changed, or by applied(), or for a look that changes nothing.
  enum class How { kChanged, kOwn, kLook };
  void read(SurveyTile& tile, How how);
  static SurveyTile new_tile(const Coord2& cell);
  /// A tile as the ground is, and changes nothing. @param own storage for one that is not known
  const SurveyTile& look(const Coord2& cell, std::optional<SurveyTile>& own);
  /// @throw std::invalid_argument if too many tiles would be seen
  void require_room(std::span<const Vec3> points_m) const;
  int sensor_of(const Sensor& sensor);

  // scan_rays.cc
  void add_rays(const Sensor& sensor, int number, std::span<const Vec3> points_m,
                std::span<const Pose* const> poses);

  // survey_solution.cc
  /// Variance of a column's own height, before any scan, m^2.
  double own_variance(const SurveyTile& tile, std::size_t i) const;
  /// A column as one residual. @param sees a, of all sensors
  ColumnResidual residual_of(const SurveyTile& tile, std::size_t i, Eigen::VectorXd& sees) const;
  /// b: how a column's predicted height depends on the common errors.
  Eigen::VectorXd predicted(const SurveyColumn& column) const;
  Eigen::VectorXd prior() const;
  /// To be called when a sensor has come.
  void set_places();
  /// Makes room for errors that came. @param to the new numbers of those that were
  void widen_errors(const std::vector<Eigen::Index>& to);
  /// What is known of a column's height.
  struct Knowledge {
    ColumnResidual residual;
    CommonErrors::Correction correction;
    double off = 0;  ///< of the correction, what the ground does not have, m

    double variance(const CommonErrors& all) const { return correction.variance(all) + off * off; }
  };
  Knowledge knowledge_of(const SurveyTile& tile, std::size_t i) const;
  Knowledge knowledge_of(const SurveyColumn& column, const ColumnResidual& residual,
                         const Eigen::VectorXd& sees, const Eigen::VectorXd& predicted) const;
  /// Is a column as the terrain, and nothing speaks against that?
  static bool is_datum(const SurveyColumn& column);
  /// Keeps what a column says of the common errors when its ground has changed.
  void retire(const SurveyTile& tile, std::size_t i);
  /// Do enough rays end about where a ray does?
  bool is_met(const Vec3& end) const;
  void see_through();
  void take_votes();
  std::vector<SurveyChange> solve();

  /// Mean of columns of one origin in a square, of which the ground has changed.
  struct Retired {
    double weight = 0, residual = 0, variance = 0;  // sums of w, w r, w s^2
    std::vector<double> sees;                       // of w (a - b)
  };
  struct Block {
    std::uint16_t origin;
    int x, y;
    auto operator<=>(const Block&) const = default;
  };
  Block block_of(const SurveyTile& tile, std::size_t i) const;

  /// The error of a volume: of columns' heights times areas.
  class VolumeError {
   public:
    explicit VolumeError(const CommonErrors& errors)
        : errors_(errors), on_(Eigen::VectorXd::Zero(errors.mean().size())) {}
    void add(const Block& block, const Knowledge& column, double area_m2);
    double sigma_m3() const;

   private:
    const CommonErrors& errors_;
    Eigen::VectorXd on_;
    double off_m3_ = 0, apart_ = 0;  // apart: variance of errors that do not hang together, m^6
    std::map<Block, double> alike_;  // sigmas of those that do, m^3
  };

  Ground& ground;
  std::vector<Bucket> buckets;
  std::vector<double> lip_sigmas_m;  // of machines, then of a tool that is not known
  HeightMap map;
  ChangeFollower changes;
  std::unordered_map<std::uint64_t, SurveyTile, PlanHash> tiles;
  struct Work {
    std::uint16_t origin = kUnknownTool;  // whose machine was the last in a tile
    std::uint32_t time = 0;               // when the tile changed
  };
  std::unordered_map<std::uint64_t, Work, PlanHash> work;  // by tile
  std::uint32_t time = 1;                                  // counts changes of the ground
  std::vector<Sensor> sensors;                             // in order of their first scan
  std::vector<int> places;                                 // of their common errors, by their names
  std::vector<int> by_name;                                // their numbers
  std::map<Block, Retired> retired;
  CommonErrors errors;  // as last solved
  RayCounts rays;
  std::vector<ThroughRay> through;  // since scans were applied
  bool is_solved = true;            // no scan came since
  double sigma_m3 = 0;              // of the last solution
};

}  // namespace soilvdb::inline v0
