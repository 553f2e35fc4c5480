// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Text files, numbers and words.
#include "io/file/text.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <utility>
#include <vector>

namespace soilvdb::inline v0::io {
namespace {

constexpr std::size_t kLongestShown = 60;

/// Optimal string alignment distance.
std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> before(b.size() + 1), last(b.size() + 1), row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) last[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      row[j] = std::min({last[j] + 1, row[j - 1] + 1, last[j - 1] + (a[i - 1] != b[j - 1])});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1]) {
        row[j] = std::min(row[j], before[j - 2] + 1);
      }
    }
    before = std::exchange(last, row);
  }
  return last[b.size()];
}

}  // namespace

void check_readable(const std::filesystem::path& file) {
  std::error_code error;
  const auto status = std::filesystem::status(file, error);
  if (status.type() == std::filesystem::file_type::not_found) {
    throw InputError(file, "no such file");
  }
  if (error) throw InputError(file, "can't be read: " + error.message());
  if (std::filesystem::is_directory(status)) {
    throw InputError(file, "is a folder; name a file");
  }
  if (!std::filesystem::is_regular_file(status)) {
    throw InputError(file, "is not a regular file");
  }
  if (!std::ifstream(file)) {
    throw InputError(file, std::string("can't be read: ") + std::strerror(errno));
  }
}

std::string read_text(const std::filesystem::path& file, std::size_t max_bytes) {
  check_readable(file);
  std::ifstream in(file, std::ios::binary);
  std::string text, block(1 << 16, '\0');
  while (text.size() <= max_bytes && in) {
    in.read(block.data(), static_cast<std::streamsize>(block.size()));
    text.append(block, 0, static_cast<std::size_t>(in.gcount()));
  }
  if (in.bad()) throw InputError(file, std::string("can't be read: ") + std::strerror(errno));
  if (text.size() > max_bytes) {
    throw InputError(file, fmt::format("is larger than {} MB; is it the right file?",
                                       max_bytes / (1024 * 1024)));
  }
  if (text.find_first_not_of(" \t\r\n") == std::string::npos) throw InputError(file, "is empty");
  if (text.find('\0') != std::string::npos) {
    throw InputError(file, "is a binary file; it must be UTF-8 text");
  }
  return text;
}

std::optional<double> parse_number(std::string_view text) {
  if (text.starts_with('+') && !text.starts_with("+-")) text.remove_prefix(1);
  return parsed<double>(text);
}

std::string lower_case(std::string text) {
  for (char& c : text)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return text;
}

std::string suffix_of(const std::filesystem::path& file) {
  return lower_case(file.extension().string());
}

std::string printable(std::string_view text) {
  const bool cut = text.size() > kLongestShown;
  if (cut) {
    std::size_t end = kLongestShown;  // not within a UTF-8 character
    while (end > 0 && (static_cast<unsigned char>(text[end]) & 0xC0) == 0x80) --end;
    text = text.substr(0, end);
  }
  const std::string line = one_line(std::string(text));
  return cut ? line + "..." : line;
}

std::string nearest(std::string_view word, std::span<const std::string> candidates) {
  word = word.substr(0, 200);
  // Candidates that begin with the word come first, shortest first.
  const auto distance = [&](const std::string& candidate) {
    const std::size_t edits = edit_distance(word, candidate);
    return std::pair(!word.empty() && candidate.starts_with(word) ? 0 : edits, edits);
  };
  const auto best = std::min_element(
      candidates.begin(), candidates.end(),
      [&](const std::string& a, const std::string& b) { return distance(a) < distance(b); });
  return best == candidates.end() ? std::string() : *best;
}

std::string quoted_list(std::span<const std::string> words) {
  std::string list;
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (i > 0) list += i + 1 == words.size() ? " and " : ", ";
    list += "'" + printable(words[i]) + "'";
  }
  return list;
}

std::string csv_field(std::string_view text) {
  if (text.find_first_of(",\"\r\n") == std::string_view::npos) return std::string(text);
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? std::string("\"\"") : std::string(1, c);
  return quoted + '"';
}

std::string markup_text(std::string_view text) {
  std::string markup;
  for (const char c : text)
    if (c == '&')
      markup += "&amp;";
    else if (c == '<')
      markup += "&lt;";
    else if (c == '>')
      markup += "&gt;";
    else if (c == '"')
      markup += "&quot;";
    else
      markup += c;
  return markup;
}

std::string shell_quoted(const std::filesystem::path& path) {
  const std::string text = path.string();
  const bool plain = !text.empty() && std::all_of(text.begin(), text.end(), [](unsigned char c) {
    return std::isalnum(c) || std::string_view("/._-+:,@=").find(char(c)) != std::string_view::npos;
  });
  if (plain && text[0] != '-') return text;
  std::string quoted = text[0] == '-' ? "./'" : "'";
  for (const char c : text) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

}  // namespace soilvdb::inline v0::io
