// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <optional>
#include <stdexcept>
#include <unordered_set>
#include <utility>
#include <vector>

#include "core/constants.h"
#include "core/lattice/bytes.h"
#include "core/lattice/text.h"
#include "core/survey/scan_state.h"
#include "core/tool/polygon.h"
#include "soilvdb/motion.h"

namespace soilvdb::inline v0 {
namespace {

/// Numbers sensors anew when one has come.
template <typename T>
void make_room(std::map<int, T>& by_sensor, int came) {
  std::map<int, T> moved;
  for (auto& [sensor, of_sensor] : by_sensor)
    moved.emplace(sensor < came ? sensor : sensor + 1, std::move(of_sensor));
  by_sensor = std::move(moved);
}

}  // namespace

std::string RayCounts::doubt() const {
  const std::int64_t all = used + through + added + dropped;
  if (all + masked == 0 && far > 0)
    return "all points of scans are beyond their sensor's max_range; are its place and the points' "
           "frame right, and both in metres?";
  if (2 * used >= all) return {};
  return std::to_string(
             std::llround(100.0 * static_cast<double>(all - used) / static_cast<double>(all))) +
         " % of the rays do not meet the ground where it is expected; are the sensor's place and "
         "axes right, and its points in metres?";
}

ScanState::ScanState(Ground& g, std::vector<Bucket> all_buckets, std::vector<double> sigmas,
                     std::shared_ptr<const SurveyedHeights> all_surveyed)
    : surveyed(std::move(all_surveyed)), ground(g), map(g), view(g, map), changes(g) {
  changes.take();
  buckets = std::move(all_buckets);
  lip_sigmas_m = std::move(sigmas);
  lip_sigmas_m.push_back(lip_sigmas_m.empty()
                             ? kDugSigmaM
                             : *std::max_element(lip_sigmas_m.begin(), lip_sigmas_m.end()));
  errors = CommonErrors(prior());
}

ScanState::ScanState(Ground& clone, const ScanState& other,
                     std::shared_ptr<const SurveyedHeights> all_surveyed)
    : ScanRecord(other),
      surveyed(std::move(all_surveyed)),
      ground(clone),
      map(clone, other.map),
      view(clone, map),
      changes(clone, other.changes) {}

void ScanState::has_changed(const Coord2& cell) {
  // Slopes at a tile's edge depend on the next one's columns.
  for (int dx = -1; dx <= 1; ++dx)
    for (int dy = -1; dy <= 1; ++dy)
      if (const Coord2 near = cell + kChunkSide * Coord2(dx, dy); tiles.contains(plan_key(near)))
        stale.insert(mark(near));
}

void ScanRecord::Work::cut_by(std::uint16_t origin_of_cut) {
  const std::uint16_t last = std::exchange(turn, origin_of_cut);
  if (last == origin_of_cut) return;
  was_cut_since = was_cut_since || last == kSurveyed;
  const auto known = std::find_if(turns.begin(), turns.end(), [&](const Turns& turns_of) {
    return turns_of.origin == origin_of_cut;
  });
  ++(known != turns.end() ? *known : turns.emplace_back(Turns{origin_of_cut})).count;
}

void ScanState::was_surveyed(const Coord2& cell) {
  has_changed(cell);
  Work& worked = work[plan_key(cell)];
  const auto known = tiles.find(plan_key(cell));
  if (worked.turns.empty() && known != tiles.end())  // what was dug before the first scan
    for (const ScanColumn& column : known->second.columns)
      if (lip_of(column) >= 0) worked.cut_by(column.origin);
  worked.turn = kSurveyed;
}

void ScanState::refresh(bool own) {
  map.reader().refresh();
  if (own)
    for (const Coord3& origin : changes.take()) was_surveyed(origin.head<2>());
  for (const auto& cell : stale) read(marked(cell), own ? How::kOwn : How::kChanged);
  stale.clear();
}

ScanTile& ScanState::tile(const Coord2& cell) {
  const auto [found, is_new] = tiles.try_emplace(plan_key(cell));
  ScanTile& tile = found->second;
  if (!is_new) return tile;
  tile = new_tile(cell);
  read(tile, How::kChanged);
  return tile;
}

ScanTile ScanState::new_tile(const Coord2& cell) {
  ScanTile tile;
  tile.cell = cell;
  for (ScanColumn& column : tile.columns) column.variance = -1;  // not read yet
  return tile;
}

const ScanTile& ScanState::look(const Coord2& cell, std::optional<ScanTile>& own) {
  const auto found = tiles.find(plan_key(cell));
  if (found != tiles.end() && !stale.contains(mark(cell))) return found->second;
  own = found == tiles.end() ? new_tile(cell) : found->second;
  read(*own, How::kLook);
  return *own;
}

/// Reads a tile's columns. Those that changed begin anew, unless that was by scans.
void ScanState::read(ScanTile& tile, How how) {
  HeightReader& reader = map.reader();
  const double h = voxel_m();
  constexpr int kSide = kChunkSide + 2;
  HeightReader::Columns &tops = reader.columns, &loose = reader.changed;
  const Coord2 size = Coord2::Constant(kChunkSide);
  reader.read(tile.cell - Coord2::Ones(), Coord2::Constant(kSide),
              static_cast<std::size_t>(MapLayer::kHeight), kNoCeiling, tops);
  reader.read(tile.cell, size, static_cast<std::size_t>(MapLayer::kLoose), kNoCeiling, loose);
  HeightReader::Columns touched;
  reader.read(tile.cell, size, HeightReader::kTouched, kNoCeiling, touched);
  const auto known_work = work.find(plan_key(tile.cell));
  const Work worked = known_work != work.end() ? known_work->second : Work{};
  std::uint16_t tool = worked.origin;
  if (tool == kUnknownTool && buckets.size() == 1) tool = kFirstMachine;
  if (how != How::kLook) unsummed.insert(mark(tile.cell));
  for (std::size_t i = 0; i < BaseColumn::kCells; ++i) {
    const int x = static_cast<int>(i) / kChunkSide, y = static_cast<int>(i) % kChunkSide;
    const double top = tops.at(x + 1, y + 1);
    const double depth = std::isnan(top) ? 0 : h * loose.at(x, y);
    const auto side = [&](int dx, int dy) {
      const double z = tops.at(x + 1 + dx, y + 1 + dy);
      return std::isnan(z) ? top : z;
    };
    tile.slopes[i] = {(side(1, 0) - side(-1, 0)) / 2, (side(0, 1) - side(0, -1)) / 2};
    tile.bends[i] = static_cast<float>(std::max(std::abs(side(1, 0) - 2 * top + side(-1, 0)),
                                                std::abs(side(0, 1) - 2 * top + side(0, -1))));
    tile.lip_shares[i] = 1;
    if (is_wall(tile, i)) {
      double low = top, high = top;
      for (int dx = -1; dx <= 1; ++dx) {
        for (int dy = -1; dy <= 1; ++dy) {
          low = std::min(low, side(dx, dy));
          high = std::max(high, side(dx, dy));
        }
      }
      tile.lip_shares[i] = static_cast<float>((high - top) / (high - low));
    }
    ScanColumn& column = tile.columns[i];
    const bool is_new = column.variance < 0;
    if (!is_new && (top == column.top || (std::isnan(top) && std::isnan(column.top)))) continue;
    if (how != How::kLook) untold.insert(mark(tile.cell));
    if (how == How::kOwn && !is_new) {
      column.top = top;
      continue;
    }
    const double dug = kDugSigmaM * kDugSigmaM, filled = kFilledSigma * kFilledSigma;
    const double natural = kNaturalSigmaM * kNaturalSigmaM;
    const bool is_surveyed = surveyed && surveyed->are_of(tile.cell + Coord2(x, y), top);
    if (is_new) {
      if (touched.at(x, y) > 0)
        column.origin = is_surveyed ? kSurveyed : depth > 0 ? kFilled : tool;
      column.variance = natural;  // also of a survey
      if (column.origin >= kUnknownTool && column.origin != kFilled) column.variance = dug;
      if (column.origin == kFilled) column.variance += filled * depth * depth;
    } else {
      if (how == How::kChanged) retire(tile, i);
      const double rise = h * (top - column.top);
      if (is_surveyed) {
        column.origin = kSurveyed;
        column.variance = natural;
      } else if (depth > 0 && rise > 0) {
        // What was known of the ground below stays known.
        if (column.prior >= 0) column.variance = height_variance(tile, i);
        if (column.prior >= 0 || column.origin == kNatural) column.origin = kFilled;
        column.variance += filled * rise * rise;
      } else {
        column.origin = tool;
        column.variance = dug + filled * depth * depth;
      }
      for (auto& [sensor, sums] : tile.sums) sums[i] = {};
      if (const auto votes = tile.votes.find(static_cast<int>(i)); votes != tile.votes.end()) {
        if (how == How::kChanged) rays.dropped += votes->second.rays() - votes->second.told;
        tile.votes.erase(votes);
      }
      tile.rays[i] = {};
      column.prior = -1;
    }
    column.first = column.top = top;
    column.changed = worked.time;
    column.pass = column.origin == kNatural ? 0 : solutions + 1;
  }
}

bool ScanState::is_seen(const ScanTile& tile, std::size_t i) const {
  const ScanColumn& column = tile.columns[i];
  return column.origin == kSurveyed || tile.is_met(i) ||
         (surveyed && surveyed->are_of(tile.place(i), column.top));
}

double ScanState::share_inside(const std::vector<Vec2>& boundary, const Coord2& column) const {
  constexpr int kParts = 4;  // along each axis
  int parts = 0;
  for (int part = 0; part < kParts * kParts; ++part) {
    const Vec2 in((part / kParts + 0.5) / kParts - 0.5, (part % kParts + 0.5) / kParts - 0.5);
    const Vec2 place = column.cast<double>() + in;
    parts += inside(boundary, ground.origin().head<2>() + voxel_m() * place);
  }
  return static_cast<double>(parts) / (kParts * kParts);
}

Eigen::AlignedBox2d ScanState::index_box(const std::vector<Vec2>& places_m) const {
  Eigen::AlignedBox2d box;
  for (const Vec2& place : places_m) box.extend(index_of(place));
  return box;
}

bool ScanState::meets(const Eigen::AlignedBox2d& box, const Coord2& cell) {
  const Vec2 low = cell.cast<double>().array() - 0.5, high = low.array() + kChunkSide;
  return box.intersects(Eigen::AlignedBox2d(low, high));
}

ScanState::Tiles ScanState::changed_within(const Eigen::AlignedBox2d& box) const {
  Tiles cells;
  for (const Chunk* chunk : ground.chunks())
    if (const Coord2 cell = chunk->origin.head<2>(); meets(box, cell)) cells.insert(mark(cell));
  return cells;
}

void ScanState::require_room(const Eigen::AlignedBox2d& around_m,
                             std::span<const Vec3> points_m) const {
  const double cells = 1 / voxel_m(), x0 = ground.origin().x(), y0 = ground.origin().y();
  const Vec2 across = around_m.sizes() * cells / kChunkSide + Vec2(2, 2);
  if (static_cast<double>(tiles.size()) + across.prod() < kMaxSurveyTiles) return;
  std::unordered_set<std::uint64_t> more;
  Coord2 last = Coord2::Constant(std::numeric_limits<int>::max());
  for (const Vec3& point : points_m) {
    const double x = (point.x() - x0) * cells, y = (point.y() - y0) * cells;
    if (!(std::max(std::abs(x), std::abs(y)) < kMaxIndex)) continue;
    const Coord2 tile = floor_to(Coord2(cell_of(x), cell_of(y)), kChunkSide);
    if (tile == last) continue;
    last = tile;
    if (!tiles.contains(plan_key(tile))) more.insert(plan_key(tile));
  }
  if (tiles.size() + more.size() > kMaxSurveyTiles)
    throw std::invalid_argument("scans may see " + std::to_string(kMaxSurveyTiles) +
                                " squares of " + std::to_string(kChunkSide) + " x " +
                                std::to_string(kChunkSide) +
                                " voxels, and with this one see more; give the sensor a max_range, "
                                "in m, or take larger voxels");
}

std::pair<int, bool> ScanState::find(const Sensor& sensor) const {
  const auto found =
      std::lower_bound(sensors.begin(), sensors.end(), sensor,
                       [](const Sensor& a, const Sensor& b) { return a.name < b.name; });
  const bool is_known = found != sensors.end() && found->name == sensor.name;
  if (is_known && std::any_of(std::begin(kSensorSigmas), std::end(kSensorSigmas),
                              [&](const auto& s) { return (*found).*s.field != sensor.*s.field; }))
    throw std::invalid_argument("sensor '" + sensor.name +
                                "' had other sigmas before; give it another name");
  if (!is_known && sensors.size() >= kMostSensors)
    throw std::invalid_argument("sensor '" + sensor.name + "': there were " +
                                std::to_string(kMostSensors) +
                                " others; give a sensor one name, not one for each scan");
  return {static_cast<int>(found - sensors.begin()), is_known};
}

int ScanState::sensor_of(const Sensor& sensor) {
  const auto [number, is_known] = find(sensor);
  if (is_known) return number;
  is_solved = false;  // so that it is recorded, also if its scan has no rays
  sensors.insert(sensors.begin() + number, sensor)
      ->pose = {};  // which scans of one name need not share
  const Eigen::Index at = place_of(static_cast<std::size_t>(number));
  widen_errors(at, kOfSensor);
  const auto widen = [&](Eigen::VectorXd& values) {
    if (values.size() > 0) values = widened(values, at, kOfSensor);
  };
  for (auto& [block, state] : blocks) {
    state.sums.reset();
    widen(state.solved);
    widen(state.retired.sees);
    widen(state.known.sees);
  }
  for (auto& [key, tile] : tiles) {
    tile.parts.clear();
    unsummed.insert(mark(tile.cell));
    make_room(tile.sums, number);
    for (auto& [column, votes] : tile.votes)
      for (auto& [bin, hits] : votes.hits) make_room(hits, number);
  }
  return number;
}

GroundScans::GroundScans(Ground& ground, std::vector<Bucket> buckets,
                         std::vector<double> lip_sigmas_m,
                         std::shared_ptr<const SurveyedHeights> surveyed)
    : state_(std::make_unique<ScanState>(ground, std::move(buckets), std::move(lip_sigmas_m),
                                         std::move(surveyed))) {}
GroundScans::GroundScans(Ground& clone, const GroundScans& other,
                         std::shared_ptr<const SurveyedHeights> surveyed)
    : state_(std::make_unique<ScanState>(clone, *other.state_, std::move(surveyed))) {}
GroundScans::~GroundScans() = default;

void GroundScans::worked(std::optional<std::size_t> machine, Work how) {
  ScanState& s = *state_;
  const std::vector<Coord3> changed = s.changes.take();
  if (!changed.empty()) ++s.time;
  for (const Coord3& origin : changed) {
    const Coord2 cell = origin.head<2>();
    if (how == Work::kSurvey) {
      s.was_surveyed(cell);
    } else {
      s.has_changed(cell);
    }
    ScanState::Work& work = s.work[plan_key(cell)];
    work.time = s.time;
    if (!machine) continue;
    work.origin = static_cast<std::uint16_t>(kFirstMachine + *machine);
    if (how == Work::kCut) work.cut_by(work.origin);
  }
}

bool GroundScans::has_news() const { return !state_->is_solved; }

void GroundScans::scan(const Sensor& sensor, std::span<const Vec3> points_m,
                       std::span<const Pose* const> poses, std::span<const PlacedBoxes> bodies) {
  sensor.validate();
  const Vec3& from = sensor.pose.position;
  std::vector<Vec3> near_m;
  const std::size_t given = points_m.size();
  if (std::isfinite(sensor.max_range_m)) {
    std::copy_if(points_m.begin(), points_m.end(), std::back_inserter(near_m),
                 [&](const Vec3& point) { return !((point - from).norm() > sensor.max_range_m); });
    points_m = near_m;
  }
  Eigen::AlignedBox2d around_m;
  for (std::size_t i = 0; i < points_m.size(); ++i) {
    if (!((points_m[i] - from).squaredNorm() <= kMostScanRangeM * kMostScanRangeM))
      throw std::invalid_argument("point " + std::to_string(i) + " must be numbers, and within " +
                                  text(kMostScanRangeM) + " m of the sensor");
    around_m.extend(points_m[i].head<2>());
  }
  if (points_m.empty()) around_m.extend(from.head<2>());
  state_->require_room(around_m, points_m);
  const bool is_known = state_->find(sensor).second;
  // A pose that is not fitted errs by itself: what fitted ones tell of their errors is not its own.
  Sensor named = sensor;
  named.name += " (poses as given)";
  if (is_moving(sensor)) state_->find(named);
  state_->rays.far += static_cast<std::int64_t>(given - points_m.size());
  ScanRays ends = state_->unmasked(sensor, points_m, poses, bodies);
  // When the ground is read shows in what is known of it: only what will be recorded reads it.
  if (is_known && ends.count() == 0) return;
  state_->refresh(false);
  std::optional<Pose> pose;
  if (is_moving(sensor)) pose = state_->fit_pose(sensor, ends);
  Sensor placed = sensor;
  if (pose) {
    placed.pose = *pose;
    placed.pose_shift_sigma_m = placed.pose_turn_sigma_rad = 0;  // rays need not allow for it
  }
  const bool is_as_given = is_moving(sensor) && !pose && ends.count() > 0;
  state_->add_rays(placed, state_->sensor_of(is_as_given ? named : sensor), ends);
}

std::vector<ScanChange> GroundScans::solve() {
  if (state_->is_solved) return {};
  state_->refresh(false);
  return state_->solve();
}

Survey GroundScans::applied() {
  ScanState& s = *state_;
  if (std::exchange(s.has_corrected, false)) {
    s.refresh(true);
    s.telling = {std::exchange(s.is_first, false), std::exchange(s.untold, {}),
                 std::exchange(s.untold_blocks, {})};
  }
  Survey survey;
  survey.sigma_m3 = s.sigma_m3;
  survey.lip_errors_m = lip_errors_m();
  survey.rays = s.rays;
  s.rays = {};
  return survey;
}

std::vector<Estimate> GroundScans::lip_errors_m() const {
  std::vector<Estimate> lips(state_->buckets.size());
  for (std::size_t m = 0; m < lips.size(); ++m) {
    const auto at = static_cast<Eigen::Index>(m);
    lips[m] = {state_->errors.mean()[at], std::sqrt(state_->errors.covariance()(at, at))};
  }
  return lips;
}

void GroundScans::sigmas(std::span<const Vec2> xy_m, std::span<double> sigmas_m,
                         std::span<double> seen) {
  ScanState& s = *state_;
  s.map.reader().refresh();
  std::fill(seen.begin(), seen.end(), HeightReader::kNoGround);
  std::fill(sigmas_m.begin(), sigmas_m.end(), HeightReader::kNoGround);
  // By tiles, each of which is read once.
  std::map<std::pair<int, int>, std::vector<std::pair<std::size_t, Coord2>>> places;
  for (std::size_t i = 0; i < xy_m.size(); ++i) {
    const Vec2 at = s.index_of(xy_m[i]);
    if (!at.allFinite() || !(at.cwiseAbs().maxCoeff() < kMaxIndex)) continue;
    const Coord2 cell(cell_of(at.x()), cell_of(at.y()));
    places[ScanState::mark(floor_to(cell, kChunkSide))].emplace_back(i, cell);
  }
  for (const auto& [of, some] : places) {
    std::optional<ScanTile> own;
    const ScanTile& tile = s.look({of.first, of.second}, own);
    for (const auto& [i, cell] : some) {
      const std::size_t n = ScanState::number_of(cell);
      if (std::isnan(tile.columns[n].top)) continue;
      sigmas_m[i] = std::sqrt(s.height_variance(tile, n));
      if (!seen.empty()) seen[i] = s.is_seen(tile, n);
    }
  }
}

std::vector<Coord2> GroundScans::seen_squares() const {
  ScanState::Tiles cells;
  for (const auto& [key, tile] : state_->tiles) cells.insert(ScanState::mark(tile.cell));
  if (state_->surveyed)
    for (const Coord2& low : state_->surveyed->squares())
      for (int x = 0; x < SurveyedHeights::kSide; x += kChunkSide)
        for (int y = 0; y < SurveyedHeights::kSide; y += kChunkSide)
          cells.insert(ScanState::mark(low + Coord2(x, y)));
  std::vector<Coord2> squares;
  for (const auto& [x, y] : cells) squares.emplace_back(x, y);
  return squares;
}

double GroundScans::volume_sigma_m3(const std::vector<Vec2>& boundary) {
  ScanState& s = *state_;
  s.map.reader().refresh();
  const Eigen::AlignedBox2d box = s.index_box(boundary);
  ScanState::Tiles cells = s.changed_within(box);
  for (const auto& [key, tile] : s.tiles)
    if (ScanState::meets(box, tile.cell)) cells.insert(ScanState::mark(tile.cell));
  std::map<Block, BlockSums> blocks;
  Eigen::VectorXd sees(s.error_count());
  CommonErrors::Correction correction;
  for (const auto& [x, y] : cells) {
    std::optional<ScanTile> own;
    const ScanTile& tile = s.look({x, y}, own);
    std::map<Block, BlockSums> parts_of;
    for (std::size_t n = 0; n < BaseColumn::kCells; ++n) {
      const ScanColumn& column = tile.columns[n];
      if (std::isnan(column.top) || ScanState::is_datum(column)) continue;
      const double share = s.share_inside(boundary, tile.place(n));
      if (share == 0) continue;
      const Block block = s.block_of(tile, n);
      const BlockError error = s.error_of(block);
      const ColumnResidual residual = s.residual_of(tile, n, sees);
      s.correct(tile, n, residual, error, sees, correction);
      s.add_volume(parts_of.try_emplace(block, s.error_count()).first->second, tile, n, residual,
                   error, correction, square(s.voxel_m()) * share, false);
    }
    for (const auto& [block, part] : parts_of)
      blocks.try_emplace(block, s.error_count()).first->second.add(part);
  }
  ScanState::VolumeError error(s.errors);
  for (const auto& [block, sums] : blocks) error.add(sums, s.error_of(block));
  return error.sigma_m3();
}

}  // namespace soilvdb::inline v0
