// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/terrain/crs.h"

#include <fmt/format.h>
#include <ogr_spatialref.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <memory>
#include <numbers>
#include <optional>

#include "io/file/text.h"
#include "io/terrain/gdal.h"
#include "io/terrain/raster_advice.h"
#include "soilvdb/io/error.h"

namespace soilvdb::inline v0::io {
namespace {

/// Length of a unit by its name, m; nothing for names that mean nothing to us.
std::optional<double> unit_metres(std::string name) {
  std::transform(name.begin(), name.end(), name.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  if (name.find("foot") != std::string::npos || name.find("feet") != std::string::npos ||
      name.starts_with("ft") || name == "us-ft" || name == "usft") {
    const bool survey =
        name.find("us") != std::string::npos || name.find("survey") != std::string::npos;
    return survey ? 1200.0 / 3937.0 : 0.3048;
  }
  if (name == "cm" || name.starts_with("centimet")) return 0.01;
  if (name == "mm" || name.starts_with("millimet")) return 0.001;
  if (name == "km" || name.starts_with("kilomet")) return 1000;
  if (name == "dm" || name.starts_with("decimet")) return 0.1;
  if (name == "yd" || name.starts_with("yard")) return 0.9144;
  if (name == "m" || name.starts_with("metre") || name.starts_with("meter")) return 1;
  return std::nullopt;
}

bool is_metre(double length) { return std::abs(length - 1) < 1e-9; }

/// Where a point of `srs` is, in degrees.
std::optional<Vec2> longitude_latitude(const OGRSpatialReference& srs, const Vec2& p) {
  OGRSpatialReference from(srs), to;
  from.StripVertical();
  to.importFromEPSG(4326);
  from.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  to.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  const std::unique_ptr<OGRCoordinateTransformation> transform(
      OGRCreateCoordinateTransformation(&from, &to));
  double x = p.x(), y = p.y();
  if (!transform || !transform->Transform(1, &x, &y)) return std::nullopt;
  if (!(std::abs(y) <= 90) || !(std::abs(x) <= 720)) return std::nullopt;
  return Vec2(x, y);
}

// UTM is off by 0.002 at most in its zone, a grid for the whole of Norway or France by 0.007, UPS
// by 0.0121 at its pole.
constexpr double kMostAreaOff = 0.0125;

/// How many square metres on the ground one of the map is at a place, by WGS 84's ellipsoid.
std::optional<double> ground_area(const OGRSpatialReference& srs, const Vec2& p) {
  constexpr double kAxis_m = 6378137, kEccentricity2 = 0.00669437999014, kStep = 100;
  std::array<Vec3, 3> earth;
  for (std::size_t i = 0; i < 3; ++i) {
    const auto place = longitude_latitude(srs, p + kStep * Vec2(i == 1, i == 2));
    if (!place) return std::nullopt;
    const Vec2 angle = *place * (std::numbers::pi / 180);
    const double sine = std::sin(angle.y());
    const double normal_m = kAxis_m / std::sqrt(1 - kEccentricity2 * sine * sine);
    earth[i] =
        normal_m * Vec3(std::cos(angle.y()) * std::cos(angle.x()),
                        std::cos(angle.y()) * std::sin(angle.x()), (1 - kEccentricity2) * sine);
  }
  return (earth[1] - earth[0]).cross(earth[2] - earth[0]).norm() / (kStep * kStep);
}

/// Refuses maps whose metres aren't: volumes would be off as their areas are, Web Mercator's by
/// half in the middle of Europe.
void require_true_scale(const RasterAdvice& advice, const OGRSpatialReference& srs,
                        const Vec2& centre) {
  const std::optional<double> area = ground_area(srs, centre);
  if (!area || std::abs(*area - 1) <= kMostAreaOff) return;
  const Vec2 place = longitude_latitude(srs, centre).value();
  const char* name = srs.GetName();
  throw InputError(advice.file(),
                   fmt::format("has coordinates in '{}', of which 1 m is {:.4g} m on the ground "
                               "here; reproject it with: {}",
                               printable(name != nullptr ? name : ""), std::sqrt(*area),
                               advice.reproject(utm_epsg(place.x(), place.y()), "")));
}

/// What a raster's heights are in, as far as it says so.
struct HeightUnit {
  std::string name;
  double metres = 1;
  bool known = false;
};

HeightUnit height_unit(const OGRSpatialReference* srs, const std::string& band_unit) {
  HeightUnit unit{band_unit, unit_metres(band_unit).value_or(1), !band_unit.empty()};
  if (srs == nullptr || !srs->IsCompound()) return unit;
  const char* name = nullptr;
  const double vertical = srs->GetTargetLinearUnits("COMPD_CS|VERT_CS", &name);
  if (!is_metre(vertical)) return {name != nullptr ? name : "an unknown unit", vertical, true};
  unit.known = true;
  return unit;
}

OGRSpatialReference horizontal_of(const OGRSpatialReference& srs) {
  OGRSpatialReference horizontal(srs);
  horizontal.StripVertical();
  if (horizontal.GetAxesCount() == 3) horizontal.DemoteTo2D(nullptr);
  return horizontal;
}

/// What heights are above; nothing where the CRS doesn't say.
std::optional<OGRSpatialReference> vertical_of(const OGRSpatialReference& srs) {
  if (!srs.IsCompound()) {
    if (srs.GetAxesCount() < 3) return std::nullopt;
    return srs;  // above its ellipsoid
  }
  char* wkt = nullptr;
  const OGR_SRSNode* node = srs.GetAttrNode("COMPD_CS|VERT_CS");
  OGRSpatialReference vertical;
  const bool read = node != nullptr && node->exportToWkt(&wkt) == OGRERR_NONE &&
                    vertical.importFromWkt(wkt) == OGRERR_NONE;
  CPLFree(wkt);
  return read ? std::optional(vertical) : std::nullopt;
}

bool same(const OGRSpatialReference& a, const OGRSpatialReference& b) {
  const char* const options[] = {"CRITERION=EQUIVALENT_EXCEPT_AXIS_ORDER_GEOGCRS",
                                 "IGNORE_DATA_AXIS_TO_SRS_AXIS_MAPPING=YES", nullptr};
  return a.IsSame(&b, options) != 0;
}

std::string authority_of(const OGRSpatialReference& srs, const char* part = nullptr) {
  const char* authority = srs.GetAuthorityName(part);
  const char* code = srs.GetAuthorityCode(part);
  return authority != nullptr && code != nullptr ? std::string(authority) + ":" + code : "";
}

std::string label_of(const OGRSpatialReference& srs) {
  if (std::string code = authority_of(srs); !code.empty()) return code;
  const char* name = srs.GetName();
  return printable(name != nullptr ? name : "");
}

/// A CRS as programs of GDAL take it.
std::string argument_of(const OGRSpatialReference& srs) {
  if (std::string code = authority_of(srs); !code.empty()) return code;
  char* wkt = nullptr;
  srs.exportToWkt(&wkt);
  const std::string argument = shell_quoted(wkt != nullptr ? wkt : "");
  CPLFree(wkt);
  return argument;
}

}  // namespace

std::string crs_label(const std::string& wkt) {
  const GdalMessages messages;
  OGRSpatialReference srs;
  if (wkt.empty() || srs.importFromWkt(wkt.c_str()) != OGRERR_NONE) return {};
  return label_of(srs);
}

int utm_epsg(double longitude, double latitude) {
  if (latitude > 84) return 32661;
  if (latitude < -80) return 32761;
  const double turned = longitude + 180 - 360 * std::floor((longitude + 180) / 360);
  const int zone = std::min(60, 1 + static_cast<int>(turned / 6));
  return (latitude < 0 ? 32700 : 32600) + zone;
}

std::vector<std::string> require_metre_heights(const RasterAdvice& advice,
                                               const OGRSpatialReference* srs,
                                               const std::string& vertical_unit) {
  const HeightUnit unit = height_unit(srs, vertical_unit);
  if (!is_metre(unit.metres)) {
    // What is made would keep a vertical CRS, and with it the unit that is no longer right.
    throw InputError(
        advice.file(),
        fmt::format("heights are in '{}', not metres; convert them with: {}", printable(unit.name),
                    advice.to_metres(unit.metres, srs != nullptr && srs->IsCompound()
                                                      ? argument_of(horizontal_of(*srs))
                                                      : "")));
  }
  if (vertical_unit.empty() || unit_metres(vertical_unit)) return {};
  return {fmt::format("{}: heights are in '{}', a unit that is not known; they are taken as metres",
                      advice.file().string(), printable(vertical_unit))};
}

bool names_height_unit(const OGRSpatialReference* srs, const std::string& vertical_unit) {
  return height_unit(srs, vertical_unit).known;
}

void require_metres(const RasterAdvice& advice, const OGRSpatialReference& srs, const Vec2& centre,
                    const std::string& vertical_unit) {
  std::string wrong, unit;
  if (srs.IsGeographic() || srs.IsDerivedGeographic()) {
    wrong = "is in degrees, not metres";
  } else if (srs.IsGeocentric()) {
    wrong = "is in geocentric coordinates, not in a map's";
  } else {
    const char* name = nullptr;
    if (!is_metre(srs.GetLinearUnits(&name))) {
      unit = printable(name != nullptr ? name : "an unknown unit");
      wrong = fmt::format("has coordinates in '{}', not metres", unit);
    }
  }
  if (wrong.empty()) return require_true_scale(advice, srs, centre);
  const auto place = longitude_latitude(srs, centre);
  const auto reproject = [&](const RasterAdvice& of) {
    return place ? of.reproject(utm_epsg(place->x(), place->y()), "")
                 : of.warp("-t_srs EPSG:<the site's UTM zone> -novshift", "_utm");
  };
  const std::string how = place ? "with" : "to a CRS in metres, as with";
  if (unit.empty() || names_height_unit(&srs, vertical_unit))
    throw InputError(advice.file(),
                     fmt::format("{}; reproject it {}: {}", wrong, how, reproject(advice)));
  throw InputError(
      advice.file(),
      fmt::format("{}, and doesn't say what its heights are in; if they are in metres, reproject "
                  "it {}: {} ; if they are in '{}', too: {} && {}",
                  wrong, how, reproject(advice), unit, advice.to_metres(srs.GetLinearUnits(), ""),
                  reproject(advice.in_metres())));
}

std::vector<std::string> crs_differences(const std::string& a_name, const std::string& a_wkt,
                                         const std::string& b_name, const std::string& b_wkt) {
  const GdalMessages messages;
  std::vector<std::string> all;
  const auto compare = [&](const char* what, const std::optional<OGRSpatialReference>& a,
                           const std::optional<OGRSpatialReference>& b) {
    if (a && b) {
      if (!same(*a, *b))
        all.push_back(fmt::format(
            "{} of {} are in {}, and those of {} in {}; volumes between the two are wrong", what,
            a_name, label_of(*a), b_name, label_of(*b)));
    } else if (a || b) {
      all.push_back(
          fmt::format("{} of {} are in {}, and {} doesn't say what its are in; they are taken to "
                      "be in the same",
                      what, a ? a_name : b_name, label_of(a ? *a : *b), a ? b_name : a_name));
    }
  };
  const auto read = [](const std::string& wkt) {
    OGRSpatialReference srs;
    const bool known = !wkt.empty() && srs.importFromWkt(wkt.c_str()) == OGRERR_NONE;
    return known ? std::optional(srs) : std::nullopt;
  };
  const auto a = read(a_wkt), b = read(b_wkt);
  using Srs = std::optional<OGRSpatialReference>;
  compare("coordinates", a ? Srs(horizontal_of(*a)) : Srs(), b ? Srs(horizontal_of(*b)) : Srs());
  compare("heights", a ? vertical_of(*a) : Srs(), b ? vertical_of(*b) : Srs());
  return all;
}

}  // namespace soilvdb::inline v0::io
