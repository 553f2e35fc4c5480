// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Lines and fields of a CSV file.
#include "soilvdb/io/csv.h"

#include <fmt/format.h>

#include "io/file/text.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::size_t kLongestLine = 1 << 16;

bool blank(char c) { return c == ' ' || c == '\t' || c == '\r'; }

std::string_view trim(std::string_view s) {
  while (!s.empty() && blank(s.front())) s.remove_prefix(1);
  while (!s.empty() && blank(s.back())) s.remove_suffix(1);
  return s;
}

}  // namespace

CsvLines::CsvLines(const std::filesystem::path& file)
    : RowPlace(file, "line"), buffer_(kLongestLine) {
  check_readable(file);
  in_.open(file, std::ios::binary);
}

bool CsvLines::next(std::string_view& line) {
  in_.getline(buffer_.data(), static_cast<std::streamsize>(buffer_.size()));
  auto length = static_cast<std::size_t>(in_.gcount());
  if (in_.bad()) throw InputError(file(), "can't be read to its end");
  if (in_.eof() && length == 0) return false;
  ++number_;
  bytes_ += static_cast<std::int64_t>(length);
  if (in_.fail()) {
    while (in_.fail() && !in_.eof()) {  // to the line's end
      in_.clear();
      in_.getline(buffer_.data(), static_cast<std::streamsize>(buffer_.size()));
      bytes_ += static_cast<std::int64_t>(in_.gcount());
    }
    fail(fmt::format("line is longer than {} characters", kLongestLine));
  }
  if (!in_.eof()) --length;  // the line end is counted but not stored
  line = {buffer_.data(), length};
  if (line.find('\0') != line.npos) fail("is a binary file; it must be UTF-8 text");
  if (number_ == 1 && line.starts_with("\xEF\xBB\xBF")) line.remove_prefix(3);
  return true;
}

void CsvLines::go_to(const RowMark& mark) {
  in_.clear();
  in_.seekg(mark.bytes);
  bytes_ = mark.bytes;
  number_ = mark.lines;
}

bool is_blank(std::string_view line) { return trim(line).empty(); }

void split_fields(std::string_view line, std::vector<std::string_view>& fields) {
  fields.clear();
  while (true) {
    while (!line.empty() && blank(line.front())) line.remove_prefix(1);
    std::size_t from = 0;
    if (line.starts_with('"')) {
      const auto close = line.find('"', 1);
      if (close != line.npos) from = close;
    }
    const auto comma = line.find(',', from);
    std::string_view field = trim(line.substr(0, comma));
    if (field.size() >= 2 && field.front() == '"' && field.back() == '"') {
      field = trim(field.substr(1, field.size() - 2));
    }
    fields.push_back(field);
    if (comma == line.npos) return;
    line.remove_prefix(comma + 1);
  }
}

}  // namespace soilvdb::inline v0::io
