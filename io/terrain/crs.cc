// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/terrain/crs.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <numbers>
#include <optional>

#include "io/file/text.h"
#include "io/terrain/gdal.h"
#include "io/terrain/raster_advice.h"
#include "soilvdb/io/error.h"

namespace soilvdb::inline v0::io {
namespace {

/// Length of a unit by its name, m; empty for unknown names.
std::optional<double> unit_metres(const std::string& unit) {
  const std::string name = lower_case(unit);
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

OwnSrs copy_of(Srs srs) { return OwnSrs(gdal().OSRClone(srs)); }

std::string text_of(Srs srs, const char* format) {
  const char* const options[] = {format, nullptr};
  char* text = nullptr;
  const bool good = gdal().OSRExportToWktEx(srs, &text, options) == OGRERR_NONE && text != nullptr;
  std::string wkt = good ? text : "";
  gdal().VSIFree(text);
  return wkt;
}

std::string name_of(Srs srs) {
  const char* const name = gdal().OSRGetName(srs);
  return printable(name != nullptr ? name : "");
}

/// Longitude and latitude of a point of `srs`, degrees.
std::optional<Vec2> longitude_latitude(Srs srs, const Vec2& p) {
  const OwnSrs from = horizontal_of(srs), to(gdal().OSRNewSpatialReference(nullptr));
  gdal().OSRImportFromEPSG(to.get(), 4326);
  gdal().OSRSetAxisMappingStrategy(to.get(), OAMS_TRADITIONAL_GIS_ORDER);
  const Transform transform(gdal().OCTNewCoordinateTransformation(from.get(), to.get()));
  double x = p.x(), y = p.y(), z = 0;
  if (!transform || !gdal().OCTTransform(transform.get(), 1, &x, &y, &z)) return std::nullopt;
  if (!(std::abs(y) <= 90) || !(std::abs(x) <= 720)) return std::nullopt;
  return Vec2(x, y);
}

// Area errors: UTM 0.002 at most in its zone, a grid for all of Norway or France 0.007, UPS 0.0121
// at its pole.
constexpr double kMostAreaOff = 0.0125;

/// Square metres on the ground per square metre of the map at a place, on the WGS 84 ellipsoid.
std::optional<double> ground_area(Srs srs, const Vec2& p) {
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

/// Refuses maps that are not true to scale, because volumes would have the error of the areas: Web
/// Mercator's is half in central Europe.
void require_true_scale(const RasterAdvice& advice, Srs srs, const Vec2& centre) {
  const std::optional<double> area = ground_area(srs, centre);
  if (!area || std::abs(*area - 1) <= kMostAreaOff) return;
  const Vec2 place = longitude_latitude(srs, centre).value();
  throw InputError(advice.file(),
                   fmt::format("has coordinates in '{}', of which 1 m is {:.4g} m on the ground "
                               "here; reproject it with: {}",
                               name_of(srs), std::sqrt(*area),
                               advice.reproject(utm_epsg(place.x(), place.y()), "")));
}

/// The unit of a raster's heights, as far as the file gives it.
struct HeightUnit {
  std::string name;
  double metres = 1;
  bool known = false;
};

HeightUnit height_unit(Srs srs, const std::string& band_unit) {
  HeightUnit unit{band_unit, unit_metres(band_unit).value_or(1), !band_unit.empty()};
  if (srs == nullptr || !gdal().OSRIsCompound(srs)) return unit;
  char* name = nullptr;  // the CRS's
  const double vertical = gdal().OSRGetTargetLinearUnits(srs, "COMPD_CS|VERT_CS", &name);
  if (!is_metre(vertical)) return {name != nullptr ? name : "an unknown unit", vertical, true};
  unit.known = true;
  return unit;
}

/// The vertical CRS; null if the CRS has none.
OwnSrs vertical_of(Srs srs) {
  if (!gdal().OSRIsCompound(srs))  // a CRS with three axes has heights above its ellipsoid
    return gdal().OSRGetAxesCount(srs) < 3 ? nullptr : copy_of(srs);
  // VERT_CS is the last part: COMPD_CS["both",PROJCS[...],VERT_CS[...],AUTHORITY[...]]
  const std::string wkt = text_of(srs, "FORMAT=WKT1_GDAL");
  const std::size_t begin = wkt.find(",VERT_CS[");
  if (begin == wkt.npos) return nullptr;
  std::size_t end = begin + 1;
  bool quoted = false;
  for (int open = 0; end < wkt.size(); ++end) {
    if (wkt[end] == '"') quoted = !quoted;
    if (quoted) continue;
    if (wkt[end] == '[') ++open;
    if (wkt[end] == ']' && --open == 0) break;
  }
  return srs_of(wkt.substr(begin + 1, end - begin));
}

bool same(Srs a, Srs b) {
  const char* const options[] = {"CRITERION=EQUIVALENT_EXCEPT_AXIS_ORDER_GEOGCRS",
                                 "IGNORE_DATA_AXIS_TO_SRS_AXIS_MAPPING=YES", nullptr};
  return gdal().OSRIsSameEx(a, b, options) != 0;
}

std::string authority_of(Srs srs) {
  const char* authority = gdal().OSRGetAuthorityName(srs, nullptr);
  const char* code = gdal().OSRGetAuthorityCode(srs, nullptr);
  return authority != nullptr && code != nullptr ? std::string(authority) + ":" + code : "";
}

std::string label_of(Srs srs) {
  const std::string code = authority_of(srs);
  return code.empty() ? name_of(srs) : code;
}

/// @param part of the CRS to name
std::string label_of(const std::string& wkt, OwnSrs (*part)(Srs)) {
  if (wkt.empty()) return {};
  const GdalMessages messages;
  const OwnSrs srs = srs_of(wkt);
  return srs ? label_of(part(srs.get()).get()) : "";
}

/// A CRS as an argument of GDAL's programs.
std::string argument_of(Srs srs) {
  const std::string code = authority_of(srs);
  return code.empty() ? shell_quoted(text_of(srs, "FORMAT=WKT1_GDAL")) : code;
}

/// The fault of coordinates that are not metres, and their unit in a map's CRS.
struct Coordinates {
  std::string wrong, unit;
};

Coordinates coordinates_of(Srs srs) {
  if (gdal().OSRIsGeographic(srs) || gdal().OSRIsDerivedGeographic(srs))
    return {"is in degrees, not metres", ""};
  if (gdal().OSRIsGeocentric(srs)) return {"is in geocentric coordinates, not in a map's", ""};
  char* name = nullptr;  // the CRS's
  if (is_metre(gdal().OSRGetLinearUnits(srs, &name))) return {};
  const std::string unit = printable(name != nullptr ? name : "an unknown unit");
  return {fmt::format("has coordinates in '{}', not metres", unit), unit};
}

/// A reprojection to a CRS in metres: the command, and the words before it.
struct Reprojection {
  std::string how, command;
  bool whole = true;  ///< the UTM zone is known
};

Reprojection reprojection(const RasterAdvice& of, Srs srs, const Vec2& centre) {
  if (const auto place = longitude_latitude(srs, centre))
    return {"with", of.reproject(utm_epsg(place->x(), place->y()), "")};
  return {"to a CRS in metres, as with",
          of.warp("-t_srs EPSG:<the site's UTM zone> -novshift", "_utm"), false};
}

}  // namespace

std::string crs_label(const std::string& wkt) { return label_of(wkt, copy_of); }
std::string map_label(const std::string& wkt) { return label_of(wkt, horizontal_of); }

std::string wkt_of(Srs srs) { return text_of(srs, "FORMAT=WKT2_2019"); }

int utm_epsg(double longitude, double latitude) {
  if (latitude > 84) return 32661;
  if (latitude < -80) return 32761;
  const double turned = longitude + 180 - 360 * std::floor((longitude + 180) / 360);
  const int zone = std::min(60, 1 + static_cast<int>(turned / 6));
  return (latitude < 0 ? 32700 : 32600) + zone;
}

std::vector<std::string> require_metre_heights(const RasterAdvice& advice, Srs srs,
                                               const Vec2& centre,
                                               const std::string& vertical_unit) {
  const HeightUnit unit = height_unit(srs, vertical_unit);
  if (!is_metre(unit.metres)) {
    // The result would otherwise keep a vertical CRS, with a unit that is wrong by then.
    std::string command = advice.to_metres(unit.metres, srs != nullptr && gdal().OSRIsCompound(srs)
                                                            ? argument_of(horizontal_of(srs).get())
                                                            : "");
    // Both faults in one message, because the converted file does not have the heights' unit any
    // more.
    if (srs != nullptr && !coordinates_of(srs).wrong.empty() && !gdal().OSRIsGeocentric(srs)) {
      const Reprojection more = reprojection(advice.in_metres(), srs, centre);
      if (more.whole) command += " && " + more.command;
    }
    throw InputError(advice.file(),
                     fmt::format("heights are in '{}', not metres; convert them with: {}",
                                 printable(unit.name), command));
  }
  if (vertical_unit.empty() || unit_metres(vertical_unit)) return {};
  return {fmt::format("{}: heights are in '{}', a unit that is not known; they are taken as metres",
                      advice.file().string(), printable(vertical_unit))};
}

std::string metre_crs(const std::filesystem::path& file, const std::string& epsg,
                      const std::string& wkt, double unit_m, const std::string& unit,
                      const Vec2& centre_m) {
  OwnSrs srs(gdal().OSRNewSpatialReference(nullptr));
  std::string code = epsg.substr(epsg.find(':') + 1);  // all without a colon
  std::erase_if(code, [](unsigned char c) { return std::isspace(c); });
  const bool is_code = code.find_first_not_of("0123456789+") == code.npos;  // compound: a plus
  if (!is_code || gdal().OSRSetFromUserInput(srs.get(), ("EPSG:" + code).c_str()) != OGRERR_NONE)
    srs = srs_of(wkt);
  if (!srs || wkt_of(srs.get()).empty()) return "";
  const std::string label = label_of(srs.get());
  if (!gdal().OSRIsProjected(srs.get()))
    throw InputError(file, fmt::format("has coordinates in {}, which is no map's CRS; export the "
                                       "surface in a projected CRS, such as EPSG:32632",
                                       label));
  char* name = nullptr;  // the CRS's
  const double length_m = gdal().OSRGetLinearUnits(srs.get(), &name);
  if (std::abs(length_m - unit_m) > 1e-9 * unit_m)
    throw InputError(file, fmt::format("has coordinates in '{}', but the unit of its CRS {} is "
                                       "'{}'; export the surface in that unit",
                                       printable(unit.empty() ? "meter" : unit), label,
                                       printable(name != nullptr ? name : "")));
  if (gdal().OSRIsCompound(srs.get()) &&
      !is_metre(gdal().OSRGetTargetLinearUnits(srs.get(), "COMPD_CS|VERT_CS", nullptr)))
    gdal().OSRStripVertical(srs.get());
  if (!is_metre(length_m)) {
    // Its name would still tell of feet.
    const OwnSrs plan = horizontal_of(srs.get()), heights = vertical_of(srs.get());
    const std::string plan_name = name_of(plan.get()) + ", in metres";
    gdal().OSRSetLinearUnitsAndUpdateParameters(plan.get(), "metre", 1);
    gdal().OSRSetProjCS(plan.get(), plan_name.c_str());
    srs = copy_of(plan.get());
    if (heights)
      gdal().OSRSetCompoundCS(srs.get(), (plan_name + " + " + name_of(heights.get())).c_str(),
                              plan.get(), heights.get());
  }
  const std::optional<double> area = ground_area(srs.get(), centre_m);
  if (area && std::abs(*area - 1) > kMostAreaOff)
    throw InputError(file, fmt::format("has coordinates in {}, of which 1 m is {:.4g} m on the "
                                       "ground here; export the surface in a CRS true to scale, "
                                       "such as that of its UTM zone",
                                       label, std::sqrt(*area)));
  return wkt_of(srs.get());
}

bool names_height_unit(Srs srs, const std::string& vertical_unit) {
  return height_unit(srs, vertical_unit).known;
}

void require_metres(const RasterAdvice& advice, Srs srs, const Vec2& centre,
                    const std::string& vertical_unit) {
  const auto [wrong, unit] = coordinates_of(srs);
  if (wrong.empty()) return require_true_scale(advice, srs, centre);
  const auto [how, command, whole] = reprojection(advice, srs, centre);
  if (unit.empty() || names_height_unit(srs, vertical_unit))
    throw InputError(advice.file(), fmt::format("{}; reproject it {}: {}", wrong, how, command));
  throw InputError(advice.file(),
                   fmt::format("{}, and doesn't give the unit of its heights; if they are in "
                               "metres, reproject it {}: {} ; if they are in '{}', too: {} && {}",
                               wrong, how, command, unit,
                               advice.to_metres(gdal().OSRGetLinearUnits(srs, nullptr), ""),
                               reprojection(advice.in_metres(), srs, centre).command));
}

namespace {

struct CrsDifference {
  std::string text = {};  ///< empty: there is none
  bool certain = false;
};

/// Of x and y, and of heights.
std::array<CrsDifference, 2> compare_crs(const std::string& a_name, const std::string& a_wkt,
                                         const std::string& b_name, const std::string& b_wkt) {
  const GdalMessages messages;
  const OwnSrs whole_a = srs_of(a_wkt), whole_b = srs_of(b_wkt);
  const auto compare = [&](const char* what, OwnSrs (*of)(Srs)) -> CrsDifference {
    const OwnSrs a = whole_a ? of(whole_a.get()) : nullptr,
                 b = whole_b ? of(whole_b.get()) : nullptr;
    if (a && b) {
      if (same(a.get(), b.get())) return {};
      return {fmt::format("{} of {} are in {}, and those of {} in {}; volumes between the two are "
                          "wrong",
                          what, a_name, label_of(a.get()), b_name, label_of(b.get())),
              true};
    }
    if (!a && !b) return {};
    return {fmt::format("{} of {} are in {}, and {} names none; the same is assumed", what,
                        a ? a_name : b_name, label_of((a ? a : b).get()), a ? b_name : a_name)};
  };
  return {compare("coordinates", horizontal_of), compare("heights", vertical_of)};
}

}  // namespace

std::vector<std::string> crs_differences(const std::string& a_name, const std::string& a_wkt,
                                         const std::string& b_name, const std::string& b_wkt) {
  std::vector<std::string> all;
  for (CrsDifference& one : compare_crs(a_name, a_wkt, b_name, b_wkt))
    if (!one.text.empty()) all.push_back(std::move(one.text));
  return all;
}

CrsConflicts crs_conflicts(const std::string& a_name, const std::string& a_wkt,
                           const std::string& b_name, const std::string& b_wkt) {
  const auto [place, heights] = compare_crs(a_name, a_wkt, b_name, b_wkt);
  return {place.certain ? place.text : "", heights.certain ? heights.text : ""};
}

}  // namespace soilvdb::inline v0::io
