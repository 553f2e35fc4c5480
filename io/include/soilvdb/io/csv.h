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

/// One line is wrong; the lines after it can be read.
struct LineError : InputError {
  using InputError::InputError;
};

/// Where rows of a motion begin: bytes and lines before them. Of MCAP files: the row's stamp in
/// nanoseconds, and the messages before the row's own.
struct RowMark {
  std::int64_t bytes = 0;
  long lines = 0;
  std::uint32_t file = 0, item = 0;        ///< of several files; of a message
  std::vector<int> turns = {};             ///< that joints which wrap have made, if any does
  long line() const { return lines + 1; }  ///< the number of the next one
};

/// The line, or message, of a file that is being looked at.
class RowPlace {
 public:
  /// @param noun what it is called
  RowPlace(std::filesystem::path file, const char* noun) : file_(std::move(file)), noun_(noun) {}

  const std::filesystem::path& file() const { return file_; }
  long number() const { return number_; }
  const char* noun() const { return noun_; }

  /// @throw LineError at the current line.
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
  /// @throw InputError unless the file is there and can be read.
  explicit CsvLines(const std::filesystem::path& file);

  /// @param line without its end; good until the next call
  /// @return false at the end of the file
  /// @throw LineError if the line is too long or not text; InputError if the file can't be read
  bool next(std::string_view& line);

  RowMark mark() const { return {bytes_, number_}; }  ///< of the line that comes next
  /// Goes on from a mark of the same file.
  void go_to(const RowMark& mark);

 private:
  std::ifstream in_;
  std::vector<char> buffer_;
  std::int64_t bytes_ = 0;
};

/// Nothing but spaces, tabs and carriage returns?
bool is_blank(std::string_view line);

/// Fields between commas, trimmed, without their quotes; a quoted field may hold commas.
void split_fields(std::string_view line, std::vector<std::string_view>& fields);

}  // namespace soilvdb::inline v0::io
