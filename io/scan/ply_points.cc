// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Vertices of a PLY file. Elements before them are skipped, those behind are not looked at.
#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "io/file/text.h"
#include "io/scan/scan_formats.h"

namespace soilvdb::inline v0::io {
namespace {

struct PlyProperty {
  std::string name;
  NumberType type = NumberType::kF32;
  std::optional<NumberType> count_type;  ///< of a list
};

struct PlyElement {
  std::string name;
  std::uint64_t count = 0;
  std::vector<PlyProperty> properties;

  bool has_lists() const {
    return std::any_of(properties.begin(), properties.end(),
                       [](const PlyProperty& p) { return p.count_type.has_value(); });
  }
  /// Bytes of one; with lists, of one whose lists are empty.
  std::size_t least_bytes() const {
    std::size_t sum = 0;
    for (const PlyProperty& p : properties) sum += size_of(p.count_type.value_or(p.type));
    return sum;
  }
};

struct PlyHeader {
  bool text = false, big_endian = false;
  std::vector<PlyElement> elements;  ///< up to the vertices
  std::array<std::size_t, 3> xyz{};  ///< properties of the vertices
};

NumberType ply_type(const ScanLines& lines, std::string_view word) {
  constexpr std::pair<std::string_view, NumberType> kTypes[] = {
      {"char", NumberType::kI8},     {"int8", NumberType::kI8},     {"uchar", NumberType::kU8},
      {"uint8", NumberType::kU8},    {"short", NumberType::kI16},   {"int16", NumberType::kI16},
      {"ushort", NumberType::kU16},  {"uint16", NumberType::kU16},  {"int", NumberType::kI32},
      {"int32", NumberType::kI32},   {"uint", NumberType::kU32},    {"uint32", NumberType::kU32},
      {"float", NumberType::kF32},   {"float32", NumberType::kF32}, {"double", NumberType::kF64},
      {"float64", NumberType::kF64},
  };
  for (const auto& [name, type] : kTypes)
    if (word == name) return type;
  lines.fail(fmt::format("'{}' is no type of PLY, such as float or double", shown(word)));
}

PlyProperty ply_property(const ScanLines& lines, std::string_view line) {
  PlyProperty property;
  std::string_view word = next_word(line);
  if (word == "list") {
    property.count_type = ply_type(lines, next_word(line));
    if (*property.count_type == NumberType::kF32 || *property.count_type == NumberType::kF64)
      lines.fail("a list's length must have a type of integers");
    word = next_word(line);
  }
  property.type = ply_type(lines, word);
  property.name = next_word(line);
  return property;
}

void read_ply_format(const ScanLines& lines, std::string_view line, PlyHeader& header) {
  const std::string_view format = next_word(line), version = next_word(line);
  header.text = format == "ascii";
  header.big_endian = format == "binary_big_endian";
  if ((!header.text && !header.big_endian && format != "binary_little_endian") || version != "1.0")
    lines.fail(
        fmt::format("has the format '{} {}'; it must be ascii, binary_little_endian or "
                    "binary_big_endian, and 1.0",
                    shown(format), shown(version)));
}

/// Finds x, y and z of the vertices.
void find_ply_xyz(const ScanLines& lines, PlyHeader& header) {
  if (header.elements.empty() || header.elements.back().name != "vertex")
    lines.fail("the header has no 'element vertex'");
  const auto& properties = header.elements.back().properties;
  for (std::size_t k = 0; k < 3; ++k) {
    const std::string name(1, static_cast<char>('x' + k));
    const auto is_it = [&](const PlyProperty& p) { return p.name == name; };
    const auto at = std::find_if(properties.begin(), properties.end(), is_it);
    if (at == properties.end() || at->count_type)
      lines.fail(fmt::format("'element vertex' has no number 'property float {}'", name));
    if (std::find_if(at + 1, properties.end(), is_it) != properties.end())
      lines.fail(fmt::format("'element vertex' has two properties '{}'", name));
    header.xyz[k] = static_cast<std::size_t>(at - properties.begin());
  }
}

/// Reads the lines up to the data.
PlyHeader read_ply_header(ScanLines& lines) {
  PlyHeader header;
  bool has_format = false, done = false;
  std::string_view line;
  lines.next(line);  // "ply"
  while (lines.next(line)) {
    const std::string_view what = next_word(line);
    if (what == "format") {
      read_ply_format(lines, line, header);
      has_format = true;
    } else if (what == "element") {
      done = done || (!header.elements.empty() && header.elements.back().name == "vertex");
      if (done) continue;
      PlyElement& element = header.elements.emplace_back();
      element.name = next_word(line);
      const std::string_view count = next_word(line);
      const auto n = parsed<std::uint64_t>(count);
      if (!n) lines.fail(fmt::format("'{}' is no number of elements", shown(count)));
      element.count = *n;
    } else if (what == "property") {
      if (header.elements.empty()) lines.fail("a property precedes all elements");
      PlyProperty property = ply_property(lines, line);
      if (!done) header.elements.back().properties.push_back(std::move(property));
    } else if (what == "end_header") {
      if (!has_format) lines.fail("the header has no line 'format'");
      find_ply_xyz(lines, header);
      return header;
    } else if (what != "comment" && what != "obj_info" && !what.empty()) {
      lines.fail(
          fmt::format("'{}' is no line of a PLY header, which 'end_header' must end", shown(what)));
    }
  }
  lines.fail("ends within the header; 'end_header' must end it");
}

void read_ply_text(ScanLines& lines, const PlyHeader& header, CloudBuilder& cloud) {
  std::string_view line;
  for (const PlyElement& element : header.elements) {
    const bool is_vertex = &element == &header.elements.back();
    if (element.properties.empty()) continue;
    for (std::uint64_t i = 0; i < element.count; ++i) {
      do {
        if (!lines.next(line))
          lines.fail(fmt::format("is the last line, after {} of {} elements '{}'", i, element.count,
                                 shown(element.name)));
      } while (line.find_first_not_of(" \t") == line.npos);
      if (!is_vertex) continue;
      Vec3 p;
      for (std::size_t k = 0; k < element.properties.size(); ++k) {
        const PlyProperty& property = element.properties[k];
        const double value = lines.number(next_word(line), property.name);
        for (double left = property.count_type ? value : 0; left >= 1; --left)
          lines.number(next_word(line), property.name);
        for (std::size_t j = 0; j < 3; ++j)
          if (header.xyz[j] == k) p[static_cast<Eigen::Index>(j)] = value;
      }
      lines.add(cloud, p);
    }
  }
}

/// Goes through elements of different sizes in a binary file.
class PlyWalk {
 public:
  PlyWalk(const std::filesystem::path& file, std::string_view bytes, std::size_t at, bool swap)
      : file_(file), bytes_(bytes), at_(at), swap_(swap) {}

  /// Moves behind an element. @param begins where each of its properties begins
  void go_behind(const PlyElement& element, std::vector<const char*>& begins) {
    begins.clear();
    for (const PlyProperty& property : element.properties) {
      begins.push_back(bytes_.data() + at_);
      const NumberType type = property.count_type.value_or(property.type);
      const char* number = take(1, size_of(type));
      if (!property.count_type) continue;
      const double length = number_at(number, type, swap_);
      if (length < 0)
        throw InputError(
            file_, fmt::format("has a list of {} numbers at byte {}", length, at_ - size_of(type)));
      take(static_cast<std::uint64_t>(length), size_of(property.type));
    }
  }
  std::size_t at() const { return at_; }

 private:
  const char* take(std::uint64_t count, std::size_t size) {
    require_fit(file_, bytes_, at_, count, size, "numbers");
    at_ += static_cast<std::size_t>(count) * size;
    return bytes_.data() + at_ - static_cast<std::size_t>(count) * size;
  }

  const std::filesystem::path& file_;
  std::string_view bytes_;
  std::size_t at_ = 0;
  bool swap_ = false;
};

void read_ply_binary(const std::filesystem::path& file, std::string_view bytes, std::size_t at,
                     const PlyHeader& header, CloudBuilder& cloud) {
  std::vector<const char*> begins;
  for (const PlyElement& element : header.elements) {
    const bool is_vertex = &element == &header.elements.back();
    const std::size_t size = element.least_bytes();
    require_fit(file, bytes, at, element.count, size, "elements '" + element.name + "'");
    const auto count = static_cast<std::size_t>(element.count);
    if (is_vertex) cloud.expect(count);
    Axes axes;
    if (!element.has_lists()) {
      std::array<std::size_t, 3> offsets{};
      for (std::size_t j = 0; j < 3; ++j)
        for (std::size_t k = 0; is_vertex && k < header.xyz[j]; ++k)
          offsets[j] += size_of(element.properties[k].type);
      for (std::size_t j = 0; is_vertex && j < 3; ++j)
        axes[j] = {bytes.data() + at + offsets[j], size, element.properties[header.xyz[j]].type};
      if (is_vertex) add_points(file, cloud, axes, count, header.big_endian);
      if (size > 0) at += count * size;
      continue;
    }
    PlyWalk walk(file, bytes, at, header.big_endian);
    for (std::size_t i = 0; i < count; ++i) {
      walk.go_behind(element, begins);
      for (std::size_t j = 0; is_vertex && j < 3; ++j)
        axes[j] = {begins[header.xyz[j]], 0, element.properties[header.xyz[j]].type};
      if (is_vertex) add_points(file, cloud, axes, 1, header.big_endian);
    }
    at = walk.at();
  }
}

}  // namespace

PointCloud read_ply_points(const std::filesystem::path& file, std::string_view bytes) {
  ScanLines lines(file, bytes);
  const PlyHeader header = read_ply_header(lines);
  CloudBuilder cloud;
  if (header.text)
    read_ply_text(lines, header, cloud);
  else
    read_ply_binary(file, bytes, lines.at(), header, cloud);
  return cloud.take();
}

}  // namespace soilvdb::inline v0::io
