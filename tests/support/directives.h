// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Files with printf's directives in the place of their words: where a library takes text of a file
// for a format, reading them ends in a crash.
#pragma once

#include <cctype>
#include <string>

namespace soilvdb::test {

/// More directives than a function's arguments: some come to what is no address.
inline std::string directives() {
  std::string text;
  while (text.size() < 256) text += "%s%n%s%hhn%ls%1$n%99999$s";
  return text;
}

/// Calls `use` for each word of `bytes` and each text in double quotes, with `bytes` in which that
/// one is directives: once of its own length, for what counts bytes, once of all of them.
/// @param least length of a word; what is shorter stays
template <typename F>
void with_directives(const std::string& bytes, F&& use, std::size_t least = 1) {
  const auto in_word = [](char c) {
    const auto byte = static_cast<unsigned char>(c);
    return std::isalnum(byte) || byte >= 0x80 || c == '_' || c == '.' || c == '-' || c == '+';
  };
  const std::string all = directives();
  const auto replace = [&](std::size_t first, std::size_t end) {
    std::string text = bytes;
    use(text.replace(first, end - first, all, 0, end - first));
    text = bytes;
    use(text.replace(first, end - first, all));
  };
  for (std::size_t first = 0, end = 0; first < bytes.size(); first = end + 1) {
    for (end = first; end < bytes.size() && in_word(bytes[end]);) ++end;
    if (end >= first + least) replace(first, end);
  }
  for (std::size_t quote = bytes.find('"'); quote != bytes.npos;) {
    const std::size_t end = bytes.find('"', quote + 1);
    if (end == bytes.npos) break;
    replace(quote + 1, end);
    quote = bytes.find('"', end + 1);
  }
}

}  // namespace soilvdb::test
