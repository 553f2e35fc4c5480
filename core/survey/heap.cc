// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What scans say of how much was cut, and of the soil of a heap: its swell and angle of repose.
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>
#include <optional>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "core/constants.h"
#include "core/lattice/text.h"
#include "core/survey/scan_state.h"
#include "core/survey/surveyed_samples.h"
#include "core/tool/polygon.h"

namespace soilvdb::inline v0 {
namespace {

double median(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// The columns around a heap.
class HeapColumns {
 public:
  struct Column {
    double share = 0;  // of it that is inside the boundary
    double rise = 0;   // above the terrain, voxels
    double loose = 0;  // depth of the loose soil, voxels
    double off = 0;    // by how much scans alone say that it is higher, voxels
    double height = HeightReader::kNoGround;  // by scans alone, where they saw it
    double variance = 0;                      // of the height, m^2
    bool is_seen = false;
    bool was_taken_from = false;  // after scans or a survey changed it
  };

  /// @throw std::invalid_argument without ground that was changed, or for too much of it
  HeapColumns(ScanState& state, const std::vector<Vec2>& boundary) : state_(state) {
    if (boundary.size() < 3) throw std::invalid_argument("a boundary must have 3 corners or more");
    for (const Vec2& corner : boundary)
      if (!corner.allFinite()) throw std::invalid_argument("a corner of the boundary is no number");
    const ScanState::Tiles tiles = state.changed_within(state.index_box(boundary));
    if (tiles.empty())
      throw std::invalid_argument(
          "there is no heap inside the boundary: nothing was put down there");
    Eigen::AlignedBox2i touched;
    for (const auto& [x, y] : tiles)
      touched.extend(Coord2(x, y)).extend(Coord2(x + kChunkSide, y + kChunkSide));
    first_ = touched.min();
    size_ = touched.sizes();
    if (const double count = 1.0 * size_.x() * size_.y(); count > kMostHeapColumns)
      throw std::invalid_argument("the boundary has " + text(count) +
                                  " columns of voxels that changed, and may have " +
                                  text(kMostHeapColumns) + "; take one around a single heap");
    columns_.resize(static_cast<std::size_t>(size_.x()) * static_cast<std::size_t>(size_.y()));
    on_ = Eigen::VectorXd::Zero(state.error_count());
    for (const auto& [x, y] : tiles) read({x, y}, boundary);
  }

  const Coord2& size() const { return size_; }
  const Column& at(int x, int y) const { return columns_[number(x, y)]; }
  Vec2 place_m(int x, int y) const {
    return state_.ground.origin().head<2>() +
           state_.voxel_m() * (first_ + Coord2(x, y)).cast<double>();
  }
  Coord2 cell(int x, int y) const { return first_ + Coord2(x, y); }
  /// Variance of the volume by what scans err, m^6.
  double variance() const { return on_.dot(state_.errors.covariance() * on_) + apart_; }

 private:
  std::size_t number(int x, int y) const { return static_cast<std::size_t>(x * size_.y() + y); }

  void read(const Coord2& cell, const std::vector<Vec2>& boundary) {
    HeightReader& reader = state_.map.reader();
    HeightReader::Columns dug, loose;
    const Coord2 size = Coord2::Constant(kChunkSide);
    reader.read(cell, size, static_cast<std::size_t>(MapLayer::kDug), kNoCeiling, dug);
    reader.read(cell, size, static_cast<std::size_t>(MapLayer::kLoose), kNoCeiling, loose);
    std::optional<ScanTile> own;
    const ScanTile& tile = state_.look(cell, own);
    const auto work = state_.work.find(plan_key(cell));
    Eigen::VectorXd sees(state_.error_count());
    for (int x = 0; x < kChunkSide; ++x) {
      for (int y = 0; y < kChunkSide; ++y) {
        const auto n = static_cast<std::size_t>(x * kChunkSide + y);
        const ScanColumn& of = tile.columns[n];
        if (std::isnan(of.top)) continue;
        const Coord2 in = cell + Coord2(x, y) - first_;
        Column& column = columns_[number(in.x(), in.y())];
        column.share = state_.share_inside(boundary, cell + Coord2(x, y));
        column.height = of.top;
        column.rise = -dug.at(x, y);
        column.variance = state_.height_variance(tile, n);
        column.is_seen = state_.is_seen(tile, n);
        column.was_taken_from = work != state_.work.end() && work->second.was_cut_since;
        column.loose = loose.at(x, y);
        // What was expected of the heap depends on the swell and the angle that are asked for, so
        // that only scans tell its height.
        const ColumnResidual residual = state_.residual_of(tile, n, sees);
        if (!(residual.weight > 0)) continue;
        const double off = residual.residual - sees.dot(state_.errors.mean());
        column.height = of.first + off / state_.voxel_m();
        column.off = column.height - of.top;
        column.variance = 1 / residual.weight;
        const double area = column.share * square(state_.voxel_m());
        on_ += area * sees;
        apart_ += square(area) * column.variance;
      }
    }
  }

  ScanState& state_;
  Coord2 first_ = {0, 0}, size_ = {0, 0};
  std::vector<Column> columns_;
  Eigen::VectorXd on_;  // how the volume depends on common errors, m^2
  double apart_ = 0;    // its variance by what errs column by column, m^6
};

/// The slope of the flanks: in each direction from the middle the median over squares that lie on
/// the flank, and of these the mean. Directions err apart from each other.
Estimate repose_of(const HeapColumns& columns, double height, double voxel_m) {
  const int half = std::max(2, static_cast<int>(std::lround(kFlankWindowM / voxel_m / 2)));
  const int side = 2 * half + 1;
  const double squares = side * static_cast<double>(side * (side * side - 1)) / 12;
  const double mean_square = (side * side - 1) / 12.0;
  double fourths = 0;  // sum of (u^2 - mean_square)^2
  for (int u = -half; u <= half; ++u) fourths += side * square(u * u - mean_square);
  Vec2 middle = Vec2::Zero();
  double whole = 0;
  for (int x = 0; x < columns.size().x(); ++x)
    for (int y = 0; y < columns.size().y(); ++y) {
      const auto& column = columns.at(x, y);
      if (!(column.share > 0) || !(column.rise > 0)) continue;
      middle += column.share * column.rise * Vec2(x, y);
      whole += column.share * column.rise;
    }
  middle /= whole;
  struct Window {
    double slope;
    int sector;
  };
  std::vector<Window> windows;
  double variance = 0;  // of heights of flanks, m^2
  for (int x = half; x + half < columns.size().x(); x += half) {
    for (int y = half; y + half < columns.size().y(); y += half) {
      double a = 0, b = 0, own = 0;
      Eigen::Vector3d bends = Eigen::Vector3d::Zero();  // along x, y and both
      int seen = 0;
      bool is_flank = true;
      for (int u = -half; u <= half && is_flank; ++u) {
        for (int v = -half; v <= half; ++v) {
          const auto& column = columns.at(x + u, y + v);
          is_flank = column.share == 1 && column.rise > kFlankLow * height &&
                     column.rise < kFlankHigh * height;
          if (!is_flank) break;
          a += u * column.height;
          b += v * column.height;
          bends += column.height * Eigen::Vector3d(u * u - mean_square, v * v - mean_square, u * v);
          own += column.variance;
          seen += column.is_seen ? 1 : 0;
        }
      }
      if (!is_flank || 2 * seen < side * side) continue;
      const Vec2 from = Vec2(x, y) - middle;
      const double turn = std::atan2(from.y(), from.x()) / (2 * M_PI) + 0.5;
      const Vec2 slope = Vec2(a, b) / squares;
      const Vec2 along = Vec2(-b, a).normalized();  // the contour
      const double bend =
          (bends.x() * square(along.x()) + bends.y() * square(along.y())) / fourths +
          bends.z() * along.x() * along.y() / (squares * mean_square);
      // Around a cone the slope turns within a square: a plane is flatter than its middle.
      const double turned = 2 * mean_square * square(bend) / slope.squaredNorm();
      windows.push_back({slope.norm() * (1 + turned),
                         std::min(kFlankSectors - 1, static_cast<int>(turn * kFlankSectors))});
      variance += own / (side * side);
    }
  }
  const std::string too_small =
      "the heap is too small, or scans saw too little of it, to tell the slope of its flanks";
  if (windows.empty()) throw std::invalid_argument(too_small);
  variance /= static_cast<double>(windows.size());
  std::vector<double> slopes;
  for (const Window& window : windows) slopes.push_back(window.slope);
  const auto steep = slopes.begin() + static_cast<std::ptrdiff_t>(slopes.size() * 9 / 10);
  std::nth_element(slopes.begin(), steep, slopes.end());
  const double least = kLeastFlankShare * *steep;
  std::array<std::vector<double>, kFlankSectors> by_sector;
  for (const Window& window : windows)
    if (window.slope >= least)
      by_sector[static_cast<std::size_t>(window.sector)].push_back(window.slope);
  std::vector<double> sectors;
  for (std::vector<double>& of : by_sector)
    if (of.size() >= kLeastFlankWindows) sectors.push_back(std::atan(median(of)));
  if (sectors.size() < kLeastFlankSectors) throw std::invalid_argument(too_small);
  const auto count = static_cast<double>(sectors.size());
  const double mean = std::accumulate(sectors.begin(), sectors.end(), 0.0) / count;
  double spread = 0;
  for (const double sector : sectors) spread += square(sector - mean);
  // Heights at foot and crest err by their sigmas, each flank by itself.
  const double run_m = (kFlankHigh - kFlankLow) * height * voxel_m / std::tan(mean);
  const double of_heights = std::pow(std::cos(mean), 2) * std::sqrt(2 * variance) / run_m;
  return {mean, std::sqrt(spread / (count - 1) / count + of_heights * of_heights / count)};
}

/// How a machine's cut depends on errors of lips: on its own by an area in a range, and on others'.
struct CutAreas {
  double least = 0, most = 0;                    // m^2
  std::map<Eigen::Index, double> others;         // at most, m^2; each counts from 0
  std::map<std::pair<int, int>, double> blocks;  // what errs alike in squares, m^2
  double apart = 0;                              // and column by column, m^4
  double bank_m3 = 0;                            // that it cut alone

  Estimate error(const CommonErrors& errors, Eigen::Index lip) const {
    const double own_m = errors.mean()[lip];
    Estimate all{(least + most) / 2 * own_m, 0};
    double variance =
        square((most - least) / 2 * own_m) + square(most) * errors.covariance()(lip, lip);
    for (const auto& [other, area] : others) {
      const double other_m = errors.mean()[other];
      all.mean -= area / 2 * other_m;
      variance += square(area / 2 * other_m) + square(area) * errors.covariance()(other, other);
    }
    double alike = 0;
    for (const auto& [block, area] : blocks) alike += square(area);
    variance += square(kDugSigmaM) * ((1 - kAlikeShare) * apart + kAlikeShare * alike);
    all.sigma = std::sqrt(variance);
    return all;
  }
};

}  // namespace

std::vector<Estimate> GroundScans::cut_errors_m3(const SurveyedSamples& samples,
                                                 std::span<const double> cut_m3) {
  ScanState& s = *state_;
  s.map.reader().refresh();
  const double area_m2 = square(s.voxel_m());
  std::vector<CutAreas> areas(s.lip_sigmas_m.size());
  double bank_m3 = 0;  // cut by all
  std::set<std::pair<int, int>> tiles;
  for (const Chunk* chunk : s.ground.chunks()) tiles.emplace(chunk->origin.x(), chunk->origin.y());
  for (const auto& [x, y] : tiles) {
    std::optional<ScanTile> looked;
    const ScanTile& tile = s.look({x, y}, looked);
    HeightReader::Columns dug, loose;
    const Coord2 size = Coord2::Constant(kChunkSide);
    s.map.reader().read(tile.cell, size, static_cast<std::size_t>(MapLayer::kDug), kNoCeiling, dug);
    s.map.reader().read(tile.cell, size, static_cast<std::size_t>(MapLayer::kLoose), kNoCeiling,
                        loose);
    const auto work = s.work.find(plan_key(tile.cell));
    std::vector<ScanState::Turns> turns;
    if (work != s.work.end()) turns = work->second.turns;
    if (turns.empty())  // dug before the first scan
      turns.push_back({s.buckets.size() == 1 ? kFirstMachine : kUnknownTool, 1});
    double all_turns = 0;
    for (const ScanState::Turns& of : turns) all_turns += of.count;
    for (std::size_t n = 0; n < BaseColumn::kCells; ++n) {
      const ScanColumn& column = tile.columns[n];
      if (std::isnan(column.top)) continue;
      const int u = static_cast<int>(n) / kChunkSide, v = static_cast<int>(n) % kChunkSide;
      const double cut = kSamplesOfCell * (dug.at(u, v) + loose.at(u, v)) +
                         samples.at(tile.place(n)).bank;  // of bank, by machines and slides
      const Eigen::Index last = s.lip_of(column);
      if (last < 0 && !(cut > kHeapCutSamples)) continue;
      const Block block = s.block_of(tile, n);
      const double bank = std::max(0.0, cut / kSamplesOfCell) * area_m2 * s.voxel_m();
      bank_m3 += bank;
      for (const ScanState::Turns& of : turns) {
        const Eigen::Index lip = s.lip_of(of.origin);
        CutAreas& to = areas[static_cast<std::size_t>(lip)];
        if (turns.size() == 1 || lip == last) to.least += area_m2;
        to.most += of.count * area_m2;
        // Where another had cut, it cut less by that one's error.
        const std::uint32_t after = of.count - (of.origin == turns.front().origin ? 1 : 0);
        for (const ScanState::Turns& other : turns)
          if (const std::uint32_t both = std::min(after, other.count);
              other.origin != of.origin && both > 0)
            to.others[s.lip_of(other.origin)] += both * area_m2;
        to.apart += square(all_turns * area_m2);
        to.blocks[{block.x, block.y}] += all_turns * area_m2;
        if (turns.size() == 1) to.bank_m3 += bank;
      }
    }
  }
  // The rest of what machines cut had been cut before.
  const double again_m3 = std::accumulate(cut_m3.begin(), cut_m3.end(), 0.0) - bank_m3;
  for (std::size_t m = 0; m < cut_m3.size(); ++m)
    areas[m].most += std::max(0.0, std::min(again_m3, cut_m3[m] - areas[m].bank_m3)) /
                     (kLooseLayer * s.buckets[m].height_m);
  std::vector<Estimate> errors;
  for (std::size_t m = 0; m < areas.size(); ++m)
    errors.push_back(areas[m].error(s.errors, static_cast<Eigen::Index>(m)));
  return errors;
}

Heap GroundScans::heap(const std::vector<Vec2>& boundary, const SurveyedSamples& samples,
                       double swell, double bank_error) {
  ScanState& s = *state_;
  s.map.reader().refresh();
  const HeapColumns columns(s, boundary);
  const Coord2 size = columns.size();
  std::vector<double> rises;
  double above = 0, put = 0;                 // voxels
  double unsure = 0;                         // of the latter: what scans added may be gone
  double area = 0, seen_area = 0;            // columns of the heap
  double hidden = 0, seen = 0, changed = 0;  // volumes of the heap, and what scans changed of it
  for (int x = 0; x < size.x(); ++x) {
    for (int y = 0; y < size.y(); ++y) {
      const HeapColumns::Column& column = columns.at(x, y);
      if (!(column.share > 0)) continue;
      const SurveyedSamples::Column surveyed = samples.at(columns.cell(x, y));
      if (kSamplesOfCell * (column.rise - column.loose) - surveyed.bank < -kHeapCutSamples) {
        const Vec2 at = columns.place_m(x, y);
        throw std::invalid_argument("the boundary has cut ground in it, as at (" + text(at.x()) +
                                    ", " + text(at.y()) + "); take one around the heap alone");
      }
      above += column.share * (column.rise + column.off);
      put += column.share * (column.loose - surveyed.loose / kSamplesOfCell);
      if (column.was_taken_from) {
        put += column.share * surveyed.loose / kSamplesOfCell / 2;
        unsure += column.share * std::abs(surveyed.loose) / kSamplesOfCell / 2;
      }
      if (column.rise <= 1) continue;
      rises.push_back(column.rise);
      area += column.share;
      if (column.is_seen) {
        seen_area += column.share;
        seen += column.share * (column.rise + column.off);
        changed += column.share * ((surveyed.bank + surveyed.loose) / kSamplesOfCell + column.off);
      } else {
        hidden += column.share * column.rise;
      }
    }
  }
  if (rises.empty())
    throw std::invalid_argument(
        "there is no heap inside the boundary: no soil is above the terrain");
  if (seen_area < kLeastHeapSeen * area)
    throw std::invalid_argument(
        "scans saw " + std::to_string(std::lround(100 * seen_area / area)) +
        " % of the heap as it is now, and must have seen half of it; scan it and apply the scans");
  const auto high = rises.begin() + static_cast<std::ptrdiff_t>(rises.size() * 98 / 100);
  std::nth_element(rises.begin(), high, rises.end());
  if (*high < kLeastHeapHeight)
    throw std::invalid_argument("the heap is " + text(*high * s.voxel_m()) +
                                " m high, and must be " + text(kLeastHeapHeight * s.voxel_m()) +
                                " m, " + text(kLeastHeapHeight) + " voxels, or more");
  if (!(put > 0))
    throw std::invalid_argument("no machine or pour put soil down inside the boundary");
  const double voxel_m3 = std::pow(s.voxel_m(), 3);
  Heap heap;
  heap.bank_m3 = {put / (1 + swell) * voxel_m3,
                  std::hypot(bank_error * put, unsure) / (1 + swell) * voxel_m3};
  // What is hidden errs as what was seen did.
  const double expected = seen - changed;
  const double of_hidden = expected > 0 ? hidden * std::abs(changed) / expected * voxel_m3 : 0;
  const double sigma_m3 = std::hypot(volume_sigma_m3(boundary), of_hidden);
  heap.loose_m3 = {above * voxel_m3, std::hypot(sigma_m3, std::sqrt(columns.variance()))};
  const double ratio = heap.loose_m3.mean / heap.bank_m3.mean;
  heap.swell = {ratio - 1,
                std::hypot(heap.loose_m3.sigma, ratio * heap.bank_m3.sigma) / heap.bank_m3.mean};
  heap.repose_rad = repose_of(columns, *high, s.voxel_m());
  return heap;
}

}  // namespace soilvdb::inline v0
