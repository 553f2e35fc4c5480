// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Where rays meet the surface of HeightMap::at(). The terrain's own surface is asked for its next
// meeting with a ray; until there only quads that changed are looked at, and beyond it those that
// may have taken it away.
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>

#include "core/ground/ray_terrain.h"
#include "core/lattice/ray_beam.h"
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
/// Rays in a row that walk together at first. Fewer save less; more part earlier.
constexpr std::size_t kRaysPerBeam = 16;
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

  /// Casts rays from one origin. Neighbours among them may go the same way.
  /// @param directions of unit length
  void cast(const Vec3& origin, std::span<const Vec3> directions, std::span<double> ranges) const {
    for (std::size_t i = 0; i < directions.size(); ++i)
      ranges[i] = meet_terrain({origin, directions[i]}, 0);
    if (pages_.box().isEmpty()) return;
    std::optional<RayPlace> from;
    if (directions.size() > 1 && all_meet_terrain(origin, directions, ranges, from)) return;
    for (std::size_t i = 0; i < directions.size(); ++i)
      ranges[i] = range({origin, directions[i]}, ranges[i], from);
  }

 private:
  struct Ray {
    const Vec3 &origin, &direction;
  };
  static constexpr float kNoBound = std::numeric_limits<float>::infinity();

  /// The page around the place of a walk, if it has one.
  struct Page {
    Coord2 first;
    const RayPage* page;
    int level;  ///< of its square, which is wider if nothing changed in it
    int outside = -1 << level;

    bool holds(int x, int y) const { return (((x ^ first.x()) | (y ^ first.y())) & outside) == 0; }
    RayPage::Bounds bounds(int of_level, int x, int y) const {
      if (page == nullptr) return {-kNoBound, kNoBound};
      return page->bounds[RayPage::square(of_level, x - first.x(), y - first.y())];
    }
  };
  Page page_at(int x, int y) const {
    const Coord2 first = floor_to(Coord2(x, y), kRaySide);
    const RayPage* page = pages_.find(first, [&](RayPage& p) { make_page(reader_, first, p); });
    return {first, page, page != nullptr ? kRayLevels : pages_.empty_level(first)};
  }

  /// @param ranges where they meet the terrain, whatever was dug
  /// @param from becomes the last place from which each ray surely goes on with the bits of its
  /// whole walk
  /// @return whether surely all meet the terrain before changed ground
  bool all_meet_terrain(const Vec3& origin, std::span<const Vec3> directions,
                        std::span<const double> ranges, std::optional<RayPlace>& from) const {
    std::array<Span, 3> along;
    Span terrain;
    for (std::size_t i = 0; i < directions.size(); ++i) {
      for (std::size_t a = 0; a < 3; ++a) along[a].extend(directions[i][static_cast<int>(a)]);
      terrain.extend(ranges[i]);
    }
    for (Span& s : along) s = {s.low / h_, s.high / h_};
    RayBeam beam(ground_.index_from_world(origin), along);
    if (!beam.is_narrow()) return false;
    const Eigen::AlignedBox2i& box = pages_.box();
    Span begin, to;
    beam.clip(box.min().cast<double>(), (box.max() + Coord2::Ones()).cast<double>(), begin, to);
    if (begin.low > to.high || terrain.high < begin.low) return true;
    if (begin.high > to.low || terrain.low < begin.high) return false;
    beam.start(begin, box.min(), box.max());
    if (!beam.is_in_one(kRayLevels)) return false;
    Page page = page_at(beam.x(), beam.y());
    for (int level = page.level; beam.is_in_one(level);) {
      const int x = beam.x(), y = beam.y();
      const Span over_x = beam.border(0, level), over_y = beam.border(1, level);
      const Span out = min(over_x, over_y), end = max(beam.t(), out);
      if (end.high >= to.low) return false;
      const RayPage::Bounds bounds = page.bounds(level, x, y);
      const Span bound = {end.low < terrain.high ? bounds.changed : bounds.all,
                          end.high < terrain.low ? bounds.changed : bounds.all};
      const Span lowest = beam.lowest(end);
      const RayPlace here{x, y, level, beam.t().low};
      if (lowest.high <= bound.low) {
        if (bounds.changed == -kNoBound) return terrain.low >= beam.t().high;
        if (level == 0) return false;
        if (beam.fall_to(bound, level)) from = here;  // wherever in the square they came from
        --level;
        continue;
      }
      const bool is_over_x = over_x.high <= over_y.low;
      if (lowest.low <= bound.high || (!is_over_x && over_y.high >= over_x.low)) return false;
      if (beam.t().high <= out.low) from = here;
      beam.leave(is_over_x ? 0 : 1, level, end);
      if (!page.holds(beam.x(), beam.y())) {
        page = page_at(beam.x(), beam.y());
        level = page.level;
      } else if (level < kRayLevels && ((x ^ beam.x()) | (y ^ beam.y())) >> (level + 1) != 0) {
        ++level;
      }
    }
    return false;
  }
  /// @param terrain where it meets that, whatever was dug
  double range(const Ray& ray, double terrain, const std::optional<RayPlace>& place) const {
    const Eigen::AlignedBox2i& box = pages_.box();
    RayWalk walk(ground_.index_from_world(ray.origin), ray.direction / h_);
    double from = 0, to = kMeetsNone;
    if (!walk.clip(box.min().cast<double>(), (box.max() + Coord2::Ones()).cast<double>(), from, to))
      return terrain;
    if (terrain < from) return terrain;
    if (place)
      walk.start(*place, box.max());
    else
      walk.start(from, box.min(), box.max());
    Page page = page_at(walk.x(), walk.y());
    for (int level = place ? place->level : page.level;;) {
      const double end = std::min(walk.end(level), to);
      const int x = walk.x(), y = walk.y();
      const RayPage::Bounds bounds = page.bounds(level, x, y);
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
          const int in_x = x - page.first.x(), in_y = y - page.first.y();
          const double met = bounds.all == kNoBound
                                 ? meet_ragged(ray, walk, end, *page.page, in_x, in_y, terrain)
                                 : meet_whole(walk, end, *page.page, in_x, in_y);
          if (met != kMeetsNone) return met;
        }
      }
      if (end >= to) break;
      walk.leave(level, end);
      if (!page.holds(walk.x(), walk.y())) {
        page = page_at(walk.x(), walk.y());
        level = page.level;
      } else if (level < kRayLevels && ((x ^ walk.x()) | (y ^ walk.y())) >> (level + 1) != 0) {
        ++level;  // in another square of the next level, that is worth a look
      }
    }
    if (to == kMeetsNone) return kMeetsNone;  // upright, over one quad
    return terrain < to ? meet_terrain(ray, to) : terrain;
  }

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

void HeightMap::fill_ranges(std::span<const Vec3> origins_m, std::span<const Vec3> directions,
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
  const bool has_one_origin = origins_m.size() == 1;
  const auto cast_some = [&](std::size_t task) {
    const std::size_t end = std::min(count, (task + 1) * kRaysPerTask);
    std::array<Vec3, kRaysPerBeam> units;
    for (std::size_t i = task * kRaysPerTask, n = 0; i < end; i += n) {
      const Vec3& origin = origins_m[has_one_origin ? 0 : i];
      const std::size_t most = std::min(kRaysPerBeam, end - i);
      for (n = 0; n < most && (has_one_origin || origins_m[i + n] == origin || n == 0); ++n) {
        if (make_unit(directions[i + n], units[n]) && origin.allFinite()) continue;
        for (std::size_t known = bad; i + n < known && !bad.compare_exchange_weak(known, i + n);) {
        }
        return;
      }
      rays.cast(origin, std::span(units).first(n), ranges_m.subspan(i, n));
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
    const bool is_origin = !origins_m[has_one_origin ? 0 : bad.load()].allFinite();
    throw std::invalid_argument("ray " + std::to_string(bad) +
                                (is_origin               ? ": its origin must be numbers"
                                 : direction.allFinite() ? ": its direction must not be zero"
                                                         : ": its direction must be numbers"));
  }
}

}  // namespace soilvdb::inline v0
