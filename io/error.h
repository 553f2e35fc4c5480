// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What every reader throws when an input file is wrong.
#pragma once

#include <filesystem>
#include <stdexcept>
#include <string>

namespace soilvdb::io {

/// An input file or the command line is wrong: "FILE:LINE: what is wrong and what would be right",
/// one line, without the line number where the file has none.
struct InputError : std::runtime_error {
  explicit InputError(const std::string& message) : std::runtime_error(message) {}
  InputError(const std::filesystem::path& file, const std::string& message)
      : std::runtime_error(file.string() + ": " + message) {}
  InputError(const std::filesystem::path& file, long line, const std::string& message)
      : std::runtime_error(file.string() + ":" + std::to_string(line) + ": " + message) {}
};

}  // namespace soilvdb::io
