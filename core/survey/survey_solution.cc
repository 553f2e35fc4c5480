// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Corrections of all columns that were seen, with the errors that they share.
#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <utility>

#include "core/constants.h"
#include "core/survey/survey_state.h"

namespace soilvdb::inline v0 {
namespace {

constexpr int kOfSensor = 4;  // common errors: height, tilts, scale
constexpr double kSamplesOfCell = 64;

double square(double value) { return value * value; }

/// A column that was seen.
struct SeenColumn {
  SurveyTile* tile;
  std::size_t i;
  ColumnResidual residual;
  Eigen::VectorXd sees, predicted;
  bool changed = false;  // is it other than errors explain?

  SurveyColumn& column() const { return tile->columns[i]; }
};

}  // namespace

void SurveyState::set_places() {
  const std::vector<int> before = places;
  by_name.resize(sensors.size());
  places.resize(sensors.size());
  std::iota(by_name.begin(), by_name.end(), 0);
  std::sort(by_name.begin(), by_name.end(), [&](int a, int b) {
    return sensors[static_cast<std::size_t>(a)].name < sensors[static_cast<std::size_t>(b)].name;
  });
  for (std::size_t n = 0; n < by_name.size(); ++n)
    places[static_cast<std::size_t>(by_name[n])] =
        static_cast<int>(lip_sigmas_m.size()) + kOfSensor * static_cast<int>(n);
  std::vector<Eigen::Index> to(lip_sigmas_m.size() + kOfSensor * before.size());
  for (std::size_t m = 0; m < lip_sigmas_m.size(); ++m) to[m] = static_cast<Eigen::Index>(m);
  for (std::size_t s = 0; s < before.size(); ++s)
    for (int n = 0; n < kOfSensor; ++n) to[static_cast<std::size_t>(before[s] + n)] = places[s] + n;
  widen_errors(to);
}

void SurveyState::widen_errors(const std::vector<Eigen::Index>& to) {
  const Eigen::VectorXd variances = prior();
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(variances.size());
  Eigen::MatrixXd covariance = variances.asDiagonal();
  for (std::size_t i = 0; i < to.size(); ++i) {
    mean[to[i]] = errors.mean()[static_cast<Eigen::Index>(i)];
    for (std::size_t j = 0; j < to.size(); ++j)
      covariance(to[i], to[j]) =
          errors.covariance()(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
  }
  errors = CommonErrors(std::move(mean), std::move(covariance));
}

Eigen::VectorXd SurveyState::prior() const {
  Eigen::VectorXd variances(
      static_cast<Eigen::Index>(lip_sigmas_m.size() + kOfSensor * sensors.size()));
  for (std::size_t m = 0; m < lip_sigmas_m.size(); ++m)
    variances[static_cast<Eigen::Index>(m)] = std::max(square(lip_sigmas_m[m]), kLeastScanVariance);
  for (std::size_t s = 0; s < sensors.size(); ++s) {
    const Sensor& sensor = sensors[s];
    const double sigmas[] = {sensor.mount_height_sigma_m, sensor.mount_tilt_sigma_rad,
                             sensor.mount_tilt_sigma_rad, sensor.mount_scale_sigma};
    for (int n = 0; n < kOfSensor; ++n)
      variances[places[s] + n] = std::max(square(sigmas[n]), kLeastScanVariance);
  }
  return variances;
}

Eigen::VectorXd SurveyState::predicted(const SurveyColumn& column) const {
  Eigen::VectorXd b = Eigen::VectorXd::Zero(
      static_cast<Eigen::Index>(lip_sigmas_m.size() + kOfSensor * sensors.size()));
  if (column.origin >= kFirstMachine) b[column.origin - kFirstMachine] = 1;
  if (column.origin == kUnknownTool) b[static_cast<Eigen::Index>(lip_sigmas_m.size()) - 1] = 1;
  return b;
}

double SurveyState::own_variance(const SurveyTile& tile, std::size_t i) const {
  return tile.columns[i].variance + square(kBendFloor * tile.bends[i] * voxel_m());
}

ColumnResidual SurveyState::residual_of(const SurveyTile& tile, std::size_t i,
                                        Eigen::VectorXd& sees) const {
  sees = Eigen::VectorXd::Zero(
      static_cast<Eigen::Index>(lip_sigmas_m.size() + kOfSensor * sensors.size()));
  ColumnResidual all{0, 0, own_variance(tile, i)};
  const double bend = all.variance - tile.columns[i].variance;
  const double rough = square(kSlopeFloorM) * tile.slopes[i].squaredNorm() + bend;
  for (const int number : by_name) {  // so that the order of their first scans does not show
    const auto sums = tile.sums.find(number);
    if (sums == tile.sums.end() || sums->second[i].rays == 0) continue;
    const ScanSums& sum = sums->second[i];
    const auto s = static_cast<std::size_t>(number);
    const bool stereo = sensors[s].range_squared_sigma_per_m > 0;
    const double whole = static_cast<double>(sum.weight);
    const double single = whole / (stereo ? kStereoPixels : 1);
    const double floor = square(stereo ? kStereoFloorM : kLidarFloorM);
    const double weight = single / (1 + single * floor);
    all.weight += weight;
    all.residual += weight * kScanUnit_m * static_cast<double>(sum.residual) / whole;
    for (int n = 0; n < kOfSensor; ++n)
      sees[places[s] + n] += weight * kScanLever_m *
                             static_cast<double>(sum.sees[static_cast<std::size_t>(n)]) / whole;
  }
  if (all.weight > 0) {
    all.residual /= all.weight;
    sees /= all.weight;
    all.weight /= 1 + all.weight * rough;  // which is the column's own, whichever sensors see it
  }
  return all;
}

SurveyState::Block SurveyState::block_of(const SurveyTile& tile, std::size_t i) const {
  const int side = std::max(1, static_cast<int>(std::lround(kScanBlockM / voxel_m())));
  const auto part = [&](int at) {
    return static_cast<int>(std::floor(static_cast<double>(at) / side));
  };
  const int n = static_cast<int>(i);
  return {tile.columns[i].origin, part(tile.cell.x() + n / kChunkSide),
          part(tile.cell.y() + n % kChunkSide)};
}

void SurveyState::retire(const SurveyTile& tile, std::size_t i) {
  const SurveyColumn& column = tile.columns[i];
  Eigen::VectorXd sees;
  const ColumnResidual residual = residual_of(tile, i, sees);
  if (residual.weight <= 0 || column.origin == kSurveyed || column.prior >= square(kChangedSigmaM))
    return;
  if (square(residual.residual) >
      square(kColumnGate) * (column.variance + prior().maxCoeff() + 1 / residual.weight))
    return;
  Retired& block = retired[block_of(tile, i)];
  // Sensors that come later stand behind: their entries are zero.
  const Eigen::VectorXd b = predicted(column);
  block.sees.resize(lip_sigmas_m.size() + kOfSensor * sensors.size());
  block.weight += residual.weight;
  block.residual += residual.weight * residual.residual;
  block.variance += residual.weight * residual.variance;
  for (std::size_t m = 0; m < lip_sigmas_m.size(); ++m)
    block.sees[m] -= residual.weight * b[static_cast<Eigen::Index>(m)];
  for (std::size_t s = 0; s < sensors.size(); ++s)
    for (int n = 0; n < kOfSensor; ++n)
      block.sees[lip_sigmas_m.size() + kOfSensor * s + static_cast<std::size_t>(n)] +=
          residual.weight * sees[places[s] + n];
}

namespace {

/// Heights of a column by what rays say of its quarters.
struct Vote {
  double height = 0;      ///< mean above the column's `first`, m
  double spread = 0;      ///< variance of the quarters' heights, m^2
  std::int64_t rays = 0;  ///< that agreed
  std::map<int, ScanSums> sums;
};

/// Of hits near one height.
struct Level {
  std::int64_t rays = 0, height = 0;
  std::array<std::int64_t, 16> areas = {};
};

Level level_at(const ScanVotes& votes, int first, int last) {
  Level level;
  for (auto at = votes.hits.lower_bound(first); at != votes.hits.end() && at->first <= last; ++at) {
    for (const auto& [sensor, hits] : at->second) {
      level.rays += hits.rays;
      level.height += hits.height;
      for (std::size_t k = 0; k < level.areas.size(); ++k) level.areas[k] += hits.cells.areas[k];
    }
  }
  return level;
}

int extent_of(const std::array<std::int64_t, 16>& areas) {
  return static_cast<int>(std::count_if(areas.begin(), areas.end(), [](auto a) { return a > 0; }));
}

/// What hits say of a column, if enough of them agree. An edge may go through a column, so heights
/// are taken by its quarters along both axes. Hits on the face of a wall lie above each other, and
/// so reach over few of these: they are left out.
std::optional<Vote> vote(const SurveyColumn& column, const ScanVotes& votes) {
  const std::int64_t all = column.cells.rays + votes.rays();
  std::map<int, std::int64_t> left;  // rays by bin
  for (const auto& [bin, hits] : votes.hits)
    for (const auto& [sensor, of_sensor] : hits) left[bin] += of_sensor.rays;
  const double least =
      std::max(static_cast<double>(kScanVotes), kScanShare * static_cast<double>(all));
  struct Height {
    double mean;  // m
    int first_bin, last_bin;
    std::array<std::int64_t, 16> areas;
    std::int64_t rays;
  };
  std::vector<Height> heights;
  for (;;) {
    std::int64_t most = 0;
    int best = 0;
    for (const auto& [bin, rays] : left) {
      std::int64_t near = 0;
      for (auto at = left.lower_bound(bin - 1); at != left.end() && at->first <= bin + 1; ++at)
        near += at->second;
      if (near <= most) continue;
      most = near;
      best = bin;
    }
    if (static_cast<double>(most) < least) break;
    int first = best, last = best;
    if (left.contains(best - 1)) first = best - 1;
    if (left.contains(best + 1)) last = best + 1;
    const Level level = level_at(votes, first, last);
    heights.push_back(
        {kScanUnit_m * static_cast<double>(level.height) / static_cast<double>(level.rays), first,
         last, level.areas, level.rays});
    for (int bin = first; bin <= last; ++bin) left.erase(bin);
  }
  if (heights.empty()) return {};
  if (column.cells.rays > 0) {
    const double old =
        kScanUnit_m * static_cast<double>(column.height) / static_cast<double>(column.cells.rays);
    // Beside a needle rays end as expected that speak for the same height as the others.
    const auto same = std::find_if(heights.begin(), heights.end(), [&](const Height& height) {
      return std::abs(height.mean - old) < kScanBinM;
    });
    if (same == heights.end()) {
      heights.push_back({old, 1, 0, column.cells.areas, column.cells.rays});
    } else {
      for (std::size_t k = 0; k < same->areas.size(); ++k) same->areas[k] += column.cells.areas[k];
      same->rays += column.cells.rays;
    }
  }
  int widest = 0;
  std::int64_t most_rays = 0;
  for (const Height& height : heights) {
    widest = std::max(widest, extent_of(height.areas));
    most_rays = std::max(most_rays, height.rays);
  }
  std::erase_if(heights, [&](const Height& height) {
    return 3 * extent_of(height.areas) <= 2 * widest || 2 * height.rays <= most_rays;
  });
  double sum = 0, squares = 0;
  int known = 0;
  for (std::size_t k = 0; k < column.cells.areas.size(); ++k) {
    double area = 0, mean = 0;
    for (const Height& height : heights) {
      area += static_cast<double>(height.areas[k]);
      mean += static_cast<double>(height.areas[k]) * height.mean;
    }
    if (area == 0) continue;
    mean /= area;
    ++known;
    sum += mean;
    squares += mean * mean;
  }
  Vote made;
  made.height = sum / known;
  made.spread = std::max(0.0, squares / known - made.height * made.height);
  for (const Height& height : heights) {
    if (height.first_bin <= height.last_bin) made.rays += height.rays;  // of new ground
    for (int bin = height.first_bin; bin <= height.last_bin; ++bin) {
      const auto found = votes.hits.find(bin);
      if (found == votes.hits.end()) continue;
      for (const auto& [sensor, hits] : found->second) {
        ScanSums& of_sensor = made.sums[sensor];
        of_sensor.rays += hits.rays;
        of_sensor.weight += hits.sums.weight;
        for (std::size_t n = 0; n < hits.sums.sees.size(); ++n)
          of_sensor.sees[n] += hits.sums.sees[n];
      }
    }
  }
  if (made.rays == 0) return {};
  return made;
}

}  // namespace

/// Columns of which enough rays say that they have another height get that. What too few rays say
/// is kept, until there are so many that enough of them would have agreed.
void SurveyState::take_votes() {
  see_through();
  for (SurveyTile* tile : sorted()) {
    std::map<int, ScanVotes> undecided;
    for (auto& [n, votes] : tile->votes) {
      const auto i = static_cast<std::size_t>(n);
      SurveyColumn& column = tile->columns[i];
      if (std::isnan(column.top)) continue;
      std::optional<Vote> now = vote(column, votes);
      const std::int64_t news = votes.rays() - votes.told;
      const std::int64_t added = now ? std::min(now->rays, news) : 0;
      rays.added += added;
      rays.dropped += news - added;
      // Rays that end in the column will tell its height better than those that pass above it.
      const bool waits =
          static_cast<double>(votes.rays()) >= kScanShare * static_cast<double>(votes.through);
      if (!now && !waits && votes.through >= kScanVotes && votes.through > column.rays)
        now = Vote{kScanUnit_m * static_cast<double>(votes.ceiling), 0, 0, {}};
      if (!now) {
        votes.told += news;
        votes.others += std::max(column.rays, column.cells.rays);
        const std::int64_t all = votes.told + votes.through + votes.others;
        if (kScanShare * static_cast<double>(all) < kScanVotes)
          undecided.emplace(n, std::move(votes));
        continue;
      }
      retire(*tile, i);
      for (auto& [number, of_tile] : tile->sums) of_tile[i] = {};
      column.first += now->height / voxel_m();
      column.origin = kSurveyed;
      column.variance = square(kChangedSigmaM);
      for (const auto& [sensor, sum] : now->sums) {
        ScanSums& of_column = tile->sums[sensor][i];
        of_column = sum;
        // Rays tell less of a column that an edge goes through.
        const double whole = static_cast<double>(sum.weight);
        const double keep = 1 / (1 + now->spread / kEdgeCells * whole);
        of_column.weight = std::max<std::int64_t>(1, std::llround(keep * whole));
        for (std::int64_t& value : of_column.sees)
          value = std::llround(static_cast<double>(value) * static_cast<double>(of_column.weight) /
                               whole);
      }
    }
    tile->votes = std::move(undecided);
    // Of the rays that met the ground as expected only new ones count: it may have changed since.
    for (SurveyColumn& column : tile->columns) {
      column.rays = column.height = 0;
      column.cells = {};
    }
  }
}

bool SurveyState::is_datum(const SurveyColumn& column) {
  return column.origin == kNatural && column.top == column.first &&
         column.prior < square(kChangedSigmaM);
}

SurveyState::Knowledge SurveyState::knowledge_of(const SurveyTile& tile, std::size_t i) const {
  Eigen::VectorXd sees;
  const ColumnResidual residual = residual_of(tile, i, sees);
  return knowledge_of(tile.columns[i], residual, sees, predicted(tile.columns[i]));
}

SurveyState::Knowledge SurveyState::knowledge_of(const SurveyColumn& column,
                                                 const ColumnResidual& residual,
                                                 const Eigen::VectorXd& sees,
                                                 const Eigen::VectorXd& b) const {
  Knowledge known{residual, {}, 0};
  if (column.prior >= 0) known.residual.variance = column.prior;
  known.correction = errors.correct(known.residual, sees, b);
  known.off = voxel_m() * (column.first - column.top) + known.correction.mean;
  return known;
}

void SurveyState::VolumeError::add(const Block& block, const Knowledge& column, double area_m2) {
  const double prior = 1 / column.residual.variance, weight = column.residual.weight;
  const double share = square(area_m2 / (prior + weight));
  // What scans found to be another height errs by itself.
  const bool alone = block.origin == kSurveyed;
  apart_ += share * (alone ? prior + weight : weight);
  if (!alone) alike_[block] += std::sqrt(share * prior);
  on_ += area_m2 * column.correction.on;
  off_m3_ += area_m2 * column.off;
}

double SurveyState::VolumeError::sigma_m3() const {
  double variance = on_.dot(errors_.covariance() * on_) + square(off_m3_) + apart_;
  for (const auto& [block, sigma] : alike_) variance += square(sigma);
  return std::sqrt(variance);
}

std::vector<SurveyChange> SurveyState::solve() {
  if (std::exchange(is_solved, true)) return {};
  take_votes();
  const double h = voxel_m();
  std::vector<SeenColumn> seen;
  std::unordered_map<std::uint64_t, std::array<int, BaseColumn::kCells>, PlanHash> numbers;
  for (SurveyTile* tile : sorted()) {
    auto& of_tile = numbers[plan_key(tile->cell)];
    of_tile.fill(-1);
    for (std::size_t i = 0; i < BaseColumn::kCells; ++i) {
      if (std::isnan(tile->columns[i].top)) continue;
      SeenColumn column{tile, i, {}, {}, {}};
      column.residual = residual_of(*tile, i, column.sees);
      const bool is_told =
          column.column().origin == kSurveyed && column.column().first != column.column().top;
      if (column.residual.weight <= 0 && !is_told) continue;
      column.predicted = predicted(column.column());
      column.changed = column.column().origin == kSurveyed;
      of_tile[i] = static_cast<int>(seen.size());
      seen.push_back(std::move(column));
    }
  }
  const auto estimate = [&] {
    struct Sum {
      double weight = 0, residual = 0, variance = 0;
      Eigen::VectorXd sees;
    };
    std::map<Block, Sum> blocks;
    const Eigen::VectorXd variances = prior();
    for (const auto& [block, old] : retired) {
      Sum& sum = blocks[block];
      sum = {old.weight, old.residual, old.variance, Eigen::VectorXd::Zero(variances.size())};
      for (std::size_t n = 0; n < old.sees.size(); ++n) {
        const std::size_t lips_count = lip_sigmas_m.size();
        const Eigen::Index at = n < lips_count
                                    ? static_cast<Eigen::Index>(n)
                                    : places[(n - lips_count) / kOfSensor] +
                                          static_cast<Eigen::Index>((n - lips_count) % kOfSensor);
        sum.sees[at] = old.sees[n];
      }
    }
    for (const SeenColumn& c : seen) {
      if (c.changed || c.residual.weight <= 0) continue;
      Sum& sum = blocks[block_of(*c.tile, c.i)];
      if (sum.sees.size() == 0) sum.sees = Eigen::VectorXd::Zero(variances.size());
      sum.weight += c.residual.weight;
      sum.residual += c.residual.weight * c.residual.residual;
      sum.variance += c.residual.weight * c.residual.variance;
      sum.sees += c.residual.weight * (c.sees - c.predicted);
    }
    CommonErrors all(variances);
    for (const auto& [block, sum] : blocks)
      all.add({sum.residual / sum.weight, sum.weight, sum.variance / sum.weight},
              sum.sees / sum.weight);
    all.solve();
    return all;
  };
  errors = estimate();
  for (int round = 0; round < kGateRounds; ++round) {
    std::vector<double> off(seen.size());
    for (std::size_t n = 0; n < seen.size(); ++n)
      off[n] = seen[n].residual.residual - (seen[n].sees - seen[n].predicted).dot(errors.mean());
    for (std::size_t n = 0; n < seen.size(); ++n) {
      SeenColumn& c = seen[n];
      if (c.column().origin == kSurveyed || c.residual.weight <= 0) continue;
      double weight = 0, sum = 0;
      const int at = static_cast<int>(c.i), x = at / kChunkSide, y = at % kChunkSide;
      for (int dx = -2; dx <= 2; ++dx) {
        for (int dy = -2; dy <= 2; ++dy) {
          int other = -1;
          const int u = x + dx, v = y + dy;
          if (((u | v) & ~(kChunkSide - 1)) == 0) {
            other =
                numbers.at(plan_key(c.tile->cell))[static_cast<std::size_t>(u * kChunkSide + v)];
          } else {
            const Coord2 cell = c.tile->cell + Coord2(u, v);
            const auto found = numbers.find(plan_key(floor_to(cell, kChunkSide)));
            if (found != numbers.end()) other = found->second[number_of(cell)];
          }
          if (other < 0) continue;
          const SeenColumn& near = seen[static_cast<std::size_t>(other)];
          if (near.column().origin != c.column().origin || near.residual.weight <= 0) continue;
          weight += near.residual.weight;
          sum += near.residual.weight * off[static_cast<std::size_t>(other)];
        }
      }
      const double variance = c.residual.variance;
      c.changed = std::abs(sum / weight) > kPooledGate * std::sqrt(variance + 1 / weight) ||
                  std::abs(off[n]) > kColumnGate * std::sqrt(variance + 1 / c.residual.weight);
    }
    errors = estimate();
  }

  std::vector<SurveyChange> made;
  VolumeError error(errors);
  for (const SeenColumn& c : seen) {
    SurveyColumn& column = c.column();
    column.prior = c.changed ? square(kChangedSigmaM) : c.residual.variance;
    Knowledge known = knowledge_of(column, c.residual, c.sees, c.predicted);
    if (!std::isfinite(known.off)) continue;
    double sigmas = column.origin == kNatural && !c.changed ? kNaturalSigmas : kMovedSigmas;
    if (c.residual.weight <= 0) sigmas = 0;  // the soil that rays passed through is surely gone
    const bool is_worth_it =
        std::abs(known.off) >= kLeastCorrection * h &&
        std::abs(known.off) >= sigmas * std::sqrt(known.correction.variance(errors));
    if (is_worth_it) {
      const int at = static_cast<int>(c.i);
      made.push_back({c.tile->cell + Coord2(at / kChunkSide, at % kChunkSide), column.top,
                      std::llround(known.off / h * kSamplesOfCell), c.tile->slopes[c.i]});
      known.off = 0;
    }
    if (is_worth_it || !is_datum(column)) error.add(block_of(*c.tile, c.i), known, h * h);
  }
  sigma_m3 = error.sigma_m3();
  return made;
}

}  // namespace soilvdb::inline v0
