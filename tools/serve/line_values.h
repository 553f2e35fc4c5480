// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Values in lines and headers of JSON. All throw std::invalid_argument with one line.
#pragma once

#include <fmt/format.h>

#include <array>
#include <cstddef>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "soilvdb/types.h"
#include "tools/serve/machine_feed.h"

namespace soilvdb::tools {

/// The JSON object of a line.
nlohmann::json object_of(std::string_view line);
void require_keys(const nlohmann::json& json, const std::vector<std::string>& known);

double number_of(const nlohmann::json& json, const std::string& what);
/// A time, s: a number, a date in ISO 8601, or {"gps": [week, seconds]}; these count from 1970.
double line_time(const nlohmann::json& json);
/// The quality of a line's position: without "fix" it is fixed.
Fix line_fix(const nlohmann::json& json);
Pose line_pose(const nlohmann::json& position, const nlohmann::json& rotation);

template <std::size_t N>
std::array<double, N> array_of(const nlohmann::json& json, const std::string& what) {
  std::array<double, N> all{};
  if (!json.is_array() || json.size() != N)
    throw std::invalid_argument(fmt::format("'{}' must be an array of {} numbers", what, N));
  for (std::size_t i = 0; i < N; ++i)
    all[i] = number_of(json[i], fmt::format("'{}' [{}]", what, i));
  return all;
}

}  // namespace soilvdb::tools
