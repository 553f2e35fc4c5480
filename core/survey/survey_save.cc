// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The state of a GroundSurvey as bytes. Columns that no scan told anything of are left out.
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "core/constants.h"
#include "core/lattice/bytes.h"
#include "core/survey/survey_state.h"

namespace soilvdb::inline v0 {
namespace {

constexpr std::uint32_t kSurveyFormat = 2;

[[noreturn]] void refuse_survey() {
  throw std::invalid_argument("the state of the scans is of another site");
}

/// A number from 0 to below `end`.
template <typename T>
T take_number(std::string_view& in, std::uint64_t end) {
  std::uint64_t value = 0;
  take(in, value);
  if (value >= end) refuse_survey();
  return static_cast<T>(value);
}
void put_number(std::string& out, std::uint64_t value) { put(out, value); }

double take_finite(std::string_view& in) {
  double value = 0;
  take(in, value);
  if (!std::isfinite(value)) refuse_survey();
  return value;
}

void put_sums(std::string& out, const ScanSums& sums) {
  put(out, sums.rays);
  put(out, sums.weight);
  put(out, sums.residual);
  for (const std::int64_t value : sums.sees) put(out, value);
}
void take_sums(std::string_view& in, ScanSums& sums) {
  take_amount(in, sums.rays);
  take_amount(in, sums.weight);
  take(in, sums.residual);
  for (std::int64_t& value : sums.sees) take(in, value);
  if (sums.rays > 0 && sums.weight == 0) refuse_survey();
}

void put_cells(std::string& out, const ScanCells& cells) {
  put(out, cells.rays);
  for (const std::int64_t area : cells.areas) put(out, area);
}
void take_cells(std::string_view& in, ScanCells& cells) {
  take_amount(in, cells.rays);
  for (std::int64_t& area : cells.areas) take_amount(in, area);
}

void put_column(std::string& out, const SurveyColumn& column) {
  for (const double value : {column.first, column.top, column.variance, column.prior})
    put(out, value);
  put_number(out, column.origin);
  put(out, column.changed);
  for (const std::int64_t value : {column.rays, column.height}) put(out, value);
  put_cells(out, column.cells);
}
void take_column(std::string_view& in, SurveyColumn& column, std::uint64_t origins) {
  take(in, column.first);
  take(in, column.top);  // NaN without ground
  column.variance = take_finite(in);
  column.prior = take_finite(in);
  if (std::isnan(column.first) != std::isnan(column.top) || !(column.variance > 0)) refuse_survey();
  column.origin = take_number<std::uint16_t>(in, origins);
  take(in, column.changed);
  take_amount(in, column.rays);
  take(in, column.height);
  take_cells(in, column.cells);
}

/// @param numbers of sensors as they are saved
void put_votes(std::string& out, const ScanVotes& votes, const std::vector<int>& numbers) {
  for (const std::int64_t value : {votes.through, votes.ceiling, votes.told, votes.others})
    put(out, value);
  put_number(out, votes.hits.size());
  for (const auto& [bin, hits] : votes.hits) {
    put(out, bin);
    put_number(out, hits.size());
    std::map<int, const ScanHits*> sorted;
    for (const auto& [sensor, of_sensor] : hits)
      sorted[numbers[static_cast<std::size_t>(sensor)]] = &of_sensor;
    for (const auto& [sensor, of] : sorted) {
      const ScanHits& of_sensor = *of;
      put_number(out, static_cast<std::uint64_t>(sensor));
      for (const std::int64_t value : {of_sensor.rays, of_sensor.height}) put(out, value);
      put_cells(out, of_sensor.cells);
      put_sums(out, of_sensor.sums);
    }
  }
}
void take_votes_of(std::string_view& in, ScanVotes& votes, std::uint64_t sensors) {
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
  if (votes.told > votes.rays()) refuse_survey();
}

}  // namespace

void GroundSurvey::save(std::string& out) const {
  const SurveyState& s = *state_;
  put(out, kSurveyFormat);
  // Sensors by their names, so that the order of their first scans does not show.
  std::vector<int> numbers = s.places;
  std::vector<const Sensor*> sensors(s.sensors.size());
  for (std::size_t n = 0; n < numbers.size(); ++n) {
    numbers[n] = (numbers[n] - static_cast<int>(s.lip_sigmas_m.size())) / 4;
    sensors[static_cast<std::size_t>(numbers[n])] = &s.sensors[n];
  }
  put_number(out, s.sensors.size());
  for (const Sensor* of : sensors) {
    const Sensor& sensor = *of;
    put_text(out, sensor.name);
    put(out, sensor.pose);
    for (const double value :
         {sensor.range_sigma_m, sensor.range_squared_sigma_per_m, sensor.mount_height_sigma_m,
          sensor.mount_tilt_sigma_rad, sensor.mount_scale_sigma})
      put(out, value);
  }
  put_number(out, s.buckets.size());
  // Whose places are by the sensors' names.
  const CommonErrors& errors = s.errors;
  for (Eigen::Index i = 0; i < errors.mean().size(); ++i) {
    put(out, errors.mean()[i]);
    for (Eigen::Index j = 0; j <= i; ++j) put(out, errors.covariance()(i, j));
  }
  for (const std::int64_t value :
       {s.rays.used, s.rays.masked, s.rays.through, s.rays.added, s.rays.dropped})
    put(out, value);
  put(out, s.time);
  std::vector<std::uint64_t> keys;
  for (const auto& [key, work] : s.work) keys.push_back(key);
  std::sort(keys.begin(), keys.end());
  put_number(out, keys.size());
  for (const std::uint64_t key : keys) {
    put_number(out, key);
    put_number(out, s.work.at(key).origin);
    put(out, s.work.at(key).time);
  }
  put_number(out, s.retired.size());
  for (const auto& [block, sums] : s.retired) {
    put_number(out, block.origin);
    put(out, block.x);
    put(out, block.y);
    for (const double value : {sums.weight, sums.residual, sums.variance}) put(out, value);
    // Sensors that came later have zeros.
    std::vector<double> sees(s.lip_sigmas_m.size() + 4 * s.sensors.size());
    const std::size_t lips = s.lip_sigmas_m.size();
    for (std::size_t n = 0; n < sums.sees.size(); ++n)
      sees[n < lips ? n
                    : lips + 4 * static_cast<std::size_t>(numbers[(n - lips) / 4]) +
                          (n - lips) % 4] = sums.sees[n];
    for (const double value : sees) put(out, value);
  }
  std::vector<ThroughRay> through = s.through;
  std::sort(through.begin(), through.end());
  put_number(out, through.size());
  for (const ThroughRay& ray : through) {
    put(out, ray.time);
    for (const double value : {ray.from.x(), ray.from.y(), ray.from.z(), ray.to.x(), ray.to.y(),
                               ray.to.z(), ray.met_m, ray.sigma_m})
      put(out, value);
  }
  put(out, s.is_solved);
  put(out, s.sigma_m3);
  const std::vector<SurveyTile*> tiles = state_->sorted();
  put_number(out, tiles.size());
  for (const SurveyTile* tile : tiles) {
    put(out, tile->cell.x());
    put(out, tile->cell.y());
    for (const SurveyColumn& column : tile->columns) put_column(out, column);
    put_number(out, tile->sums.size());
    std::map<int, const std::array<ScanSums, BaseColumn::kCells>*> sums;
    for (const auto& [sensor, of_sensor] : tile->sums)
      sums[numbers[static_cast<std::size_t>(sensor)]] = &of_sensor;
    for (const auto& [sensor, of_sensor] : sums) {
      put_number(out, static_cast<std::uint64_t>(sensor));
      for (const ScanSums& of_column : *of_sensor) put_sums(out, of_column);
    }
    put_number(out, tile->votes.size());
    for (const auto& [column, votes] : tile->votes) {
      put_number(out, static_cast<std::uint64_t>(column));
      put_votes(out, votes, numbers);
    }
  }
}

void GroundSurvey::load(std::string_view& in) {
  SurveyState& s = *state_;
  std::uint32_t format = 0;
  take(in, format);
  if (format != kSurveyFormat) refuse_survey();
  const std::uint64_t origins = kFirstMachine + s.buckets.size();
  for (auto count = take_number<std::uint64_t>(in, in.size() + 1); count > 0; --count) {
    Sensor sensor;
    sensor.name = take_text(in);
    take(in, sensor.pose);
    for (double* value :
         {&sensor.range_sigma_m, &sensor.range_squared_sigma_per_m, &sensor.mount_height_sigma_m,
          &sensor.mount_tilt_sigma_rad, &sensor.mount_scale_sigma})
      take(in, *value);
    sensor.validate();
    s.sensors.push_back(std::move(sensor));
  }
  s.set_places();
  // Machines may have come since.
  const auto machines = take_number<std::size_t>(in, s.buckets.size() + 1);
  const std::size_t came = s.buckets.size() - machines;
  const std::size_t all_errors = s.lip_sigmas_m.size() + 4 * s.sensors.size();
  const auto known_errors = static_cast<Eigen::Index>(all_errors - came);
  Eigen::VectorXd mean(known_errors);
  Eigen::MatrixXd covariance(known_errors, known_errors);
  std::vector<Eigen::Index> to;
  for (Eigen::Index i = 0; i < known_errors; ++i) {
    to.push_back(i + static_cast<Eigen::Index>(to.size() < machines ? 0 : came));
    mean[i] = take_finite(in);
    for (Eigen::Index j = 0; j <= i; ++j) covariance(i, j) = covariance(j, i) = take_finite(in);
    if (!(covariance(i, i) > 0)) refuse_survey();
  }
  s.errors = CommonErrors(std::move(mean), std::move(covariance));
  s.widen_errors(to);
  for (std::int64_t* value :
       {&s.rays.used, &s.rays.masked, &s.rays.through, &s.rays.added, &s.rays.dropped})
    take_amount(in, *value);
  take(in, s.time);
  for (auto count = take_number<std::uint64_t>(in, in.size() + 1); count > 0; --count) {
    std::uint64_t key = 0;
    take(in, key);
    SurveyState::Work& work = s.work[key];
    work.origin = take_number<std::uint16_t>(in, origins);
    take(in, work.time);
  }
  for (auto count = take_number<std::uint64_t>(in, in.size() + 1); count > 0; --count) {
    SurveyState::Block block{take_number<std::uint16_t>(in, origins), 0, 0};
    take(in, block.x);
    take(in, block.y);
    SurveyState::Retired& sums = s.retired[block];
    for (double* value : {&sums.weight, &sums.residual, &sums.variance}) *value = take_finite(in);
    if (!(sums.weight > 0)) refuse_survey();
    sums.sees.resize(all_errors);
    for (std::size_t n = 0; n + came < all_errors; ++n)
      sums.sees[n < machines ? n : n + came] = take_finite(in);
  }
  for (auto count = take_number<std::uint64_t>(in, in.size() + 1); count > 0; --count) {
    ThroughRay& ray = s.through.emplace_back();
    take(in, ray.time);
    for (double* value : {&ray.from.x(), &ray.from.y(), &ray.from.z(), &ray.to.x(), &ray.to.y(),
                          &ray.to.z(), &ray.met_m, &ray.sigma_m})
      *value = take_finite(in);
  }
  take(in, s.is_solved);
  s.sigma_m3 = take_finite(in);
  for (auto count = take_number<std::uint64_t>(in, in.size() + 1); count > 0; --count) {
    Coord2 cell;
    take(in, cell.x());
    take(in, cell.y());
    if (floor_to(cell, kChunkSide) != cell || cell.cwiseAbs().maxCoeff() > kMaxIndex)
      refuse_survey();
    SurveyTile& tile = s.tiles[plan_key(cell)];
    tile.cell = cell;
    for (SurveyColumn& column : tile.columns) take_column(in, column, origins);
    for (auto sums = take_number<std::uint64_t>(in, s.sensors.size() + 1); sums > 0; --sums)
      for (ScanSums& of_column : tile.sums[take_number<int>(in, s.sensors.size())])
        take_sums(in, of_column);
    for (auto votes = take_number<std::uint64_t>(in, BaseColumn::kCells + 1); votes > 0; --votes) {
      const int column = take_number<int>(in, BaseColumn::kCells);
      take_votes_of(in, tile.votes[column], s.sensors.size());
    }
  }
}

}  // namespace soilvdb::inline v0
