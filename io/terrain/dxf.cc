// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Surfaces of DXF files by GDAL: 3DFACEs and polyface meshes; a layer with faces is a surface.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "io/file/text.h"
#include "io/terrain/gdal.h"
#include "io/terrain/tin.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr double kFlat_m = 0.001;  // corners of a four-sided face that are this near a plane
constexpr std::size_t kMostLayers = 1000;

struct Unit {
  int code;
  const char* name;
  double metres;
};
/// $INSUNITS of a DXF's header.
constexpr Unit kDxfUnits[] = {
    {1, "inch", 0.0254},  {2, "foot", 0.3048}, {4, "mm", 0.001},
    {5, "cm", 0.01},      {6, "m", 1},         {7, "km", 1000},
    {10, "yard", 0.9144}, {14, "dm", 0.1},     {21, "US survey foot", 1200.0 / 3937}};

/// The groups of a DXF: a line with a code, and one with its value.
class DxfGroups {
 public:
  explicit DxfGroups(const std::filesystem::path& file) : in_(file, std::ios::binary) {}

  bool next() {
    if (!std::getline(in_, code_) || !std::getline(in_, value_)) return false;
    code = parsed<int>(trimmed(code_)).value_or(-1);
    value = trimmed(value_);
    return true;
  }
  std::string text() const { return code_ + '\n' + value_ + '\n'; }

  int code = -1;
  std::string_view value;

 private:
  static std::string_view trimmed(std::string_view line) {
    const std::size_t from = line.find_first_not_of(" \t"), to = line.find_last_not_of(" \t\r");
    return from == line.npos ? std::string_view() : line.substr(from, to - from + 1);
  }

  std::ifstream in_;
  std::string code_, value_;
};

/// The header's unit, which GDAL doesn't tell; empty without one.
std::optional<int> unit_code(const std::filesystem::path& file) {
  for (DxfGroups group(file); group.next() && group.value != "ENTITIES";)
    if (group.value == "$INSUNITS" && group.next()) return parsed<int>(group.value);
  return std::nullopt;
}

/// The text of a DXF, of its entities only visible faces in space, and blocks. GDAL does not tell
/// these from others in blocks, and takes a missing corner for 0, 0, 0.
struct DxfFaces {
  explicit DxfFaces(const std::filesystem::path& file) {
    std::string section, kind;
    std::size_t begin = 0;  // of the entity in the text
    std::array<std::array<std::string, 3>, 4> corners;
    bool hidden = false, on_paper = false, is_mesh = false, kept = false;
    std::size_t corner_count = 0;
    const auto end_entity = [&] {
      if (section != "BLOCKS" && section != "ENTITIES") return;
      if (kind == "3DFACE" || kind == "INSERT" || (kind == "POLYLINE" && is_mesh)) {
        kept = !hidden && !on_paper;
        invisible += hidden && !on_paper;
      } else if (kind != "VERTEX" && kind != "ATTRIB" && kind != "SEQEND") {  // as the one before
        kept = kind == "SECTION" || kind == "BLOCK" || kind == "ENDBLK";
      }
      if (!kept) return text.resize(begin);
      corner_count += kind == "3DFACE" ? 3 : kind == "VERTEX" ? 1 : 0;
      if (corner_count > kMostTinPoints) throw InputError(file, "has more than 10 million corners");
      for (std::size_t i = 1; i < 4 && kind == "3DFACE"; ++i) {
        if (!corners[i][0].empty()) continue;
        corners[i] = corners[i - 1];
        for (std::size_t axis = 0; axis < 3; ++axis)
          text += fmt::format("{}\n{}\n", 10 * (axis + 1) + i, corners[i][axis]);
      }
    };
    DxfGroups group(file);
    while (group.next()) {
      const int code = group.code;
      if (code == 0) {
        end_entity();
        kind = group.value;
        if (kind == "ENDSEC") section.clear();
        begin = text.size();
        hidden = on_paper = is_mesh = false;
        corners = {};
      }
      text += group.text();
      if (code == 2 && kind == "SECTION") section = group.value;
      if (code == 60) hidden = group.value == "1";
      if (code == 67) on_paper = group.value == "1";
      if (code == 70) is_mesh = (parsed<int>(group.value).value_or(0) & 64) != 0;
      if (kind == "3DFACE" && code >= 10 && code < 40 && code % 10 < 4)
        corners[std::size_t(code % 10)][std::size_t(code / 10 - 1)] = group.value;
      if (code == 9 && group.value == "$ACADVER" && group.next()) {
        text += group.text();
        is_utf8 = group.value >= "AC1021";
      }
    }
    end_entity();
  }

  std::string text;
  std::size_t invisible = 0;
  bool is_utf8 = false;
};

struct Layer {
  std::string name;
  Tin tin;
  std::size_t warped = 0;  ///< faces of four corners that are not in a plane
};

class DxfReader {
 public:
  explicit DxfReader(const FilePart& from) : from_(from) {}

  TinInput read() {
    check_readable(from_.file);
    units_ = dxf_units(from_.file);
    DxfFaces faces(from_.file);
    const MemoryFile memory(".dxf");
    memory.hold(faces.text);
    GdalMessages messages;
    const char* const drivers[] = {"DXF", nullptr};
    if (faces.is_utf8) gdal().CPLSetThreadLocalConfigOption("DXF_ENCODING", "UTF-8");
    const GdalDataset dataset(
        gdal().GDALOpenEx(memory.path(), GDAL_OF_VECTOR | GDAL_OF_READONLY | GDAL_OF_VERBOSE_ERROR,
                          drivers, nullptr, nullptr));
    gdal().CPLSetThreadLocalConfigOption("DXF_ENCODING", nullptr);
    if (!dataset || gdal().GDALDatasetGetLayerCount(dataset.get()) < 1)
      throw InputError(from_.file, "is not a readable DXF of text; save it as one");
    const OGRLayerH entities = gdal().GDALDatasetGetLayer(dataset.get(), 0);
    while (const Feature feature{gdal().OGR_L_GetNextFeature(entities)}) {
      const OGRGeometryH geometry = gdal().OGR_F_GetGeometryRef(feature.get());
      if (geometry == nullptr) continue;
      const int layer = gdal().OGR_F_GetFieldIndex(feature.get(), "Layer");
      add(gdal().OGR_F_GetFieldAsString(feature.get(), layer), geometry);
    }
    if (!messages.error().empty())
      throw InputError(from_.file, fmt::format("is damaged ({})", messages.error()));
    if (layers_.empty() && faces.invisible > 0)
      throw InputError(from_.file,
                       "has no visible face (group 60 hides them); show those of the "
                       "surface");
    if (faces.invisible > 0)
      units_.doubts.push_back(faces.invisible == 1
                                  ? "an invisible face, mesh or block (group 60) is left out"
                                  : fmt::format("{} invisible faces, meshes or blocks (group 60) "
                                                "are left out",
                                                faces.invisible));
    return chosen();
  }

 private:
  void add(const std::string& layer, OGRGeometryH geometry) {
    const OGRwkbGeometryType type = gdal().OGR_G_GetGeometryType(geometry);
    if (type == wkbPolygon25D) return add_face(layer, geometry);
    // Of a mesh, or of a block that was inserted.
    if (type != wkbPolyhedralSurfaceZ && type != wkbTINZ && type != wkbMultiPolygon25D &&
        type != wkbGeometryCollection25D)
      return;
    for (int i = 0; i < gdal().OGR_G_GetGeometryCount(geometry); ++i)
      add(layer, gdal().OGR_G_GetGeometryRef(geometry, i));
  }

  Layer& layer_of(const std::string& name) {
    const auto is_it = [&](const Layer& layer) { return layer.name == name; };
    // Faces of a layer mostly follow one another.
    if (last_ < layers_.size() && is_it(layers_[last_])) return layers_[last_];
    last_ = static_cast<std::size_t>(std::find_if(layers_.begin(), layers_.end(), is_it) -
                                     layers_.begin());
    if (last_ == kMostLayers) throw InputError(from_.file, "has faces on more than 1000 layers");
    if (last_ == layers_.size()) layers_.push_back({name, {}});
    return layers_[last_];
  }

  void add_face(const std::string& name, OGRGeometryH polygon) {
    if (gdal().OGR_G_GetGeometryCount(polygon) != 1) return;
    const OGRGeometryH ring = gdal().OGR_G_GetGeometryRef(polygon, 0);
    std::vector<Vec3> corners;
    for (int i = 0; i < gdal().OGR_G_GetPointCount(ring); ++i) {
      Vec3 p;
      gdal().OGR_G_GetPoint(ring, i, &p.x(), &p.y(), &p.z());
      if (!(p.cwiseAbs().maxCoeff() <= kMaxNumber))
        throw InputError(from_.file, "has a corner that is not a number or beyond 1e9");
      if (corners.empty() || p != corners.back()) corners.push_back(p);
      if (corners.size() > 5) return;
    }
    if (corners.size() > 1 && corners.front() == corners.back()) corners.pop_back();
    if (corners.size() < 3 || corners.size() > 4) return;
    Layer& layer = layer_of(name);
    Tin& tin = layer.tin;
    if (tin.faces.size() + 2 > kMostTinFaces || tin.points.size() + 4 > kMostTinPoints)
      throw InputError(from_.file, "has more than 10 million corners");
    const auto first = static_cast<std::uint32_t>(tin.points.size());
    tin.points.insert(tin.points.end(), corners.begin(), corners.end());
    tin.faces.push_back({first, first + 1, first + 2});
    if (corners.size() == 3) return;
    tin.faces.push_back({first, first + 2, first + 3});
    const Vec3 normal = (corners[2] - corners[0]).cross(corners[3] - corners[1]);
    layer.warped +=
        units_.unit_m * std::abs(normal.dot(corners[1] - corners[0])) > kFlat_m * normal.norm();
  }

  TinInput chosen() {
    std::vector<std::string> names;
    for (const Layer& layer : layers_) names.push_back(layer.name);
    Layer& layer = layers_[choose_surface(from_, names)];
    TinInput input = std::move(units_);
    input.tin = std::move(layer.tin);
    if (layer.warped > 0)
      input.doubts.push_back(
          layer.warped == 1
              ? "a face of four corners is not flat; it is folded from its first corner to its "
                "third"
              : fmt::format(
                    "{} faces of four corners are not flat; they are folded from their first "
                    "corner to their third",
                    layer.warped));
    return input;
  }

  const FilePart& from_;
  TinInput units_;  ///< without its triangles
  std::vector<Layer> layers_;
  std::size_t last_ = 0;
};

}  // namespace

TinInput dxf_units(const std::filesystem::path& file) {
  TinInput units;
  const int code = unit_code(file).value_or(0);
  const auto unit = std::find_if(std::begin(kDxfUnits), std::end(kDxfUnits),
                                 [&](const Unit& known) { return known.code == code; });
  if (unit != std::end(kDxfUnits)) {
    units.unit = unit->name;
    units.unit_m = units.height_unit_m = unit->metres;
  } else if (code != 0) {
    throw InputError(file, fmt::format("has the unit {} of $INSUNITS; 6 is metres, 2 feet, 21 US "
                                       "survey feet",
                                       code));
  } else {
    units.doubts.emplace_back("gives no unit ($INSUNITS); its coordinates are taken as metres");
  }
  return units;
}

TinInput read_dxf(const FilePart& from) { return DxfReader(from).read(); }

}  // namespace soilvdb::inline v0::io
