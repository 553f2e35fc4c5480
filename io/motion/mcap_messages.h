// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Decodes the ROS messages of motions from CDR.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "io/mcap/cdr.h"

namespace soilvdb::inline v0::io {

/// What networks delay is bridged: gaps between two samples up to this long, and rows that are this
/// far beyond a track's ends.
inline constexpr std::int64_t kMostGap_ns = 1'000'000'000, kMostEnd_ns = 250'000'000;

enum class McapType { kJointState, kPoseStamped, kOdometry, kTransforms };

/// The ROS name, "sensor_msgs/JointState".
const char* type_name(McapType type);
/// "sensor_msgs/JointState" of "sensor_msgs/msg/JointState" or "sensor_msgs::msg::JointState".
std::string plain_type(std::string name);

/// A builtin_interfaces/Time, ns. @throw CdrError
std::int64_t read_stamp(CdrReader& cdr);

/// Values of one thing at one time, from a message.
struct McapItem {
  std::int64_t stamp_ns = 0;
  /// Joints: their names, each followed by a zero byte. Transform: child and parent, in the same
  /// way. Pose: the name of its frame.
  std::string names;
  std::vector<double> values;  ///< positions of the joints; or x, y, z, qx, qy, qz, qw
};

/// The items of a message: several for transforms, else one. Joints without a position are left
/// out.
/// @throw CdrError
void read_items(McapType type, std::string_view cdr, std::vector<McapItem>& items);

/// The parts of McapItem::names that end with a zero byte.
std::vector<std::string> split_names(std::string_view names);

/// Seconds with all nine decimals, as in a CSV file.
std::string stamp_text(std::int64_t stamp_ns);
/// The same as a number, with the bits that reading it from a CSV file gives.
double stamp_s(std::int64_t stamp_ns);

}  // namespace soilvdb::inline v0::io
