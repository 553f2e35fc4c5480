// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/ros_types.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>

namespace soilvdb::tools {

const std::vector<RosType>& ros_types() {
  static const std::vector<RosType> types = {
      {"geometry_msgs/PoseStamped",
       "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8"},
      {"geometry_msgs/WrenchStamped",
       "8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77"},
      {"grid_map_msgs/GridMap", "343b0e72887541beda6b035cc053f2d6fffaad9d6dcb2773c15a808dfca31fde"},
      {"nav_msgs/Odometry", "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0"},
      {"sensor_msgs/JointState",
       "a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"},
      {"std_msgs/Float64", "705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a"},
      {"tf2_msgs/TFMessage", "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"}};
  return types;
}

DdsType dds_type(const std::string& name) {
  const auto& types = ros_types();
  const auto found = std::find_if(types.begin(), types.end(),
                                  [&](const RosType& type) { return type.name == name; });
  const std::size_t slash = name.find('/');
  return {fmt::format("{}::msg::dds_::{}_", name.substr(0, slash), name.substr(slash + 1)),
          fmt::format("typehash=RIHS01_{};", found->hash)};
}

std::string dds_topic(const std::string& topic) {
  return (topic.starts_with('/') ? "rt" : "rt/") + topic;
}

std::string ros_name(const std::string& name) {
  std::string part = name;
  for (char& c : part)
    if (std::isalnum(static_cast<unsigned char>(c)) == 0) c = '_';
  return part.empty() || std::isdigit(static_cast<unsigned char>(part[0])) != 0 ? '_' + part : part;
}

}  // namespace soilvdb::tools
