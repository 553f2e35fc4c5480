// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/measures.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

#include "core/tool/polygon.h"
#include "io/file/atomic_file.h"
#include "io/file/json.h"
#include "io/file/text.h"
#include "io/terrain/crs.h"
#include "tools/serve/ground_query.h"
#include "tools/serve/line_values.h"
#include "tools/serve/target.h"

namespace soilvdb::tools {
namespace {

namespace fs = std::filesystem;
using OrderedJson = nlohmann::ordered_json;

constexpr std::size_t kMostMeasures = 200, kMostPointsInAll = 10'000, kMostName_bytes = 80;
constexpr std::size_t kMostFile_bytes = 4 << 20;
constexpr double kFarthestPoint_m = 1e9;
constexpr int kSectionPoints = 500;

struct KindWords {
  const char *name, *geometry;
  std::size_t least, most;
};
/// By Measure::Kind.
constexpr std::array<KindWords, 4> kKinds = {{{"boundary", "Polygon", 3, kMostCorners},
                                              {"section", "LineString", 2, 2},
                                              {"height", "Point", 1, 1},
                                              {"distance", "LineString", 2, 2}}};
const KindWords& words_of(Measure::Kind kind) { return kKinds[static_cast<std::size_t>(kind)]; }

Measure::Kind kind_of(const nlohmann::json& json) {
  for (std::size_t i = 0; i < kKinds.size(); ++i)
    if (json.is_string() && json == kKinds[i].name) return static_cast<Measure::Kind>(i);
  throw std::invalid_argument("'kind' must be boundary, section, height or distance");
}

std::string measure_name(const nlohmann::json& json) {
  std::string name = json.is_string() ? json.get<std::string>() : "";
  name.erase(0, name.find_first_not_of(' '));
  name.erase(name.find_last_not_of(' ') + 1);
  const auto is_control = [](unsigned char c) { return c < 0x20 || c == 0x7f; };
  if (name.empty() || name.size() > kMostName_bytes ||
      std::any_of(name.begin(), name.end(), is_control))
    throw std::invalid_argument(
        fmt::format("'name' must be a line of text, 1 to {} bytes long", kMostName_bytes));
  return name;
}

std::vector<Vec2> points_of(const nlohmann::json& json, Measure::Kind kind) {
  const auto [name, geometry, least, most] = words_of(kind);
  if (!json.is_array() || json.size() < least || json.size() > most)
    throw std::invalid_argument(
        fmt::format("'points' of a {} must be an array of {} [x, y]", name,
                    least == most ? fmt::to_string(least) : fmt::format("{} to {}", least, most)));
  std::vector<Vec2> points;
  for (const nlohmann::json& point : json) {
    const auto xy = array_of<2>(point, "points");
    if (!(std::abs(xy[0]) <= kFarthestPoint_m && std::abs(xy[1]) <= kFarthestPoint_m))
      throw std::invalid_argument(
          fmt::format("'points' must be within {:g} m of 0, 0", kFarthestPoint_m));
    points.emplace_back(xy[0], xy[1]);
  }
  if (kind == Measure::Kind::kBoundary && crosses_itself(points))
    throw std::invalid_argument(
        "the boundary crosses itself; its corners must be in order around what it encloses");
  if (points.size() == 2 && points[0] == points[1])
    throw std::invalid_argument(fmt::format("the two points of a {} must differ", name));
  return points;
}

std::uint64_t id_of(const nlohmann::json& json) {
  if (!json.is_number_unsigned())
    throw std::invalid_argument("'id' must be the whole number of a measure");
  return json.get<std::uint64_t>();
}

OrderedJson points_json(const std::vector<Vec2>& points) {
  OrderedJson all = OrderedJson::array();
  for (const Vec2& point : points) all.push_back({point.x(), point.y()});
  return all;
}

OrderedJson measure_json(const Measure& measure) {
  return {{"id", measure.id},
          {"kind", words_of(measure.kind).name},
          {"name", measure.name},
          {"points", points_json(measure.points)}};
}

OrderedJson list_json(const std::vector<Measure>& all) {
  OrderedJson list = OrderedJson::array();
  for (const Measure& measure : all) list.push_back(measure_json(measure));
  return list;
}

void require_room(const std::vector<Measure>& all) {
  std::size_t points = 0;
  for (const Measure& measure : all) points += measure.points.size();
  if (all.size() > kMostMeasures || points > kMostPointsInAll)
    throw std::invalid_argument(fmt::format(
        "a site keeps at most {} measures with {} points in all; remove one that is not needed",
        kMostMeasures, kMostPointsInAll));
}

void require_own_name(const std::vector<Measure>& all, const Measure& named) {
  for (const Measure& other : all)
    if (other.id != named.id && other.name == named.name)
      throw std::invalid_argument(
          fmt::format("there is a measure '{}' already; give another name", named.name));
}

std::size_t place_of(const std::vector<Measure>& all, std::uint64_t id) {
  for (std::size_t i = 0; i < all.size(); ++i)
    if (all[i].id == id) return i;
  throw std::invalid_argument(fmt::format("there is no measure {}; it may have been removed", id));
}

}  // namespace

Measures::Measures(fs::path file) : file_(std::move(file)) {
  std::error_code none;
  if (file_.empty() || !fs::exists(file_, none)) return;
  try {
    const nlohmann::json json = object_of(io::read_text(file_, kMostFile_bytes));
    require_keys(json, {"next", "measures"});
    next_ = id_of(json.value("next", nlohmann::json()));
    if (!json.at("measures").is_array()) throw std::invalid_argument("'measures' must be an array");
    for (const nlohmann::json& one : json["measures"]) {
      require_keys(one, {"id", "kind", "name", "points"});
      const Measure::Kind kind = kind_of(one.at("kind"));
      Measure measure{id_of(one.at("id")), kind, measure_name(one.at("name")),
                      points_of(one.at("points"), kind), ++shapes_};
      require_own_name(all_, measure);
      if (std::any_of(all_.begin(), all_.end(),
                      [&](const Measure& m) { return m.id == measure.id; }))
        throw std::invalid_argument("two measures have one 'id'");
      if (measure.id >= next_) throw std::invalid_argument("'next' must be larger than every id");
      all_.push_back(std::move(measure));
    }
    require_room(all_);
  } catch (const io::InputError&) {
    throw;
  } catch (const std::exception& e) {
    throw io::InputError(
        file_, fmt::format("holds no measures of a site: {}; move it away to go on without them",
                           io::printable(e.what())));
  }
}

std::vector<Measure> Measures::areas() const {
  std::vector<Measure> areas;
  for (const Measure& measure : all_)
    if (measure.kind == Measure::Kind::kBoundary) areas.push_back(measure);
  return areas;
}

const Measure& Measures::find(std::uint64_t id) const { return all_[place_of(all_, id)]; }

void Measures::keep(std::vector<Measure> all, std::uint64_t next) {
  require_room(all);
  if (!file_.empty())
    io::write_atomically(
        file_, io::to_text(OrderedJson{{"next", next}, {"measures", list_json(all)}}) + '\n');
  all_ = std::move(all);
  next_ = next;
}

OrderedJson Measures::change(std::string_view text) {
  const nlohmann::json json = object_of(text);
  require_keys(json, {"add", "change", "remove"});
  if (json.size() != 1)
    throw std::invalid_argument("a change has one of 'add', 'change' and 'remove'");
  std::vector<Measure> all = all_;
  if (json.contains("remove")) {
    const std::size_t place = place_of(all, id_of(json["remove"]));
    OrderedJson removed = measure_json(all[place]);
    all.erase(all.begin() + static_cast<std::ptrdiff_t>(place));
    keep(std::move(all), next_);
    return removed;
  }
  const bool adds = json.contains("add");
  const nlohmann::json& given = json[adds ? "add" : "change"];
  if (!given.is_object())
    throw std::invalid_argument(fmt::format("'{}' must be an object", adds ? "add" : "change"));
  const char* const key = adds ? "kind" : "id";
  require_keys(given, {key, "name", "points"});
  Measure measure = adds ? Measure{next_, kind_of(given.value("kind", nlohmann::json()))}
                         : find(id_of(given.value("id", nlohmann::json())));
  if (adds || given.contains("name"))
    measure.name = measure_name(given.value("name", nlohmann::json()));
  if (adds || given.contains("points")) {
    measure.points = points_of(given.value("points", nlohmann::json()), measure.kind);
    measure.shape = ++shapes_;
  }
  require_own_name(all, measure);
  if (adds)
    all.push_back(measure);
  else
    all[place_of(all, measure.id)] = measure;
  keep(std::move(all), adds ? next_ + 1 : next_);
  return measure_json(measure);
}

OrderedJson Measures::json() const { return {{"measures", list_json(all_)}}; }

OrderedJson Measures::geojson(const std::string& crs_wkt) const {
  OrderedJson features = OrderedJson::array();
  for (const Measure& measure : all_) {
    OrderedJson at = points_json(measure.points);
    if (measure.kind == Measure::Kind::kBoundary) {
      // Rings go counter-clockwise, and end where they begin.
      if (signed_area(measure.points) < 0) std::reverse(at.begin(), at.end());
      at.push_back(at[0]);
      at = OrderedJson::array({at});
    }
    if (measure.kind == Measure::Kind::kHeight) at = OrderedJson(at[0]);
    const KindWords& words = words_of(measure.kind);
    features.push_back({{"type", "Feature"},
                        {"id", measure.id},
                        {"properties", {{"name", measure.name}, {"kind", words.name}}},
                        {"geometry", {{"type", words.geometry}, {"coordinates", at}}}});
  }
  OrderedJson json = {{"type", "FeatureCollection"}};
  // RFC 7946 knows degrees only; this member of its predecessor is what GIS programs read.
  if (const std::string map = io::map_label(crs_wkt); map.starts_with("EPSG:"))
    json["crs"] = {{"type", "name"},
                   {"properties", {{"name", "urn:ogc:def:crs:EPSG::" + map.substr(5)}}}};
  json["features"] = std::move(features);
  return json;
}

namespace {

constexpr std::array<const char*, 17> kColumns = {
    "cut_m3",    "fill_m3",    "net_m3",   "area_m2", "off_site_m2", "design_area_m2",
    "to_cut_m3", "to_fill_m3", "length_m", "cut_m2",  "fill_m2",     "height_m",
    "before_m",  "design_m",   "level_m",  "rise_m",  "slope_m"};

OrderedJson values_of(const Measure& measure, GroundQuery& ground) {
  const std::vector<Vec2>& at = measure.points;
  switch (measure.kind) {
    case Measure::Kind::kBoundary:
      return ground.volume(at);
    case Measure::Kind::kSection: {
      const OrderedJson all = ground.section(at[0], at[1], kSectionPoints);
      return {{"length_m", (at[1] - at[0]).norm()},
              {"cut_m2", all["cut_m2"]},
              {"fill_m2", all["fill_m2"]}};
    }
    case Measure::Kind::kHeight:
      return ground.height(at[0]);
    case Measure::Kind::kDistance:
      break;
  }
  const double level_m = (at[1] - at[0]).norm();
  OrderedJson values = {{"level_m", level_m}};
  const OrderedJson from = ground.height(at[0])["height_m"], to = ground.height(at[1])["height_m"];
  if (from.is_null() || to.is_null()) return values;
  const double rise_m = to.get<double>() - from.get<double>();
  values["rise_m"] = rise_m;
  values["slope_m"] = std::hypot(level_m, rise_m);
  return values;
}

}  // namespace

std::string measures_csv_head() {
  return fmt::format("id,kind,name,{},error\n", fmt::join(kColumns, ","));
}

std::string measures_csv_row(const Measure& measure, GroundQuery& ground) {
  OrderedJson values;
  std::string error;
  try {
    values = values_of(measure, ground);
  } catch (const std::invalid_argument& e) {
    error = e.what();
  }
  std::string row =
      fmt::format("{},{},{}", measure.id, words_of(measure.kind).name, io::csv_field(measure.name));
  for (const char* column : kColumns) {
    const auto found = values.find(column);
    row += found == values.end() || found->is_null() ? "," : "," + io::to_text(*found);
  }
  return row + ',' + io::csv_field(error) + '\n';
}

}  // namespace soilvdb::tools
