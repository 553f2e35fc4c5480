// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What is known of columns of voxels by scans: sums of residuals, and votes that the ground is
// another one.
#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <compare>
#include <cstdint>
#include <map>

#include "core/ground/base_columns.h"
#include "core/survey/common_errors.h"
#include "soilvdb/types.h"

namespace soilvdb::inline v0 {

/// How a column came to its height. Machine m's is kFirstMachine + m.
inline constexpr std::uint16_t kNatural = 0;      ///< as the terrain
inline constexpr std::uint16_t kSurveyed = 1;     ///< as scans or a survey say
inline constexpr std::uint16_t kUnknownTool = 2;  ///< dug, by which machine is not known
inline constexpr std::uint16_t kFilled = 3;       ///< by soil that was moved
inline constexpr std::uint16_t kFirstMachine = 4;

/// Integer sums over the rays of one sensor that met a column about where it was expected.
struct ScanSums {
  std::int64_t weight = 0, residual = 0;  ///< sums of w and w r
  std::array<std::int64_t, 4> sees = {};  ///< of w a: height, tilts, scale
  std::int64_t rays = 0;

  void add(std::int64_t w, std::int64_t r, const std::array<std::int64_t, 4>& a) {
    ++rays;
    weight += w;
    residual += w * r;
    for (std::size_t i = 0; i < a.size(); ++i) sees[i] += w * a[i];
  }
  void add(const ScanSums& other) {
    rays += other.rays;
    weight += other.weight;
    residual += other.residual;
    for (std::size_t i = 0; i < sees.size(); ++i) sees[i] += other.sees[i];
  }
};

/// Area in plan that rays stand for, by quarter of a column along x, and along y: 4 x + y.
struct ScanCells {
  std::array<std::int64_t, 16> areas = {};
  std::int64_t rays = 0;

  void add(std::size_t cell, std::int64_t area) {
    ++rays;
    areas[cell] += area;
  }
};

/// Rays that met one height of a column, other than expected.
struct ScanHits {
  ScanCells cells;
  std::int64_t rays = 0, height = 0;  ///< height: sum of heights above the column's `first`
  ScanSums sums;                      ///< with residuals of 0
};

/// A ray that ended farther away than the ground that it was to meet, m, world.
struct ThroughRay {
  Vec3 from, to;
  double met_m, sigma_m;  ///< range of that ground; standard deviation of the ray's own
  std::uint32_t time;     ///< of the ground, as of ScanColumn::changed

  bool operator<(const ThroughRay& other) const {
    const auto key = [](const ThroughRay& r) {
      return std::array{r.to.x(),   r.to.y(), r.to.z(),  r.from.x(),    r.from.y(),
                        r.from.z(), r.met_m,  r.sigma_m, double(r.time)};
    };
    return key(*this) < key(other);
  }
};

/// What speaks against a column's height, until that is decided or its ground changes.
struct ScanVotes {
  std::int64_t through = 0;  ///< rays that went through its soil
  std::int64_t ceiling = 0;  ///< lowest of them, above the column's `first`
  std::int64_t told = 0;     ///< hits that were counted as dropped when scans were applied
  std::int64_t others = 0;   ///< rays that met the column as expected, until scans were applied
  std::map<int, std::map<int, ScanHits>> hits = {};  ///< by height, and by sensor

  std::int64_t rays() const {
    std::int64_t all = 0;
    for (const auto& [bin, of_bin] : hits)
      for (const auto& [sensor, of_sensor] : of_bin) all += of_sensor.rays;
    return all;
  }
};

struct ScanColumn {
  double first = 0;     ///< height from which residuals are counted, index space
  double top = 0;       ///< height now; NaN: no ground
  double variance = 0;  ///< of its own error before any scan, m^2
  double prior = -1;    ///< variance of its own error as last solved, m^2; negative: not yet
  std::uint16_t origin = kNatural;
  std::uint32_t changed = 0;  ///< when it last changed, other than by scans
  std::uint32_t pass = 0;     ///< corrections there were until then, plus 1; natural: 0
};

/// Rays of a column since scans were applied. Apart from what corrections read, many times.
struct ColumnRays {
  std::int64_t met = 0;     ///< that met it as expected
  ScanCells cells;          ///< of those that ended in it as expected
  std::int64_t height = 0;  ///< sum of the latter's heights above the column's `first`
  std::int64_t blind = 0;   ///< others that ended in it as expected, but tell no height
};

/// The columns in a square of one origin, which changed between two corrections: their own errors
/// hang together. Only natural columns have pass 0; of others it keeps what ground told that is
/// gone.
struct Block {
  std::uint16_t origin;
  std::uint32_t pass;
  int x, y;
  auto operator<=>(const Block&) const = default;
};

/// What columns of a block say.
struct BlockSums {
  explicit BlockSums(Eigen::Index errors) : on(Eigen::VectorXd::Zero(errors)), volume_on(on) {}

  BlockResidual told;
  double columns = 0;         ///< that scans saw
  Eigen::VectorXd on;         ///< sum of their corrections' dependences on the common errors
  double alike = 0;           ///< and on what errs alike in the block
  double off_m3 = 0;          ///< error of their volume, were there no common errors
  Eigen::VectorXd volume_on;  ///< how that depends on the common errors, m^2
  double alike_m3 = 0;        ///< and on what errs alike in the block
  double apart = 0;           ///< variance of what errs column by column, m^6
  double near_m3 = 0;         ///< sigma of what else errs alike in a tile
  double untold_m3 = 0;       ///< sigma of columns that are others, but scans do not tell how high

  void add(const BlockSums& other) {
    told.add(other.told);
    columns += other.columns;
    on += other.on;
    alike += other.alike;
    off_m3 += other.off_m3;
    volume_on += other.volume_on;
    apart += other.apart + other.near_m3 * other.near_m3;
    alike_m3 += other.alike_m3;
    untold_m3 += other.untold_m3;
  }
};

/// 8 x 8 columns. Column (x, y) from `cell` is entry x * 8 + y.
struct ScanTile {
  Coord2 cell = {0, 0};
  std::array<ScanColumn, BaseColumn::kCells> columns;
  std::array<ColumnRays, BaseColumn::kCells> rays;
  std::array<Vec2, BaseColumn::kCells> slopes;  ///< of the ground, m/m
  std::array<float, BaseColumn::kCells> bends;  ///< difference of slopes over a column
  /// Of the error of the lip that dug it, what its height has: a wall's upper end stays.
  std::array<float, BaseColumn::kCells> lip_shares;
  std::map<int, std::array<ScanSums, BaseColumn::kCells>> sums;  ///< by sensor
  std::map<int, ScanVotes> votes;                                ///< by number of the column
  std::map<Block, BlockSums> parts;                              ///< of blocks, as last solved

  /// Of one of its columns.
  Coord2 place(std::size_t i) const {
    const int n = static_cast<int>(i);
    return cell + Coord2(n / kChunkSide, n % kChunkSide);
  }
  /// Did rays meet a column about where it was expected?
  bool is_met(std::size_t i) const {
    return std::any_of(sums.begin(), sums.end(),
                       [i](const auto& of) { return of.second[i].rays > 0; });
  }
};

}  // namespace soilvdb::inline v0
