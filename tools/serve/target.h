// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The target of a request.
#pragma once

#include <cstddef>
#include <initializer_list>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "soilvdb/types.h"

namespace soilvdb::tools {

/// Of a boundary.
inline constexpr std::size_t kMostCorners = 1000;

/// Parts of "/path?a=b&c=d", decoded.
struct Target {
  std::string path;
  std::map<std::string, std::string> values;
};
/// Empty for an invalid target, or one with a repeated name.
std::optional<Target> parse_target(const std::string& text);

/// The values of a target by name. All members throw std::invalid_argument with one line if a value
/// is missing or wrong.
class QueryParameters {
 public:
  /// @param target must outlive it
  explicit QueryParameters(const Target& target) : target_(target) {}
  /// Are they for a path? @param known names of the values that it takes
  bool are_for(std::string_view path, std::initializer_list<const char*> known) const;

  const std::string& text(const std::string& name) const;
  /// Empty if it is missing.
  std::string text_if(const std::string& name) const;
  /// Comma-separated numbers; magnitudes beyond `most` are refused.
  std::vector<double> numbers(const std::string& name, double most = kFarthest_m) const;
  double number(const std::string& name, double most = kFarthest_m) const;
  /// One number; empty if it is missing.
  std::optional<double> number_if(const std::string& name) const;
  /// A time, s: a number, or a date in ISO 8601.
  double time(const std::string& name) const;
  std::optional<double> time_if(const std::string& name) const;
  /// One of these words; default: the first.
  std::string word(const std::string& name, const std::vector<std::string>& words) const;
  Vec2 place(const std::string& name) const;
  /// Of a boundary.
  std::vector<Vec2> corners(const std::string& name) const;

 private:
  static constexpr double kFarthest_m = 1e9, kMostTime_s = 1e10;
  const Target& target_;
};

/// A value, escaped for an address.
std::string in_address(std::string_view value);

}  // namespace soilvdb::tools
