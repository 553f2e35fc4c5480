// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/scenario/scans.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <stdexcept>

#include "core/constants.h"
#include "io/file/text.h"
#include "soilvdb/io/point_cloud.h"
#include "soilvdb/io/urdf.h"

namespace soilvdb::inline v0::io {
namespace {

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
void read_carrier(const YamlMap& map, Scenario& scenario, ScanInput& scan) {
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

/// A sensor as part of a scan that has no file yet.
ScanInput read_sensor(const YamlMap& map, const std::string& name, Scenario& scenario) {
  ScanInput scan;
  Sensor& sensor = scan.sensor;
  sensor.name = name;
  if (map.has("at")) sensor.pose.position = Vec3(map.numbers("at", 3).data());
  if (map.has("rotation")) sensor.pose.rotation = read_rotation(map);
  if (map.has("machine")) read_carrier(map, scenario, scan);
  if (map.has("link") && !map.has("machine"))
    map.fail("link", "'link' goes with 'machine', whose it is; add that, or remove 'link'");
  if (map.has("noise")) {
    const YamlMap noise = map.map("noise", {"range", "range_squared"});
    sensor.range_sigma_m = noise.has("range") ? noise.number("range", 0, kMostSensorSigma, "m") : 0;
    if (noise.has("range_squared"))
      sensor.range_squared_sigma_per_m = noise.number("range_squared", 0, kMostSensorSigma, "1/m");
    if (sensor.range_sigma_m == 0 && sensor.range_squared_sigma_per_m == 0)
      map.fail("noise", "noise has neither range nor range_squared; one must be more than 0");
  }
  if (map.has("mount")) {
    const YamlMap mount = map.map("mount", {"height", "tilt", "scale"});
    if (mount.has("height"))
      sensor.mount_height_sigma_m = mount.number("height", 0, kMostSensorSigma, "m");
    if (mount.has("tilt"))
      sensor.mount_tilt_sigma_rad = mount.number("tilt", 0, kMostSensorSigma, "rad");
    if (mount.has("scale"))
      sensor.mount_scale_sigma = mount.number("scale", 0, kMostSensorSigma, "of range");
  }
  try {
    sensor.validate();
  } catch (const std::invalid_argument& e) {
    map.fail(map.has("noise") ? "noise" : "at", fmt::format("sensor '{}': {}", name, e.what()));
  }
  return scan;
}

/// Refuses points that are too far from a sensor that stands still.
void check_points(const YamlMap& map, const ScanInput& scan, const PointCloud& cloud) {
  if (scan.machine) return;
  const Pose& pose = scan.sensor.pose;
  for (std::size_t i = 0; i < cloud.points_m.size(); ++i) {
    const Vec3& point = cloud.points_m[i];
    const double range_m = scan.in_world ? (point - pose.position).norm() : point.norm();
    if (range_m <= kMostScanRangeM) continue;
    map.fail("file",
             fmt::format("file: {}: point {} is {:.4g} m from the sensor; it must be within "
                         "{} m: is 'frame' right, and 'at'?",
                         scan.file.string(), i + 1, range_m, kMostScanRangeM));
  }
}

}  // namespace

Pose ScanInput::world_from_link(const Pose& pose, const std::vector<double>& values) const {
  if (!link) return pose;
  std::vector<double> own;
  for (const std::size_t joint : joints) own.push_back(values.at(joint));
  return link->world_from_bucket(own);
}

void read_scan_inputs(const YamlMap& scenario, Scenario& result) {
  std::map<std::string, ScanInput> sensors;
  if (scenario.has("sensors"))
    for (const std::string& name : scenario.keys("sensors"))
      sensors[name] =
          read_sensor(scenario.map("sensors", scenario.keys("sensors"))
                          .map(name, {"at", "rotation", "machine", "link", "noise", "mount"}),
                      name, result);
  if (!scenario.has("scans")) return;
  for (const YamlMap& map : scenario.maps("scans", "scan", {"sensor", "file", "time", "frame"})) {
    const std::string name = map.text("sensor");
    const auto sensor = sensors.find(name);
    if (sensor == sensors.end())
      map.fail("sensor", fmt::format("there is no sensor '{}' in 'sensors'", printable(name)));
    ScanInput scan = sensor->second;
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
      check_points(map, scan, read_points(scan.file));
    } catch (const InputError& e) {
      if (std::string(e.what()).find(scan.file.string()) != 0) throw;
      map.fail("file", fmt::format("file: {}", e.what()));
    }
    if (scan.machine) {
      const MachineInput& machine = result.machines[*scan.machine];
      if (machine.has_motion() && scan.time_s < machine.motion.begin_s())
        map.fail("time", fmt::format("time is {} s, before '{}', which carries the sensor, has a "
                                     "place at {} s",
                                     scan.time_s, machine.name, machine.motion.begin_s()));
    }
    if (std::find(result.inputs.begin(), result.inputs.end(), scan.file) == result.inputs.end())
      result.inputs.push_back(scan.file);
    result.scans.push_back(std::move(scan));
  }
  std::stable_sort(result.scans.begin(), result.scans.end(),
                   [](const ScanInput& a, const ScanInput& b) { return a.time_s < b.time_s; });
}

}  // namespace soilvdb::inline v0::io
