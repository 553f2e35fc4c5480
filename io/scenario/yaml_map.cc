// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Strict YAML on yaml-cpp. Aliases share nodes and merge keys are not expanded, so reading costs no
// more than the file is long.
#include "io/scenario/yaml_map.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <yaml-cpp/eventhandler.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string_view>

#include "io/file/text.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::size_t kMaxBytes = 16 << 20;
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

/// Where documents start. Looks for no more than two: a comma where one should start makes yaml-cpp
/// see documents without end.
struct DocumentStarts : YAML::EventHandler {
  explicit DocumentStarts(const std::string& text) {
    std::istringstream in(text);
    YAML::Parser parser(in);
    if (parser.HandleNextDocument(*this)) parser.HandleNextDocument(*this);
  }

  void OnDocumentStart(const YAML::Mark& mark) override {
    if (++count == 2) second_line = mark.line + 1;
  }
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark&, YAML::anchor_t) override {}
  void OnAlias(const YAML::Mark&, YAML::anchor_t) override {}
  void OnScalar(const YAML::Mark&, const std::string&, YAML::anchor_t,
                const std::string&) override {}
  void OnSequenceStart(const YAML::Mark&, const std::string&, YAML::anchor_t,
                       YAML::EmitterStyle::value) override {}
  void OnSequenceEnd() override {}
  void OnMapStart(const YAML::Mark&, const std::string&, YAML::anchor_t,
                  YAML::EmitterStyle::value) override {}
  void OnMapEnd() override {}

  int count = 0;
  long second_line = 0;  ///< 0: there is none
};

constexpr const char* kNoBlank = "a blank is missing after the colon of '";

/// The word before a colon that another character follows at once, where that is how a line or an
/// item begins, as in voxel_size:0.05, which is no key; else nothing. Not of paths, C:/ or http://.
std::string key_without_blank(std::string_view line) {
  const auto skip = [&](const char* characters) {
    line.remove_prefix(std::min(line.find_first_not_of(characters), line.size()));
  };
  skip(" ");
  while (line.starts_with("- ")) {
    line.remove_prefix(1);
    skip(" ");
  }
  const std::size_t colon = line.find_first_not_of("abcdefghijklmnopqrstuvwxyz_");
  if (colon == 0 || colon + 1 >= line.size() || line[colon] != ':') return "";
  return std::string_view(" \t\r\n:/\\").find(line[colon + 1]) == std::string_view::npos
             ? std::string(line.substr(0, colon))
             : "";
}

/// The same of one of the `known` keys.
std::string known_without_blank(const std::string& text, const std::vector<std::string>& known) {
  const std::string key = key_without_blank(text);
  return std::find(known.begin(), known.end(), key) == known.end() ? "" : key;
}

[[noreturn]] void refuse(const std::filesystem::path& file, const std::string& text,
                         const YAML::Exception& e) {
  const std::string message = "is not valid YAML: " + printable(e.msg);
  if (e.mark.is_null()) throw InputError(file, message);
  // What it says of a tab is another thing each time, at the line or the one before.
  std::istringstream in(text);
  std::string line, key;
  long line_of_key = 0;
  for (long n = 0; n <= e.mark.line && std::getline(in, line); ++n) {
    // yaml-cpp goes on to the next key before it complains.
    if (const std::string found = key_without_blank(line); !found.empty()) {
      key = found;
      line_of_key = n + 1;
    }
    const std::size_t indent = std::min(line.find_first_not_of(" \t"), line.size());
    if (n + 1 < e.mark.line || line.find('\t') >= indent) continue;
    throw InputError(file, n + 1, "is not valid YAML: a tab indents this line; use spaces instead");
  }
  if (!key.empty()) {
    throw InputError(file, line_of_key, "is not valid YAML: " + (kNoBlank + printable(key)) + "'");
  }
  throw InputError(file, e.mark.line + 1, message);
}

}  // namespace

YAML::Node read_yaml(const std::filesystem::path& file) {
  const std::string text = read_text(file, kMaxBytes);
  try {
    const DocumentStarts starts(text);
    if (starts.second_line > 0) {
      throw InputError(file, starts.second_line, "a second document starts; there must be one");
    }
    const YAML::Node document = YAML::Load(text);
    if (document.IsNull()) throw InputError(file, "is empty");
    return document;
  } catch (const YAML::Exception& e) {
    refuse(file, text, e);
  }
}

YamlMap::YamlMap(const std::filesystem::path& file, const YAML::Node& node, std::string what,
                 std::vector<std::string> known)
    : file_(file), node_(node), what_(std::move(what)) {
  if (!node_.IsMap()) {
    const std::string cut = node_.IsScalar() ? known_without_blank(node_.Scalar(), known) : "";
    if (!cut.empty()) fail(node_, fmt::format("{}{}' in {}", kNoBlank, cut, what_));
    fail(node_, fmt::format("{} is {}; it must be a map with keys of {}", what_, describe(node),
                            fmt::join(known, ", ")));
  }
  std::set<std::string> seen;
  for (const auto& entry : node_) {
    const std::string key = entry.first.IsScalar() ? entry.first.Scalar() : "";
    if (std::find(known.begin(), known.end(), key) == known.end()) {
      const std::string cut = known_without_blank(key, known);
      if (!cut.empty()) fail(entry.first, fmt::format("{}{}' in {}", kNoBlank, cut, what_));
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
  const std::string value = text(key);
  if (value.find('\0') != value.npos) fail(key, key + " has a zero character; it must be a path");
  return file_.parent_path() / value;
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

std::vector<Vec2> YamlMap::points(const std::string& key) const {
  const YAML::Node list = at(key);
  if (!list.IsSequence()) {
    fail(list, fmt::format("{} is {}; it must be a list of points [x, z]", key, describe(list)));
  }
  std::vector<Vec2> points;
  for (const auto& point : list) {
    const auto xz = numbers(point, 2, "a point of " + key);
    points.emplace_back(xz[0], xz[1]);
  }
  return points;
}

YAML::Node YamlMap::node_of(const std::string& key) const {
  // The key's own line: yaml-cpp gives an empty value the place of what comes after it.
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
