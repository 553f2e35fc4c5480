// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Points as text: XYZ, CSV, PTS.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <optional>
#include <vector>

#include "io/file/text.h"
#include "io/scan/scan_formats.h"
#include "soilvdb/io/csv.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::array<const char*, 3> kCoordinates = {"x", "y", "z"};
constexpr std::string_view kSpaces = " \t";

/// A semicolon or a comma, or else spaces: decimal commas thus become no columns.
char separator_of(std::string_view line) {
  for (const char c : {';', ','})
    if (line.find(c) != line.npos) return c;
  return ' ';
}

std::string_view without_spaces(std::string_view field) {
  field.remove_prefix(std::min(field.find_first_not_of(kSpaces), field.size()));
  field.remove_suffix(field.size() - (field.find_last_not_of(kSpaces) + 1));
  if (field.size() >= 2 && field.front() == '"' && field.back() == '"')
    field = field.substr(1, field.size() - 2);
  return field;
}

/// The fields of a line, up to `most`.
void split_columns(std::string_view line, char separator, std::size_t most,
                   std::vector<std::string_view>& fields) {
  fields.clear();
  while (fields.size() < most) {
    if (separator == ' ') {
      const std::string_view word = next_word(line);
      if (word.empty()) return;
      fields.push_back(word);
      continue;
    }
    const std::size_t end = line.find(separator);
    fields.push_back(without_spaces(line.substr(0, end)));
    if (end == line.npos) return;
    line.remove_prefix(end + 1);
  }
}

/// Columns of x, y, z by the names of a header.
std::array<std::size_t, 3> columns_of(const ScanLines& lines,
                                      const std::vector<std::string_view>& names) {
  std::array<std::size_t, 3> columns{};
  for (std::size_t k = 0; k < columns.size(); ++k) {
    const auto is_it = [&](std::string_view name) {
      return lower_case(std::string(name)) == kCoordinates[k];
    };
    const auto at = std::find_if(names.begin(), names.end(), is_it);
    if (at == names.end())
      lines.fail(
          fmt::format("has neither three numbers nor a column '{}': its columns must be x, "
                      "y, z, or named so",
                      kCoordinates[k]));
    if (std::find_if(at + 1, names.end(), is_it) != names.end())
      lines.fail(fmt::format("has two columns '{}'", kCoordinates[k]));
    columns[k] = static_cast<std::size_t>(at - names.begin());
  }
  return columns;
}

}  // namespace

PointCloud read_text_points(const std::filesystem::path& file, std::string_view bytes) {
  if (bytes.starts_with("\xEF\xBB\xBF")) bytes.remove_prefix(3);
  CloudBuilder cloud;
  ScanLines lines(file, bytes);
  std::string_view line;
  std::vector<std::string_view> fields;
  char separator = 0;  // unknown before the first line
  bool counted = false;
  std::array<std::size_t, 3> columns = {0, 1, 2};
  std::size_t wanted = 3;  // columns
  while (lines.next(line)) {
    const std::string_view begin = without_spaces(line);
    if (begin.empty() || begin.starts_with('#') || begin.starts_with("//")) continue;
    if (separator == 0) {
      separator = separator_of(line);
      split_columns(line, separator, line.size() + 1, fields);
      if (fields.size() == 1 && !counted && parsed<std::uint64_t>(fields[0])) {
        counted = true;
        separator = 0;
        continue;
      }
      if (!parse_number(fields[0])) {
        columns = columns_of(lines, fields);
        wanted = *std::max_element(columns.begin(), columns.end()) + 1;
        continue;
      }
    }
    split_columns(line, separator, wanted, fields);
    if (fields.size() < wanted)
      lines.fail(fmt::format("has {} column{}; at least {} are needed for x, y and z",
                             fields.size(), fields.size() == 1 ? "" : "s", wanted));
    Vec3 p;
    for (std::size_t k = 0; k < columns.size(); ++k)
      p[static_cast<Eigen::Index>(k)] = lines.number(fields[columns[k]], kCoordinates[k]);
    lines.add(cloud, p);
  }
  return cloud.take();
}

}  // namespace soilvdb::inline v0::io
