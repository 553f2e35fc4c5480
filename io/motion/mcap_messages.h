// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The ROS messages that motions come in, out of their CDR.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "io/mcap/cdr.h"

namespace soilvdb::inline v0::io {

enum class McapType { kJointState, kPoseStamped, kOdometry, kTransforms };

/// As ROS has it, "sensor_msgs/JointState".
const char* type_name(McapType type);

/// What a message says of one thing at one time.
struct McapItem {
  std::int64_t stamp_ns = 0;
  /// Of joints their names, each with a zero behind it; of a transform the names of child and
  /// parent in the same way; of a pose that of the frame it is in.
  std::string names;
  std::vector<double> values;  ///< positions of the joints; or x, y, z, qx, qy, qz, qw
};

/// The items of a message: one, but for transforms. Joints without a position are left out.
/// @throw CdrError
void read_items(McapType type, std::string_view cdr, std::vector<McapItem>& items);

/// The parts of McapItem::names that have a zero behind them.
std::vector<std::string> split_names(std::string_view names);

/// Decimals of a second, all nine, as a CSV file would have them.
std::string stamp_text(std::int64_t stamp_ns);
/// Those as a number: what reading them from a CSV file would give, to the last bit.
double stamp_s(std::int64_t stamp_ns);

}  // namespace soilvdb::inline v0::io
