// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The state of GroundScans as bytes. Columns that no scan told anything of are left out.
#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>

#include "core/constants.h"
#include "core/lattice/bytes.h"
#include "core/survey/scan_state.h"

namespace soilvdb::inline v0 {
namespace {

constexpr std::uint32_t kScanFormat = 8;

[[noreturn]] void refuse_scans() {
  throw std::invalid_argument("the state of the scans is of another site");
}

/// A number from 0 to below `end`.
template <typename T>
T take_number(std::string_view& in, std::uint64_t end) {
  std::uint64_t value = 0;
  take(in, value);
  if (value >= end) refuse_scans();
  return static_cast<T>(value);
}
void put_number(std::string& out, std::uint64_t value) { put(out, value); }

double take_finite(std::string_view& in) {
  double value = 0;
  take(in, value);
  if (!std::isfinite(value)) refuse_scans();
  return value;
}

void put_sums(std::string& out, const ScanSums& sums) {
  put(out, sums.rays, sums.weight, sums.residual);
  for (const std::int64_t value : sums.sees) put(out, value);
}
void take_sums(std::string_view& in, ScanSums& sums) {
  take_amount(in, sums.rays);
  take_amount(in, sums.weight);
  take(in, sums.residual);
  for (std::int64_t& value : sums.sees) take(in, value);
  if (sums.rays > 0 && sums.weight == 0) refuse_scans();
}

void put_cells(std::string& out, const ScanCells& cells) {
  put(out, cells.rays);
  for (const std::int64_t area : cells.areas) put(out, area);
}
void take_cells(std::string_view& in, ScanCells& cells) {
  take_amount(in, cells.rays);
  for (std::int64_t& area : cells.areas) take_amount(in, area);
}

void put_column(std::string& out, const ScanColumn& column, const ColumnRays& rays) {
  put(out, column.first, column.top, column.variance, column.prior);
  put_number(out, column.origin);
  put(out, column.changed, column.pass, rays.met, rays.height, rays.blind);
  put_cells(out, rays.cells);
}
void take_column(std::string_view& in, ScanColumn& column, ColumnRays& rays,
                 std::uint64_t origins) {
  take(in, column.first, column.top);  // NaN without ground
  column.variance = take_finite(in);
  column.prior = take_finite(in);
  if (std::isnan(column.first) != std::isnan(column.top) || !(column.variance > 0)) refuse_scans();
  column.origin = take_number<std::uint16_t>(in, origins);
  take(in, column.changed, column.pass);
  take_amount(in, rays.met);
  take(in, rays.height);
  take_amount(in, rays.blind);
  take_cells(in, rays.cells);
}

void put_votes(std::string& out, const ScanVotes& votes) {
  put(out, votes.through, votes.ceiling, votes.told, votes.others);
  put_number(out, votes.hits.size());
  for (const auto& [bin, hits] : votes.hits) {
    put(out, bin);
    put_number(out, hits.size());
    for (const auto& [sensor, of_sensor] : hits) {
      put_number(out, static_cast<std::uint64_t>(sensor));
      put(out, of_sensor.rays, of_sensor.height);
      put_cells(out, of_sensor.cells);
      put_sums(out, of_sensor.sums);
    }
  }
}
void take_votes_of(std::string_view& in, ScanVotes& votes, std::size_t sensors) {
  take_amount(in, votes.through);
  take(in, votes.ceiling);
  take_amount(in, votes.told);
  take_amount(in, votes.others);
  for (auto bins = take_number<std::uint64_t>(in, in.size() + 1); bins > 0; --bins) {
    int bin = 0;
    take(in, bin);
    for (auto count = take_number<std::uint64_t>(in, sensors + 1); count > 0; --count) {
      ScanHits& hits = votes.hits[bin][take_number<int>(in, sensors)];
      take_amount(in, hits.rays);
      take(in, hits.height);
      take_cells(in, hits.cells);
      take_sums(in, hits.sums);
    }
  }
  if (votes.told > votes.rays()) refuse_scans();
}

using Tiles = ScanState::Tiles;

void put_cells_of(std::string& out, const Tiles& tiles) {
  put_number(out, tiles.size());
  for (const auto& [x, y] : tiles) put(out, x, y);
}
Coord2 take_cell(std::string_view& in) {
  Coord2 cell;
  take(in, cell);
  if (floor_to(cell, kChunkSide) != cell || cell.cwiseAbs().maxCoeff() > kMaxIndex) refuse_scans();
  return cell;
}
/// Of tiles that there are.
void take_cells_of(std::string_view& in, const ScanState& s, Tiles& tiles) {
  for (auto count = take_number<std::uint64_t>(in, in.size() + 1); count > 0; --count) {
    const Coord2 cell = take_cell(in);
    if (!s.tiles.contains(plan_key(cell))) refuse_scans();
    tiles.insert(ScanState::mark(cell));
  }
}

void put_block(std::string& out, const Block& block) {
  put_number(out, block.origin);
  put(out, block.pass, block.x, block.y);
}
Block take_block(std::string_view& in, std::uint64_t origins) {
  Block block{take_number<std::uint16_t>(in, origins), 0, 0, 0};
  take(in, block.pass, block.x, block.y);
  return block;
}

void put_tile(std::string& out, const ScanTile& tile) {
  put(out, tile.cell);
  for (std::size_t i = 0; i < tile.columns.size(); ++i)
    put_column(out, tile.columns[i], tile.rays[i]);
  put_number(out, tile.sums.size());
  for (const auto& [sensor, of_sensor] : tile.sums) {
    put_number(out, static_cast<std::uint64_t>(sensor));
    for (const ScanSums& of_column : of_sensor) put_sums(out, of_column);
  }
  put_number(out, tile.votes.size());
  for (const auto& [column, votes] : tile.votes) {
    put_number(out, static_cast<std::uint64_t>(column));
    put_votes(out, votes);
  }
}
void take_tile(std::string_view& in, ScanState& s, std::uint64_t origins) {
  const Coord2 cell = take_cell(in);
  ScanTile& tile = s.tiles[plan_key(cell)];
  std::map<Block, BlockSums> parts = std::move(tile.parts);  // which sums still have in them
  tile = {};
  tile.cell = cell;
  tile.parts = std::move(parts);
  for (std::size_t i = 0; i < tile.columns.size(); ++i)
    take_column(in, tile.columns[i], tile.rays[i], origins);
  const std::size_t sensors = s.sensors.size();
  for (auto sums = take_number<std::uint64_t>(in, sensors + 1); sums > 0; --sums)
    for (ScanSums& of_column : tile.sums[take_number<int>(in, sensors)]) take_sums(in, of_column);
  for (auto votes = take_number<std::uint64_t>(in, BaseColumn::kCells + 1); votes > 0; --votes) {
    const int column = take_number<int>(in, BaseColumn::kCells);
    take_votes_of(in, tile.votes[column], sensors);
  }
  s.stale.insert(ScanState::mark(cell));
  s.unsummed.insert(ScanState::mark(cell));
}

void put_block_state(std::string& out, const ScanState::BlockState& state) {
  for (const BlockResidual* told : {&state.retired, &state.known}) {
    put(out, told->weight, told->residual);
    for (const double value : told->places) put(out, value);
    for (const double value : told->sees) put(out, value);
  }
  put(out, state.solved.size() > 0);
  for (const double value : state.solved) put(out, value);
  put(out, state.solved_alike);
}

void put_scans(std::string& out, const ScanState& s, bool all, const Tiles& tiles,
               const std::set<Block>& blocks) {
  put(out, kScanFormat, all);
  put_number(out, s.sensors.size());
  for (const Sensor& sensor : s.sensors) {
    put_text(out, sensor.name);
    put(out, sensor.pose);
    for (const SensorSigma& sigma : kSensorSigmas) put(out, sensor.*sigma.field);
  }
  put_number(out, s.buckets.size());
  const CommonErrors& errors = s.errors;
  for (Eigen::Index i = 0; i < errors.mean().size(); ++i) {
    put(out, errors.mean()[i]);
    for (Eigen::Index j = 0; j <= i; ++j) put(out, errors.covariance()(i, j));
  }
  put(out, s.rays.used, s.rays.masked, s.rays.through, s.rays.added, s.rays.dropped, s.time,
      s.solutions);
  if (all) {
    const std::map<std::uint64_t, ScanState::Work> work(s.work.begin(), s.work.end());
    put_number(out, work.size());
    for (const auto& [key, of] : work) {
      put_number(out, key);
      put_number(out, of.origin);
      put(out, of.time);
      put_number(out, of.turn);
      put(out, of.was_cut_since);
      put_number(out, of.turns.size());
      for (const ScanState::Turns& turns : of.turns) {
        put_number(out, turns.origin);
        put(out, turns.count);
      }
    }
  }
  put_number(out, blocks.size());
  for (const Block& block : blocks) {
    put_block(out, block);
    const auto known = s.blocks.find(block);  // none: it was retired
    put_block_state(out, known != s.blocks.end() ? known->second : ScanState::BlockState());
  }
  std::vector<ThroughRay> through = s.through;
  std::sort(through.begin(), through.end());
  put_number(out, through.size());
  for (const ThroughRay& ray : through) {
    put(out, ray.time, ray.from, ray.to, ray.met_m, ray.sigma_m);
  }
  put(out, s.is_solved, s.sigma_m3);
  put_number(out, tiles.size());
  for (const auto& [x, y] : tiles) put_tile(out, s.tiles.at(plan_key({x, y})));
  put_cells_of(out, s.news);
  put(out, s.has_corrected, s.is_first);
  if (!all) return;
  put_cells_of(out, s.untold);
  put_number(out, s.untold_blocks.size());
  for (const Block& block : s.untold_blocks) put_block(out, block);
}

bool tells(const ScanState::BlockState& state) {
  return state.known.weight > 0 || state.retired.weight > 0 || state.solved.size() > 0;
}

/// What is to be saved of all blocks.
std::set<Block> told_blocks(const ScanState& s) {
  std::set<Block> told;
  for (const auto& [block, state] : s.blocks)
    if (tells(state)) told.insert(block);
  return told;
}

}  // namespace

void GroundScans::save(std::string& out) const {
  Tiles tiles;
  for (const auto& [key, tile] : state_->tiles) tiles.insert(ScanState::mark(tile.cell));
  put_scans(out, *state_, true, tiles, told_blocks(*state_));
}

void GroundScans::save_changes(std::string& out) const {
  const ScanState::Telling& telling = state_->telling;
  if (telling.all) {
    save(out);
  } else {
    put_scans(out, *state_, false, telling.tiles, telling.blocks);
  }
}

void GroundScans::load(std::string_view& in) {
  std::uint32_t format = 0;
  bool all = false;
  take(in, format);
  if (format != kScanFormat)
    throw std::invalid_argument("the state of the scans is of another version of soilvdb");
  take(in, all);
  if (all) {
    std::vector<double> lips = state_->lip_sigmas_m;
    lips.pop_back();  // that of a tool that is not known
    state_ = std::make_unique<ScanState>(state_->ground, state_->buckets, std::move(lips),
                                         state_->surveyed);
  }
  ScanState& s = *state_;
  const std::uint64_t origins = kFirstMachine + s.buckets.size();
  const int sensors = take_number<int>(in, kMostSensors + 1);
  for (int n = 0; n < sensors; ++n) {
    Sensor sensor;
    sensor.name = take_text(in);
    take(in, sensor.pose);
    for (const SensorSigma& sigma : kSensorSigmas) take(in, sensor.*sigma.field);
    sensor.validate();
    if (s.sensor_of(sensor) != n) refuse_scans();
  }
  if (std::ssize(s.sensors) != sensors) refuse_scans();
  // Machines may have come since.
  const auto machines = take_number<std::size_t>(in, in.size() + 1);
  if (machines > s.buckets.size())
    throw std::invalid_argument("the state of the scans is of " + std::to_string(machines) +
                                " machines, and the site has " + std::to_string(s.buckets.size()) +
                                "; with scans machines stay, also those without a state");
  const auto at = static_cast<Eigen::Index>(machines);
  const Eigen::Index came = std::ssize(s.buckets) - at, known_errors = s.error_count() - came;
  Eigen::VectorXd mean(known_errors);
  Eigen::MatrixXd covariance(known_errors, known_errors);
  for (Eigen::Index i = 0; i < known_errors; ++i) {
    mean[i] = take_finite(in);
    for (Eigen::Index j = 0; j <= i; ++j) covariance(i, j) = covariance(j, i) = take_finite(in);
    if (!(covariance(i, i) > 0)) refuse_scans();
  }
  s.errors = CommonErrors(std::move(mean), std::move(covariance));
  s.widen_errors(at, came);
  for (std::int64_t* value :
       {&s.rays.used, &s.rays.masked, &s.rays.through, &s.rays.added, &s.rays.dropped})
    take_amount(in, *value);
  const std::uint32_t time = s.time;
  take(in, s.time);
  if (!all && s.time != time) refuse_scans();
  take(in, s.solutions);
  if (all)
    for (auto count = take_number<std::uint64_t>(in, in.size() + 1); count > 0; --count) {
      std::uint64_t key = 0;
      take(in, key);
      ScanState::Work& work = s.work[key];
      work.origin = take_number<std::uint16_t>(in, origins);
      take(in, work.time);
      work.turn = take_number<std::uint16_t>(in, origins);
      take(in, work.was_cut_since);
      for (auto turns = take_number<std::uint64_t>(in, origins + 1); turns > 0; --turns) {
        ScanState::Turns& of = work.turns.emplace_back();
        of.origin = take_number<std::uint16_t>(in, origins);
        take(in, of.count);
        if (s.lip_of(of.origin) < 0 || of.count == 0) refuse_scans();
      }
    }
  for (auto count = take_number<std::uint64_t>(in, in.size() + 1); count > 0; --count) {
    const Block block = take_block(in, origins);
    ScanState::BlockState& state = s.blocks[block];
    const auto take_errors = [&](bool any, Eigen::VectorXd& values) {
      values.resize(any ? known_errors : 0);
      for (double& value : values) value = take_finite(in);
      if (any) values = ScanState::widened(values, at, came);
    };
    for (BlockResidual* told : {&state.retired, &state.known}) {
      told->weight = take_finite(in);
      told->residual = take_finite(in);
      for (double& value : told->places) value = take_finite(in);
      if (!(told->weight >= 0)) refuse_scans();
      take_errors(told->weight > 0, told->sees);
    }
    bool is_solved = false;
    take(in, is_solved);
    take_errors(is_solved, state.solved);
    state.solved_alike = take_finite(in);
    if (!tells(state)) s.blocks.erase(block);
  }
  s.through.clear();  // a snapshot may have scans that were applied since
  for (auto count = take_number<std::uint64_t>(in, in.size() + 1); count > 0; --count) {
    ThroughRay& ray = s.through.emplace_back();
    take(in, ray.time);
    for (double* value : {&ray.from.x(), &ray.from.y(), &ray.from.z(), &ray.to.x(), &ray.to.y(),
                          &ray.to.z(), &ray.met_m, &ray.sigma_m})
      *value = take_finite(in);
  }
  take(in, s.is_solved);
  s.sigma_m3 = take_finite(in);
  for (auto count = take_number<std::uint64_t>(in, in.size() + 1); count > 0; --count)
    take_tile(in, s, origins);
  s.news.clear();
  take_cells_of(in, s, s.news);
  take(in, s.has_corrected, s.is_first);
  s.untold.clear();
  s.untold_blocks.clear();
  if (!all) {
    // Corrections, which whoever loads this has made as well, are no work.
    for (const Coord3& origin : s.changes.take()) s.was_surveyed(origin.head<2>());
    return;
  }
  take_cells_of(in, s, s.untold);
  for (auto count = take_number<std::uint64_t>(in, in.size() + 1); count > 0; --count)
    s.untold_blocks.insert(take_block(in, origins));
}

}  // namespace soilvdb::inline v0
