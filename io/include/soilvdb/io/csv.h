// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Lines and fields of a CSV file, one line in memory at a time.
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "soilvdb/io/error.h"

namespace soilvdb::inline v0::io {

/// A line is wrong; later lines can still be read.
struct LineError : InputError {
  using InputError::InputError;
};

/// Where a row of a motion begins: bytes and lines before it. In MCAP files: the row's stamp in
/// nanoseconds, and the messages before the row's own.
struct RowMark {
  std::int64_t bytes = 0;
  long lines = 0;
  std::uint32_t file = 0, item = 0;  ///< number of the file, of several; of the item in its message
  std::vector<int> turns = {};       ///< whole turns of joints that wrap; empty if no joint wraps
  long line() const { return lines + 1; }  ///< number of the next line
};

/// The current line, or message, of a file.
class RowPlace {
 public:
  /// @param noun name of these items, "line" or "message"
  RowPlace(std::filesystem::path file, const char* noun) : file_(std::move(file)), noun_(noun) {}

  const std::filesystem::path& file() const { return file_; }
  long number() const { return number_; }
  const char* noun() const { return noun_; }

  /// @throw LineError for the current line.
  [[noreturn]] void fail(const std::string& message) const {
    throw LineError(file_, number_, message);
  }

 protected:
  std::filesystem::path file_;
  long number_ = 0;

 private:
  const char* noun_;
};

/// The lines of a text file, with their numbers. A byte order mark is skipped.
class CsvLines : public RowPlace {
 public:
  /// @throw InputError unless the file exists and can be read.
  explicit CsvLines(const std::filesystem::path& file);

  /// @param line without its line end; valid until the next call
  /// @return false at the end of the file
  /// @throw LineError if the line is too long or not text; InputError if the file can't be read
  bool next(std::string_view& line);

  RowMark mark() const { return {bytes_, number_}; }  ///< of the next line
  /// Continues from a mark of the same file.
  void go_to(const RowMark& mark);

 private:
  std::ifstream in_;
  std::vector<char> buffer_;
  std::int64_t bytes_ = 0;
};

/// Does the line hold only spaces, tabs and carriage returns?
bool is_blank(std::string_view line);

/// Fields between commas, trimmed, without their quotes; a quoted field may hold commas.
void split_fields(std::string_view line, std::vector<std::string_view>& fields);

}  // namespace soilvdb::inline v0::io
