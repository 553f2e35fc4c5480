// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// PROJ by its C interface, loaded at its first use as GDAL is.
#include "io/terrain/geodetic.h"

#include <fmt/format.h>
#include <proj.h>
#include <proj_experimental.h>

#include <algorithm>
#include <cctype>
#include <chrono>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "io/file/shared_library.h"
#include "io/file/text.h"
#include "io/terrain/crs.h"

namespace soilvdb::inline v0::io {

struct DestroyProj {
  void operator()(PJ_CONTEXT* context) const;
  void operator()(PJ* object) const;
  void operator()(PJ_OPERATION_FACTORY_CONTEXT* search) const;
  void operator()(PJ_OBJ_LIST* list) const;
};
template <typename T>
using OwnProj = std::unique_ptr<T, DestroyProj>;

namespace {

struct ProjFunctions {
  const SharedLibrary library{SOILVDB_PROJ_LIBRARY, "PROJ", "positions by latitude and longitude"};
  SOILVDB_FUNCTIONS(proj_context_create, proj_context_destroy, proj_context_errno_string,
                    proj_context_set_enable_network, proj_coordoperation_get_accuracy,
                    proj_coordoperation_get_grid_used, proj_coordoperation_get_grid_used_count,
                    proj_coordoperation_has_ballpark_transformation, proj_create,
                    proj_create_crs_to_crs_from_pj, proj_create_operation_factory_context,
                    proj_create_operations, proj_crs_get_coordinate_system, proj_crs_get_sub_crs,
                    proj_crs_promote_to_3D, proj_cs_get_axis_count, proj_cs_get_axis_info,
                    proj_destroy, proj_errno, proj_errno_reset, proj_get_source_crs, proj_get_type,
                    proj_list_destroy, proj_list_get, proj_list_get_count, proj_log_func,
                    proj_normalize_for_visualization, proj_operation_factory_context_destroy,
                    proj_operation_factory_context_set_area_of_interest,
                    proj_operation_factory_context_set_grid_availability_use,
                    proj_operation_factory_context_set_spatial_criterion, proj_trans);
};

const ProjFunctions& proj() {
  static const ProjFunctions functions;
  return functions;
}

constexpr double kMostHeight_m = 1e4, kDegree = std::numbers::pi / 180;
/// What receivers with corrections measure better than.
constexpr double kDoubtful_m = 0.1;
constexpr double kAround_degrees = 1e-3;  ///< half an area of interest

[[noreturn]] void refuse_gnss(const std::string& why) { throw std::invalid_argument(why); }

double year_now() {
  using Years = std::chrono::duration<double, std::chrono::years::period>;
  return 1970 + Years(std::chrono::system_clock::now().time_since_epoch()).count();
}

/// Makes PROJ's objects of one context.
class ProjMaker {
 public:
  explicit ProjMaker(PJ_CONTEXT* context) : context_(context) {}

  /// @param key whose value the code is, for messages
  OwnProj<PJ> crs(const char* key, const std::string& code) const {
    // Only codes: PROJ would also read other texts, and files.
    const bool is_code =
        code.find(':') != code.npos && std::all_of(code.begin(), code.end(), [](unsigned char c) {
          return std::isalnum(c) != 0 || c == ':' || c == '+' || c == '_';
        });
    OwnProj<PJ> made(is_code ? proj().proj_create(context_, code.c_str()) : nullptr);
    if (!made || count_axes(made.get()) == 0)
      refuse_gnss(fmt::format("'{}' is '{}', no CRS that PROJ knows; it must be a code such as {}",
                              key, printable(code),
                              std::string_view(key) == "crs" ? "EPSG:4979" : "EPSG:25832+7837"));
    return made;
  }
  /// Null if it is none.
  OwnProj<PJ> crs_by_wkt(const std::string& wkt) const {
    return OwnProj<PJ>(proj().proj_create(context_, wkt.c_str()));
  }
  /// Latitude and longitude in degrees, and the height above the ellipsoid.
  OwnProj<PJ> receivers_crs(const std::string& code) const {
    OwnProj<PJ> made = crs("crs", code);
    const PJ_TYPE type = proj().proj_get_type(made.get());
    const bool is_flat = type == PJ_TYPE_GEOGRAPHIC_2D_CRS;
    if ((!is_flat && type != PJ_TYPE_GEOGRAPHIC_3D_CRS) ||
        std::abs(axis(made.get(), 0).unit / kDegree - 1) > 1e-9)
      refuse_gnss(
          fmt::format("'crs' is '{}'; it must be of latitude and longitude in degrees and the "
                      "height above the ellipsoid, such as EPSG:4979",
                      printable(code)));
    return is_flat ? with_ellipsoidal_height(made.get()) : std::move(made);
  }
  OwnProj<PJ> with_ellipsoidal_height(const PJ* flat) const {
    return OwnProj<PJ>(proj().proj_crs_promote_to_3D(context_, nullptr, flat));
  }
  OwnProj<PJ> part(const PJ* compound, int index) const {
    return OwnProj<PJ>(proj().proj_crs_get_sub_crs(context_, compound, index));
  }
  int count_axes(const PJ* crs) const {
    const OwnProj<PJ> system = system_of(crs);
    return system ? std::max(0, proj().proj_cs_get_axis_count(context_, system.get())) : 0;
  }
  struct Axis {
    std::string direction;
    double unit = 0;
  };
  Axis axis(const PJ* crs, int index) const {
    const OwnProj<PJ> system = system_of(crs);
    const char* direction = nullptr;
    Axis found;
    proj().proj_cs_get_axis_info(context_, system.get(), index, nullptr, nullptr, &direction,
                                 &found.unit, nullptr, nullptr, nullptr);
    found.direction = direction != nullptr ? direction : "";
    return found;
  }
  /// A CRS without the transformation that may be bound to it.
  PJ_TYPE type_of(const PJ* crs) const {
    const OwnProj<PJ> base = base_of(crs);
    return proj().proj_get_type(base ? base.get() : crs);
  }
  bool is_bound(const PJ* crs) const { return base_of(crs) != nullptr; }
  /// To x east and y north, of longitude and latitude.
  OwnProj<PJ> normal(const OwnProj<PJ>& way) const {
    return OwnProj<PJ>(way ? proj().proj_normalize_for_visualization(context_, way.get())
                           : nullptr);
  }
  /// About where a place of a map is: longitude and latitude in degrees.
  std::optional<Vec2> about_where(const PJ* map, const Vec2& place) const {
    const OwnProj<PJ> globe(proj().proj_create(context_, "EPSG:4326"));
    const OwnProj<PJ> way = normal(OwnProj<PJ>(
        proj().proj_create_crs_to_crs_from_pj(context_, globe.get(), map, nullptr, nullptr)));
    if (!way) return {};
    const PJ_COORD at = proj().proj_trans(way.get(), PJ_INV, {{place.x(), place.y(), 0, HUGE_VAL}});
    if (!(std::abs(at.v[1]) <= 90) || !(std::abs(at.v[0]) <= 360)) return {};
    return Vec2(at.v[0], at.v[1]);
  }
  /// The best way that PROJ knows, whether or not its grids are installed.
  OwnProj<PJ> best_way(const PJ* from, const PJ* to, const std::optional<Vec2>& where) const {
    const OwnProj<PJ_OPERATION_FACTORY_CONTEXT> search(
        proj().proj_create_operation_factory_context(context_, nullptr));
    proj().proj_operation_factory_context_set_grid_availability_use(context_, search.get(),
                                                                    PROJ_GRID_AVAILABILITY_IGNORED);
    proj().proj_operation_factory_context_set_spatial_criterion(
        context_, search.get(), PROJ_SPATIAL_CRITERION_PARTIAL_INTERSECTION);
    if (where)
      proj().proj_operation_factory_context_set_area_of_interest(
          context_, search.get(), where->x() - kAround_degrees, where->y() - kAround_degrees,
          where->x() + kAround_degrees, where->y() + kAround_degrees);
    const OwnProj<PJ_OBJ_LIST> ways(
        proj().proj_create_operations(context_, from, to, search.get()));
    if (!ways || proj().proj_list_get_count(ways.get()) == 0) return nullptr;
    return OwnProj<PJ>(proj().proj_list_get(context_, ways.get(), 0));
  }
  /// A grid that a way needs and that is not installed; empty: there is none.
  /// @param way null: none
  std::string missing_grid(const PJ* way) const {
    const int count =
        way == nullptr ? 0 : proj().proj_coordoperation_get_grid_used_count(context_, way);
    for (int i = 0; i < count; ++i) {
      const char* name = nullptr;
      int available = 0;
      proj().proj_coordoperation_get_grid_used(context_, way, i, &name, nullptr, nullptr, nullptr,
                                               nullptr, nullptr, &available);
      if (available == 0) return name != nullptr && *name != '\0' ? name : "without a name";
    }
    return {};
  }
  OwnProj<PJ> geoid(const std::string& grid) const {
    // '@' and 'null' would be a geoid of 0 m.
    OwnProj<PJ> made(
        grid.find_first_of("@,\"") != grid.npos || grid == "null"
            ? nullptr
            : proj().proj_create(
                  context_, ("+proj=vgridshift +multiplier=1 +grids=\"" + grid + "\"").c_str()));
    if (!made)
      refuse_gnss(
          fmt::format("'geoid' is '{}', no grid that PROJ can read; it must be metres, a "
                      "file, or one of PROJ's, such as egm96_15.gtx",
                      printable(grid)));
    return made;
  }

 private:
  OwnProj<PJ> base_of(const PJ* crs) const {
    return OwnProj<PJ>(proj().proj_get_type(crs) == PJ_TYPE_BOUND_CRS
                           ? proj().proj_get_source_crs(context_, crs)
                           : nullptr);
  }
  /// Of a compound CRS, that of its first part.
  OwnProj<PJ> system_of(const PJ* crs) const {
    const OwnProj<PJ> first =
        proj().proj_get_type(crs) == PJ_TYPE_COMPOUND_CRS ? part(crs, 0) : nullptr;
    const PJ* const single = first ? first.get() : crs;
    const OwnProj<PJ> base = base_of(single);
    return OwnProj<PJ>(proj().proj_crs_get_coordinate_system(context_, base ? base.get() : single));
  }

  PJ_CONTEXT* context_;
};

/// The CRS of a site, and of a compound one its parts.
struct SiteCrs {
  std::string name;
  OwnProj<PJ> whole, map = nullptr, vertical = nullptr;

  const PJ* horizontal() const { return map ? map.get() : whole.get(); }
};

/// Its axes must be east, north and up, in metres.
void require_metric_axes(const ProjMaker& make, const SiteCrs& site) {
  bool good = make.type_of(site.horizontal()) == PJ_TYPE_PROJECTED_CRS;
  const auto require = [&](const PJ* crs, int index, std::string_view wrong) {
    if (!good) return;
    const ProjMaker::Axis axis = make.axis(crs, index);
    good = std::abs(axis.unit - 1) < 1e-9 && axis.direction != wrong;
  };
  for (int i = 0; i < make.count_axes(site.horizontal()); ++i)
    require(site.horizontal(), i, "west");
  if (site.vertical) require(site.vertical.get(), 0, "down");
  if (!good)
    refuse_gnss(fmt::format(
        "the site's CRS, {}, must be a map's with x east, y north and heights up in metres",
        site.name));
}

SiteCrs site_crs_of(const ProjMaker& make, const Gnss& gnss, const std::string& terrain_wkt) {
  const std::string label = printable(crs_label(terrain_wkt));
  if (terrain_wkt.empty() && gnss.site_crs.empty())
    refuse_gnss(
        "the terrain has no CRS, in which the positions would be; give 'site_crs', such as "
        "EPSG:25832+7837");
  if (!terrain_wkt.empty() && !gnss.site_crs.empty())
    refuse_gnss(fmt::format(
        "'site_crs' is for a terrain without a CRS, and this one has {}; remove it", label));
  SiteCrs site = terrain_wkt.empty()
                     ? SiteCrs{printable(gnss.site_crs), make.crs("site_crs", gnss.site_crs)}
                     : SiteCrs{label, make.crs_by_wkt(terrain_wkt)};
  if (!site.whole) refuse_gnss(fmt::format("PROJ can't read the terrain's CRS, {}", label));
  if (proj().proj_get_type(site.whole.get()) == PJ_TYPE_COMPOUND_CRS) {
    site.map = make.part(site.whole.get(), 0);
    site.vertical = make.part(site.whole.get(), 1);
  }
  require_metric_axes(make, site);
  return site;
}

/// A site's map whose heights are left as they are, so that a stated geoid counts from the
/// receiver's own ellipsoid. Null if the heights are those of the site's CRS.
OwnProj<PJ> target_crs(const ProjMaker& make, const Gnss& gnss, const SiteCrs& site) {
  const bool has_geoid = gnss.undulation_m || !gnss.geoid.empty();
  const bool above_ellipsoid = make.count_axes(site.horizontal()) == 3;
  if (has_geoid && above_ellipsoid)
    refuse_gnss(fmt::format(
        "heights in the site's CRS, {}, are above the ellipsoid; remove 'geoid'", site.name));
  if (!has_geoid && !above_ellipsoid && !site.vertical)
    refuse_gnss(fmt::format(
        "the site's CRS, {}, doesn't tell what its heights are above; give 'geoid': a grid such as "
        "egm96_15.gtx, or the geoid's height above the ellipsoid in metres, 0 if heights are above "
        "the ellipsoid",
        site.name));
  return has_geoid ? make.with_ellipsoidal_height(site.horizontal()) : nullptr;
}

}  // namespace

void DestroyProj::operator()(PJ_CONTEXT* context) const { proj().proj_context_destroy(context); }
void DestroyProj::operator()(PJ* object) const { proj().proj_destroy(object); }
void DestroyProj::operator()(PJ_OPERATION_FACTORY_CONTEXT* search) const {
  proj().proj_operation_factory_context_destroy(search);
}
void DestroyProj::operator()(PJ_OBJ_LIST* list) const { proj().proj_list_destroy(list); }

struct Geodetic::Way {
  OwnProj<PJ_CONTEXT> context;
  OwnProj<PJ> to_site = nullptr;  ///< of longitude, latitude and height
  OwnProj<PJ> geoid = nullptr;    ///< of heights, if one was stated; null: `undulation_m`
  std::optional<double> undulation_m = {};
  double year = year_now();  ///< for transformations that depend on it
  std::string doubt = {};
};

Geodetic::Geodetic(const Gnss& gnss, const std::string& site_wkt, const Eigen::AlignedBox2d& bounds)
    : way_(std::make_unique<Way>(Way{OwnProj<PJ_CONTEXT>(proj().proj_context_create())})) {
  PJ_CONTEXT* const context = way_->context.get();
  proj().proj_log_func(context, nullptr, [](void*, int, const char*) {});
  proj().proj_context_set_enable_network(context, 0);
  const ProjMaker make(context);
  const OwnProj<PJ> receiver = make.receivers_crs(gnss.crs);

  const SiteCrs site = site_crs_of(make, gnss, site_wkt);
  const OwnProj<PJ> target = target_crs(make, gnss, site);
  if (!gnss.geoid.empty()) way_->geoid = make.geoid(gnss.geoid);
  way_->undulation_m = gnss.undulation_m;

  const bool is_known = !bounds.isEmpty() && bounds.sizes().allFinite();
  const std::optional<Vec2> where =
      is_known ? make.about_where(site.horizontal(), bounds.center()) : std::nullopt;
  const OwnProj<PJ> best =
      make.best_way(receiver.get(), target ? target.get() : site.whole.get(), where);
  const std::string from_to = fmt::format("from {} to {}", printable(gnss.crs), site.name);
  if (const std::string grid = make.missing_grid(best.get()); !grid.empty())
    refuse_gnss(fmt::format(
        "PROJ lacks the grid {} for the way {}; install it, or give another 'crs' or 'geoid'",
        printable(grid), from_to));
  way_->to_site = make.normal(best);
  if (!way_->to_site || proj().proj_coordoperation_has_ballpark_transformation(context, best.get()))
    refuse_gnss(
        fmt::format("PROJ doesn't know the way {}; give another 'crs' or 'geoid'", from_to));
  const double accuracy_m = proj().proj_coordoperation_get_accuracy(context, best.get());
  if (accuracy_m > kDoubtful_m)
    way_->doubt = fmt::format(
        "the way {} is known to {} m; 'crs' should be that of the receiver's corrections", from_to,
        accuracy_m);
  else if (accuracy_m < 0 && make.is_bound(site.horizontal()))
    way_->doubt = fmt::format(
        "how well the way {} is known, PROJ can't say: the terrain's CRS has its own "
        "transformation",
        from_to);
  if (target && site.vertical)
    way_->doubt += fmt::format("{}heights are by 'geoid', not by the vertical part of {}",
                               way_->doubt.empty() ? "" : "; ", site.name);
  if (where) in_site({where->y(), where->x(), 0});  // is it within the grids?
}

Geodetic::~Geodetic() = default;
Geodetic::Geodetic(Geodetic&&) noexcept = default;
Geodetic& Geodetic::operator=(Geodetic&&) noexcept = default;

const std::string& Geodetic::doubt() const { return way_->doubt; }

Vec3 Geodetic::in_site(const GeodeticPlace& place) const {
  const auto require = [](bool holds, const char* what, double value, const char* range) {
    if (!holds) refuse_gnss(fmt::format("'{}' is {}; it must be {}", what, value, range));
  };
  const double latitude = place.latitude, longitude = place.longitude;
  require(std::abs(latitude) <= 90, "lat", latitude, "from -90 to 90 degrees");
  require(longitude >= -180 && longitude < 360, "lon", longitude, "from -180 to below 360 degrees");
  require(std::abs(place.height_m) <= kMostHeight_m, "height", place.height_m, "within 10000 m");
  const double east = longitude >= 180 ? longitude - 360 : longitude;
  const auto transformed = [&](PJ* by, double unit, double z) {
    const PJ_COORD at =
        proj().proj_trans(by, PJ_FWD, {{east * unit, latitude * unit, z, way_->year}});
    if (const Vec3 found(at.v[0], at.v[1], at.v[2]); found.allFinite()) return found;
    const char* const why =
        proj().proj_context_errno_string(way_->context.get(), proj().proj_errno(by));
    proj().proj_errno_reset(by);
    refuse_gnss(fmt::format("PROJ can't transform latitude {}, longitude {}: {}", latitude,
                            longitude, printable(why != nullptr ? why : "the result is infinite")));
  };
  Vec3 found = transformed(way_->to_site.get(), 1, place.height_m);
  if (way_->geoid) {
    const double geoid_m = transformed(way_->geoid.get(), kDegree, 0).z();
    require(std::abs(geoid_m) <= kMostUndulation_m, "geoid", geoid_m,
            "a grid of heights of a geoid, within 200 m");
    found.z() = place.height_m - geoid_m;
  } else if (way_->undulation_m) {
    found.z() = place.height_m - *way_->undulation_m;
  }
  return found;
}

}  // namespace soilvdb::inline v0::io
