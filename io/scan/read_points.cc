// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Finds the format of a scan.
#include <fmt/format.h>

#include <algorithm>
#include <fstream>

#include "io/file/json.h"
#include "io/file/text.h"
#include "io/scan/scan_formats.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::uintmax_t kMostScanBytes = std::uintmax_t{1} << 32;
constexpr std::size_t kTextBegin = 4096;  // bytes that show whether it is text

std::string scan_bytes(const std::filesystem::path& file) {
  check_readable(file);
  const std::uintmax_t size = std::filesystem::file_size(file);
  if (size > kMostScanBytes)
    throw InputError(file,
                     fmt::format("is larger than {} GB; cut it into parts", kMostScanBytes >> 30));
  std::string bytes(static_cast<std::size_t>(size), '\0');
  std::ifstream in(file, std::ios::binary);
  in.read(bytes.data(), std::ssize(bytes));
  if (in.gcount() != std::ssize(bytes)) throw InputError(file, "can't be read to its end");
  return bytes;
}

bool is_pcd(const std::filesystem::path& file, std::string_view bytes) {
  ScanLines lines(file, bytes.substr(0, kTextBegin));
  std::string_view line;
  while (lines.next(line)) {
    if (line.starts_with("# .PCD")) return true;
    const std::string_view word = next_word(line);
    if (!word.empty() && !word.starts_with('#')) return word == "VERSION" || word == "FIELDS";
  }
  return false;
}

}  // namespace

PointCloud read_points(const std::filesystem::path& file) {
  const std::string bytes = scan_bytes(file);
  const std::string_view view = bytes;
  PointCloud cloud;
  if (view.starts_with("ply\n") || view.starts_with("ply\r")) {
    cloud = read_ply_points(file, view);
  } else if (view.starts_with("LASF")) {
    cloud = read_las_points(file, view);
  } else if (is_pcd(file, view)) {
    cloud = read_pcd_points(file, view);
  } else if (view.starts_with("ASTM-E57") || suffix_of(file) == ".e57") {
    throw InputError(file, fmt::format("is an E57 file, which isn't read; convert it, as by "
                                       "`pdal translate {} {}`, or by CloudCompare",
                                       shell_quoted(file.filename()),
                                       shell_quoted(file.stem().string() + ".las")));
  } else {
    for (const char* format : {".ply", ".pcd", ".las", ".laz"})
      if (suffix_of(file) == format)
        throw InputError(file, fmt::format("is not a {} file: at byte 0 it begins with '{}'",
                                           format + 1, shown(view.substr(0, 8))));
    if (view.substr(0, kTextBegin).find('\0') != view.npos)
      throw InputError(file, "is not a readable scan; use PLY, PCD, LAS, or text with x, y, z");
    cloud = read_text_points(file, view);
  }
  if (cloud.points_m.empty() && cloud.without_return == 0) throw InputError(file, "has no points");
  return cloud;
}

bool ScanLines::next(std::string_view& line) {
  if (at_ >= bytes_.size()) return false;
  const std::size_t end = std::min(bytes_.find('\n', at_), bytes_.size());
  line = bytes_.substr(at_, end - at_);
  if (line.ends_with('\r')) line.remove_suffix(1);
  at_ = std::min(end + 1, bytes_.size());
  ++number_;
  return true;
}

std::string shown(std::string_view text) {
  std::string line = printable(text);
  if (is_utf8(line)) return line;
  std::replace_if(
      line.begin(), line.end(), [](char c) { return static_cast<unsigned char>(c) >= 0x80; }, '?');
  return line;
}

double ScanLines::number(std::string_view word, std::string_view name) const {
  const auto value = parse_number(word);
  if (!value)
    fail(fmt::format("{} is '{}'; it must be a number, such as -1.5e3", name, shown(word)));
  return *value;
}

void ScanLines::add(CloudBuilder& cloud, const Vec3& p) const {
  if (!cloud.add(p)) fail("a point " + CloudBuilder::too_far(p));
}

std::string_view next_word(std::string_view& line) {
  constexpr std::string_view kSpace = " \t";
  line.remove_prefix(std::min(line.find_first_not_of(kSpace), line.size()));
  const std::string_view word = line.substr(0, std::min(line.find_first_of(kSpace), line.size()));
  line.remove_prefix(word.size());
  return word;
}

void require_fit(const std::filesystem::path& file, std::string_view bytes, std::size_t at,
                 std::uint64_t count, std::uint64_t size, const std::string& what) {
  const std::size_t there = bytes.size() - std::min(at, bytes.size());
  if (size == 0 || count <= there / size) return;
  throw InputError(file, fmt::format("is truncated or damaged: {} {} of {} bytes each, from byte "
                                     "{} on, don't fit into a file of {} bytes",
                                     count, what, size, at, bytes.size()));
}

void add_points(const std::filesystem::path& file, CloudBuilder& cloud, const Axes& axes,
                std::size_t count, bool swap) {
  const std::size_t before = cloud.seen();
  if (const auto far = cloud.add(axes, count, swap))
    throw InputError(file, fmt::format("point {} {}", before + *far + 1,
                                       CloudBuilder::too_far(point_at(axes, *far, swap))));
}

}  // namespace soilvdb::inline v0::io
