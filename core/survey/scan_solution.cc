// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Corrections of all columns that were seen, with the errors that they share.
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <optional>
#include <utility>

#include "core/constants.h"
#include "core/survey/scan_state.h"

namespace soilvdb::inline v0 {

Eigen::VectorXd ScanState::widened(const Eigen::VectorXd& values, Eigen::Index at,
                                   Eigen::Index count) {
  Eigen::VectorXd wide = Eigen::VectorXd::Zero(values.size() + count);
  wide.head(at) = values.head(at);
  wide.tail(values.size() - at) = values.tail(values.size() - at);
  return wide;
}

void ScanState::widen_errors(Eigen::Index at, Eigen::Index count) {
  const Eigen::MatrixXd& before = errors.covariance();
  const Eigen::Index behind = before.rows() - at;
  Eigen::MatrixXd covariance = prior().asDiagonal();
  covariance.topLeftCorner(at, at) = before.topLeftCorner(at, at);
  covariance.topRightCorner(at, behind) = before.topRightCorner(at, behind);
  covariance.bottomLeftCorner(behind, at) = before.bottomLeftCorner(behind, at);
  covariance.bottomRightCorner(behind, behind) = before.bottomRightCorner(behind, behind);
  errors = CommonErrors(widened(errors.mean(), at, count), std::move(covariance));
}

Eigen::Index ScanState::error_count() const { return place_of(sensors.size()); }

Eigen::VectorXd ScanState::prior() const {
  Eigen::VectorXd variances(error_count());
  for (std::size_t m = 0; m < lip_sigmas_m.size(); ++m)
    variances[static_cast<Eigen::Index>(m)] = std::max(square(lip_sigmas_m[m]), kLeastScanVariance);
  for (std::size_t s = 0; s < sensors.size(); ++s) {
    const Sensor& sensor = sensors[s];
    const double height = height_sigma_m(sensor), tilt = tilt_sigma_rad(sensor);
    const double sigmas[] = {height, tilt, tilt, sensor.mount_scale_sigma};
    for (int n = 0; n < kOfSensor; ++n)
      variances[place_of(s) + n] = std::max(square(sigmas[n]), kLeastScanVariance);
  }
  return variances;
}

Eigen::Index ScanState::lip_of(std::uint16_t origin) const {
  if (origin >= kFirstMachine) return origin - kFirstMachine;
  if (origin == kUnknownTool) return static_cast<Eigen::Index>(lip_sigmas_m.size()) - 1;
  return -1;
}

double ScanState::expected_variance(const ScanTile& tile, std::size_t i) const {
  const ScanColumn& column = tile.columns[i];
  const Eigen::Index lip = lip_of(column);
  return column.variance + square(kBendFloor * tile.bends[i] * voxel_m()) +
         square(kSlopeFloorM) * tile.slopes[i].squaredNorm() +
         (lip >= 0 ? square(lip_sigmas_m[static_cast<std::size_t>(lip)]) : 0);
}

double ScanState::weight_of(const ScanSums& sums, const Sensor& sensor, const Vec2& slope) {
  const RangeModel model = range_model(sensor);
  const double whole = static_cast<double>(sums.weight);
  const double single = whole / model.rays_alike;
  double floor = square(model.floor_m);
  if (is_moving(sensor)) {
    const double arm2_m2 =
        square(kScanLever_m / whole) *
        (square(static_cast<double>(sums.sees[1])) + square(static_cast<double>(sums.sees[2])));
    floor += slope.squaredNorm() *
             (square(sensor.pose_shift_sigma_m) + square(sensor.pose_turn_sigma_rad) * arm2_m2);
  }
  return single / (1 + single * floor);
}

ColumnResidual ScanState::residual_of(const ScanTile& tile, std::size_t i,
                                      Eigen::Ref<Eigen::VectorXd> sees) const {
  sees.setZero();
  const double variance = tile.columns[i].variance;
  const double bend = square(kBendFloor * tile.bends[i] * voxel_m());
  ColumnResidual all{0, 0, (1 - kAlikeShare) * variance + bend, std::sqrt(kAlikeShare * variance)};
  const double rough = square(kSlopeFloorM) * tile.slopes[i].squaredNorm() + bend;
  for (const auto& [number, of_tile] : tile.sums) {
    const ScanSums& sum = of_tile[i];
    if (sum.rays == 0) continue;
    const auto s = static_cast<std::size_t>(number);
    const double whole = static_cast<double>(sum.weight);
    const double weight = weight_of(sum, sensors[s], tile.slopes[i]);
    all.weight += weight;
    all.residual += weight * kScanUnit_m * static_cast<double>(sum.residual) / whole;
    for (int n = 0; n < kOfSensor; ++n)
      sees[place_of(s) + n] += weight * kScanLever_m *
                               static_cast<double>(sum.sees[static_cast<std::size_t>(n)]) / whole;
  }
  if (all.weight > 0) {
    all.residual /= all.weight;
    sees /= all.weight;
    all.weight /= 1 + all.weight * rough;  // which is the column's own, whichever sensors see it
  }
  return all;
}

bool ScanState::tells_of_errors(const ScanTile& tile, std::size_t i,
                                const ColumnResidual& residual) const {
  return residual.weight > 0 && !is_other(tile.columns[i]) &&
         kBendFloor * tile.bends[i] * voxel_m() < kMostBendErrorM;
}

Block ScanState::block_of(const ScanTile& tile, std::size_t i) const {
  const Coord2 at = tile.place(i);
  return {tile.columns[i].origin, tile.columns[i].pass, square_of(at.x(), block_side()),
          square_of(at.y(), block_side())};
}

Eigen::Vector2d ScanState::place_in(const Block& block, const ScanTile& tile, std::size_t i) const {
  return (tile.place(i) - block_side() * Coord2(block.x, block.y)).cast<double>();
}

void ScanState::retire(const ScanTile& tile, std::size_t i) {
  const ScanColumn& column = tile.columns[i];
  Eigen::VectorXd sees(error_count());
  const ColumnResidual residual = residual_of(tile, i, sees);
  if (column.origin == kSurveyed || !tells_of_errors(tile, i, residual)) return;
  if (square(residual.residual) >
      square(kColumnGate) * (column.variance + prior().maxCoeff() + 1 / residual.weight))
    return;
  const Block block = block_of(tile, i);
  untold_blocks.insert(block);
  if (const Eigen::Index lip = lip_of(column); lip >= 0) sees[lip] -= 1;
  blocks[block].retired.add(residual, sees, place_in(block, tile, i));
}

bool ScanState::is_other(const ScanColumn& column) {
  return column.prior >= square(kChangedSigmaM);
}

bool ScanState::is_datum(const ScanColumn& column) {
  return column.origin == kNatural && column.top == column.first && !is_other(column);
}

void ScanState::retire_blocks() {
  for (auto at = blocks.begin(); at != blocks.end();) {
    const auto& [block, state] = *at;
    if (block.pass == 0 || state.sums) {
      ++at;
      continue;
    }
    const Block past{block.origin, 0, block.x, block.y};
    untold_blocks.insert({block, past});
    blocks[past].retired.add(state.retired);
    at = blocks.erase(at);
  }
}

BlockError ScanState::error_of(const Block& block) const {
  const auto known = blocks.find(block);
  return (known == blocks.end() ? BlockResidual{} : known->second.known).error(error_count());
}

void ScanState::correct(const ScanTile& tile, std::size_t i, ColumnResidual residual,
                        const BlockError& block, const Eigen::Ref<const Eigen::VectorXd>& sees,
                        CommonErrors::Correction& to) const {
  const ScanColumn& column = tile.columns[i];
  const Eigen::Index lip = lip_of(column);
  const double share = lip >= 0 ? tile.lip_shares[i] : 0.0;
  if (is_other(column)) {
    residual.variance = column.prior;
    residual.alike = 0;
  } else if (lip >= 0) {
    residual.alike *= share;
  }
  errors.correct(residual, block, sees,
                 share * Eigen::VectorXd::Unit(sees.size(), std::max<Eigen::Index>(lip, 0)), to);
}

double ScanState::height_variance(const ScanTile& tile, std::size_t i) const {
  const ScanColumn& column = tile.columns[i];
  Eigen::VectorXd sees(error_count());
  const ColumnResidual residual = residual_of(tile, i, sees);
  CommonErrors::Correction correction;
  const BlockError block = error_of(block_of(tile, i));
  correct(tile, i, residual, block, sees, correction);
  const double off = voxel_m() * (column.first - column.top) + correction.mean;
  return errors.variance(correction, block) + off * off;
}

double ScanState::untold_about(const ScanTile& tile, std::size_t i) {
  const int x = static_cast<int>(i) / kChunkSide, y = static_cast<int>(i) % kChunkSide;
  int all = 0, untold = 0;
  for (int u = std::max(0, x - 1); u <= std::min(kChunkSide - 1, x + 1); ++u) {
    for (int v = std::max(0, y - 1); v <= std::min(kChunkSide - 1, y + 1); ++v) {
      if (u == x && v == y) continue;
      const auto n = static_cast<std::size_t>(u * kChunkSide + v);
      ++all;
      untold += is_other(tile.columns[n]) && !tile.is_met(n);
    }
  }
  return static_cast<double>(untold) / all;
}

void ScanState::add_volume(BlockSums& to, const ScanTile& tile, std::size_t i,
                           const ColumnResidual& residual, const BlockError& block,
                           const CommonErrors::Correction& correction, double area_m2,
                           bool is_corrected) const {
  const ScanColumn& column = tile.columns[i];
  double off = correction.on.dot(errors.mean()) + correction.alike * errors.mean_of(block);
  if (!is_corrected) off += voxel_m() * (column.first - column.top) + correction.mean;
  const double own = area_m2 * std::sqrt(correction.own);
  const double seen = residual.weight * correction.own;  // share that measurements have in it
  if (is_other(column)) {
    // What scans measured to be another height errs by itself; what they only say is another errs
    // as those about it do.
    const double alike = residual.weight > 0 ? 0 : untold_about(tile, i);  // of the variance
    to.apart += square(own) * (1 - alike);
    to.untold_m3 += own * std::sqrt(alike);
  } else {
    to.apart += square(own) * seen;
    to.near_m3 += own * std::sqrt(std::max(0.0, 1 - seen));
  }
  to.alike_m3 += area_m2 * correction.alike;
  to.volume_on += area_m2 * correction.on;
  to.off_m3 += area_m2 * off;
}

double ScanState::VolumeError::sigma_m3() const {
  const double off = off_m3_ - on_.dot(errors_.mean());
  return std::sqrt(on_.dot(errors_.covariance() * on_) + square(off) + variance_);
}

std::vector<ScanTile*> ScanState::tiles_of(const Block& block) {
  const int side = block_side();
  std::vector<ScanTile*> found;
  for (int x = floor_to(block.x * side, kChunkSide); x < (block.x + 1) * side; x += kChunkSide)
    for (int y = floor_to(block.y * side, kChunkSide); y < (block.y + 1) * side; y += kChunkSide)
      if (const auto tile = tiles.find(plan_key({x, y})); tile != tiles.end())
        found.push_back(&tile->second);
  return found;
}

CommonErrors ScanState::estimate() const {
  CommonErrors all(prior());
  for (const auto& [block, state] : blocks) {
    const BlockResidual told = state.told();
    // A part of a block hangs together with what is beside it: the errors of blocks that are cut
    // in parts, by a trench or an edge of the view, are fewer than the parts.
    if (told.weight > 0) all.add(told, 1 / std::sqrt(told.extent(block_side())));
  }
  all.solve();
  return all;
}

class ScanState::SeenColumns {
 public:
  SeenColumns(ScanState& state, const Tiles& tiles) : state_(state), errors_(state.error_count()) {
    columns_.reserve(tiles.size() * BaseColumn::kCells);
    sees_.reserve((columns_.capacity() + 1) * static_cast<std::size_t>(errors_));
    for (const auto& cell : tiles) add(state.marked(cell));
    own_tiles_ = tiles_.size();
    own_ = columns_.size();
  }

  /// What the columns say of the common errors, and the errors of their volumes, as they are.
  void sum_up() {
    const std::set<Block> blocks = sum_told();
    sum_volumes(nullptr);
    sum_blocks(blocks);
  }

  /// Finds the common errors, and the columns that are off by more than these explain.
  /// @return corrections that are worth it
  std::vector<ScanChange> corrections() {
    for (std::size_t n = 0; n < own_; ++n) tell(columns_[n], columns_[n].is_surveyed());
    const std::set<Block> blocks = sum_told();
    sum_blocks(blocks);
    state_.errors = state_.estimate();
    look_beside();
    std::vector<Judged> judged;
    judged.reserve(columns_.size());
    for (const Column& c : columns_) judged.push_back({c.residual.weight, 0, c.block.origin});
    for (std::size_t t = 0; t < own_tiles_; ++t) find_weights_about(tiles_[t], judged);
    for (int round = 0; round < kGateRounds; ++round) {
      const Eigen::VectorXd& mean = state_.errors.mean();
      for (std::size_t n = 0; n < columns_.size(); ++n) {
        const Column& c = columns_[n];
        judged[n].off = c.residual.residual - sees(n).dot(mean) + (c.lip >= 0 ? mean[c.lip] : 0);
      }
      for (std::size_t t = 0; t < own_tiles_; ++t)
        if (judge(tiles_[t], judged)) tiles_[t].is_told = false;
      const std::set<Block> changed = sum_told();
      if (changed.empty()) break;
      sum_blocks(changed);
      state_.errors = state_.estimate();
    }
    for (std::size_t t = 0; t < own_tiles_; ++t) judge_unseen(tiles_[t]);
    std::vector<ScanChange> made;
    sum_volumes(&made);
    sum_blocks(blocks);
    return made;
  }

 private:
  struct Column {
    ScanTile* tile;
    std::size_t i;
    ColumnResidual residual;
    Eigen::Index lip;  // as of lip_of()
    Block block;
    bool is_other = false;
    double weight_about = 0;  // of it and those of its origin about it

    ScanColumn& column() const { return tile->columns[i]; }
    bool is_surveyed() const { return block.origin == kSurveyed; }
  };
  /// What judge() asks about the columns about one, close together.
  struct Judged {
    double weight, off;  // off: more than the common errors explain, m
    std::uint16_t origin;
  };
  static constexpr int kReach = 2, kWindow = kChunkSide + 2 * kReach;  // columns
  struct OfTile {
    ScanTile* tile;
    std::size_t first, last;                           // its columns
    bool is_told = false;                              // its parts have what its columns say
    std::array<int, BaseColumn::kCells> numbers = {};  // of its columns; -1: not seen
    std::array<int, kWindow* kWindow> about = {};      // the same, and of those beside it
  };

  Eigen::Map<Eigen::VectorXd> sees(std::size_t n) {
    return {sees_.data() + n * static_cast<std::size_t>(errors_), errors_};
  }

  /// What columns say of the common errors, of tiles of which that changed.
  /// @return the blocks of which their parts changed
  std::set<Block> sum_told() {
    std::set<Block> changed;
    for (std::size_t t = 0; t < own_tiles_; ++t) {
      if (std::exchange(tiles_[t].is_told, true)) continue;
      std::map<Block, BlockSums>& parts = tiles_[t].tile->parts;
      for (const auto& [block, part] : parts) changed.insert(block);
      parts.clear();
      std::pair<const Block, BlockSums>* at = nullptr;
      for (std::size_t n = tiles_[t].first; n < tiles_[t].last; ++n) {
        const Column& c = columns_[n];
        if (at == nullptr || at->first != c.block) at = &*parts.try_emplace(c.block, errors_).first;
        ++at->second.columns;
        if (!state_.tells_of_errors(*c.tile, c.i, c.residual)) continue;
        told_ = sees(n);
        if (c.lip >= 0) told_[c.lip] -= 1;
        at->second.told.add(c.residual, told_, state_.place_in(c.block, *c.tile, c.i));
      }
      for (const auto& [block, part] : parts) changed.insert(block);
    }
    return changed;
  }

  /// What the common errors do to the columns' corrections, and the errors of the volumes.
  /// @param made corrections that are worth it; null: they are not to be made
  void sum_volumes(std::vector<ScanChange>* made) {
    const double area_m2 = square(state_.voxel_m());
    for (std::size_t t = 0; t < own_tiles_; ++t) {
      std::pair<const Block, BlockSums>* at = nullptr;
      const BlockError* error = nullptr;
      for (std::size_t n = tiles_[t].first; n < tiles_[t].last; ++n) {
        const Column& c = columns_[n];
        if (at == nullptr || at->first != c.block) {
          at = &*c.tile->parts.find(c.block);
          error = &error_of(c.block);
        }
        BlockSums& part = at->second;
        state_.correct(*c.tile, c.i, c.residual, *error, sees(n), correction_);
        part.on += correction_.on;
        part.alike += correction_.alike;
        const bool is_corrected = made != nullptr && make(c, *error, *made);
        if (is_corrected || !is_datum(c.column()))
          state_.add_volume(part, *c.tile, c.i, c.residual, *error, correction_, area_m2,
                            is_corrected);
      }
    }
  }

  /// Makes a column's correction. @return whether that is worth it
  bool make(const Column& c, const BlockError& block, std::vector<ScanChange>& made) {
    const double h = state_.voxel_m();
    const ScanColumn& column = c.column();
    const double off = h * (column.first - column.top) + correction_.mean;
    if (!(std::abs(off) >= kLeastCorrection * h) || !std::isfinite(off)) return false;
    double sigmas = column.origin == kNatural && !is_other(column) ? kNaturalSigmas : kMovedSigmas;
    double variance = state_.errors.variance(correction_, block);
    if (c.residual.weight <= 0) {
      // The soil that rays passed through is surely gone. Elsewhere the lip alone is known better:
      // what else a column errs by is the same before and after.
      if (c.is_surveyed()) sigmas = 0;
      if (c.lip >= 0) variance -= correction_.own;
    }
    if (std::abs(off) < sigmas * std::sqrt(variance)) return false;
    made.push_back({c.tile->place(c.i), column.top, std::llround(off / h * kSamplesOfCell),
                    c.tile->slopes[c.i]});
    return true;
  }

  /// What is known of a block by the sums that it has.
  const BlockError& error_of(const Block& block) {
    const auto known = block_errors_.find(block);
    if (known != block_errors_.end()) return known->second;
    return block_errors_.emplace(block, state_.error_of(block)).first->second;
  }

  void sum_blocks(const std::set<Block>& changed) {
    block_errors_.clear();
    for (const Block& block : changed) {
      BlockState& of = state_.blocks[block];
      std::optional<BlockSums>& sums = of.sums;
      sums.reset();
      for (const ScanTile* tile : state_.tiles_of(block))
        if (const auto part = tile->parts.find(block); part != tile->parts.end()) {
          if (!sums) sums.emplace(errors_);
          sums->add(part->second);
        }
      of.known = of.told();
      state_.untold_blocks.insert(block);
    }
  }

  void add(ScanTile& tile) {
    OfTile& of = tiles_.emplace_back(OfTile{&tile, columns_.size(), 0});
    of.numbers.fill(-1);
    std::vector<std::size_t> unseen;
    std::vector<Block> seen;
    const auto add_column = [&](std::size_t i, const ColumnResidual& residual, const Block& block) {
      of.numbers[i] = static_cast<int>(columns_.size());
      const ScanColumn& column = tile.columns[i];
      columns_.push_back({&tile, i, residual, state_.lip_of(column), block, is_other(column)});
    };
    sees_.resize((columns_.size() + BaseColumn::kCells + 1) * static_cast<std::size_t>(errors_));
    const auto next = [&](std::size_t i) {
      return state_.residual_of(tile, i, sees(columns_.size()));
    };
    for (std::size_t i = 0; i < BaseColumn::kCells; ++i) {
      const ScanColumn& column = tile.columns[i];
      if (std::isnan(column.top)) continue;
      const ColumnResidual residual = next(i);
      const bool is_told = column.origin == kSurveyed && column.first != column.top;
      if (residual.weight > 0 || is_told) {
        const Block block = state_.block_of(tile, i);
        if (column.origin != kSurveyed && (seen.empty() || seen.back() != block))
          seen.push_back(block);
        add_column(i, residual, block);
      } else if (column.origin != kSurveyed) {
        unseen.push_back(i);
      }
    }
    // A lidar's rings leave columns between them, whose errors are alike.
    for (const std::size_t i : unseen) {
      const bool is_no_ones_wall = is_wall(tile, i) && state_.lip_of(tile.columns[i]) < 0;
      const Block block = state_.block_of(tile, i);
      const bool is_between =
          !is_no_ones_wall && std::find(seen.begin(), seen.end(), block) != seen.end();
      if (is_between || is_contested(tile, i)) add_column(i, next(i), block);
    }
    of.last = columns_.size();
  }

  /// Adds the tiles beside, whose columns count where it is asked what a column's surroundings say.
  void look_beside() {
    Tiles own, beside;
    for (const OfTile& of : tiles_) own.insert(mark(of.tile->cell));
    for (const auto& [x, y] : own)
      for (int dx = -kChunkSide; dx <= kChunkSide; dx += kChunkSide)
        for (int dy = -kChunkSide; dy <= kChunkSide; dy += kChunkSide)
          if (!own.contains({x + dx, y + dy}) && state_.tiles.contains(plan_key({x + dx, y + dy})))
            beside.emplace(x + dx, y + dy);
    for (const auto& cell : beside) add(state_.marked(cell));
    std::unordered_map<std::uint64_t, const OfTile*, PlanHash> by_cell;
    for (const OfTile& of : tiles_) by_cell[plan_key(of.tile->cell)] = &of;
    for (std::size_t t = 0; t < own_tiles_; ++t) {
      const Coord2& low = tiles_[t].tile->cell;
      std::array<const OfTile*, 9> near = {};
      for (int k = 0; k < 9; ++k)
        if (const auto found =
                by_cell.find(plan_key(low + kChunkSide * Coord2(k / 3 - 1, k % 3 - 1)));
            found != by_cell.end())
          near[static_cast<std::size_t>(k)] = found->second;
      for (int x = 0; x < kWindow; ++x) {
        for (int y = 0; y < kWindow; ++y) {
          const Coord2 in = Coord2(x - kReach, y - kReach) + Coord2::Constant(kChunkSide);
          const OfTile* of =
              near[static_cast<std::size_t>(in.x() / kChunkSide * 3 + in.y() / kChunkSide)];
          tiles_[t].about[static_cast<std::size_t>(x * kWindow + y)] =
              of == nullptr ? -1 : of->numbers[number_of(in)];
        }
      }
    }
  }

  void tell(Column& c, bool is_other) {
    c.is_other = is_other;
    c.column().prior = is_other ? square(kChangedSigmaM) : c.residual.whole_variance();
  }

  /// Sums over the columns within kReach of each of a tile's.
  static std::array<double, BaseColumn::kCells> sums_about(
      const std::array<double, kWindow * kWindow>& values) {
    constexpr std::size_t kSide = kChunkSide, kAll = kWindow, kNear = 2 * kReach;
    std::array<double, kSide * kAll> rows;
    for (std::size_t x = 0; x < kSide; ++x) {
      for (std::size_t y = 0; y < kAll; ++y) {
        double sum = 0;
        for (std::size_t u = x; u <= x + kNear; ++u) sum += values[u * kAll + y];
        rows[x * kAll + y] = sum;
      }
    }
    std::array<double, BaseColumn::kCells> sums;
    for (std::size_t x = 0; x < kSide; ++x) {
      for (std::size_t y = 0; y < kSide; ++y) {
        double sum = 0;
        for (std::size_t v = y; v <= y + kNear; ++v) sum += rows[x * kAll + v];
        sums[x * kSide + y] = sum;
      }
    }
    return sums;
  }

  /// Sums over the columns about each of a tile's, those of its origin, of what value(judged) is.
  /// Calls f(column, number, sum) for those that scans did not correct.
  template <typename Value, typename F>
  void each_about(const OfTile& of, const std::vector<Judged>& judged, const Value& value,
                  const F& f) {
    std::array<bool, BaseColumn::kCells> known = {};  // those of an origin that was looked at
    for (std::size_t first = of.first; first < of.last; ++first) {
      const std::uint16_t origin = columns_[first].block.origin;
      if (origin == kSurveyed || known[columns_[first].i]) continue;
      std::array<double, kWindow* kWindow> values = {};
      for (std::size_t k = 0; k < of.about.size(); ++k) {
        if (of.about[k] < 0) continue;
        const Judged& about = judged[static_cast<std::size_t>(of.about[k])];
        if (about.origin == origin) values[k] = value(about);
      }
      const auto sums = sums_about(values);
      for (std::size_t n = first; n < of.last; ++n) {
        Column& c = columns_[n];
        if (c.block.origin != origin) continue;
        known[c.i] = true;
        f(c, n, sums[c.i]);
      }
    }
  }

  void find_weights_about(const OfTile& of, const std::vector<Judged>& judged) {
    each_about(
        of, judged, [](const Judged& about) { return about.weight; },
        [](Column& c, std::size_t, double sum) { c.weight_about = sum; });
  }

  /// Are columns that rays met other than errors explain, by themselves or with those about them?
  /// @return whether that of some changed
  bool judge(const OfTile& of, const std::vector<Judged>& judged) {
    bool any = false;
    each_about(
        of, judged, [](const Judged& about) { return about.weight * about.off; },
        [&](Column& c, std::size_t n, double residual) {
          if (c.residual.weight <= 0) return;
          const double variance = c.residual.whole_variance(), about = c.weight_about;
          const bool is_other =
              std::abs(residual / about) > kPooledGate * std::sqrt(variance + 1 / about) ||
              std::abs(judged[n].off) > kColumnGate * std::sqrt(variance + 1 / c.residual.weight);
          if (is_other == c.is_other) return;  // as it was told
          tell(c, is_other);
          any = true;
        });
    return any;
  }

  /// Of columns that no ray met as expected: do rays, or most columns about one, say that it is
  /// another?
  void judge_unseen(const OfTile& of) {
    std::optional<std::array<double, BaseColumn::kCells>> others;  // less those as expected
    for (std::size_t n = of.first; n < of.last; ++n) {
      Column& c = columns_[n];
      if (c.residual.weight > 0 || c.is_surveyed()) continue;
      if (!others) {
        std::array<double, kWindow* kWindow> about = {};
        for (std::size_t k = 0; k < about.size(); ++k) {
          if (of.about[k] < 0) continue;
          const Column& near = columns_[static_cast<std::size_t>(of.about[k])];
          if (near.residual.weight > 0) about[k] = near.is_other ? 1 : -1;
        }
        others = sums_about(about);
      }
      tell(c, (*others)[c.i] > 0 || is_contested(*c.tile, c.i));
    }
  }

  ScanState& state_;
  const Eigen::Index errors_;
  std::vector<Column> columns_;
  std::vector<double> sees_;  // a, without b, of each column
  std::vector<OfTile> tiles_;
  std::size_t own_tiles_ = 0, own_ = 0;  // those beside stand behind
  CommonErrors::Correction correction_;
  Eigen::VectorXd told_;
  std::map<Block, BlockError> block_errors_;
};

ScanState::Tiles ScanState::moved() {
  Tiles found;
  for (const auto& [block, state] : blocks) {
    if (!state.sums || state.sums->columns == 0 || state.solved.size() == 0) continue;
    const double alike = errors.mean_of(error_of(block)) - state.solved_alike;
    const double by =
        (state.sums->on.dot(errors.mean() - state.solved) + state.sums->alike * alike) /
        state.sums->columns;
    if (std::abs(by) < kLeastCorrection / 2 * voxel_m()) continue;
    for (const ScanTile* tile : tiles_of(block)) found.insert(mark(tile->cell));
  }
  return found;
}

/// Only the tiles of which scans told something are corrected, so that it costs as much as these,
/// whatever was ever scanned. Others are when the common errors have become others.
std::vector<ScanChange> ScanState::solve() {
  is_solved = true;
  take_votes();
  Tiles now = news;
  Tiles others;
  std::set_difference(unsummed.begin(), unsummed.end(), now.begin(), now.end(),
                      std::inserter(others, others.end()));
  SeenColumns(*this, others).sum_up();
  for (auto& [block, state] : blocks) {  // also of columns that have changed since a scan
    BlockResidual told = state.told();
    if (told.weight == state.known.weight && told.residual == state.known.residual) continue;
    state.known = std::move(told);
    untold_blocks.insert(block);
  }
  std::vector<ScanChange> made = SeenColumns(*this, now).corrections();
  const std::size_t count = now.size();
  now.merge(moved());
  if (now.size() > count) made = SeenColumns(*this, now).corrections();
  unsummed.clear();
  for (const ScanChange& change : made) unsummed.insert(mark(floor_to(change.cell, kChunkSide)));
  std::set<Block> seen_blocks;
  for (const auto& cell : now)
    for (const auto& [block, part] : marked(cell).parts) seen_blocks.insert(block);
  for (const Block& block : seen_blocks) {
    Eigen::VectorXd& solved = blocks[block].solved;
    const std::vector<ScanTile*> reached = tiles_of(block);
    const bool all = std::all_of(reached.begin(), reached.end(), [&](const ScanTile* tile) {
      return now.contains(mark(tile->cell));
    });
    if (solved.size() > 0 && !all) continue;  // some of its columns were corrected before
    solved = errors.mean();
    blocks[block].solved_alike = errors.mean_of(error_of(block));
    untold_blocks.insert(block);
  }
  retire_blocks();
  ++solutions;
  VolumeError error(errors);
  for (const auto& [block, state] : blocks)
    if (state.sums) error.add(*state.sums, error_of(block));
  sigma_m3 = error.sigma_m3();
  untold.insert(now.begin(), now.end());
  news.clear();
  has_corrected = true;
  return made;
}

}  // namespace soilvdb::inline v0
