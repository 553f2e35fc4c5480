// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The readers of each format of scans, and the lines of those that are text.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

#include "io/scan/cloud_builder.h"

namespace soilvdb::inline v0::io {

/// Each reads the whole content of a file. @throw InputError
PointCloud read_ply_points(const std::filesystem::path& file, std::string_view bytes);
PointCloud read_pcd_points(const std::filesystem::path& file, std::string_view bytes);
PointCloud read_las_points(const std::filesystem::path& file, std::string_view bytes);
PointCloud read_text_points(const std::filesystem::path& file, std::string_view bytes);

/// Decompresses a block of LZF, which is `size` bytes long without compression. Memory for the
/// result is only taken if the block can be so long.
/// @throw std::invalid_argument if it is no such block; the message lacks its subject
std::string decompress_lzf(std::string_view block, std::size_t size);

/// The lines of a content, with their numbers.
class ScanLines {
 public:
  ScanLines(const std::filesystem::path& file, std::string_view bytes)
      : file_(file), bytes_(bytes) {}

  /// @param line without its line end @return false at the end
  bool next(std::string_view& line);
  std::string_view rest() const { return bytes_.substr(at_); }  ///< behind the line
  std::size_t at() const { return at_; }                        ///< offset of rest()
  /// @throw InputError for the line
  [[noreturn]] void fail(const std::string& what) const { throw InputError(file_, number_, what); }
  /// A coordinate or another number. @throw InputError
  double number(std::string_view word, std::string_view name) const;
  /// Adds a point of this line. @throw InputError
  void add(CloudBuilder& cloud, const Vec3& p) const;

 private:
  const std::filesystem::path& file_;
  std::string_view bytes_;
  std::size_t at_ = 0;
  long number_ = 0;
};

/// Removes the next word, between spaces and tabs, from a line; empty at its end.
std::string_view next_word(std::string_view& line);

/// A part of a file for messages, as printable() has it, also of a file that is no text.
std::string shown(std::string_view text);

/// @param at offset of the first record
/// @throw InputError if `count` records of `size` bytes don't fit into the file
void require_fit(const std::filesystem::path& file, std::string_view bytes, std::size_t at,
                 std::uint64_t count, std::uint64_t size, const std::string& what);

/// Adds `count` points, whose bytes the caller has found. @throw InputError if one is too far
void add_points(const std::filesystem::path& file, CloudBuilder& cloud, const Axes& axes,
                std::size_t count, bool swap);

}  // namespace soilvdb::inline v0::io
