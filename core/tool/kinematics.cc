// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Forward kinematics of a serial chain: one rigid transform after the other, root to lip.
#include "soilvdb/kinematics.h"

#include <cassert>

namespace soilvdb::inline v0 {

std::vector<std::string> Chain::movable() const {
  std::vector<std::string> names;
  for (const Joint& joint : joints) {
    if (joint.type != Joint::Type::kFixed) names.push_back(joint.name);
  }
  return names;
}

Pose Chain::world_from_bucket(std::span<const double> values) const {
  Pose world_from_link = world_from_root;
  std::size_t next = 0;
  for (const Joint& joint : joints) {
    Pose joint_from_child;
    switch (joint.type) {
      case Joint::Type::kFixed:
        break;
      case Joint::Type::kRevolute:
      case Joint::Type::kContinuous:
        assert(next < values.size());
        joint_from_child.rotation = Eigen::AngleAxisd(values[next++], joint.axis);
        break;
      case Joint::Type::kPrismatic:
        assert(next < values.size());
        joint_from_child.position = values[next++] * joint.axis;
        break;
    }
    world_from_link = world_from_link * joint.parent_from_joint * joint_from_child;
  }
  assert(next == values.size());
  Pose world_from_bucket = world_from_link * link_from_bucket;
  world_from_bucket.rotation.normalize();  // rounding of long chains
  return world_from_bucket;
}

}  // namespace soilvdb::inline v0
