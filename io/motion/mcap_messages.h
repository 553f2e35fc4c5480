// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The ROS messages that motions come in, out of their CDR. All throw CdrError.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "io/mcap/cdr.h"
#include "soilvdb/types.h"

namespace soilvdb::inline v0::io {

/// A time stamp as the message has it.
struct RosTime {
  std::int32_t sec = 0;
  std::uint32_t nanosec = 0;

  std::int64_t ns() const { return std::int64_t{sec} * 1'000'000'000 + nanosec; }
  /// Decimals of a second, as a CSV file would have them.
  std::string text() const;
  /// Those as a number: what reading them from a CSV file would give, to the last bit.
  double seconds() const;
};

/// sensor_msgs/JointState, as far as it is of use.
struct JointStateMessage {
  RosTime stamp;
  std::vector<std::string_view> names;  ///< good as long as the message
  std::vector<double> positions;
};
void read_message(std::string_view cdr, JointStateMessage& message);

/// geometry_msgs/PoseStamped: x, y, z, qx, qy, qz, qw.
struct PoseMessage {
  RosTime stamp;
  double values[7] = {};
};
void read_message(std::string_view cdr, PoseMessage& message);

/// One of the transforms of a tf2_msgs/TFMessage; numbers as above.
struct TransformMessage {
  RosTime stamp;
  std::string_view parent, child;  ///< good as long as the message
  double values[7] = {};
};
void read_message(std::string_view cdr, std::vector<TransformMessage>& transforms);

}  // namespace soilvdb::inline v0::io
