// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What the readers of text files share: the whole file as a string, strict numbers, and words for
// messages.
#pragma once

#include <charconv>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "soilvdb/io/error.h"

namespace soilvdb::inline v0::io {

/// Largest magnitude of a number in an input file: beyond it is a slip, or metres taken for
/// millimetres.
inline constexpr double kMaxNumber = 1e9;

/// @throw InputError unless `file` is there, a file (no folder, no device), and can be read.
void check_readable(const std::filesystem::path& file);

/// The whole file. @throw InputError also if it is empty, larger than `max_bytes` or not text.
std::string read_text(const std::filesystem::path& file, std::size_t max_bytes);

/// The number of a type that fills all of `text`; nothing otherwise. Independent of the locale. May
/// be NaN or infinite.
template <typename T>
std::optional<T> parsed(std::string_view text) {
  T value{};
  const char* end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, value);
  if (error != std::errc() || stop != end) return std::nullopt;
  return value;
}

/// The same, where a number may have a plus.
std::optional<double> parse_number(std::string_view text);

/// `text` with ASCII's capital letters made small, whatever the locale.
std::string lower_case(std::string text);

/// The file's suffix with its dot, in small letters: ".obj".
std::string suffix_of(const std::filesystem::path& file);

/// `text` on one line, without control characters, cut to a length fit for a message.
std::string printable(std::string_view text);

/// The shortest candidate that begins with `word`, else the one with the fewest insertions,
/// deletions, changes and swaps of letters from it; the first of equals; empty if there are none.
std::string nearest(std::string_view word, std::span<const std::string> candidates);

/// 'a', 'b' and 'c'
std::string quoted_list(std::span<const std::string> words);

/// `path` as an argument for a shell.
std::string shell_quoted(const std::filesystem::path& path);

}  // namespace soilvdb::inline v0::io
