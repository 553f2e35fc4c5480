// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/survey_input.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <variant>

#include "core/tool/polygon.h"
#include "io/terrain/crs.h"
#include "tools/run/text.h"

namespace soilvdb::tools {
namespace {

/// Columns along a side of a part, a multiple of 8, and voxels in it that change: it is taken at
/// once, some hundredths of a second, and feeds wait meanwhile.
constexpr int kPart = 128;
constexpr std::int64_t kMostWork = 1 << 20;
/// Posts of a survey that are kept at a time.
constexpr std::uint64_t kMostSurface_bytes = 64 << 20;
/// Most columns of a survey: a square of 400 m in voxels of 10 cm. The ground then takes 1 GB.
constexpr double kMostColumns = 1 << 24;
constexpr std::size_t kMostSurveyCorners = 4096;
constexpr double kMostIndex = (1 << 23) - 2;
/// If half of a survey is farther above the ground than this, or below it, its heights are above
/// something else or no heights; if less is, but so much of it, that is told.
constexpr double kOtherDatum_m = 5, kMostFar = 0.5, kSomeFar = 0.01;
/// If nine tenths are off by about the same, at least so much, that is told.
constexpr double kOffset_m = 0.15, kAlike = 0.5;
constexpr double kFoot_m = 0.3048, kLikeFeet = 0.05;

using Box = Eigen::AlignedBox2d;

/// Columns of a rectangle.
struct SurveyedColumns {
  Coord2 first = {0, 0}, size = {0, 0};

  double count() const { return static_cast<double>(size.x()) * size.y(); }
};

/// Those that are wholly in a box of the world.
SurveyedColumns columns_in(const Box& box, const Ground& ground) {
  const auto index = [&](const Vec2& at) {
    return Vec2(((at - ground.origin().head<2>()) / ground.voxel_size_m())
                    .cwiseMax(-kMostIndex)
                    .cwiseMin(kMostIndex));
  };
  constexpr double kRounding = 1e-6;  // of a voxel: rounding of the world's coordinates
  const Coord2 first =
      (index(box.min()).array() + 0.5 - kRounding).ceil().matrix().template cast<int>();
  const Coord2 last =
      (index(box.max()).array() - 0.5 + kRounding).floor().matrix().template cast<int>();
  return {first, (last - first + Coord2::Ones()).cwiseMax(Coord2::Zero())};
}

void check_crs(const io::Site& site, const io::Base& survey, const SurveyOptions& options,
               std::vector<std::string>& warnings) {
  if (std::holds_alternative<io::PlaneTerrain>(site.undug().terrain) ||
      std::holds_alternative<io::PlaneTerrain>(survey.reference.terrain))
    return;
  const std::string name = "the survey " + options.name;
  const auto found = io::crs_conflicts("the terrain", site.crs_wkt, name, survey.crs_wkt);
  if (!found.place.empty())
    throw std::invalid_argument(
        fmt::format("{}; convert it first, a raster by: gdalwarp -t_srs {} IN.tif OUT.tif",
                    found.place, io::map_label(site.crs_wkt)));
  if (!found.heights.empty() && !options.trusts_heights)
    throw std::invalid_argument(
        fmt::format("{}; convert its heights first, or say that they are to be trusted if they are "
                    "above the terrain's zero all the same",
                    found.heights));
  for (const std::string& difference :
       io::crs_differences("the terrain", site.crs_wkt, name, survey.crs_wkt))
    warnings.push_back(difference);
}

/// Nine tenths of the differences are between these, m.
struct SurveyOffset {
  double low_m = 0, middle_m = 0, high_m = 0;

  explicit SurveyOffset(std::vector<float> differences_m) {
    const auto at = [&](double share) {
      const auto nth =
          differences_m.begin() +
          static_cast<std::ptrdiff_t>(share * static_cast<double>(differences_m.size() - 1));
      std::nth_element(differences_m.begin(), nth, differences_m.end());
      return static_cast<double>(*nth);
    };
    low_m = at(0.05);
    middle_m = at(0.5);
    high_m = at(0.95);
  }
};

void check_heights(const std::vector<float>& differences_m, double ground_m,
                   const SurveyOptions& options, std::vector<std::string>& warnings) {
  const SurveyOffset off(differences_m);
  const auto all = static_cast<double>(differences_m.size());
  for (const double side : {1.0, -1.0}) {
    const auto is_far = [&](double by_m) { return side * by_m > kOtherDatum_m; };
    const double far =
        static_cast<double>(std::count_if(differences_m.begin(), differences_m.end(), is_far)) /
        all;
    if (far < kSomeFar) continue;
    std::string by = fmt::format("{:.0f} % of {} are more than {:.0f} m {} the ground", 100 * far,
                                 options.name, kOtherDatum_m, side > 0 ? "above" : "below");
    if (far <= kMostFar) {
      warnings.push_back(by + "; are these heights, and not voids?");
      continue;
    }
    by += fmt::format(", half of it {:.2f} m or more", side * off.middle_m);
    if (options.trusts_heights) {
      warnings.push_back(by);
      continue;
    }
    const double ratio = (ground_m + off.middle_m) / ground_m;
    const bool in_feet = std::abs(ratio * kFoot_m - 1) < kLikeFeet;
    throw std::invalid_argument(
        by + (in_feet ? "; they seem to be in feet; convert them to metres"
                      : "; are its heights above the same zero as the terrain's, and not above the "
                        "ellipsoid, in metres, and no voids? Convert them, or say that they are to "
                        "be trusted"));
  }
  if ((off.low_m > 0) == (off.high_m > 0) && std::abs(off.middle_m) > kOffset_m &&
      off.high_m - off.low_m < kAlike * std::abs(off.middle_m))
    warnings.push_back(fmt::format(
        "nine tenths of {} are {:.2f} to {:.2f} m {} the ground, about alike; are its heights "
        "above the same zero as the terrain's?",
        options.name, std::min(std::abs(off.low_m), std::abs(off.high_m)),
        std::max(std::abs(off.low_m), std::abs(off.high_m)), off.middle_m > 0 ? "above" : "below"));
}

/// Cuts a part in halves until each piece is little work. The ground comes out as of the whole
/// part.
/// @param now heights of the same columns
class PartCutter {
 public:
  PartCutter(const SurveyHeights& part, const SurveyHeights& now, std::vector<SurveyHeights>& to)
      : part_(part), now_(now), to_(to) {
    cut({0, 0}, part.size);
  }

 private:
  void cut(const Coord2& low, const Coord2& high) {
    const Coord2 size = high - low;
    const int axis = size.x() >= size.y() ? 0 : 1;
    // Between squares of 8 columns, each of which is changed as one.
    const int middle = part_.first[axis] + low[axis] + size[axis] / 2;
    const int at = (middle & ~(kChunkSide - 1)) - part_.first[axis];
    if (at <= low[axis] || is_little(low, high)) return add(low, high);
    Coord2 first_end = high, second = low;
    first_end[axis] = second[axis] = at;
    cut(low, first_end);
    cut(second, high);
  }

  bool is_little(const Coord2& low, const Coord2& high) const {
    std::int64_t samples = 0;
    for (int x = low.x(); x < high.x(); ++x) {
      for (int y = low.y(); y < high.y(); ++y) {
        const std::size_t n = part_.number(x, y);
        if (part_.heights[n] != SurveyHeights::kNone)
          samples += std::abs(std::int64_t{part_.heights[n]} - now_.heights[n]);
      }
    }
    return samples / 64 <= kMostWork;
  }

  void add(const Coord2& low, const Coord2& high) {
    if (high - low == part_.size) return to_.push_back(part_);
    SurveyHeights piece{part_.first + low - Coord2::Ones(), high - low + Coord2(2, 2), {}, 1};
    bool any = false;
    for (int x = low.x() - 1; x <= high.x(); ++x) {
      for (int y = low.y() - 1; y <= high.y(); ++y) {
        const bool is_in = x >= 0 && y >= 0 && x < part_.size.x() && y < part_.size.y();
        const std::int32_t height =
            is_in ? part_.heights[part_.number(x, y)] : SurveyHeights::kNone;
        const bool is_own = x >= low.x() && x < high.x() && y >= low.y() && y < high.y();
        any = any || (is_own && height != SurveyHeights::kNone);
        piece.heights.push_back(height);
      }
    }
    if (any) to_.push_back(std::move(piece));
  }

  const SurveyHeights &part_, &now_;
  std::vector<SurveyHeights>& to_;
};

}  // namespace

SurveyInput read_survey(const Session& session, const io::Base& survey,
                        const SurveyOptions& options) {
  const io::Site& site = session.site();
  const Ground& ground = *site.ground;
  const double h = ground.voxel_size_m();
  SurveyInput input;
  input.warnings = survey.warnings;
  check_crs(site, survey, options, input.warnings);
  Box box = survey.bounds, common = box.intersection(site.bounds);
  if (common.isEmpty())
    throw std::invalid_argument(fmt::format(
        "{} misses the site: it goes {}, and the terrain {}; are its coordinates those of the "
        "site?",
        options.name, extent_text(box), extent_text(site.bounds)));
  if (!options.boundary.empty()) {
    if (options.boundary.size() < 3 || options.boundary.size() > kMostSurveyCorners ||
        crosses_itself(options.boundary))
      throw std::invalid_argument(fmt::format(
          "a boundary must have 3 to {} corners, and sides that do not cross", kMostSurveyCorners));
    Box around;
    for (const Vec2& corner : options.boundary) {
      if (!corner.allFinite()) throw std::invalid_argument("a boundary's corners must be numbers");
      around.extend(corner);
    }
    if (!common.intersects(around))
      throw std::invalid_argument(
          fmt::format("the boundary misses {}: it goes {}, and {} on this site {}", options.name,
                      extent_text(around), options.name, extent_text(common)));
    const Vec2 column = Vec2::Constant(h);  // those are taken whose middles are inside
    around = {around.min() - column, around.max() + column};
    box = box.intersection(around);
    common = common.intersection(around);
  }
  if (!common.sizes().allFinite())
    throw std::invalid_argument("neither the survey nor the site has an end; give a boundary");
  const SurveyedColumns columns = columns_in(common, ground);
  const bool is_bounded = !options.boundary.empty();
  const auto is_asked = [&](const Coord2& cell) {
    return !is_bounded ||
           inside(options.boundary, Vec2(ground.origin().head<2>() + h * cell.cast<double>()));
  };
  if (columns.count() > kMostColumns)
    throw std::invalid_argument(fmt::format(
        "{} has {:.0f} columns of voxels on this site, and may have {:.0f}; cut it to what has "
        "changed, or give a boundary",
        options.name, columns.count(), kMostColumns));
  const auto surface = std::make_shared<Ground>(h, ground.origin(), survey.surface);
  std::vector<float> differences_m;
  double ground_m = 0;
  std::int64_t asked = 0, voids = 0, outside = 0, taken = 0;
  const Coord2 end = columns.first + columns.size;
  const auto aligned = [](int at) { return at & ~(kPart - 1); };
  // Along the rows of a raster, which a file has one after another.
  for (int y = columns.first.y(); y < end.y(); y = aligned(y) + kPart) {
    for (int x = columns.first.x(); x < end.x(); x = aligned(x) + kPart) {
      options.go_on();
      const Coord2 first(x, y);
      const Coord2 size = Coord2(aligned(x) + kPart, aligned(y) + kPart).cwiseMin(end) - first;
      SurveyHeights part = column_heights(*surface, first, size);
      const SurveyHeights now = column_heights(ground, first, size);
      std::int64_t of_part = 0;
      for (int i = 0; i < size.x(); ++i) {
        for (int j = 0; j < size.y(); ++j) {
          const std::size_t n = part.number(i, j);
          std::int32_t& height = part.heights[n];
          const bool is_void = height == SurveyHeights::kNone;
          const bool is_in = is_asked(first + Coord2(i, j));
          asked += is_in;
          if (!is_in || is_void || now.heights[n] == SurveyHeights::kNone) {
            voids += is_in && is_void;
            outside += is_in && !is_void;
            height = SurveyHeights::kNone;
            continue;
          }
          ++of_part;
          differences_m.push_back(static_cast<float>(
              h / 64 * static_cast<double>(std::int64_t{height} - now.heights[n])));
          ground_m += ground.origin().z() + h / 64 * now.heights[n];
        }
      }
      taken += of_part;
      if (of_part > 0) PartCutter(part, now, input.parts);
      if (survey.surface->memory_bytes() > kMostSurface_bytes) survey.surface->forget();
    }
  }
  if (taken == 0)
    throw std::invalid_argument(fmt::format(
        "{} has no height where the site has ground{}", options.name,
        is_bounded ? " inside the boundary" : "; are its coordinates those of the site?"));
  check_heights(differences_m, ground_m / static_cast<double>(taken), options, input.warnings);
  // What is beyond the site was not looked at; a boundary there is taken as its box.
  const double beyond = box.sizes().allFinite()
                            ? std::max(0.0, columns_in(box, ground).count() - columns.count())
                            : 0;
  const double all = static_cast<double>(asked) + beyond;
  input.area_m2 = static_cast<double>(taken) * h * h;
  input.voids = static_cast<double>(voids) / all;
  input.outside = (static_cast<double>(outside) + beyond) / all;
  return input;
}

}  // namespace soilvdb::tools
