// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The pose of each scan of a sensor that moves, fitted to ground that nobody touched.
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "core/constants.h"
#include "core/survey/scan_state.h"

namespace soilvdb::inline v0 {
namespace {

/// A shift, then a turn about the sensor, along the world's axes.
using PoseError = Eigen::Matrix<double, 6, 1>;
using PoseMatrix = Eigen::Matrix<double, 6, 6>;

/// By which the height of a place above ground of a slope changes with the pose of its sensor.
PoseError lever(const Vec2& slope, const Vec3& from_sensor) {
  const Vec3 normal(-slope.x(), -slope.y(), 1);
  PoseError on;
  on << normal, from_sensor.cross(normal);
  return on;
}

Eigen::Quaterniond turn_by(const Vec3& vector) {
  const double angle = vector.norm();
  if (angle == 0) return Eigen::Quaterniond::Identity();
  return Eigen::Quaterniond(Eigen::AngleAxisd(angle, vector / angle));
}

class PoseFit {
 public:
  PoseFit(ScanState& state, const Sensor& sensor, const ScanRays& rays)
      : state_(state), sensor_(sensor), told_(rays), rays_(rays), ranges_(rays.count()) {
    const double shift = sensor.pose_shift_sigma_m, turn = sensor.pose_turn_sigma_rad;
    const double height = height_sigma_m(sensor), tilt = tilt_sigma_rad(sensor);
    prior_ << shift, shift, height, tilt, tilt, turn;
    prior_ = prior_.cwiseAbs2().cwiseMax(kLeastScanVariance);
    covariance_ = prior_.asDiagonal();
  }

  /// @return whether the pose was found
  bool fit() {
    for (int step = 0; step < kPoseSteps; ++step) {
      if (!meet()) return false;
      const PoseError by = solve();
      error_ += by;
      if ((error_.cwiseAbs2() - kLostPoseSigmas * kLostPoseSigmas * prior_).maxCoeff() >
          kLostPoseVariance)
        return false;
      turn_rays();
      if (by.head<3>().norm() < kLastPoseShiftM && by.tail<3>().norm() < kLastPoseTurn) break;
    }
    return true;
  }
  Pose pose() const { return {place(), turn_by(error_.tail<3>()) * sensor_.pose.rotation}; }
  ScanRays& rays() { return rays_; }

 private:
  struct OfTile {
    const ScanTile* tile = nullptr;
    std::array<ScanSums, BaseColumn::kCells> sums = {};
  };

  Vec3 place() const { return sensor_.pose.position + error_.head<3>(); }

  void turn_rays() {
    const Eigen::Matrix3d turn = turn_by(error_.tail<3>()).toRotationMatrix();
    for (std::size_t i = 0; i < told_.count(); ++i) rays_.set_way(i, turn * told_.way(i));
  }

  /// Is a column as it always was, and neither steep nor beside an edge?
  bool is_stable(const ScanTile& tile, std::size_t i) const {
    return ScanState::is_datum(tile.columns[i]) &&
           tile.slopes[i].squaredNorm() < kPoseSlope * kPoseSlope &&
           kBendFloor * tile.bends[i] * state_.voxel_m() < kMostBendErrorM;
  }

  /// Sums up the rays that meet stable ground about where they end.
  bool meet() {
    const Vec3 from = place();
    state_.view.ranges(from, rays_, ranges_);
    tiles_.clear();
    OfTile* tile = nullptr;
    std::int64_t all = 0, met = 0;
    for (std::size_t i = 0; i < rays_.count(); ++i) {
      const double range = ranges_[i];
      if (!(range > 0) || !std::isfinite(range)) continue;
      const Vec3 way = rays_.way(i), p = range * way;
      const Vec3 at = state_.ground.index_from_world(from + p);
      if (!(at.head<2>().cwiseAbs().maxCoeff() < kMaxIndex)) continue;
      const Coord2 column(cell_of(at.x()), cell_of(at.y()));
      const Coord2 cell = floor_to(column, kChunkSide);
      if (tile == nullptr || tile->tile->cell != cell) {
        tile = &tiles_[ScanState::mark(cell)];
        if (tile->tile == nullptr) tile->tile = &state_.tile(cell);
      }
      const std::size_t n = ScanState::number_of(column);
      if (!is_stable(*tile->tile, n)) continue;
      const Vec2& slope = tile->tile->slopes[n];
      const double descent = way.z() - slope.dot(way.head<2>());
      if (descent > -kLeastDescent) continue;
      ++all;
      const double length = rays_.length_m[i], residual = (length - range) * descent;
      const double error = kScanErrorM - descent * model_.sigma(length);
      const double along = range * descent, scale = sensor_.mount_scale_sigma * along;
      const PoseError on = lever(slope, p);
      if (residual * residual >=
          9 * (error * error + scale * scale + state_.expected_variance(*tile->tile, n) +
               on.dot(covariance_ * on)))
        continue;
      ++met;
      tile->sums[n].add(ray_weight(error), height_units(residual),
                        {0, levers(p.x()), levers(p.y()), levers(along)});
    }
    return 2 * met >= all && has_blocks();
  }

  bool has_blocks() const {
    const int side = std::max(1, static_cast<int>(std::lround(kPoseBlockM / state_.voxel_m())));
    std::set<std::pair<int, int>> blocks;
    for (const auto& [cell, of] : tiles_)
      for (std::size_t i = 0; i < of.sums.size(); ++i)
        if (of.sums[i].rays > 0) {
          const Coord2 column = of.tile->place(i);
          blocks.emplace(ScanState::square_of(column.x(), side),
                         ScanState::square_of(column.y(), side));
        }
    return blocks.size() >= kPoseBlocks;
  }

  /// By what the pose errs more than was known. What is alike in a block's columns is eliminated.
  PoseError solve() {
    struct OfBlock {
      double weight = 0, residual = 0;
      PoseError on = PoseError::Zero();
    };
    std::map<Block, OfBlock> blocks;
    PoseMatrix information = prior_.cwiseInverse().asDiagonal();
    PoseError sum = -prior_.cwiseInverse().cwiseProduct(error_);
    for (const auto& [cell, of] : tiles_) {
      for (std::size_t i = 0; i < of.sums.size(); ++i) {
        const ScanSums& sums = of.sums[i];
        if (sums.rays == 0) continue;
        const Vec2& slope = of.tile->slopes[i];
        const auto whole = static_cast<double>(sums.weight);
        const auto mean = [&](std::int64_t all) { return static_cast<double>(all) / whole; };
        const Vec2 xy = kScanLever_m * Vec2(mean(sums.sees[1]), mean(sums.sees[2]));
        const double z = kScanLever_m * mean(sums.sees[3]) + slope.dot(xy);
        const PoseError on = lever(slope, {xy.x(), xy.y(), z});
        const double residual = kScanUnit_m * mean(sums.residual);
        const double own = state_.expected_variance(*of.tile, i);
        const double alike = kAlikeShare * of.tile->columns[i].variance;
        const double weight =
            1 / (own - alike + 1 / ScanState::weight_of(sums, sensor_, Vec2(0, 0)));
        information += weight * on * on.transpose();
        sum -= weight * residual * on;
        OfBlock& block = blocks[state_.block_of(*of.tile, i)];
        block.weight += weight * alike;
        block.residual += weight * std::sqrt(alike) * residual;
        block.on += weight * std::sqrt(alike) * on;
      }
    }
    for (const auto& [number, block] : blocks) {
      information -= block.on * block.on.transpose() / (1 + block.weight);
      sum += block.residual / (1 + block.weight) * block.on;
    }
    covariance_ = information.ldlt().solve(PoseMatrix::Identity());
    return covariance_ * sum;
  }

  ScanState& state_;
  const Sensor& sensor_;
  const RangeModel model_ = range_model(sensor_);
  const ScanRays& told_;
  ScanRays rays_;  // turned
  std::vector<float> ranges_;
  PoseError prior_, error_ = PoseError::Zero();
  PoseMatrix covariance_;
  std::map<std::pair<int, int>, OfTile> tiles_;
};

}  // namespace

std::optional<Pose> ScanState::fit_pose(const Sensor& sensor, ScanRays& ends) {
  PoseFit fit(*this, sensor, ends);
  if (!fit.fit()) return {};
  ends = std::move(fit.rays());
  return fit.pose();
}

}  // namespace soilvdb::inline v0
