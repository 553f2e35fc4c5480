// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Messages of ROS 2 about the ground and buckets, in CDR.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>

#include "io/mcap/cdr.h"
#include "soilvdb/resistance.h"
#include "soilvdb/types.h"
#include "tools/run/elevation_map.h"

namespace soilvdb::tools {

/// A time as a stamp can have it, ns: from 0 to 2^31 s.
std::uint64_t stamp_ns(double time_s);
void put_stamp(io::CdrWriter& cdr, double time_s);
/// A geometry_msgs/Pose or Transform.
void put_pose(io::CdrWriter& cdr, const Pose& pose);

/// A tf2_msgs/TFMessage with the place of one frame in another.
std::string transform_message(double time_s, std::string_view parent, std::string_view frame,
                              const Pose& parent_from_frame);
/// A std_msgs/Float64.
std::string float_message(double value);
/// Force and moment.
std::array<double, 6> wrench_numbers(const Wrench& wrench);
/// A geometry_msgs/WrenchStamped. @param force and moment, N and N m
std::string wrench_message(double time_s, std::string_view frame,
                           const std::array<double, 6>& force);
/// A grid_map_msgs/GridMap with the layer `elevation`. @param origin of the map in the frame
std::string grid_map_message(double time_s, std::string_view frame, const ElevationMap& map,
                             const Vec3& origin);

}  // namespace soilvdb::tools
