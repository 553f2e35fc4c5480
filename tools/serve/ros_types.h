// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Names and hashes of ROS 2's message types, as its nodes have them in DDS.
#pragma once

#include <string>
#include <vector>

#include "tools/serve/dds.h"

namespace soilvdb::tools {

struct RosType {
  const char* name;  ///< "sensor_msgs/JointState"
  const char* hash;  ///< of its definition (REP-2011): RIHS01, SHA-256
};

/// All types of the bridge.
const std::vector<RosType>& ros_types();
/// @param name of one of ros_types()
DdsType dds_type(const std::string& name);
/// "rt/joint_states" of "/joint_states" or "joint_states".
std::string dds_topic(const std::string& topic);
/// A part of a topic's name, with '_' in place of what must not be in it.
std::string ros_name(const std::string& name);

}  // namespace soilvdb::tools
