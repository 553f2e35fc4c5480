// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Messages of a live site's stream /scan.
#include <algorithm>
#include <cstddef>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string_view>
#include <vector>

#include "core/constants.h"
#include "tests/fuzz/fuzz.h"
#include "tools/serve/live_site.h"
#include "tools/serve/scan_message.h"

using namespace soilvdb;

namespace {

Session site() {
  Earthmoving earthmoving;
  earthmoving.soil.emplace().repose_rad = 0.6;
  return Session({.voxel_size_m = 0.2,
                  .terrain = io::PlaneTerrain{},
                  .machines = {{"digger", {1, 1, {}, {}}}},
                  .earthmoving = earthmoving,
                  .near_m = Vec3(0, 0, 0)});
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const Session start = site();
  tools::LiveSite live(start.clone(), "site");
  io::SensorInput mast;
  mast.sensor.pose = {{0, 0, 4}, Eigen::Quaterniond(0, 1, 0, 0)};
  io::SensorInput carried;
  carried.machine = 0;
  live.set_sensors({{"mast", mast}, {"bucket", carried}});
  const std::string_view message = fuzz::text(data, std::min<std::size_t>(size, 4096));
  const std::uint64_t before = live.session().ground_hash();
  try {
    const tools::ScanHead head(message);
    const Sensor sensor = live.sensor_of(head);
    const std::vector<Vec3> points_m = tools::scan_points(head, message, sensor);
    // A place that is far off has few digits.
    const double far_m = 1e-9 * sensor.pose.position.cwiseAbs().maxCoeff() + 1e-6;
    for (const Vec3& point : points_m)
      fuzz::require((point - sensor.pose.position).norm() <= kMostScanRangeM + far_m,
                    "points are near their sensor");
    const auto answer = live.scan(head, sensor, points_m);
    fuzz::require(answer.contains("removed_m3") && !answer.contains("error"),
                  "an answer tells what was changed");
  } catch (const std::invalid_argument& error) {
    fuzz::check_message(error);
    fuzz::require(live.session().ground_hash() == before, "what is refused changes nothing");
  }
  return 0;
}
