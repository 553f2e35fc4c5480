// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/scenario/scans.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <map>
#include <memory>
#include <stdexcept>

#include "core/constants.h"
#include "core/survey/sensor_model.h"
#include "io/file/text.h"
#include "soilvdb/io/point_cloud.h"
#include "soilvdb/io/recorded_scans.h"
#include "soilvdb/io/urdf.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr double kMostScanEveryS = 1e6;
/// Share of `every` from which on two scans are so far apart: stamps jitter, and are rounded.
constexpr double kSameEvery = 0.9;

/// Rotation from x, y, z, w.
Eigen::Quaterniond read_rotation(const YamlMap& map) {
  const auto v = map.numbers("rotation", 4);
  const Eigen::Quaterniond rotation(v[3], v[0], v[1], v[2]);
  constexpr double kMostError = 1e-3;
  if (std::abs(rotation.norm() - 1) > kMostError)
    map.fail("rotation", fmt::format("rotation has length {:.6g}; it must be a unit quaternion, x, "
                                     "y, z, w",
                                     rotation.norm()));
  return rotation.normalized();
}

/// The link of a machine that carries a sensor.
void read_carrier(const YamlMap& map, Scenario& scenario, SensorInput& scan) {
  const std::string name = map.text("machine");
  const auto found = std::find_if(scenario.machines.begin(), scenario.machines.end(),
                                  [&](const MachineInput& m) { return m.name == name; });
  if (found == scenario.machines.end())
    map.fail("machine", fmt::format("there is no machine '{}'", printable(name)));
  scan.machine = static_cast<std::size_t>(found - scenario.machines.begin());
  if (!map.has("link")) return;  // on the bucket
  if (!found->chain)
    map.fail("link", fmt::format("'{}' has no 'urdf' and so no links; remove 'link', then the "
                                 "sensor is on the bucket",
                                 printable(name)));
  const std::string link = map.text("link");
  try {
    Chain chain = read_chain(found->chain_file, link);
    chain.world_from_root = found->chain->world_from_root;
    const std::vector<std::string> all = found->chain->movable();
    scan.carrier_joints = all.size();
    for (const std::string& joint : chain.movable()) {
      const auto at = std::find(all.begin(), all.end(), joint);
      if (at == all.end())
        throw std::invalid_argument(fmt::format(
            "link '{}' moves with joint '{}', which is not between root and bucket", link, joint));
      scan.joints.push_back(static_cast<std::size_t>(at - all.begin()));
    }
    scan.link = std::move(chain);
  } catch (const std::invalid_argument& e) {
    map.fail("link", e.what());
  }
}

void read_sigmas(const YamlMap& map, const char* group, Sensor& sensor) {
  const YamlMap given = map.map(group, sigma_keys(group));
  for (const SensorSigma& sigma : kSensorSigmas)
    if (sigma.group == group && given.has(sigma.key))
      sensor.*sigma.field = given.number(sigma.key, 0, kMostSensorSigma, sigma.unit);
}

/// The longest time between a scan of a file and the motions that is not told, s, if these do not
/// last longer.
constexpr double kFarFromMotions_s = 600;

/// Warns of a sensor that moves without a known error of its poses. @param how it moves
void warn_of_poses(const YamlMap& map, const char* key, const Sensor& sensor,
                   const std::string& how, Scenario& scenario) {
  if (sensor.pose_shift_sigma_m > 0 || sensor.pose_turn_sigma_rad > 0) return;
  scenario.warnings.push_back(fmt::format(
      "{}: sensor '{}' {}, and each of its poses is believed to the last millimetre; give their "
      "standard deviations in m and rad, such as 'pose: {{shift: 0.02, turn: 0.003}}'",
      map.place(key), printable(sensor.name), how));
}

/// Begin and end of all motions; the begin is later than the end if there are none.
std::pair<double, double> times_of_motions(const Scenario& scenario) {
  double begin_s = std::numeric_limits<double>::infinity(), end_s = -begin_s;
  for (const MachineInput& machine : scenario.machines) {
    if (!machine.has_motion()) continue;
    begin_s = std::min(begin_s, machine.motion.begin_s());
    end_s = std::max(end_s, machine.motion.end_s());
  }
  return {begin_s, end_s};
}

/// Where a recording has its points, transforms place a sensor that has no place here.
SensorInput read_sensor(const YamlMap& map, const std::string& name, Scenario& scenario) {
  SensorInput scan;
  Sensor& sensor = scan.sensor;
  sensor.name = name;
  scan.by_transforms = !map.has("at") && !map.has("rotation") && !map.has("machine");
  if (map.has("at")) sensor.pose.position = Vec3(map.numbers("at", 3).data());
  if (map.has("rotation")) sensor.pose.rotation = read_rotation(map);
  if (map.has("machine")) read_carrier(map, scenario, scan);
  if (map.has("link") && !map.has("machine"))
    map.fail("link", "'link' goes with 'machine', whose it is; add that, or remove 'link'");
  if (map.has("noise") && !map.is_map("noise")) {
    try {
      const RangeNoise noise = noise_of(printable(map.text("noise")));
      sensor.range_sigma_m = noise.sigma_m;
      sensor.range_squared_sigma_per_m = noise.squared_per_m;
    } catch (const std::invalid_argument& e) {
      map.fail("noise", fmt::format("noise: {}", e.what()));
    }
  } else if (map.has("noise")) {
    sensor.range_sigma_m = 0;
    read_sigmas(map, "noise", sensor);
    if (sensor.range_sigma_m == 0 && sensor.range_squared_sigma_per_m == 0)
      map.fail("noise", "noise has neither range nor range_squared; one must be more than 0");
  }
  if (map.has("mount")) read_sigmas(map, "mount", sensor);
  if (map.has("pose")) read_sigmas(map, "pose", sensor);
  if (map.has("max_range")) sensor.max_range_m = map.number("max_range");
  if (map.has("machine"))
    warn_of_poses(map, "machine", sensor,
                  fmt::format("moves with '{}'", printable(map.text("machine"))), scenario);
  try {
    sensor.validate();
  } catch (const std::invalid_argument& e) {
    const bool of_range = std::string_view(e.what()).starts_with("max_range");
    map.fail(of_range           ? "max_range"
             : map.has("noise") ? "noise"
                                : "at",
             fmt::format("sensor '{}': {}", name, e.what()));
  }
  return scan;
}

/// Refuses points of a file that are too far from their sensor, unless it leaves such out.
void check_points(const YamlMap& map, const ScanInput& scan, const std::vector<Vec3>& points_m) {
  if (std::isfinite(scan.sensor.max_range_m)) return;
  const Vec3 eye = scan.in_world ? scan.sensor.pose.position : Vec3(0, 0, 0);
  for (std::size_t i = 0; i < points_m.size(); ++i) {
    const double range_m = (points_m[i] - eye).norm();
    if (range_m <= kMostScanRangeM) continue;
    map.fail("file",
             fmt::format("file: {}: point {} is {:.4g} m from the sensor; it must be within "
                         "{} m: is 'frame' right, and 'at'?",
                         scan.file.string(), i + 1, range_m, kMostScanRangeM));
  }
}

/// Is the machine that carries the sensor somewhere by then? Says since when where it is not.
std::optional<double> begin_of_carrier(const ScanInput& scan, const Scenario& scenario) {
  if (!scan.machine) return {};
  const MachineInput& machine = scenario.machines[*scan.machine];
  if (!machine.has_motion() || scan.time_s >= machine.motion.begin_s()) return {};
  return machine.motion.begin_s();
}

/// A scan of a file.
void read_file_scan(const YamlMap& map, ScanInput scan, Scenario& result) {
  if (scan.by_transforms)
    map.fail("sensor", fmt::format("sensor '{}' has no place; give it 'at', or the 'machine' that "
                                   "carries it",
                                   scan.sensor.name));
  scan.file = map.path("file");
  scan.time_s = map.number("time");
  if (map.has("frame")) {
    const std::string frame = map.text("frame");
    if (frame != "world" && frame != "sensor")
      map.fail("frame", fmt::format("frame is '{}'; it must be world or sensor: what the points "
                                    "are in",
                                    printable(frame)));
    scan.in_world = frame == "world";
  }
  try {
    const PointCloud cloud = read_points(scan.file);
    if (!scan.machine) check_points(map, scan, cloud.points_m);
  } catch (const InputError& e) {
    if (std::string(e.what()).find(scan.file.string()) != 0) throw;
    map.fail("file", fmt::format("file: {}", e.what()));
  }
  if (const auto begin_s = begin_of_carrier(scan, result))
    map.fail("time",
             fmt::format("time is {} s, before '{}', which carries the sensor, has a place at {} s",
                         scan.time_s, result.machines[*scan.machine].name, *begin_s));
  const auto [begin_s, end_s] = times_of_motions(result);
  const double far_s = std::max(begin_s - scan.time_s, scan.time_s - end_s);
  if (begin_s <= end_s && far_s > std::max(kFarFromMotions_s, end_s - begin_s))
    result.warnings.push_back(fmt::format(
        "{}: the scan is {:.10g} s {} all motions, which are from {:.10g} to {:.10g} s; "
        "its time must be by the same clock",
        map.place("time"), far_s, scan.time_s < begin_s ? "before" : "after", begin_s, end_s));
  result.scans.push_back(std::move(scan));
}

/// The scans of a topic of a recording.
class RecordedInputs {
 public:
  RecordedInputs(const YamlMap& map, ScanInput scan, Scenario& result)
      : map_(map), scan_(std::move(scan)), result_(result), before_(result.scans.size()) {}

  void read() {
    ScanSource source{map_.paths("mcap"), map_.text("topic")};
    if (map_.has("parent")) source.world = map_.text("parent");
    if (map_.has("parent") && !scan_.by_transforms)
      map_.fail("parent",
                fmt::format("sensor '{}' has a place, so the recording's transforms aren't "
                            "looked at; remove 'parent', or the sensor's place",
                            scan_.sensor.name));
    if (map_.has("every")) every_s_ = map_.number("every", 0, kMostScanEveryS, "s");
    try {
      scan_.recording = std::make_shared<RecordedScans>(std::move(source));
      scan_.file = scan_.recording->files().front();
      scan_.recording->each([&](RecordedScan&& recorded) { take(std::move(recorded)); }, warnings_);
    } catch (const InputError& e) {
      map_.fail("mcap", fmt::format("mcap: {}", e.what()));
    }
    tell_left_out();
    tell_times();
  }

 private:
  void take(RecordedScan&& recorded) {
    if (recorded.time_s < next_s_) return;
    scan_.time_s = recorded.time_s;
    scan_.number = recorded.number;
    if (begin_of_carrier(scan_, result_)) {
      ++early_;
    } else if (scan_.by_transforms && (!recorded.world_from_sensor || recorded.frame_id.empty())) {
      ++lost_;
      frame_ = recorded.frame_id;
    } else {
      far_ += recorded.cloud.leave_out_far();
      next_s_ = scan_.time_s + kSameEvery * every_s_;
      if (scan_.by_transforms) see_from(*recorded.world_from_sensor);
      result_.scans.push_back(scan_);
    }
  }
  void see_from(const Pose& place) {
    if (!place_) place_ = place;
    moves_ =
        moves_ || place.position != place_->position || !place.rotation.isApprox(place_->rotation);
  }
  void warn(const std::string& what) {
    result_.warnings.push_back(fmt::format("{}: {}", map_.place("mcap"), what));
  }
  void tell_left_out() {
    std::string why;
    if (lost_ > 0)
      why = fmt::format("the transforms do not say where frame '{}' is at the time of {} scan{}",
                        printable(frame_), lost_, lost_ == 1 ? "" : "s");
    if (early_ > 0)
      why += fmt::format("{}{} scan{} from before '{}', which carries the sensor, has a place",
                         why.empty() ? "" : ", and ", early_, early_ == 1 ? " is" : "s are",
                         result_.machines[*scan_.machine].name);
    if (result_.scans.size() == before_)
      map_.fail("mcap", fmt::format("mcap: {}: no scan of topic '{}' can be used: {}{}",
                                    scan_.file.string(), printable(map_.text("topic")), why,
                                    warnings_.empty() ? "" : "; " + warnings_.front()));
    result_.warnings.insert(result_.warnings.end(), warnings_.begin(), warnings_.end());
    if (!why.empty()) warn(why + "; left out");
    if (moves_) warn_of_poses(map_, "sensor", scan_.sensor, "moves", result_);
    if (far_ > 0)
      warn(fmt::format("{} point{} more than {} m from the sensor; left out", far_,
                       far_ == 1 ? " is" : "s are", kMostScanRangeM));
  }
  /// Scans that no motion is about may have another clock.
  void tell_times() {
    const double begin_s = times_of_motions(result_).first,
                 end_s = times_of_motions(result_).second;
    const auto first = result_.scans.begin() + static_cast<std::ptrdiff_t>(before_);
    const auto count = std::count_if(first, result_.scans.end(), [&](const ScanInput& scan) {
      return scan.time_s < begin_s || scan.time_s > end_s;
    });
    if (begin_s <= end_s && count > 0)
      warn(
          fmt::format("{} of {} scans {} before or after all motions: scans are from {:.10g} to "
                      "{:.10g} s, motions from {:.10g} to {:.10g} s",
                      count, result_.scans.end() - first, count == 1 ? "is" : "are", first->time_s,
                      result_.scans.back().time_s, begin_s, end_s));
  }

  const YamlMap& map_;
  ScanInput scan_;
  Scenario& result_;
  const std::size_t before_;
  double every_s_ = 0, next_s_ = -std::numeric_limits<double>::infinity();
  std::size_t early_ = 0, lost_ = 0, far_ = 0;
  std::string frame_;
  std::optional<Pose> place_;  // by transforms, of the first scan
  bool moves_ = false;
  std::vector<std::string> warnings_;
};

}  // namespace

Pose SensorInput::carried(const Pose& bucket, std::span<const double> values) const {
  if (!link) return bucket * sensor.pose;
  std::vector<double> own;
  for (const std::size_t joint : joints) own.push_back(values[joint]);
  const std::span<const double> base = values.subspan(carrier_joints);
  own.insert(own.end(), base.begin(), base.end());
  return link->world_from_bucket(own) * sensor.pose;
}

ScanInput::Seen ScanInput::read(const Motion* carrier) const {
  Seen seen{sensor, {}};
  if (machine && carrier == nullptr)
    throw InputError(file, "the machine that carries its sensor has no motion");
  if (machine && !link) seen.sensor.pose = carried(carrier->pose(time_s), {});
  if (link) seen.sensor.pose = carried({}, carrier->joint_values(time_s));
  if (recording) {
    RecordedScan recorded = recording->read(number);
    recorded.cloud.leave_out_far();
    seen.points_m = std::move(recorded.cloud.points_m);
    if (by_transforms && !recorded.world_from_sensor)
      throw InputError(file, "changed while it was being read");
    if (by_transforms) seen.sensor.pose = *recorded.world_from_sensor;
  } else {
    seen.points_m = read_points(file).points_m;
  }
  if (!in_world)
    for (Vec3& point : seen.points_m) point = seen.sensor.pose * point;
  return seen;
}

void read_scan_inputs(const YamlMap& scenario, Scenario& result) {
  std::map<std::string, SensorInput>& sensors = result.sensors;
  if (scenario.has("sensors"))
    for (const std::string& name : scenario.keys("sensors"))
      sensors[name] = read_sensor(scenario.map("sensors", scenario.keys("sensors"))
                                      .map(name, {"at", "rotation", "machine", "link", "noise",
                                                  "mount", "pose", "max_range"}),
                                  name, result);
  if (!scenario.has("scans")) return;
  for (const YamlMap& map :
       scenario.maps("scans", "scan",
                     {"sensor", "file", "time", "frame", "mcap", "topic", "parent", "every"})) {
    const std::string name = map.text("sensor");
    const auto sensor = sensors.find(name);
    if (sensor == sensors.end())
      map.fail("sensor", fmt::format("there is no sensor '{}' in 'sensors'", printable(name)));
    const bool recorded = map.has("mcap");
    for (const char* key : {"file", "time", "frame"})
      if (recorded && map.has(key))
        map.fail(key, fmt::format("'{}' does not go with 'mcap', whose messages have it", key));
    for (const char* key : {"topic", "parent", "every"})
      if (!recorded && map.has(key))
        map.fail(key, fmt::format("'{}' goes with 'mcap', a recording; add that, or remove '{}'",
                                  key, key));
    const std::size_t before = result.scans.size();
    if (recorded)
      RecordedInputs(map, {sensor->second}, result).read();
    else
      read_file_scan(map, {sensor->second}, result);
    const ScanInput& first = result.scans[before];
    for (const auto& path : recorded ? first.recording->files() : std::vector{first.file})
      result.add_input(path);
  }
  std::stable_sort(result.scans.begin(), result.scans.end(),
                   [](const ScanInput& a, const ScanInput& b) { return a.time_s < b.time_s; });
}

}  // namespace soilvdb::inline v0::io
