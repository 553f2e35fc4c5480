// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A dig controller at 100 Hz: digs until the bucket holds a load, curls it, and writes the ground.
#include <soilvdb/session.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <exception>

using soilvdb::Vec2;

int main(int argc, char** argv) try {
  const double wanted_m3 = argc > 1 ? std::atof(argv[1]) : 0.5;
  soilvdb::SessionSite yard{.voxel_size_m = 0.05, .terrain = soilvdb::io::PlaneTerrain{}};
  const std::vector<Vec2> side = {{0, 0}, {-0.45, -0.1}, {-0.95, 0.55}, {-0.7, 0.9}, {0, 0.9}};
  yard.machines = {{"digger", {.width_m = 1.2, .height_m = 0.9, .profile = side}}};
  yard.earthmoving.soil = {.repose_rad = 0.61, .swell = 0.25};
  soilvdb::Session site(yard);

  soilvdb::MachineState state;  // of machine 0
  double x_m = 0, depth_m = 0, pitch_rad = -0.4, load_m3 = 0;
  const auto move_on = [&](int tick) {
    state.time_s = 0.01 * tick;
    state.pose.position = {x_m, 0, -depth_m};
    state.pose.rotation = Eigen::AngleAxisd(pitch_rad, soilvdb::Vec3::UnitY());
    const soilvdb::StepResult step = site.update(state);
    if (!step.ok()) std::fprintf(stderr, "not moved: %s\n", step.why.c_str());
    load_m3 = step.ok() ? step.update.bucket_m3 : load_m3;
    return step.ok();
  };
  int tick = 0;
  for (; load_m3 < wanted_m3 && x_m < 8; ++tick) {  // drag at 1 m/s, to 0.3 m deep
    x_m += 0.01;
    depth_m = std::min(0.3, depth_m + 0.004);
    if (!move_on(tick)) return EXIT_FAILURE;
  }
  for (; depth_m > -1; ++tick) {  // curl and lift
    pitch_rad = std::max(-1.4, pitch_rad - 0.02);
    depth_m -= 0.01;
    if (!move_on(tick)) return EXIT_FAILURE;
  }
  const std::array<Vec2, 2> places = {Vec2(x_m / 2, 0), Vec2(x_m / 2, 2)};
  std::array<double, 2> heights_m{};
  site.heights(places, heights_m);
  std::printf("%.2f m3 after %.2f m; the trench is %.2f m deep\n", load_m3, x_m,
              heights_m[1] - heights_m[0]);
  site.write("dug.vdb");
} catch (const std::exception& e) {
  std::fprintf(stderr, "%s\n", e.what());
  return EXIT_FAILURE;
}
