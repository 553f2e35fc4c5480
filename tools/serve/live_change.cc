// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Machines and hoppers that come to a live site and leave it.
#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "io/file/json.h"
#include "io/file/text.h"
#include "tools/run/text.h"
#include "tools/serve/line_values.h"
#include "tools/serve/live_site.h"

namespace soilvdb::tools {
namespace {

using Json = nlohmann::ordered_json;

Json names_of_machines(const Session& session) {
  Json names = Json::array();
  for (std::size_t i = 0; i < session.machines().size(); ++i)
    if (!session.is_retired(i)) names.push_back(session.machines()[i].name);
  return names;
}

Json list_of_hoppers(const Session& session) {
  // One that came now begins by the least number that is later than what was fed.
  const auto or_null = [](double s) {
    return std::isfinite(s) ? Json(std::round(1e6 * s) / 1e6) : Json();
  };
  Json all = Json::array();
  for (const Hopper& hopper : session.earthmoving().hoppers)
    all.push_back(
        {{"name", hopper.name}, {"time", {or_null(hopper.begin_s), or_null(hopper.end_s)}}});
  return all;
}

}  // namespace

/// Hoppers take soil by time. What was dug so far must stay as it is when it is dug again.
void LiveSite::set_time(nlohmann::json& change) const {
  if (fed_.is_untimed)
    throw std::invalid_argument(
        "states without times were fed, and hoppers of a running site come and go at times; list "
        "them in the scenario");
  if (!fed_.latest_s) return;
  if (change.contains("retire")) change["time"] = *fed_.latest_s;
  if (!change.contains("add") || !change["add"].is_object()) return;
  nlohmann::json& time = change["add"]["time"];
  const double next_s = std::nextafter(*fed_.latest_s, std::numeric_limits<double>::infinity());
  if (time.is_null()) time = {next_s};
  if (time.is_array() && !time.empty() && time[0].is_number() && !(time[0] >= next_s))
    throw std::invalid_argument(fmt::format(
        "the hopper's 'time' begins at {} s; it must be later than all that was fed, {} s. Leave "
        "it out to begin now",
        io::to_text(time[0]), time_text(*fed_.latest_s)));
}

void LiveSite::follow_machines() {
  const std::vector<SiteMachine>& machines = session_.machines();
  joints_.clear();
  for (const SiteMachine& machine : machines)
    joints_.push_back(machine.chain ? machine.chain->movable() : std::vector<std::string>());
  moved_.resize(machines.size());
  feeds_.resize(machines.size());
  doubted_s_.resize(machines.size());
  fed_.log.follow(session_);
}

Json LiveSite::change_list(const std::string& list, std::string_view text) {
  nlohmann::json change = object_of(text);
  if (list == "hoppers") set_time(change);
  try {
    session_.change_list(list, io::to_text(change));
  } catch (...) {
    follow_machines();  // it may be that only the disk was full
    throw;
  }
  follow_machines();
  Json answer = {
      {list, list == "machines" ? names_of_machines(session_) : list_of_hoppers(session_)}};
  for (const std::string& warning : session_.take_warnings()) answer["warning"] = warning;
  return answer;
}

}  // namespace soilvdb::tools
