// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Scans and surveys that correct the ground of a live site.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <nlohmann/json.hpp>
#include <stdexcept>

#include "io/file/text.h"
#include "soilvdb/io/motion_rows.h"
#include "tools/serve/live_site.h"
#include "tools/serve/scan_message.h"

namespace soilvdb::tools {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kLongestSensorName = 100;  // bytes
/// What was dug since a scan would be filled again by it.
constexpr double kOldestScan_s = 10;
/// A clock that is farther ahead of all machines is wrong.
constexpr double kScanAhead_s = 60;

}  // namespace

/// Where a sensor of the scenario was that a machine carries, world.
Pose LiveSite::carried(const io::SensorInput& input, std::optional<double> time_s) const {
  const std::size_t machine = *input.machine;
  const std::string& name = session_.machines()[machine].name;
  const MachinePlaces::State* state = fed_.places.at(machine, time_s);
  if (state == nullptr) {
    const std::optional<double> from_s = fed_.places.from_s(machine);
    throw std::invalid_argument(
        from_s
            ? fmt::format("header: 'time' is {} s, and where '{}' was, which carries the sensor, "
                          "is known from {} s on",
                          *time_s, name, *from_s)
            : fmt::format("header: machine '{}', which carries the sensor, has no state yet; "
                          "feed one first",
                          name));
  }
  const std::vector<double>& numbers = state->at.numbers;
  if (!input.link)
    return input.carried(state->at.joints
                             ? session_.machines()[machine].chain->world_from_bucket(numbers)
                             : pose_of(numbers.data()),
                         {});
  if (!state->at.joints)
    throw std::invalid_argument(
        fmt::format("header: the link of '{}' that carries the sensor has no place, because the "
                    "machine was fed "
                    "'position' and 'rotation'; feed its 'joints'",
                    name));
  return input.carried({}, numbers);
}

Sensor LiveSite::sensor_of(const ScanHead& head) const {
  const auto found = sensors_.find(head.sensor);
  const io::SensorInput* known = found == sensors_.end() ? nullptr : &found->second;
  if (known == nullptr && !head.pose) {
    std::vector<std::string> names;
    for (const auto& [name, sensor] : sensors_) names.push_back(name);
    throw std::invalid_argument(fmt::format(
        "header: {}; name one of the scenario's 'sensors'{}, or give 'position' and 'rotation'",
        head.sensor.empty() ? "'sensor' is missing"
                            : fmt::format("there is no sensor '{}'", io::printable(head.sensor)),
        names.empty() ? ", which has none" : ": " + io::quoted_list(names)));
  }
  if (head.sensor.size() > kLongestSensorName)
    throw std::invalid_argument(fmt::format("header: 'sensor' has {} bytes, and may have {}",
                                            head.sensor.size(), kLongestSensorName));
  if (known != nullptr && known->by_transforms && !head.pose)
    throw std::invalid_argument(
        fmt::format("header: sensor '{}' has no place in the scenario; give 'position' and "
                    "'rotation'",
                    head.sensor));
  if (const auto latest_s = fed_.places.latest_s(); head.time_s && latest_s) {
    const double ahead_s = *head.time_s - *latest_s;
    if (ahead_s < -kOldestScan_s)
      throw std::invalid_argument(fmt::format(
          "header: 'time' is {} s, more than {} s before the latest state, {} s; what was dug "
          "since would be filled again. Send scans at once",
          *head.time_s, kOldestScan_s, *latest_s));
    if (ahead_s > kScanAhead_s)
      throw std::invalid_argument(
          fmt::format("header: 'time' is {} s, more than {} s after the latest state, {} s; is the "
                      "sensor's clock right?",
                      *head.time_s, kScanAhead_s, *latest_s));
  }
  Sensor sensor = known != nullptr ? known->sensor : Sensor();
  if (!head.sensor.empty()) sensor.name = head.sensor;
  if (head.pose)
    sensor.pose = *head.pose;
  else if (known->machine)
    sensor.pose = carried(*known, head.time_s);
  for (const auto& [field, sigma] : head.sigmas) sensor.*field = sigma;
  try {
    sensor.validate();
  } catch (const std::invalid_argument& e) {
    throw std::invalid_argument(fmt::format("header: {}", e.what()));
  }
  return sensor;
}

Json LiveSite::scan(const ScanHead& head, const Sensor& sensor, std::span<const Vec3> points_m) {
  // A scan that can't be recorded must not be left for the next one.
  if (const std::string why = session_.recording_fault(); !why.empty())
    throw std::runtime_error(why);
  if (const StepResult step = session_.scan(sensor, points_m); !step.ok())
    throw std::invalid_argument(step.why);
  Survey survey;
  const StepResult step = session_.apply_scans(survey);
  if (!step.ok())
    throw std::runtime_error(session_.recording_fault().empty() ? step.why : kNotOnDisk + step.why);
  if (!points_m.empty()) {  // without points there is seldom something to record
    ++fed_.count;
    fed_.log.note_scan();
    Scans& of = scans_[sensor.name];
    of = {head.time_s ? head.time_s : time_s(), Clock::now(), of.count + 1};
  }
  Json answer = {{"time", head.time_s ? Json(*head.time_s) : Json()},
                 {"acknowledged_s", nullptr},
                 {"removed_m3", survey.removed_m3},
                 {"added_m3", survey.added_m3},
                 {"sigma_m3", survey.sigma_m3},
                 {"rays",
                  {{"used", survey.rays.used},
                   {"masked", survey.rays.masked},
                   {"through", survey.rays.through},
                   {"new", survey.rays.added},
                   {"dropped", survey.rays.dropped},
                   {"far", survey.rays.far}}},
                 {"lip_error", Json::object()}};
  for (std::size_t i = 0; i < survey.lip_errors_m.size(); ++i)
    answer["lip_error"][session_.machines()[i].name] = {survey.lip_errors_m[i].mean,
                                                        survey.lip_errors_m[i].sigma};
  std::vector<std::string> told = session_.take_warnings();
  if (const std::string doubt = survey.rays.doubt(); !doubt.empty()) {
    std::erase(told, "scans: " + doubt);  // of the first doubtful scan only
    told.push_back(doubt);
  }
  if (!told.empty()) answer["warning"] = fmt::format("{}", fmt::join(told, "; "));
  return answer;
}

std::string LiveSite::survey(const SurveyHeights& heights, SurveyVolumes& volumes) {
  const std::uint64_t before = session_.changes();
  const StepResult step = session_.survey(heights, volumes);
  if (session_.changes() == before) throw std::runtime_error(step.why);
  ++fed_.count;
  fed_.log.note_survey();
  ++changes_of_past_;  // what was known of the ground at the latest time
  return step.ok() ? "" : step.why;
}

}  // namespace soilvdb::tools
