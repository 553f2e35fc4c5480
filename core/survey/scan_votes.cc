// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What rays that met other ground than expected say: new heights of columns, by votes.
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "core/constants.h"
#include "core/survey/scan_state.h"

namespace soilvdb::inline v0 {
namespace {

using Heights = ScanState::Heights;

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

/// Rays of a column: those that ended in it as expected, and all.
struct RaysOf {
  RaysOf(const ColumnRays& rays, const ScanVotes& votes)
      : expected(rays.cells.rays + rays.blind), others(votes.rays()) {}

  /// How many must agree on a height.
  double least() const {
    return std::max(static_cast<double>(kScanVotes),
                    kScanShare * static_cast<double>(expected + others));
  }
  bool may_agree() const { return static_cast<double>(others) >= least(); }
  /// How many are most of them, and enough if those about the column agree.
  double most() const { return std::floor(static_cast<double>(expected + others) / 2) + 1; }

  std::int64_t expected, others;
};

int extent_of(const std::array<std::int64_t, 16>& areas) {
  return static_cast<int>(std::count_if(areas.begin(), areas.end(), [](auto a) { return a > 0; }));
}

/// What hits say of a column, if enough of them agree. An edge may go through a column, so heights
/// are taken by its quarters along both axes. Hits on the face of a wall lie above each other, and
/// so reach over few of these: they are left out.
/// @param wall heights above the column's `first`, m, of rays that are of no new ground
/// @param least how many must agree
std::optional<Vote> vote(const ColumnRays& rays_of, const ScanVotes& votes,
                         const std::optional<Heights>& wall, double least) {
  std::map<int, std::int64_t> left;  // rays by bin
  for (const auto& [bin, hits] : votes.hits)
    for (const auto& [sensor, of_sensor] : hits) left[bin] += of_sensor.rays;
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
  std::erase_if(heights, [&](const Height& height) {
    return wall && height.mean > wall->low - kScanBinM && height.mean < wall->high + kScanBinM;
  });
  if (heights.empty()) return {};
  if (rays_of.cells.rays > 0) {
    const double old =
        kScanUnit_m * static_cast<double>(rays_of.height) / static_cast<double>(rays_of.cells.rays);
    // Beside a needle rays end as expected that speak for the same height as the others.
    const auto same = std::find_if(heights.begin(), heights.end(), [&](const Height& height) {
      return std::abs(height.mean - old) < kScanBinM;
    });
    if (same == heights.end()) {
      heights.push_back({old, 1, 0, rays_of.cells.areas, rays_of.cells.rays});
    } else {
      for (std::size_t k = 0; k < same->areas.size(); ++k) same->areas[k] += rays_of.cells.areas[k];
      same->rays += rays_of.cells.rays;
    }
  }
  int widest = 0;
  std::int64_t most_rays = RaysOf(rays_of, votes).expected;
  for (const Height& height : heights) {
    widest = std::max(widest, extent_of(height.areas));
    most_rays = std::max(most_rays, height.rays);
  }
  std::erase_if(heights, [&](const Height& height) {
    return 3 * extent_of(height.areas) <= 2 * widest || 2 * height.rays <= most_rays;
  });
  double sum = 0, squares = 0;
  int known = 0;
  for (std::size_t k = 0; k < rays_of.cells.areas.size(); ++k) {
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
      for (const auto& [sensor, hits] : found->second) made.sums[sensor].add(hits.sums);
    }
  }
  if (made.rays == 0) return {};
  return made;
}

}  // namespace

std::int64_t ScanState::rays_about(const Coord2& cell, double height_m, std::int64_t enough) const {
  std::int64_t count = 0;
  std::optional<Coord2> last;
  auto tile = tiles.end();
  for (int dx = -1; dx <= 1; ++dx) {
    for (int dy = -1; dy <= 1; ++dy) {
      const Coord2 near = cell + Coord2(dx, dy), low = floor_to(near, kChunkSide);
      if (last != low) tile = tiles.find(plan_key(low));
      last = low;
      if (tile == tiles.end()) continue;
      const std::size_t i = number_of(near);
      const auto votes = tile->second.votes.find(static_cast<int>(i));
      if (votes == tile->second.votes.end()) continue;
      const int bin =
          static_cast<int>(std::floor((height_m - first_m(tile->second.columns[i])) / kScanBinM));
      const auto& hits = votes->second.hits;
      for (auto of = hits.lower_bound(bin - 1); of != hits.end() && of->first <= bin + 1; ++of)
        for (const auto& [sensor, some] : of->second) count += some.rays;
      if (count >= enough) return count;
    }
  }
  return count;
}

bool ScanState::is_met(const Vec3& end) const {
  const Vec3 at = ground.index_from_world(end);
  return rays_about({cell_of(at.x()), cell_of(at.y())}, end.z(), kScanVotes) >= kScanVotes;
}

/// Votes of columns whose soil lies above rays, short of their ends. Only where other rays end as
/// well: mirrors and leaves let single rays end anywhere.
void ScanState::see_through() {
  const double h = voxel_m();
  for (const ThroughRay& ray : through) {
    const Vec3 way = ray.to - ray.from;
    const double length = way.norm();
    const Vec3 along = way / length;
    const double step = h / std::max(along.head<2>().norm(), 0.3);
    const double end = length - std::max(kThroughShortM, 3 * ray.sigma_m);
    const double room = kThroughRoomM + 3.5 * ray.sigma_m * std::abs(along.z());
    if (!is_met(ray.to)) continue;
    bool any = false;
    std::optional<Coord2> last;
    ScanTile* in = nullptr;
    for (double t = std::max(0.0, ray.met_m - kThroughBeforeM); t < end; t += step) {
      const Vec3 place = ray.from + t * along, at = ground.index_from_world(place);
      if (!(at.head<2>().cwiseAbs().maxCoeff() < kMaxIndex)) break;
      const Coord2 cell(cell_of(at.x()), cell_of(at.y()));
      if (in == nullptr || in->cell != floor_to(cell, kChunkSide)) in = &tile_of(cell);
      ScanTile& tile = *in;
      const std::size_t i = number_of(cell);
      const ScanColumn& column = tile.columns[i];
      const double ceiling = place.z() + room;
      if (!(ceiling < ground.origin().z() + h * column.top) || column.changed > ray.time) continue;
      news.insert(mark(tile.cell));
      ScanVotes& votes = tile.votes[static_cast<int>(i)];
      const std::int64_t height = height_units(place.z() - first_m(column));
      votes.ceiling = votes.through == 0 ? height : std::min(votes.ceiling, height);
      votes.through += last == cell ? 0 : 1;
      last = cell;
      any = true;
    }
    rays.through += any;
  }
  through.clear();
}

std::optional<ScanState::Heights> ScanState::wall_at(const ScanTile& tile, std::size_t i) const {
  const double h = voxel_m(), first = tile.columns[i].first;
  constexpr double kNone = std::numeric_limits<double>::infinity();
  Heights wall = {kNone, -kNone};
  for (int dx = -1; dx <= 1; ++dx) {
    for (int dy = -1; dy <= 1; ++dy) {
      const Coord2 cell = tile.place(i) + Coord2(dx, dy);
      const auto found = tiles.find(plan_key(floor_to(cell, kChunkSide)));
      if (found == tiles.end()) continue;
      const std::size_t n = number_of(cell);
      const auto votes = found->second.votes.find(static_cast<int>(n));
      if (votes != found->second.votes.end() && votes->second.through >= kScanVotes) return {};
      // What scans found before may be half of what is there.
      const ScanColumn& column = found->second.columns[n];
      const bool is_scanned =
          column.origin == kSurveyed && !(surveyed && surveyed->are_of(cell, column.top));
      if (std::isnan(column.top) || is_scanned) continue;
      wall.low = std::min(wall.low, h * (column.top - first));
      wall.high = std::max(wall.high, h * (column.top - first));
    }
  }
  if (wall.high - wall.low < 2 * h * kScanWallSlope) return {};
  return wall;
}

namespace {

/// What a few rays of a column say, if most of them agree, and enough of those about it.
std::optional<Vote> vote_of_few(const ScanState& state, const ScanTile& tile, std::size_t i,
                                const ScanVotes& votes) {
  const ScanColumn& column = tile.columns[i];
  const RaysOf of_column(tile.rays[i], votes);
  if (static_cast<double>(of_column.others) < of_column.most()) return {};
  std::optional<Vote> few = vote(tile.rays[i], votes, state.wall_at(tile, i), of_column.most());
  if (!few) return {};
  std::int64_t about =
      state.rays_about(tile.place(i), state.first_m(column) + few->height, kScanVotesAbout);
  // Those that pass through what stood there say as well that it is gone.
  if (few->height < state.voxel_m() * (column.top - column.first)) about += votes.through;
  if (about < kScanVotesAbout) return {};
  // They see a part of the column.
  few->spread = kEdgeCells * square(kScanBinM) / static_cast<double>(few->rays);
  return few;
}

}  // namespace

/// Columns of which enough rays say that they have another height get that, and those of which a
/// few do together with those about them. What too few rays say is kept, until there are so many
/// that enough of them would have agreed.
void ScanState::take_votes() {
  see_through();
  // All are looked at before any is decided, so that the order of columns does not matter.
  std::vector<std::optional<Vote>> decisions;
  for (const auto& cell : news) {
    const ScanTile& tile = marked(cell);
    for (const auto& [n, votes] : tile.votes) {
      const auto i = static_cast<std::size_t>(n);
      if (std::isnan(tile.columns[i].top)) continue;
      const RaysOf of_column(tile.rays[i], votes);
      std::optional<Vote>& decision = decisions.emplace_back();
      if (of_column.may_agree())
        decision = vote(tile.rays[i], votes, wall_at(tile, i), of_column.least());
      if (!decision) decision = vote_of_few(*this, tile, i, votes);
    }
  }
  auto decision = decisions.begin();
  for (const auto& cell : news) {
    ScanTile* tile = &marked(cell);
    std::map<int, ScanVotes> undecided;
    for (auto& [n, votes] : tile->votes) {
      const auto i = static_cast<std::size_t>(n);
      ScanColumn& column = tile->columns[i];
      const ColumnRays& of = tile->rays[i];
      if (std::isnan(column.top)) continue;
      std::optional<Vote> now = std::move(*decision++);
      const std::int64_t hits = votes.rays(), fresh = hits - votes.told;
      const std::int64_t added = now ? std::min(now->rays, fresh) : 0;
      rays.added += added;
      rays.dropped += fresh - added;
      // Rays that end in the column will tell its height better than those that pass above it.
      const bool waits =
          static_cast<double>(hits) >= kScanShare * static_cast<double>(votes.through);
      if (!now && !waits && votes.through >= kScanVotes && votes.through > of.met + of.blind)
        now = Vote{kScanUnit_m * static_cast<double>(votes.ceiling), 0, 0, {}};
      if (!now) {
        votes.told += fresh;
        votes.others += std::max(of.met, of.cells.rays + of.blind);
        const std::int64_t all = votes.told + votes.through + votes.others;
        if (kScanShare * static_cast<double>(all) < kScanVotes)
          undecided.emplace(n, std::move(votes));
        continue;
      }
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
    tile->rays.fill({});
  }
}

bool ScanState::is_contested(const ScanTile& tile, std::size_t i) {
  const auto found = tile.votes.find(static_cast<int>(i));
  if (found == tile.votes.end()) return false;
  const ScanVotes& votes = found->second;
  std::int64_t most = votes.through;
  for (const auto& [bin, hits] : votes.hits)
    most = std::max(most, level_at(votes, bin - 1, bin + 1).rays);
  return most > std::max<std::int64_t>(1, votes.others);
}

}  // namespace soilvdb::inline v0
