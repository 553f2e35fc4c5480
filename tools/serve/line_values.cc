// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/line_values.h"

#include <algorithm>
#include <cmath>

#include "io/file/instant.h"
#include "io/file/json.h"
#include "io/file/text.h"

namespace soilvdb::tools {
namespace {

/// Latest time, beyond any calendar's. After a wrong one, no later state would be accepted.
constexpr double kMostTime_s = 1e10;
/// Tolerance for the norm of rotations, which JSON often rounds.
constexpr double kUnitTolerance = 1e-3;

}  // namespace

nlohmann::json object_of(std::string_view line) {
  nlohmann::json json = io::parse_json(line);
  if (json.is_discarded() || !json.is_object())
    throw std::invalid_argument(
        fmt::format("not a JSON object: '{}'{}", io::printable(line),
                    json.is_discarded() && (line.find("NaN") != std::string_view::npos ||
                                            line.find("Infinity") != std::string_view::npos)
                        ? "; JSON has no NaN and no Infinity: leave such a state out"
                        : ""));
  return json;
}

void require_keys(const nlohmann::json& json, const std::vector<std::string>& known) {
  for (const auto& [key, value] : json.items())
    if (std::find(known.begin(), known.end(), key) == known.end())
      throw std::invalid_argument(fmt::format("unknown key '{}'; there are {}", io::printable(key),
                                              io::quoted_list(known)));
}

double number_of(const nlohmann::json& json, const std::string& what) {
  if (!json.is_number()) throw std::invalid_argument(what + " must be a number");
  return json.get<double>();
}

double line_time(const nlohmann::json& json) {
  const bool is_date = json.is_string() && io::is_date(json.get<std::string>());
  if (is_date || json.is_object()) {
    try {
      if (is_date) return io::date_time_s(json.get<std::string>());
      require_keys(json, {"gps"});
      const auto gps = array_of<2>(json.value("gps", nlohmann::json()), "gps");
      return io::gps_time_s(gps[0], gps[1]);
    } catch (const std::invalid_argument& e) {
      throw std::invalid_argument(fmt::format("'time': {}", e.what()));
    }
  }
  if (!json.is_number())
    throw std::invalid_argument(
        "'time' must be a number, a date such as \"2026-05-01T07:00:00.25+02:00\", or a GPS time, "
        "{\"gps\": [week, seconds]}");
  const auto time_s = json.get<double>();
  if (!(std::abs(time_s) <= kMostTime_s))
    throw std::invalid_argument(
        fmt::format("'time' is {:.6g} s; it must be within {:g} s of 0; are these milliseconds?",
                    time_s, kMostTime_s));
  return time_s;
}

Fix line_fix(const nlohmann::json& json) {
  if (!json.contains("fix")) return Fix::kFixed;
  if (!json["fix"].is_string()) throw std::invalid_argument("'fix' must be a word");
  return fix_of(json["fix"].get<std::string>());
}

Pose line_pose(const nlohmann::json& position, const nlohmann::json& rotation) {
  const auto p = array_of<3>(position, "position");
  const auto q = array_of<4>(rotation, "rotation");
  Pose pose{{p[0], p[1], p[2]}, Eigen::Quaterniond(q[3], q[0], q[1], q[2])};
  const double norm = pose.rotation.norm();
  if (!(std::abs(norm - 1) <= kUnitTolerance))
    throw std::invalid_argument(
        fmt::format("'rotation' must be a unit quaternion x, y, z, w; its length is {:.6g}", norm));
  pose.rotation.normalize();
  return pose;
}

}  // namespace soilvdb::tools
