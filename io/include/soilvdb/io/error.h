// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The exceptions of files: wrong input, and no room for output.
#pragma once

#include <filesystem>
#include <stdexcept>
#include <string>

namespace soilvdb::inline v0::io {

/// `text` on one line: `instead` replaces control characters, which names and fields may hold.
inline std::string one_line(std::string text, char instead = '?') {
  for (char& c : text) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7F) c = instead;
  }
  return text;
}

/// An input file or the command line is wrong: "FILE:LINE: what is wrong and what would be right",
/// without the line number if the file has no lines. Always one line, whatever the file's name.
struct InputError : std::runtime_error {
  explicit InputError(const std::string& message) : std::runtime_error(one_line(message)) {}
  InputError(const std::filesystem::path& file, const std::string& message)
      : InputError(file.string() + ": " + message) {}
  InputError(const std::filesystem::path& file, long line, const std::string& message)
      : InputError(file.string() + ":" + std::to_string(line) + ": " + message) {}
};

/// A file can't be written because its disk is full.
struct DiskFull : std::runtime_error {
  using std::runtime_error::runtime_error;
};

}  // namespace soilvdb::inline v0::io
