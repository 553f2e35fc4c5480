// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Strict YAML on yaml-cpp. Aliases share nodes and merge keys are not expanded, so the cost of
// reading is limited by the file's length.
#include "io/scenario/yaml_map.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>

#include "io/file/text.h"
#include "io/scenario/yaml_file.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::size_t kMaxNameBytes = 100;

std::string describe(const YAML::Node& node) {
  switch (node.Type()) {
    case YAML::NodeType::Map:
      return "a map";
    case YAML::NodeType::Sequence:
      return "a list";
    case YAML::NodeType::Scalar:
      return "'" + printable(node.Scalar()) + "'";
    default:
      return "empty";
  }
}

/// The known key in `text` that lacks a blank after its colon.
std::string known_without_blank(const std::string& text, const std::vector<std::string>& known) {
  const std::string key = key_without_blank(text);
  return std::find(known.begin(), known.end(), key) == known.end() ? "" : key;
}

}  // namespace

YamlMap::YamlMap(const std::filesystem::path& file, const YAML::Node& node, std::string what,
                 std::vector<std::string> known)
    : file_(file), node_(node), what_(std::move(what)) {
  if (!node_.IsMap()) {
    const std::string cut = node_.IsScalar() ? known_without_blank(node_.Scalar(), known) : "";
    if (!cut.empty()) fail(node_, fmt::format("{} in {}", no_blank(cut), what_));
    fail(node_, fmt::format("{} is {}; it must be a map with keys of {}", what_, describe(node),
                            fmt::join(known, ", ")));
  }
  std::set<std::string> seen;
  for (const auto& entry : node_) {
    const std::string key = entry.first.IsScalar() ? entry.first.Scalar() : "";
    if (std::find(known.begin(), known.end(), key) == known.end()) {
      const std::string cut = known_without_blank(key, known);
      if (!cut.empty()) fail(entry.first, fmt::format("{} in {}", no_blank(cut), what_));
      fail(entry.first,
           fmt::format("unknown key {} in {}; did you mean '{}'? Its keys are {}",
                       entry.first.IsScalar() ? describe(entry.first) : "that is no word", what_,
                       nearest(key, known), fmt::join(known, ", ")));
    }
    if (!seen.insert(key).second) {
      fail(entry.first, fmt::format("key '{}' is there twice in {}; leave one out", key, what_));
    }
  }
}

YamlMap YamlMap::load(const std::filesystem::path& file, std::string what,
                      std::vector<std::string> known) {
  return YamlMap(file, read_yaml(file), std::move(what), std::move(known));
}

bool YamlMap::has(const std::string& key) const { return node_[key].IsDefined(); }
bool YamlMap::is_map(const std::string& key) const { return has(key) && node_[key].IsMap(); }

std::vector<std::string> YamlMap::keys(const std::string& key) const {
  const YAML::Node node = at(key);
  if (!node.IsMap()) fail(key, fmt::format("{} must be a map", key));
  std::vector<std::string> names;
  for (const auto& entry : node) names.push_back(entry.first.as<std::string>());
  return names;
}

YAML::Node YamlMap::at(const std::string& key) const {
  YAML::Node node = node_[key];
  if (!node.IsDefined()) fail(node_, fmt::format("key '{}' is missing in {}", key, what_));
  if (node.IsNull()) fail(key, fmt::format("{} is empty; it must have a value", key));
  return node;
}

YamlMap YamlMap::map(const std::string& key, std::vector<std::string> known) const {
  return YamlMap(file_, at(key), key, std::move(known));
}

std::vector<YamlMap> YamlMap::maps(const std::string& key, const std::string& what,
                                   std::vector<std::string> known) const {
  const YAML::Node list = at(key);
  if (!list.IsSequence() || list.size() == 0) {
    fail(list, fmt::format("{} is {}; it must be a list of at least one {}", key,
                           list.IsSequence() ? "empty" : describe(list), what));
  }
  std::vector<YamlMap> maps;
  for (const auto& node : list) maps.emplace_back(file_, node, what, known);
  return maps;
}

std::string YamlMap::text(const std::string& key) const {
  const YAML::Node node = at(key);
  if (!node.IsScalar() || node.Scalar().empty()) {
    fail(node,
         fmt::format("{} is {}; it must be text", key, node.IsScalar() ? "empty" : describe(node)));
  }
  return node.Scalar();
}

std::vector<std::string> YamlMap::texts(const std::string& key) const {
  const YAML::Node node = at(key);
  if (!node.IsSequence()) return {text(key)};
  if (node.size() == 0) fail(node, fmt::format("{} is an empty list; it must have an entry", key));
  std::vector<std::string> all;
  for (const YAML::Node& entry : node) {
    if (!entry.IsScalar() || entry.Scalar().empty())
      fail(entry, fmt::format("{} has an entry that is not text; each must be text", key));
    all.push_back(entry.Scalar());
  }
  return all;
}

std::string YamlMap::name(const std::string& key) const {
  const std::string value = text(key);
  try {
    check_name(value);
  } catch (const std::invalid_argument& e) {
    fail(key, fmt::format("{} {}", key, e.what()));
  }
  return value;
}

std::filesystem::path YamlMap::path(const std::string& key) const {
  text(key);  // not a list
  return paths(key).front();
}

std::vector<std::filesystem::path> YamlMap::paths(const std::string& key) const {
  std::vector<std::filesystem::path> all;
  for (const std::string& value : texts(key)) {
    if (value.find('\0') != value.npos) fail(key, key + " has a zero character; it must be a path");
    all.push_back(file_.parent_path() / value);
  }
  return all;
}

double YamlMap::number(const YAML::Node& node, const std::string& name) const {
  // yaml-cpp gives quoted scalars the tag "!", plain ones "?".
  if (!node.IsScalar() || node.Tag() == "!") {
    fail(node, fmt::format("{} is {}; it must be a number{}", name, describe(node),
                           node.IsScalar() ? " without quotes" : ""));
  }
  const auto value = parse_number(node.Scalar());
  if (!value || !(std::abs(*value) <= kMaxNumber)) {
    fail(node, fmt::format(
                   "{} is {}; it must be a number{}", name, describe(node),
                   value && std::isfinite(*value) ? fmt::format(" within {:g}", kMaxNumber) : ""));
  }
  return *value;
}

double YamlMap::number(const std::string& key) const { return number(at(key), key); }

double YamlMap::number(const std::string& key, double least, double most, const char* unit) const {
  const double value = number(key);
  if (value < least || value > most) {
    fail(key, fmt::format("{} is {} {}; it must be from {} to {} {}", key, value, unit, least, most,
                          unit));
  }
  return value;
}

std::size_t YamlMap::count(const std::string& key, std::size_t least, std::size_t most) const {
  const double value = number(key);
  if (value != std::floor(value) || value < static_cast<double>(least) ||
      value > static_cast<double>(most)) {
    fail(key,
         fmt::format("{} is {}; it must be a whole number from {} to {}", key, value, least, most));
  }
  return static_cast<std::size_t>(value);
}

bool YamlMap::flag(const std::string& key) const {
  const std::string value = text(key);
  if (value != "true" && value != "false")
    fail(key, fmt::format("{} is '{}'; it must be true or false", key, printable(value)));
  return value == "true";
}

std::vector<double> YamlMap::numbers(const YAML::Node& node, std::size_t n,
                                     const std::string& name) const {
  if (!node.IsSequence() || node.size() != n) {
    fail(node,
         fmt::format("{} is {}; it must be a list of {} numbers", name,
                     node.IsSequence() ? fmt::format("a list of {}", node.size()) : describe(node),
                     n));
  }
  std::vector<double> values;
  for (const auto& value : node) values.push_back(number(value, name));
  return values;
}

std::vector<double> YamlMap::numbers(const std::string& key, std::size_t n) const {
  return numbers(at(key), n, key);
}

std::vector<std::vector<double>> YamlMap::lists(const std::string& key, std::size_t n,
                                                const char* form) const {
  const YAML::Node list = at(key);
  if (!list.IsSequence())
    fail(list, fmt::format("{} is {}; it must be a list of points {}", key, describe(list), form));
  std::vector<std::vector<double>> all;
  for (const auto& point : list) all.push_back(numbers(point, n, "a point of " + key));
  return all;
}

std::vector<Vec2> YamlMap::points(const std::string& key) const {
  std::vector<Vec2> points;
  for (const auto& xz : lists(key, 2, "[x, z]")) points.emplace_back(xz[0], xz[1]);
  return points;
}

std::vector<Vec3> YamlMap::places(const std::string& key) const {
  std::vector<Vec3> places;
  for (const auto& xyz : lists(key, 3, "[x, y, z]")) places.emplace_back(xyz[0], xyz[1], xyz[2]);
  return places;
}

YAML::Node YamlMap::node_of(const std::string& key) const {
  // yaml-cpp places an empty value at the next token, so this takes the key's own line.
  for (const auto& entry : node_) {
    if (entry.first.IsScalar() && entry.first.Scalar() == key) return entry.first;
  }
  return node_;
}

std::string YamlMap::place(const std::string& key) const {
  return fmt::format("{}:{}", file_.string(), node_of(key).Mark().line + 1);
}

void YamlMap::fail(const std::string& key, const std::string& message) const {
  fail(node_of(key), message);
}

void YamlMap::fail(const YAML::Node& node, const std::string& message) const {
  if (node.Mark().is_null()) throw InputError(file_, message);
  throw InputError(file_, node.Mark().line + 1, message);
}

void check_name(const std::string& name) {
  const auto bad = [](unsigned char c) { return c < 0x20 || c == 0x7F || c == '/' || c == '\\'; };
  if (name.empty() || name == "." || name == ".." || name.size() > kMaxNameBytes ||
      std::any_of(name.begin(), name.end(), bad)) {
    throw std::invalid_argument(
        fmt::format("is '{}'; it must be fit for the name of a file: 1 to {} bytes, no slashes, no "
                    "control characters",
                    printable(name), kMaxNameBytes));
  }
}

}  // namespace soilvdb::inline v0::io
