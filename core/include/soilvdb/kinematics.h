// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Where the lip is, given a machine's joints.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "soilvdb/types.h"

namespace soilvdb::inline v0 {

/// One joint on the way from the machine's root link to the lip.
struct Joint {
  enum class Type { kFixed, kRevolute, kContinuous, kPrismatic };
  std::string name;
  Type type = Type::kFixed;
  Pose parent_from_joint;       ///< the URDF <origin>
  Vec3 axis = Vec3::UnitX();    ///< unit, in the joint frame
  double lower = 0, upper = 0;  ///< rad or m; equal values mean no limit
  double fastest = 0;           ///< rad/s or m/s; 0 means no limit
  /// The joint that it follows, at `multiplier` times that one's value plus `offset` (rad or m);
  /// empty: it follows none. Both are of one chain.
  std::string mimics = {};
  double multiplier = 1, offset = 0;
  bool beside = false;  ///< it is not on the way to the lip: only joints that follow it move that

  /// Has it a value of its own?
  bool moves_itself() const { return type != Type::kFixed && mimics.empty(); }
};

/// A serial chain. Joint values come in the order of the movable joints: all but the fixed ones and
/// those that follow others.
struct Chain {
  Pose world_from_root;
  std::vector<Joint> joints;  ///< root to lip link
  Pose link_from_bucket;      ///< the bucket frame in the last joint's child link

  /// Names of the movable joints, in order.
  std::vector<std::string> movable() const;

  /// The bucket frame in the world.
  /// @param values rad or m, one per movable joint, not checked against the limits
  Pose world_from_bucket(std::span<const double> values) const;

  /// Where the joints are, from the root to the lip, those that don't move left out; world, m.
  std::vector<Vec3> joint_places(std::span<const double> values) const;
};

}  // namespace soilvdb::inline v0
