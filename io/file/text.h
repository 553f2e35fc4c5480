// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Helpers of the text file readers: whole files as strings, strict numbers, and words for messages.
#pragma once

#include <charconv>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "soilvdb/io/error.h"

namespace soilvdb::inline v0::io {

/// Largest magnitude of a number in an input file. A larger one is an error, such as millimetres
/// for metres.
inline constexpr double kMaxNumber = 1e9;

/// @throw InputError unless `file` exists, is a regular file and is readable.
void check_readable(const std::filesystem::path& file);

/// The whole file. @throw InputError also if it is empty, larger than `max_bytes` or not text.
std::string read_text(const std::filesystem::path& file, std::size_t max_bytes);

/// The number that fills all of `text`; empty otherwise. Independent of the locale. May be NaN or
/// infinite.
template <typename T>
std::optional<T> parsed(std::string_view text) {
  T value{};
  const char* end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, value);
  if (error != std::errc() || stop != end) return std::nullopt;
  return value;
}

/// As above, for numbers that may begin with a plus.
std::optional<double> parse_number(std::string_view text);

/// `text` with ASCII capitals in lower case, in any locale.
std::string lower_case(std::string text);

/// The file's suffix with its dot, in lower case: ".obj".
std::string suffix_of(const std::filesystem::path& file);

/// `text` on one line, without control characters, cut to a length for messages.
std::string printable(std::string_view text);

/// The shortest candidate that begins with `word`, else the one with the smallest edit distance to
/// it (insertions, deletions, changes, swaps of neighbours); the first of equals; empty if there is
/// no candidate.
std::string nearest(std::string_view word, std::span<const std::string> candidates);

/// 'a', 'b' and 'c'
std::string quoted_list(std::span<const std::string> words);

/// A field of a CSV file, quoted as in RFC 4180.
std::string csv_field(std::string_view text);

/// `text` with entities in place of &, <, > and ", for XML and HTML.
std::string markup_text(std::string_view text);

/// `path` as an argument for a shell.
std::string shell_quoted(const std::filesystem::path& path);

}  // namespace soilvdb::inline v0::io
