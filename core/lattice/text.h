// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Numbers as text, for messages.
#pragma once

#include <charconv>
#include <string>

namespace soilvdb::inline v0 {

/// The shortest text that reads back as `value`.
inline std::string text(double value) {
  char buffer[32];
  return {buffer, std::to_chars(buffer, buffer + sizeof(buffer), value).ptr};
}

/// `value` rounded to a number of digits.
inline std::string text(double value, int digits) {
  char buffer[32];
  char* const end = buffer + sizeof(buffer);
  return {buffer, std::to_chars(buffer, end, value, std::chars_format::general, digits).ptr};
}

}  // namespace soilvdb::inline v0
