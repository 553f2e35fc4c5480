// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/terrain/design_lines.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <utility>

#include "io/file/text.h"
#include "io/terrain/alignments.h"
#include "io/terrain/crs.h"
#include "io/terrain/gdal.h"
#include "io/terrain/tin.h"

namespace soilvdb::inline v0::io {
namespace {

struct EndGeometry {
  void operator()(void* geometry) const { gdal().OGR_G_DestroyGeometry(geometry); }
};

class LineReader {
 public:
  LineReader(const std::filesystem::path& file, const std::string& site_wkt)
      : file_(file), site_(srs_of(site_wkt)) {}

  DesignLines read() {
    check_readable(file_);
    GdalMessages messages;
    if (const std::string suffix = suffix_of(file_); suffix == ".xml" || suffix == ".landxml")
      return read_landxml_lines();
    const std::string path = std::filesystem::absolute(file_).string();
    const char* const drivers[] = {"DXF", "GPKG", "GeoJSON", "ESRI Shapefile", nullptr};
    const GdalDataset dataset(
        gdal().GDALOpenEx(path.c_str(), GDAL_OF_VECTOR | GDAL_OF_READONLY | GDAL_OF_VERBOSE_ERROR,
                          drivers, nullptr, nullptr));
    if (!dataset)
      throw InputError(file_, fmt::format("is not a readable LandXML, DXF, GeoPackage, GeoJSON or "
                                          "Shapefile of lines ({})",
                                          messages.error_or("GDAL can't open it")));
    is_dxf_ = driver_of(dataset) == "DXF";
    if (is_dxf_) {
      TinInput units = dxf_units(file_);
      unit_m_ = units.unit_m;
      for (const std::string& doubt : units.doubts)
        all_.warnings.push_back(file_.string() + ": " + doubt);
    }
    for (int i = 0; i < gdal().GDALDatasetGetLayerCount(dataset.get()); ++i)
      read_layer(gdal().GDALDatasetGetLayer(dataset.get(), i));
    if (!messages.error().empty())
      throw InputError(file_, fmt::format("is damaged ({})", messages.error()));
    if (all_.lines.empty()) throw InputError(file_, "has no lines");
    return std::move(all_);
  }

 private:
  DesignLines read_landxml_lines() {
    Alignments from = read_alignments(file_);
    if (!from.epsg.empty() || !from.wkt.empty()) {
      const Vec2 first_m = from.lines.empty() ? Vec2(0, 0) : Vec2(from.lines[0][0].head<2>());
      const OwnSrs srs =
          srs_of(metre_crs(file_, from.epsg, from.wkt, from.unit_m, from.unit, first_m));
      if (!srs)
        from.doubts.push_back(fmt::format("its CRS '{}' is not known",
                                          printable(from.epsg.empty() ? from.wkt : from.epsg)));
      set_way(srs.get());
    }
    for (const std::string& doubt : from.doubts)
      all_.warnings.push_back(file_.string() + ": " + doubt);
    for (std::vector<Vec3>& line : from.lines) {
      for (Vec3& p : line) place(p);
      all_.lines.push_back(std::move(line));
    }
    if (all_.lines.empty()) throw InputError(file_, "has no lines");
    return std::move(all_);
  }

  std::string ogr2ogr(const std::string& options) const {
    return fmt::format("ogr2ogr {} {} {}", options,
                       shell_quoted(file_.stem().string() + "_new.gpkg"), shell_quoted(file_));
  }

  void read_layer(OGRLayerH layer) {
    way_.reset();
    set_way(gdal().OGR_L_GetSpatialRef(layer));
    while (const Feature feature{gdal().OGR_L_GetNextFeature(layer)})
      if (const OGRGeometryH geometry = gdal().OGR_F_GetGeometryRef(feature.get())) {
        const std::unique_ptr<void, EndGeometry> straight{
            // arcs as chords
            gdal().OGR_G_GetLinearGeometry(geometry, 0, nullptr)};
        add(straight.get(), 0);
      }
  }

  /// Prepares the way from a layer's CRS to the site's.
  void set_way(Srs srs) {
    if (srs == nullptr) return;  // as of DXF: in the site's coordinates
    const OwnSrs from = horizontal_of(srs);
    const std::string label = crs_label(wkt_of(from.get()));
    if (site_) {
      const OwnSrs to = horizontal_of(site_.get());
      way_.reset(gdal().OCTNewCoordinateTransformation(from.get(), to.get()));
      if (!way_)
        throw InputError(file_,
                         fmt::format("has coordinates in {}, from which PROJ knows no way to "
                                     "those of the terrain",
                                     label));
      return;
    }
    if (!gdal().OSRIsProjected(from.get()) ||
        std::abs(gdal().OSRGetLinearUnits(from.get(), nullptr) - 1) > 1e-9)
      throw InputError(file_,
                       fmt::format("has coordinates in {}, and the terrain has no CRS to "
                                   "bring them to; reproject it with: {}",
                                   label, ogr2ogr("-t_srs EPSG:<of the terrain's coordinates>")));
    all_.warnings.push_back(
        fmt::format("{}: has coordinates in {}, and the terrain names no CRS; the same is assumed",
                    file_.string(), label));
  }

  void add(OGRGeometryH geometry, int depth) {
    constexpr int kMostNested = 10;
    const OGRwkbGeometryType type = gdal().OGR_GT_Flatten(gdal().OGR_G_GetGeometryType(geometry));
    if (type == wkbLineString || type == wkbLinearRing) return add_line(geometry);
    if (depth == kMostNested) return;
    const int parts = type == wkbPoint ? 0 : gdal().OGR_G_GetGeometryCount(geometry);
    for (int i = 0; i < parts; ++i) add(gdal().OGR_G_GetGeometryRef(geometry, i), depth + 1);
  }

  /// Brings a point into the site.
  void place(Vec3& p) const {
    double none = 0;
    if (way_ && !gdal().OCTTransform(way_.get(), 1, &p.x(), &p.y(), &none))
      throw InputError(file_, "has a point that can't be brought into the terrain's CRS");
    p *= unit_m_;
    if (!(p.head<2>().cwiseAbs().maxCoeff() <= kMaxNumber) || std::abs(p.z()) > kMaxNumber)
      throw InputError(file_, "has a point that is not a number or beyond 1e9 m");
  }

  void add_line(OGRGeometryH geometry) {
    const int count = gdal().OGR_G_GetPointCount(geometry);
    if (count < 2) return;
    points_ += static_cast<std::size_t>(count);
    if (points_ > kMostLinePoints)
      throw InputError(file_, fmt::format("has more than {} points; simplify it with: {}",
                                          kMostLinePoints, ogr2ogr("-simplify 0.05")));
    const bool has_heights = gdal().OGR_G_Is3D(geometry) != 0;
    std::vector<Vec3> line;
    bool level_0 = true;
    for (int i = 0; i < count; ++i) {
      Vec3 p;
      gdal().OGR_G_GetPoint(geometry, i, &p.x(), &p.y(), &p.z());
      place(p);
      level_0 = level_0 && p.z() == 0;
      line.push_back(p);
    }
    // Every line of a DXF has heights; those of a plan are 0.
    if (!has_heights || (is_dxf_ && level_0))
      for (Vec3& p : line) p.z() = std::numeric_limits<double>::quiet_NaN();
    all_.lines.push_back(std::move(line));
  }

  const std::filesystem::path& file_;
  OwnSrs site_;
  Transform way_;  ///< null: none is needed
  bool is_dxf_ = false;
  double unit_m_ = 1;
  std::size_t points_ = 0;
  DesignLines all_;
};

}  // namespace

DesignLines read_lines(const std::filesystem::path& file, const std::string& site_wkt) {
  return LineReader(file, site_wkt).read();
}

}  // namespace soilvdb::inline v0::io
