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
#include "soilvdb/io/error.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr int kWarpNodata = -9999;  // taken for no height in any raster

/// DIR/NAME_SUFFIX.tif beside the file.
std::filesystem::path beside(const std::filesystem::path& file, const std::string& suffix) {
  std::filesystem::path out = file;
  return out.replace_filename(file.stem().string() + suffix + ".tif");
}

/// Length of a unit by its name, m; nothing for names that mean nothing to us, which is taken as m.
std::optional<double> unit_metres(std::string name) {
  std::transform(name.begin(), name.end(), name.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  if (name.find("foot") != std::string::npos || name.find("feet") != std::string::npos ||
      name.starts_with("ft") || name == "us-ft" || name == "usft") {
    const bool survey = name.find("us") != std::string::npos;
    return survey ? 1200.0 / 3937.0 : 0.3048;
  }
  if (name == "cm" || name.starts_with("centimet")) return 0.01;
  if (name == "mm" || name.starts_with("millimet")) return 0.001;
  if (name == "km" || name.starts_with("kilomet")) return 1000;
  if (name == "dm" || name.starts_with("decimet")) return 0.1;
  if (name == "yd" || name.starts_with("yard")) return 0.9144;
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
void require_true_scale(const std::filesystem::path& file, const OGRSpatialReference& srs,
                        const Vec2& centre) {
  const std::optional<double> area = ground_area(srs, centre);
  if (!area || std::abs(*area - 1) <= kMostAreaOff) return;
  const Vec2 place = longitude_latitude(srs, centre).value();
  const char* name = srs.GetName();
  throw InputError(
      file, fmt::format("has coordinates in '{}', of which 1 m is {:.4g} m on the ground here; "
                        "reproject it with: {}",
                        printable(name != nullptr ? name : ""), std::sqrt(*area),
                        reproject_command(file, utm_epsg(place.x(), place.y()), "")));
}

/// The command that takes heights from a unit to metres.
std::string heights_command(const std::filesystem::path& file, double metres) {
  return fmt::format("gdal_calc.py --calc=A*{} -A {} --outfile={}", metres, shell_quoted(file),
                     shell_quoted(beside(file, "_m")));
}

/// What a raster's heights are in, as far as it says so.
struct HeightUnit {
  std::string name;
  double metres = 1;
  bool known = false;
};

[[noreturn]] void refuse_heights(const std::filesystem::path& file, const HeightUnit& unit,
                                 const std::string& horizontal) {
  std::string command = heights_command(file, unit.metres);
  // gdal_calc copies the vertical CRS, and with it the unit that is no longer right.
  if (!horizontal.empty()) {
    command +=
        fmt::format(" && gdal_edit.py -a_srs {} {}", horizontal, shell_quoted(beside(file, "_m")));
  }
  throw InputError(file, fmt::format("heights are in '{}', not metres; convert them with: {}",
                                     printable(unit.name), command));
}

HeightUnit height_unit(const OGRSpatialReference& srs, const std::string& band_unit) {
  HeightUnit unit{band_unit, unit_metres(band_unit).value_or(1), !band_unit.empty()};
  if (!srs.IsCompound()) return unit;
  const char* name = nullptr;
  const double vertical = srs.GetTargetLinearUnits("COMPD_CS|VERT_CS", &name);
  if (!is_metre(vertical)) return {name != nullptr ? name : "an unknown unit", vertical, true};
  unit.known = true;
  return unit;
}

/// gdalwarp -novshift moves heights but doesn't convert them, and what it makes doesn't name their
/// unit.
/// @param length of the unit of the coordinates, m
std::string after_warp(const std::filesystem::path& file, const HeightUnit& unit, double length) {
  const std::string command =
      heights_command(beside(file, "_utm"), unit.known ? unit.metres : length);
  if (!is_metre(unit.metres)) {
    return fmt::format(" && {} (its heights are in '{}', which gdalwarp leaves as they are)",
                       command, printable(unit.name));
  }
  if (unit.known || is_metre(length)) return "";
  return fmt::format(
      "; that leaves heights as they are; if they are in the same unit, convert "
      "them, too, with: {}",
      command);
}

}  // namespace

std::string crs_label(const std::string& wkt) {
  const GdalMessages messages;
  OGRSpatialReference srs;
  if (wkt.empty() || srs.importFromWkt(wkt.c_str()) != OGRERR_NONE) return {};
  const char* authority = srs.GetAuthorityName(nullptr);
  const char* code = srs.GetAuthorityCode(nullptr);
  if (authority != nullptr && code != nullptr) return std::string(authority) + ":" + code;
  const char* name = srs.GetName();
  return name != nullptr ? name : "";
}

int utm_epsg(double longitude, double latitude) {
  if (latitude > 84) return 32661;
  if (latitude < -80) return 32761;
  const double turned = longitude + 180 - 360 * std::floor((longitude + 180) / 360);
  const int zone = std::min(60, 1 + static_cast<int>(turned / 6));
  return (latitude < 0 ? 32700 : 32600) + zone;
}

std::string warp_command(const std::filesystem::path& file, const std::string& options,
                         const std::string& suffix) {
  // Where the source names no NODATA, gdalwarp would fill what lies outside of it with ground at 0.
  return fmt::format("gdalwarp {}{}-r bilinear -ot Float32 -dstnodata {} {} {}", options,
                     options.empty() ? "" : " ", kWarpNodata, shell_quoted(file),
                     shell_quoted(beside(file, suffix)));
}

std::string reproject_command(const std::filesystem::path& file, int epsg,
                              const std::string& source) {
  return warp_command(file,
                      fmt::format("{}-t_srs EPSG:{} -novshift",
                                  source.empty() ? "" : "-s_srs " + source + " ", epsg),
                      "_utm");
}

void require_metres(const std::filesystem::path& file, const OGRSpatialReference& srs,
                    const Vec2& centre, const std::string& vertical_unit) {
  const HeightUnit unit = height_unit(srs, vertical_unit);
  double length = 1;
  std::string wrong;
  if (srs.IsGeographic() || srs.IsDerivedGeographic()) {
    wrong = "is in degrees, not metres";
  } else if (srs.IsGeocentric()) {
    wrong = "is in geocentric coordinates, not in a map's";
  } else {
    const char* name = nullptr;
    length = srs.GetLinearUnits(&name);
    if (!is_metre(length)) {
      wrong = fmt::format("has coordinates in '{}', not metres",
                          printable(name != nullptr ? name : "an unknown unit"));
    }
  }
  if (!wrong.empty()) {
    const auto place = longitude_latitude(srs, centre);
    throw InputError(
        file,
        fmt::format(
            "{}; reproject it {}: {}{}", wrong, place ? "with" : "to a CRS in metres, as with",
            place ? reproject_command(file, utm_epsg(place->x(), place->y()), "")
                  : warp_command(file, "-t_srs EPSG:<the site's UTM zone> -novshift", "_utm"),
            after_warp(file, unit, length)));
  }
  require_true_scale(file, srs, centre);
  if (is_metre(unit.metres)) return;
  std::string horizontal;
  if (srs.IsCompound()) {
    const char* authority = srs.GetAuthorityName("COMPD_CS|PROJCS");
    const char* code = srs.GetAuthorityCode("COMPD_CS|PROJCS");
    horizontal = authority != nullptr && code != nullptr ? std::string(authority) + ":" + code
                                                         : "EPSG:<its horizontal CRS>";
  }
  refuse_heights(file, unit, horizontal);
}

void require_metres(const std::filesystem::path& file, const std::string& vertical_unit) {
  const double length = unit_metres(vertical_unit).value_or(1);
  if (!is_metre(length)) refuse_heights(file, {vertical_unit, length, true}, "");
}

}  // namespace soilvdb::inline v0::io
