// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/ros_messages.h"

#include <algorithm>
#include <cmath>

namespace soilvdb::tools {

std::uint64_t stamp_ns(double time_s) {
  constexpr double kMostTimeS = 2147483647;  // largest stamp
  return static_cast<std::uint64_t>(std::llround(std::clamp(time_s, 0.0, kMostTimeS) * 1e9));
}

void put_stamp(io::CdrWriter& cdr, double time_s) {
  constexpr std::uint64_t kNsPerS = 1'000'000'000;
  const std::uint64_t ns = stamp_ns(time_s);
  cdr.put_all(static_cast<std::int32_t>(ns / kNsPerS), static_cast<std::uint32_t>(ns % kNsPerS));
}

void put_pose(io::CdrWriter& cdr, const Pose& pose) {
  const Vec3& at = pose.position;
  const Eigen::Quaterniond& turn = pose.rotation;
  cdr.put_all(at.x(), at.y(), at.z(), turn.x(), turn.y(), turn.z(), turn.w());
}

std::string transform_message(double time_s, std::string_view parent, std::string_view frame,
                              const Pose& parent_from_frame) {
  io::CdrWriter cdr;
  cdr.put(std::uint32_t{1});
  put_stamp(cdr, time_s);
  cdr.put_all(parent, frame);
  put_pose(cdr, parent_from_frame);
  return cdr.bytes();
}

std::string float_message(double value) {
  io::CdrWriter cdr;
  cdr.put(value);
  return cdr.bytes();
}

std::array<double, 6> wrench_numbers(const Wrench& wrench) {
  const Vec3 &force = wrench.force, &moment = wrench.moment;
  return {force.x(), force.y(), force.z(), moment.x(), moment.y(), moment.z()};
}

std::string wrench_message(double time_s, std::string_view frame,
                           const std::array<double, 6>& force) {
  io::CdrWriter cdr;
  put_stamp(cdr, time_s);
  cdr.put(frame);
  for (const double value : force) cdr.put(value);
  return cdr.bytes();
}

std::string grid_map_message(double time_s, std::string_view frame, const ElevationMap& map,
                             const Vec3& origin) {
  const std::size_t nx = map.size_x(), ny = map.size_y();
  const double cell_m = map.cell_m();
  const Vec2 size_m(static_cast<double>(nx) * cell_m, static_cast<double>(ny) * cell_m);
  const Vec2 middle_m = origin.head<2>() + map.corner_m() + size_m / 2;
  io::CdrWriter cdr;
  put_stamp(cdr, time_s);
  cdr.put_all(frame, cell_m, size_m.x(), size_m.y());
  put_pose(cdr, {.position = {middle_m.x(), middle_m.y(), 0}});
  for (int i = 0; i < 2; ++i)  // layers, and those that make a cell valid
    cdr.put_all(std::uint32_t{1}, std::string_view("elevation"));
  // grid_map's order: column by column, from the highest x and y down.
  const auto columns = static_cast<std::uint32_t>(ny), rows = static_cast<std::uint32_t>(nx);
  cdr.put_all(std::uint32_t{1}, std::uint32_t{2});  // layers; their dimensions
  cdr.put_all(std::string_view("column_index"), columns, columns * rows);
  cdr.put_all(std::string_view("row_index"), rows, rows);
  cdr.put_all(std::uint32_t{0}, columns * rows);
  const auto heights_m = map.heights_m();
  for (std::size_t y = ny; y-- > 0;)
    for (std::size_t x = nx; x-- > 0;)
      cdr.put(static_cast<float>(double{heights_m[y * nx + x]} + origin.z()));
  cdr.put_all(std::uint16_t{0}, std::uint16_t{0});
  return cdr.bytes();
}

}  // namespace soilvdb::tools
