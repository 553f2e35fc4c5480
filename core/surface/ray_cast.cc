// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Where rays meet the surface of HeightMap::at(). The terrain's own surface is asked for its next
// meeting with a ray; until there only quads that changed are looked at, and beyond it those that
// may have taken it away.
#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "core/ground/ray_terrain.h"
#include "core/lattice/ray_walk.h"
#include "core/surface/height_reader.h"
#include "core/surface/ray_pages.h"
#include "soilvdb/height_map.h"

namespace soilvdb::inline v0 {
namespace {

constexpr double kMeetsNone = RayWalk::kNever;
/// Pages of 80 kB that are kept at most: 330 MB.
constexpr std::size_t kMaxRayPages = 4096;
/// Rays that a thread takes at a time. With fewer, tasks take time; with more, threads wait.
constexpr std::size_t kRaysPerTask = 256;
/// Steps in which a curve over a quad with a corner missing is looked at.
constexpr int kRaggedSteps = 16;
/// Length to which an interval with a meeting is halved, m.
constexpr double kMeetPrecision = 1e-9;
/// A ray is looked at in steps down to this where the terrain only tells heights, voxels.
constexpr double kLeastRayStep = 0.25;
/// Distance up to which it is, voxels.
constexpr double kFarthestSearch = 1 << 24;
/// Sizes of boxes in voxels between which the terrain isn't asked for their content: it would look
/// at each.
constexpr double kFewBoxVoxels = 1 << 11, kManyBoxVoxels = 1 << 20;

/// Squared length of a direction from which on it surely has all its bits.
constexpr double kLeastSquare = 1e-200;

/// Where holds(t) begins to hold. @param low where it doesn't @param high where it does
template <typename Holds>
double begin_of(double low, double high, const Holds& holds) {
  while (high - low > kMeetPrecision) {
    const double middle = (low + high) / 2;
    if (middle <= low || middle >= high) break;  // far away, where numbers are no closer
    (holds(middle) ? high : low) = middle;
  }
  return high;
}

/// A ray over a terrain that only tells heights, and what boxes hold.
class SearchedTerrain {
 public:
  SearchedTerrain(const InitialTerrain& terrain, double step_m, const Vec3& origin,
                  const Vec3& direction)
      : terrain_(terrain), h_(step_m), origin_(origin), direction_(direction) {}

  double meet(double from) const {
    if (is_below(from)) return from;
    for (double side = 8 * h_, begin = from; begin - from < kFarthestSearch * h_; side *= 2) {
      const double met = first(begin, begin + side);
      if (met != kMeetsNone) return met;
      begin += side;
    }
    return kMeetsNone;
  }

 private:
  bool is_below(double t) const {
    const Vec3 p = origin_ + t * direction_;
    const auto z = terrain_.height(p.x(), p.y());
    return z && p.z() <= *z;
  }
  /// The first place in (begin, end].
  double first(double begin, double end) const {
    const bool is_short = end - begin <= kLeastRayStep * h_;
    Eigen::AlignedBox3d box;
    for (const double t : {begin, end}) box.extend(Vec3(origin_ + t * direction_));
    const double voxels = (box.sizes() / h_ + Vec3::Ones()).prod();
    if (is_short || voxels < kFewBoxVoxels || voxels > kManyBoxVoxels) {
      const bool is_air = terrain_.classify(box) == Content::kAir;
      if (is_short || is_air) {
        const auto below = [&](double t) { return is_below(t); };
        if (below(end)) return begin_of(begin, end, below);
        return kMeetsNone;
      }
    }
    const double middle = (begin + end) / 2;
    const double met = first(begin, middle);
    return met != kMeetsNone ? met : first(middle, end);
  }

  const InitialTerrain& terrain_;
  const double h_;
  const Vec3& origin_;
  const Vec3& direction_;
};

float bound_of(double height) {
  const auto z = static_cast<float>(height);
  return z < height ? std::nextafter(z, std::numeric_limits<float>::infinity()) : z;
}

/// @param first its first quad
void make_page(HeightReader& reader, const Coord2& first, RayPage& page) {
  constexpr int kColumns = RayPage::kColumns;
  const Coord2 size = Coord2::Constant(kColumns);
  HeightReader::Columns &columns = reader.columns, &changed = reader.changed;
  reader.read(first, size, static_cast<std::size_t>(MapLayer::kHeight), kNoCeiling, columns);
  reader.read(first, size, HeightReader::kTouched, kNoCeiling, changed);
  std::copy(columns.values.begin(), columns.values.end(), page.heights.begin());
  for (int x = 0; x < kRaySide; ++x) {
    for (int y = 0; y < kRaySide; ++y) {
      bool some = false, whole = true;
      double high = -kMeetsNone;
      for (const auto& [u, v] : {std::pair(x, y), {x, y + 1}, {x + 1, y}, {x + 1, y + 1}}) {
        const double z = columns.at(u, v);
        some |= changed.at(u, v) > 0;
        whole &= !std::isnan(z);
        if (!std::isnan(z)) high = std::max(high, z);
      }
      constexpr float kAny = std::numeric_limits<float>::infinity();
      page.bounds[RayPage::square(0, x, y)] = {some ? bound_of(high) : -kAny,
                                               some && whole ? bound_of(high) : kAny};
    }
  }
  for (int level = 1; level <= kRayLevels; ++level) {
    for (int x = 0; x < kRaySide; x += 1 << level) {
      for (int y = 0; y < kRaySide; y += 1 << level) {
        RayPage::Bounds& square = page.bounds[RayPage::square(level, x, y)];
        const int half = 1 << (level - 1);
        square = page.bounds[RayPage::square(level - 1, x, y)];
        for (const auto& [u, v] : {std::pair(x, y + half), {x + half, y}, {x + half, y + half}}) {
          const RayPage::Bounds& part = page.bounds[RayPage::square(level - 1, u, v)];
          square.changed = std::max(square.changed, part.changed);
          square.all = std::max(square.all, part.all);
        }
      }
    }
  }
}

class GroundRays {
 public:
  explicit GroundRays(HeightReader& reader)
      : reader_(reader),
        ground_(reader.ground()),
        pages_(reader.pages()),
        terrain_(dynamic_cast<const RayTerrain*>(&ground_.terrain())),
        h_(ground_.voxel_size_m()) {}

  /// @param direction of unit length
  double range(const Vec3& origin, const Vec3& direction) const {
    const Ray ray{origin, direction};
    double terrain = meet_terrain(ray, 0);  // the first meeting from here on, whatever was dug
    const Eigen::AlignedBox2i& box = pages_.box();
    if (box.isEmpty()) return terrain;
    RayWalk walk(ground_.index_from_world(origin), direction / h_);
    double from = 0, to = kMeetsNone;
    if (!walk.clip(box.min().cast<double>(), (box.max() + Coord2::Ones()).cast<double>(), from, to))
      return terrain;
    if (terrain < from) return terrain;
    walk.start(from, box.min(), box.max());
    Coord2 first = floor_to(Coord2(walk.x(), walk.y()), kRaySide) + Coord2::Constant(kRaySide);
    const RayPage* page = nullptr;
    for (int level = kRayLevels;;) {
      if ((((walk.x() ^ first.x()) | (walk.y() ^ first.y())) & -kRaySide) != 0) {
        const Coord2 here = floor_to(Coord2(walk.x(), walk.y()), kRaySide);
        page = pages_.find(here, [&](RayPage& p) { make_page(reader_, here, p); });
        first = here;
        level = kRayLevels;
      }
      const double end = std::min(walk.end(level), to);
      const int x = walk.x() - first.x(), y = walk.y() - first.y();
      const RayPage::Bounds bounds = page == nullptr ? RayPage::Bounds{-kNoBound, kNoBound}
                                                     : page->bounds[RayPage::square(level, x, y)];
      const float bound = end < terrain ? bounds.changed : bounds.all;
      if (walk.lowest(end) <= bound) {
        if (bounds.changed == -kNoBound) {
          if (terrain < walk.t()) terrain = meet_terrain(ray, walk.t());
          if (terrain <= end) return terrain;
        } else if (level > 0) {
          walk.fall_to(bound, level);
          --level;
          continue;
        } else {
          const double met = bounds.all == kNoBound
                                 ? meet_ragged(ray, walk, end, *page, x, y, terrain)
                                 : meet_whole(walk, end, *page, x, y);
          if (met != kMeetsNone) return met;
        }
      }
      if (end >= to) break;
      const int old_x = walk.x(), old_y = walk.y();
      walk.leave(level, end);
      // In another square of the next level, that is worth a look.
      if (level < kRayLevels && ((old_x ^ walk.x()) | (old_y ^ walk.y())) >> (level + 1) != 0)
        ++level;
    }
    if (to == kMeetsNone) return kMeetsNone;  // upright, over one quad
    return terrain < to ? meet_terrain(ray, to) : terrain;
  }

 private:
  struct Ray {
    const Vec3 &origin, &direction;
  };
  static constexpr float kNoBound = std::numeric_limits<float>::infinity();

  double meet_terrain(const Ray& ray, double from) const {
    if (terrain_ != nullptr) return terrain_->meet(ray.origin, ray.direction, from);
    return SearchedTerrain(ground_.terrain(), h_, ray.origin, ray.direction).meet(from);
  }
  static double meet_whole(const RayWalk& walk, double end, const RayPage& page, int x, int y) {
    const double* z = &page.heights[static_cast<std::size_t>(x * RayPage::kColumns + y)];
    return walk.meet(z[0], z[RayPage::kColumns], z[1], z[RayPage::kColumns + 1], end);
  }
  /// In a quad of which a column has no ground: by quarters, each with its nearest column.
  double meet_ragged(const Ray& ray, const RayWalk& walk, double end, const RayPage& page, int x,
                     int y, double& terrain) const {
    const double* z = &page.heights[static_cast<std::size_t>(x * RayPage::kColumns + y)];
    const double corners[] = {z[0], z[1], z[RayPage::kColumns], z[RayPage::kColumns + 1]};
    const auto place = [&](double t) {
      const Vec3 p = walk.at(t);
      return Vec3(p.x() - walk.x(), p.y() - walk.y(), p.z());
    };
    const auto is_below = [&](double t) {
      const Vec3 p = place(t);
      const double u = p.x(), v = p.y();
      const double weights[] = {(1 - u) * (1 - v), (1 - u) * v, u * (1 - v), u * v};
      double sum = 0, whole = 0;
      for (int n = 0; n < 4; ++n) {
        if (std::isnan(corners[n])) continue;
        sum += weights[n] * corners[n];
        whole += weights[n];
      }
      return p.z() * whole <= sum;
    };
    // An upright ray never leaves: it is followed down to the lowest corner.
    double last = end;
    if (last == kMeetsNone) {
      last = walk.t();
      for (const double corner : corners)
        if (!std::isnan(corner) && !is_below(last))
          last = std::max(last, walk.t() + (walk.height(walk.t()) - corner + 1) * h_);
    }
    std::array<double, 4> stops = {walk.t(), walk.t(), walk.t(), last};
    const Vec3 begin = place(walk.t()), along = place(walk.t() + h_) - begin;
    for (int a = 0; a < 2; ++a)
      if (along[a] != 0)
        stops[static_cast<std::size_t>(a + 1)] =
            std::clamp(walk.t() + (0.5 - begin[a]) / along[a] * h_, walk.t(), last);
    std::sort(stops.begin(), stops.end());
    for (std::size_t n = 0; n + 1 < stops.size(); ++n) {
      const double from = stops[n], to = n + 2 == stops.size() ? end : stops[n + 1];
      const double part_end = stops[n + 1];
      if (n + 2 < stops.size() && from == to) continue;
      const Vec3 middle = place((from + part_end) / 2);
      if (std::isnan(corners[2 * (middle.x() >= 0.5) + (middle.y() >= 0.5)])) {
        if (terrain < from) terrain = meet_terrain(ray, from);
        if (terrain <= to && terrain != kMeetsNone) return terrain;
        continue;
      }
      double before = from;
      for (int k = 0; k <= kRaggedSteps; ++k) {
        const double t = from + (part_end - from) * k / kRaggedSteps;
        if (is_below(t)) return begin_of(before, t, is_below);
        before = t;
      }
    }
    return kMeetsNone;
  }

  HeightReader& reader_;
  const Ground& ground_;
  RayPages& pages_;
  const RayTerrain* terrain_;  // null: it is searched
  const double h_;
};

/// Its unit direction; false if there is none.
bool make_unit(const Vec3& direction, Vec3& unit) {
  const double square = direction.squaredNorm();
  if (square > kLeastSquare && square < 1 / kLeastSquare) {
    unit = direction * (1 / std::sqrt(square));
    return true;
  }
  const double most = direction.cwiseAbs().maxCoeff();
  if (!direction.allFinite() || most == 0) return false;
  unit = direction / most;  // so that squares neither vanish nor overflow
  unit /= unit.norm();
  return true;
}

}  // namespace

void HeightMap::cast(std::span<const Vec3> origins_m, std::span<const Vec3> directions,
                     std::span<double> ranges_m) {
  const std::size_t count = directions.size();
  if (origins_m.size() != count && origins_m.size() != 1)
    throw std::invalid_argument("there must be an origin for each ray, or one for all");
  if (ranges_m.size() != count)
    throw std::invalid_argument("there must be room for a distance of each ray");
  HeightReader& reader = *reader_;
  reader.refresh();
  reader.pages().prepare(kMaxRayPages);
  const GroundRays rays(reader);
  std::atomic<std::size_t> bad = count;  // the first
  const auto cast_some = [&](std::size_t task) {
    for (std::size_t i = task * kRaysPerTask; i < std::min(count, (task + 1) * kRaysPerTask); ++i) {
      const Vec3& origin = origins_m[origins_m.size() == 1 ? 0 : i];
      Vec3 unit;
      if (!make_unit(directions[i], unit) || !origin.allFinite()) {
        for (std::size_t known = bad; i < known && !bad.compare_exchange_weak(known, i);) {
        }
        return;
      }
      ranges_m[i] = rays.range(origin, unit);
    }
  };
  const std::size_t tasks = (count + kRaysPerTask - 1) / kRaysPerTask;
  if (tasks == 1) {
    cast_some(0);
  } else {
    tbb::parallel_for(std::size_t{0}, tasks, cast_some);
  }
  if (bad < count) {
    const Vec3& direction = directions[bad];
    const bool is_origin = !origins_m[origins_m.size() == 1 ? 0 : bad.load()].allFinite();
    throw std::invalid_argument("ray " + std::to_string(bad) +
                                (is_origin               ? ": its origin must be numbers"
                                 : direction.allFinite() ? ": its direction must not be zero"
                                                         : ": its direction must be numbers"));
  }
}

}  // namespace soilvdb::inline v0
