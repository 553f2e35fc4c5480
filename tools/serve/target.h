// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a request asks for.
#pragma once

#include <initializer_list>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "soilvdb/types.h"

namespace soilvdb::tools {

/// Parts of "/path?a=b&c=d", decoded.
struct Target {
  std::string path;
  std::map<std::string, std::string> values;
};
/// Nothing if it isn't one, or names a value twice.
std::optional<Target> parse_target(const std::string& text);

/// The values of a target, each of which is asked for by its name. All throw std::invalid_argument
/// in one line where one is missing or can't be.
class QueryParameters {
 public:
  /// @param target outlives it
  /// @param known values that it may have
  QueryParameters(const Target& target, std::initializer_list<const char*> known);

  const std::string& text(const std::string& name) const;
  /// Numbers with commas between; of one beyond `most` it is said that it is none.
  std::vector<double> numbers(const std::string& name, double most = kFarthest_m) const;
  double number(const std::string& name, double most = kFarthest_m) const;
  /// Also a time, in s; nothing where it isn't there.
  std::optional<double> number_if(const std::string& name) const;
  /// One of these words; the first where nothing is said.
  std::string word(const std::string& name, const std::vector<std::string>& words) const;
  Vec2 place(const std::string& name) const;

 private:
  static constexpr double kFarthest_m = 1e9, kMostTime_s = 1e10;
  const Target& target_;
};

/// A value as it is written in an address.
std::string in_address(std::string_view value);

}  // namespace soilvdb::tools
