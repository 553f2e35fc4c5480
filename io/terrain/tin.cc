// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/terrain/tin.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/geometry/geometries/box.hpp>
#include <boost/geometry/geometries/point.hpp>
#include <boost/geometry/index/rtree.hpp>
#include <boost/iterator/function_output_iterator.hpp>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <utility>

#include "core/tool/polygon.h"
#include "io/file/text.h"
#include "io/terrain/crs.h"
#include "io/terrain/gdal.h"
#include "io/terrain/gdal_heights.h"

namespace soilvdb::inline v0::io {
namespace {

namespace index = boost::geometry::index;
using TinPoint = boost::geometry::model::point<double, 2, boost::geometry::cs::cartesian>;
using TinBox = boost::geometry::model::box<TinPoint>;
using Corners = std::array<Vec3, 3>;

constexpr double kMostTinPosts = 1 << 24, kLeastSpacing_m = 1.0 / 32;
/// Places this near a face are on it; a face that is narrower in plan is vertical.
constexpr double kOn_m = 1e-6;
/// Faces that lie over one another by less, in plan or in height, do so by rounding.
constexpr double kRounding_m = 0.001;
constexpr double kHighest_m = 1e5;     // as of rasters
constexpr double kMostFacesOver = 32;  // one another, on average
constexpr double kCoarse_m = 1;        // posts that are farther apart are told

Vec2 in_plan(const Vec3& p) { return p.head<2>(); }

/// Twice the area in plan, above 0 if the corners turn left.
double turn(const Corners& t) { return cross2(in_plan(t[1] - t[0]), in_plan(t[2] - t[0])); }

/// The height of a face at a place on it or beside its edge. @param t turns left
double height_at(const Corners& t, const Vec2& at) {
  double sum = 0, height = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    const Vec3 &from = t[(k + 1) % 3], &to = t[(k + 2) % 3];
    const double weight = std::max(0.0, cross2(in_plan(to - from), at - in_plan(from)));
    sum += weight;
    height += weight * t[k].z();
  }
  return height / sum;
}

/// The part of a row of places that is on a face, from low x to high.
/// @param t turns left @param y within its bounds
std::pair<double, double> span_at(const Corners& t, double y) {
  double low = -std::numeric_limits<double>::infinity(), high = -low;
  for (std::size_t k = 0; k < 3; ++k) {
    const Vec2 from = in_plan(t[k]), edge = in_plan(t[(k + 1) % 3]) - from;
    const double slack = edge.x() * (y - from.y()) + kOn_m * edge.norm();
    if (edge.y() > 0) high = std::min(high, from.x() + slack / edge.y());
    if (edge.y() < 0) low = std::max(low, from.x() + slack / edge.y());
  }
  return {low, high};
}

/// Is a face beside an edge of another, or nearly so?
bool is_beside(const Corners& face, const Corners& other) {
  for (std::size_t k = 0; k < 3; ++k) {
    const Vec2 from = in_plan(other[k]), edge = in_plan(other[(k + 1) % 3]) - from;
    const auto outside = [&](const Vec3& p) {
      return cross2(edge, in_plan(p) - from) <= kRounding_m * edge.norm();
    };
    if (outside(face[0]) && outside(face[1]) && outside(face[2])) return true;
  }
  return false;
}

/// The part of two faces in plan that is over both.
std::vector<Vec2> common_part(const Corners& a, const Corners& b) {
  std::vector<Vec2> part{in_plan(a[0]), in_plan(a[1]), in_plan(a[2])}, kept;
  for (std::size_t k = 0; k < 3 && !part.empty(); ++k) {
    const Vec2 from = in_plan(b[k]), edge = in_plan(b[(k + 1) % 3]) - from;
    kept.clear();
    for (std::size_t i = 0, j = part.size() - 1; i < part.size(); j = i++) {
      const double u = cross2(edge, part[j] - from), v = cross2(edge, part[i] - from);
      if ((u < 0) != (v < 0)) kept.push_back(part[j] + u / (u - v) * (part[i] - part[j]));
      if (v >= 0) kept.push_back(part[i]);
    }
    part.swap(kept);
  }
  return part;
}

/// Narrowest width of a convex part of the plan.
double width_of(const std::vector<Vec2>& part) {
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0, j = part.size() - 1; i < part.size(); j = i++) {
    const Vec2 edge = part[i] - part[j];
    const double length = edge.norm();
    if (length == 0) continue;
    double far = 0;
    for (const Vec2& p : part) far = std::max(far, cross2(edge, p - part[j]) / length);
    least = std::min(least, far);
  }
  return std::isfinite(least) ? least : 0;
}

/// A place where two faces have two heights.
struct Overlap {
  Vec2 at;
  double low, high;
};

/// Triangles as posts. Coordinates are relative to the first post.
class TinHeights final : public HeightSource {
 public:
  /// @param input scaled to metres
  TinHeights(const std::filesystem::path& path, Tin tin) : path_(path), tin_(std::move(tin)) {
    for (const auto& face : tin_.faces)
      for (const std::uint32_t corner : face) box_.extend(tin_.points[corner]);
    // So rounding is the same wherever the surface lies.
    const Vec3 base(box_.min().x(), box_.min().y(), 0);
    for (Vec3& p : tin_.points) p -= base;
    std::vector<Entry> entries;
    for (std::size_t i = 0; i < tin_.faces.size(); ++i) add(i, entries);
    if (entries.empty()) throw InputError(path, "has no face with an area seen from above");
    tree_ = Tree(entries.begin(), entries.end());
    grid_.first = in_plan(base);
    const Vec2 size = box_.sizes().head<2>();
    double spacing_m = kLeastSpacing_m;
    while ((size.x() / spacing_m + 2) * (size.y() / spacing_m + 2) > kMostTinPosts) spacing_m *= 2;
    const auto posts = [&](double length_m) {
      return std::max(2, 1 + static_cast<int>(std::ceil(length_m / spacing_m - 1e-6)));
    };
    grid_.nx = posts(size.x());
    grid_.ny = posts(size.y());
    grid_.spacing = size.cwiseQuotient(Vec2(grid_.nx - 1, grid_.ny - 1));
    if (area_m2_ > kMostFacesOver * size.prod()) fail_as_pile();
    find_overlap();
  }

  const HeightGrid& grid() const { return grid_; }
  const Eigen::AlignedBox3d& box() const { return box_; }

  std::vector<std::string> doubts() const {
    std::vector<std::string> all;
    if (vertical_ > 0)
      all.push_back(
          fmt::format("{} vertical; heights jump there",
                      vertical_ == 1 ? "a face is" : fmt::format("{} faces are", vertical_)));
    if (grid_.spacing.maxCoeff() > kCoarse_m)
      all.push_back(
          fmt::format("faces span {:.0f} m x {:.0f} m, so heights are read at posts {:.2g} m apart",
                      box_.sizes().x(), box_.sizes().y(), grid_.spacing.maxCoeff()));
    if (has_too_many_)
      all.emplace_back(
          "has too many long faces side by side to compare all; some may lie over others");
    if (overlap_)
      all.push_back(
          fmt::format("faces lie over one another, first at {:.2f}, {:.2f} with heights "
                      "{:.3f} and {:.3f} m; the highest is taken",
                      overlap_->at.x(), overlap_->at.y(), overlap_->low, overlap_->high));
    return all;
  }

  void read(int x0, int y0, int nx, int ny, float* out) const override {
    std::fill_n(out, std::size_t(nx) * std::size_t(ny), std::numeric_limits<float>::quiet_NaN());
    const Vec2 low = grid_.spacing.cwiseProduct(Vec2(x0, y0)),
               high = grid_.spacing.cwiseProduct(Vec2(x0 + nx - 1, y0 + ny - 1));
    const auto draw = [&](const Entry& entry) {
      const Corners t = corners(entry.second);
      const TinBox& b = entry.first;
      const int j0 = first_post(b.min_corner().get<1>() / grid_.spacing.y(), y0),
                j1 = last_post(b.max_corner().get<1>() / grid_.spacing.y(), y0 + ny - 1);
      for (int j = j0; j <= j1; ++j) {
        const auto [from, to] = span_at(t, j * grid_.spacing.y());
        const int i0 = first_post(from / grid_.spacing.x(), x0),
                  i1 = last_post(to / grid_.spacing.x(), x0 + nx - 1);
        for (int i = i0; i <= i1; ++i) {
          float& z = out[std::size_t(j - y0) * std::size_t(nx) + std::size_t(i - x0)];
          const auto height =
              static_cast<float>(height_at(t, grid_.spacing.cwiseProduct(Vec2(i, j))));
          if (!(z >= height)) z = height;  // NaN, too
        }
      }
    };
    const TinBox window(TinPoint(low.x(), low.y()), TinPoint(high.x(), high.y()));
    tree_.query(index::intersects(window), boost::make_function_output_iterator(draw));
  }

 private:
  using Entry = std::pair<TinBox, std::uint32_t>;
  using Tree = index::rtree<Entry, index::quadratic<16>>;

  static int first_post(double at, int least) {
    return static_cast<int>(std::ceil(std::clamp(at - 1e-9, double(least), 1e9)));
  }
  static int last_post(double at, int most) {
    return static_cast<int>(std::floor(std::clamp(at + 1e-9, -1e9, double(most))));
  }

  Corners corners(std::uint32_t face) const {
    const auto& [a, b, c] = tin_.faces[face];
    return {tin_.points[a], tin_.points[b], tin_.points[c]};
  }

  /// Turns a face left, and adds it unless it is vertical or without any area.
  void add(std::size_t face, std::vector<Entry>& entries) {
    Corners t = corners(static_cast<std::uint32_t>(face));
    const double area = turn(t);
    double longest = 0;
    for (std::size_t k = 0; k < 3; ++k)
      longest = std::max(longest, in_plan(t[(k + 1) % 3] - t[k]).norm());
    if (std::abs(area) <= kOn_m * longest) {
      vertical_ += (t[1] - t[0]).cross(t[2] - t[0]).norm() > kRounding_m * longest;
      return;
    }
    area_m2_ += std::abs(area) / 2;
    if (area < 0) std::swap(tin_.faces[face][1], tin_.faces[face][2]);
    const Vec2 lower = in_plan(t[0]).cwiseMin(in_plan(t[1])).cwiseMin(in_plan(t[2])),
               upper = in_plan(t[0]).cwiseMax(in_plan(t[1])).cwiseMax(in_plan(t[2]));
    const TinPoint least(lower.x() - kOn_m, lower.y() - kOn_m);
    const TinPoint most(upper.x() + kOn_m, upper.y() + kOn_m);
    entries.emplace_back(TinBox(least, most), static_cast<std::uint32_t>(face));
  }

  [[noreturn]] void fail_as_pile() const {
    throw InputError(path_, "has too many faces over one another to be a surface");
  }

  /// The first face of which another has another height.
  void find_overlap() {
    std::int64_t left = 50'000'000 + 200 * static_cast<std::int64_t>(tin_.faces.size());
    for (const auto& [box, face] : tree_) {
      const Corners t = corners(face);
      const auto compare = [&, own = face](const Entry& entry) {
        if (entry.second <= own) return;
        if (--left < 0) return;
        const Corners other = corners(entry.second);
        if (is_beside(t, other) || is_beside(other, t)) return;
        const std::vector<Vec2> part = common_part(t, other);
        if (part.size() < 3 || width_of(part) <= kRounding_m) return;
        for (const Vec2& at : part) {
          const double a = height_at(t, at), b = height_at(other, at);
          if (!overlap_ && std::abs(a - b) > kRounding_m)
            overlap_ = {grid_.first + at, std::min(a, b), std::max(a, b)};
        }
      };
      tree_.query(index::intersects(box), boost::make_function_output_iterator(compare));
      has_too_many_ = left < 0;
      if (overlap_ || has_too_many_) return;
    }
  }

  std::filesystem::path path_;
  Tin tin_;
  Tree tree_;
  HeightGrid grid_;
  Eigen::AlignedBox3d box_;
  double area_m2_ = 0;  ///< of all faces in plan
  std::size_t vertical_ = 0;
  bool has_too_many_ = false;  ///< pairs of faces to look for overlaps
  std::optional<Overlap> overlap_;
};

}  // namespace

RasterInput open_tin(const std::filesystem::path& path) {
  const FilePart from = file_part(path);
  const bool is_dxf = suffix_of(from.file) == ".dxf";
  TinInput input = is_dxf ? read_dxf(from) : read_landxml(from);
  const auto is_void = [&](std::uint32_t corner) {
    const double z = input.tin.points[corner].z();
    return std::find(std::begin(kVoids), std::end(kVoids), z) != std::end(kVoids);
  };
  const std::size_t without = std::erase_if(input.tin.faces, [&](const auto& face) {
    return std::any_of(face.begin(), face.end(), is_void);
  });
  if (without > 0)
    input.doubts.push_back(fmt::format(
        "{} with a corner at -9999 or another number for no height {} left out",
        without == 1 ? "a face" : fmt::format("{} faces", without), without == 1 ? "is" : "are"));
  const Vec3 metres(input.unit_m, input.unit_m, input.height_unit_m);
  for (Vec3& p : input.tin.points) p = p.cwiseProduct(metres);
  const auto source = std::make_shared<TinHeights>(path, std::move(input.tin));
  if (!(source->box().max().cwiseAbs().z() <= kHighest_m &&
        source->box().min().cwiseAbs().z() <= kHighest_m))
    throw InputError(path, "has heights beyond +-100 km");
  RasterInput raster{source->grid(), source, "", is_dxf ? "DXF" : "LandXML", {}};
  if (!input.epsg.empty() || !input.wkt.empty()) {
    const GdalMessages messages;
    raster.crs_wkt = metre_crs(path, input.epsg, input.wkt, input.unit_m, input.unit,
                               source->box().center().head<2>());
    if (raster.crs_wkt.empty())
      input.doubts.push_back(fmt::format("its CRS '{}' is not known",
                                         printable(input.epsg.empty() ? input.wkt : input.epsg)));
  }
  for (const std::vector<std::string>& doubts : {input.doubts, source->doubts()})
    for (const std::string& doubt : doubts) raster.warnings.push_back(path.string() + ": " + doubt);
  return raster;
}

}  // namespace soilvdb::inline v0::io
