// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Points of a PCD file, the format of PCL.
#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <optional>
#include <stdexcept>
#include <vector>

#include "io/file/text.h"
#include "io/scan/scan_formats.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::uint64_t kMostFieldNumbers = 1 << 20;  // COUNT of a field; histograms have hundreds

struct PcdField {
  std::string name;
  NumberType type = NumberType::kF32;
  std::uint64_t size = 4, count = 1;

  std::uint64_t bytes() const { return size * count; }
  bool is_padding() const { return name == "_"; }
};

struct PcdHeader {
  std::vector<PcdField> fields;
  std::array<std::size_t, 3> xyz{};  ///< fields
  std::uint64_t points = 0;
  std::string data;  ///< ascii, binary, binary_compressed
};

std::uint64_t pcd_integer(const ScanLines& lines, std::string_view word, const char* what) {
  const auto value = parsed<std::uint64_t>(word);
  if (!value) lines.fail(fmt::format("{} is '{}'; it must be a whole number", what, shown(word)));
  return *value;
}

/// The type that a field's TYPE and SIZE mean. @throw InputError if there is none
NumberType pcd_type(const ScanLines& lines, const PcdField& field, char letter) {
  constexpr NumberType kTypes[] = {
      NumberType::kI8,  NumberType::kI16, NumberType::kI32, NumberType::kI64, NumberType::kU8,
      NumberType::kU16, NumberType::kU32, NumberType::kU64, NumberType::kF32, NumberType::kF64};
  for (const NumberType type : kTypes) {
    const char its = type >= NumberType::kF32 ? 'F' : static_cast<int>(type) % 2 == 0 ? 'I' : 'U';
    if (its == letter && size_of(type) == field.size) return type;
  }
  lines.fail(
      fmt::format("field '{}' has type '{}' and size {}; there are I and U of 1, 2, 4 and 8 "
                  "bytes, and F of 4 and 8",
                  shown(field.name), shown({&letter, 1}), field.size));
}

/// Calls `set(field, word)` for each field and its word.
template <typename F>
void for_pcd_fields(const ScanLines& lines, std::string_view line, const char* what,
                    std::vector<PcdField>& fields, F set) {
  if (fields.empty()) lines.fail(fmt::format("{} precedes FIELDS", what));
  for (PcdField& field : fields) {
    const std::string_view word = next_word(line);
    if (word.empty())
      lines.fail(fmt::format("{} has too few words for {} fields", what, fields.size()));
    set(field, word);
  }
  if (!next_word(line).empty())
    lines.fail(fmt::format("{} has more words than the {} fields", what, fields.size()));
}

void find_pcd_xyz(const ScanLines& lines, PcdHeader& header) {
  for (std::size_t k = 0; k < 3; ++k) {
    const std::string name(1, static_cast<char>('x' + k));
    std::optional<std::size_t> at;
    for (std::size_t i = 0; i < header.fields.size(); ++i) {
      if (header.fields[i].name != name) continue;
      if (at) lines.fail(fmt::format("FIELDS has two fields '{}'", name));
      at = i;
    }
    if (!at || header.fields[*at].count != 1)
      lines.fail(fmt::format("FIELDS has no field '{}' with COUNT 1", name));
    header.xyz[k] = *at;
  }
}

using PcdInteger = std::optional<std::uint64_t>;

/// @throw InputError if the three contradict each other, or don't tell it
std::uint64_t pcd_count(const ScanLines& lines, const PcdInteger& width, const PcdInteger& height,
                        const PcdInteger& points) {
  if (!points && !width) lines.fail("the header has no number of POINTS");
  if (!width) return *points;
  const std::uint64_t high = height.value_or(1);
  const bool fits = high == 0 || *width <= UINT64_MAX / high;
  const std::uint64_t count = fits ? *width * high : UINT64_MAX;
  if (points && *points != count)
    lines.fail(fmt::format("WIDTH {} times HEIGHT {} isn't POINTS, {}", *width, high, *points));
  return count;
}

/// Reads the lines up to the data. VERSION and VIEWPOINT are not looked at.
PcdHeader read_pcd_header(ScanLines& lines) {
  PcdHeader header;
  PcdInteger width, height, points;
  bool has_size = false, has_type = false;
  std::string letters;
  std::string_view line;
  while (lines.next(line)) {
    const std::string_view what = next_word(line);
    if (what.empty() || what.starts_with('#')) continue;
    if (what == "FIELDS" || what == "COLUMNS") {
      header.fields.clear();
      for (std::string_view w = next_word(line); !w.empty(); w = next_word(line))
        header.fields.emplace_back().name = w;
    } else if (what == "SIZE") {
      has_size = true;
      for_pcd_fields(lines, line, "SIZE", header.fields, [&](PcdField& field, auto word) {
        field.size = pcd_integer(lines, word, "a SIZE");
      });
    } else if (what == "TYPE") {
      has_type = true;
      letters.clear();
      for_pcd_fields(lines, line, "TYPE", header.fields, [&](PcdField&, std::string_view word) {
        letters += word.size() == 1 ? word[0] : '?';
      });
    } else if (what == "COUNT") {
      for_pcd_fields(lines, line, "COUNT", header.fields, [&](PcdField& field, auto word) {
        field.count = pcd_integer(lines, word, "a COUNT");
        if (field.count < 1 || field.count > kMostFieldNumbers)
          lines.fail(fmt::format("a COUNT is {}; it must be from 1 to {}", field.count,
                                 kMostFieldNumbers));
      });
    } else if (what == "WIDTH") {
      width = pcd_integer(lines, next_word(line), "WIDTH");
    } else if (what == "HEIGHT") {
      height = pcd_integer(lines, next_word(line), "HEIGHT");
    } else if (what == "POINTS") {
      points = pcd_integer(lines, next_word(line), "POINTS");
    } else if (what == "DATA") {
      header.data = next_word(line);
      break;
    } else if (what != "VERSION" && what != "VIEWPOINT") {
      lines.fail(fmt::format("'{}' is no line of a PCD header, which DATA must end", shown(what)));
    }
  }
  if (header.data != "ascii" && header.data != "binary" && header.data != "binary_compressed")
    lines.fail("the header must end with DATA ascii, DATA binary or DATA binary_compressed");
  if (header.fields.empty() || !has_size || !has_type || letters.size() != header.fields.size())
    lines.fail("the header needs the lines FIELDS, SIZE and TYPE before DATA");
  for (std::size_t i = 0; i < header.fields.size(); ++i)
    header.fields[i].type = pcd_type(lines, header.fields[i], letters[i]);
  find_pcd_xyz(lines, header);
  header.points = pcd_count(lines, width, height, points);
  return header;
}

void read_pcd_text(ScanLines& lines, const PcdHeader& header, CloudBuilder& cloud) {
  std::string_view line;
  for (std::uint64_t i = 0; i < header.points; ++i) {
    do {
      if (!lines.next(line))
        lines.fail(fmt::format("is the last line, after {} of {} points", i, header.points));
    } while (line.find_first_not_of(" \t") == line.npos);
    Vec3 p;
    for (std::size_t k = 0; k < header.fields.size(); ++k) {
      const PcdField& field = header.fields[k];
      for (std::uint64_t n = 0; n < field.count; ++n) {
        const std::string_view word = next_word(line);
        if (word.empty())
          lines.fail(fmt::format("ends before the point's field '{}'", shown(field.name)));
        for (std::size_t j = 0; j < 3; ++j)
          if (header.xyz[j] == k) p[static_cast<Eigen::Index>(j)] = lines.number(word, field.name);
      }
    }
    lines.add(cloud, p);
  }
}

/// Bytes of a point, or before a field of it.
std::uint64_t pcd_bytes(const PcdHeader& header, std::size_t fields, bool padding) {
  std::uint64_t sum = 0;
  for (std::size_t k = 0; k < fields; ++k)
    if (padding || !header.fields[k].is_padding()) sum += header.fields[k].bytes();
  return sum;
}

void read_pcd_binary(const std::filesystem::path& file, std::string_view bytes, std::size_t at,
                     const PcdHeader& header, CloudBuilder& cloud) {
  const std::uint64_t size = pcd_bytes(header, header.fields.size(), true);
  require_fit(file, bytes, at, header.points, size, "points");
  Axes axes;
  for (std::size_t j = 0; j < 3; ++j)
    axes[j] = {bytes.data() + at + pcd_bytes(header, header.xyz[j], true), size,
               header.fields[header.xyz[j]].type};
  const auto count = static_cast<std::size_t>(header.points);
  cloud.expect(count);
  add_points(file, cloud, axes, count, false);
}

/// Of a compressed file each field is in one piece.
void read_pcd_compressed(const std::filesystem::path& file, std::string_view bytes, std::size_t at,
                         const PcdHeader& header, CloudBuilder& cloud) {
  std::uint32_t packed = 0, unpacked = 0;
  if (bytes.size() - at < sizeof packed + sizeof unpacked)
    throw InputError(file, fmt::format("is truncated: the sizes of its compressed bytes, at byte "
                                       "{}, are missing",
                                       at));
  std::memcpy(&packed, bytes.data() + at, sizeof packed);
  std::memcpy(&unpacked, bytes.data() + at + sizeof packed, sizeof unpacked);
  at += sizeof packed + sizeof unpacked;
  if (packed > bytes.size() - at)
    throw InputError(file, fmt::format("is truncated: {} compressed bytes, from byte {} on, don't "
                                       "fit into a file of {} bytes",
                                       packed, at, bytes.size()));
  // PCL leaves out padding here.
  bool padding = false;
  const auto size = [&] { return pcd_bytes(header, header.fields.size(), padding); };
  const auto fits = [&] { return unpacked / size() == header.points && unpacked % size() == 0; };
  if (!fits()) padding = true;
  if (!fits())
    throw InputError(
        file, fmt::format("is damaged: at byte {} it claims {} bytes; the points have {} x {}",
                          at - sizeof unpacked, unpacked, header.points, size()));
  std::string data;
  try {
    data = decompress_lzf(bytes.substr(at, packed), unpacked);
  } catch (const std::invalid_argument& e) {
    throw InputError(
        file, fmt::format("is damaged: the compressed block from byte {} on {}", at, e.what()));
  }
  Axes axes;
  for (std::size_t j = 0; j < 3; ++j) {
    const PcdField& field = header.fields[header.xyz[j]];
    axes[j] = {data.data() + pcd_bytes(header, header.xyz[j], padding) * header.points, field.size,
               field.type};
  }
  const auto count = static_cast<std::size_t>(header.points);
  cloud.expect(count);
  add_points(file, cloud, axes, count, false);
}

}  // namespace

PointCloud read_pcd_points(const std::filesystem::path& file, std::string_view bytes) {
  ScanLines lines(file, bytes);
  const PcdHeader header = read_pcd_header(lines);
  CloudBuilder cloud;
  if (header.data == "ascii")
    read_pcd_text(lines, header, cloud);
  else if (header.data == "binary")
    read_pcd_binary(file, bytes, lines.at(), header, cloud);
  else
    read_pcd_compressed(file, bytes, lines.at(), header, cloud);
  return cloud.take();
}

}  // namespace soilvdb::inline v0::io
