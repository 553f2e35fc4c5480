// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Forward kinematics of a serial chain: one rigid transform after the other, root to lip.
#include "soilvdb/kinematics.h"

#include <algorithm>
#include <cassert>

namespace soilvdb::inline v0 {

std::vector<std::string> Chain::movable() const {
  std::vector<std::string> names;
  for (const Joint& joint : joints) {
    if (joint.moves_itself()) names.push_back(joint.name);
  }
  return names;
}

std::size_t Chain::movable_count() const {
  return static_cast<std::size_t>(std::count_if(
      joints.begin(), joints.end(), [](const Joint& joint) { return joint.moves_itself(); }));
}

Pose Chain::base_of(std::span<const double> values) const {
  const std::size_t count = movable_count();
  if (values.size() == count) return world_from_root;
  assert(takes(values.size()));
  Pose base = pose_of(values.data() + count);
  base.rotation.normalize();  // a small error is large at the end of the arm
  return base;
}

void Chain::add_base(std::vector<double>& values, const Pose& base) {
  const auto row = row_of(base);
  values.insert(values.end(), row.begin(), row.end());
}

void Chain::between(std::span<const double> a, std::span<const double> b, double s,
                    double* out) const {
  assert(a.size() == b.size() && takes(a.size()));
  const std::size_t count = movable_count();
  for (std::size_t k = 0; k < count; ++k) out[k] = a[k] + s * (b[k] - a[k]);
  if (a.size() == count) return;
  const auto base = row_of(interpolate(pose_of(&a[count]), pose_of(&b[count]), s));
  std::copy(base.begin(), base.end(), out + count);
}

namespace {

/// The value of the joint that `joint` follows.
double followed(const Chain& chain, const Joint& joint, std::span<const double> values) {
  std::size_t next = 0;
  for (const Joint& other : chain.joints) {
    if (!other.moves_itself()) continue;
    if (other.name == joint.mimics) return values[next];
    ++next;
  }
  return 0;
}

/// Calls `f(joint, world_from_joint)` for each joint, with its pose at the value 0.
/// @return world_from_link of the last link
template <typename F>
Pose walk(const Chain& chain, std::span<const double> values, const F& f) {
  Pose world_from_link = chain.base_of(values);
  std::size_t next = 0;
  for (const Joint& joint : chain.joints) {
    Pose joint_from_child;
    double value = 0;
    if (joint.moves_itself()) {
      assert(next < values.size());
      value = values[next++];
    } else if (!joint.mimics.empty()) {
      value = joint.multiplier * followed(chain, joint, values) + joint.offset;
    }
    if (joint.beside) continue;
    switch (joint.type) {
      case Joint::Type::kFixed:
        break;
      case Joint::Type::kRevolute:
      case Joint::Type::kContinuous:
        joint_from_child.rotation = Eigen::AngleAxisd(value, joint.axis);
        break;
      case Joint::Type::kPrismatic:
        joint_from_child.position = value * joint.axis;
        break;
    }
    world_from_link = world_from_link * joint.parent_from_joint;
    f(joint, world_from_link);
    world_from_link = world_from_link * joint_from_child;
  }
  assert(next == chain.movable_count());
  return world_from_link;
}

}  // namespace

Pose Chain::world_from_bucket(std::span<const double> values) const {
  const Pose world_from_link = walk(*this, values, [](const Joint&, const Pose&) {});
  Pose world_from_bucket = world_from_link * link_from_bucket;
  world_from_bucket.rotation.normalize();  // rounding of long chains
  return world_from_bucket;
}

std::vector<double> Chain::joint_loads(std::span<const double> values, const Vec3& force,
                                       const Vec3& moment) const {
  const std::vector<std::string> names = movable();
  std::vector<double> loads(names.size(), 0);
  const Vec3 lip = world_from_bucket(values).position;
  walk(*this, values, [&](const Joint& joint, const Pose& world_from_joint) {
    if (joint.type == Joint::Type::kFixed) return;
    const Vec3 axis = world_from_joint.rotation * joint.axis;
    const double load = joint.type == Joint::Type::kPrismatic
                            ? axis.dot(force)
                            : axis.dot((lip - world_from_joint.position).cross(force) + moment);
    const std::string& name = joint.mimics.empty() ? joint.name : joint.mimics;
    for (std::size_t i = 0; i < names.size(); ++i)
      if (names[i] == name) loads[i] += joint.mimics.empty() ? load : joint.multiplier * load;
  });
  return loads;
}

std::vector<Vec3> Chain::joint_places(std::span<const double> values) const {
  std::vector<Vec3> places;
  walk(*this, values, [&](const Joint& joint, const Pose& world_from_joint) {
    if (joint.type != Joint::Type::kFixed) places.push_back(world_from_joint.position);
  });
  return places;
}

std::vector<PlacedBoxes> Chain::placed_bodies(std::span<const double> values) const {
  std::vector<PlacedBoxes> placed;
  if (!bodies) return placed;
  const Pose base = base_of(values);
  for (const LinkBody& body : bodies->all()) {
    std::vector<double> own;
    for (const std::size_t joint : body.joints) own.push_back(values[joint]);
    add_base(own, base);
    placed.push_back({body.link.world_from_bucket(own), body.boxes_m});
  }
  return placed;
}

const LinkBodies::Read& LinkBodies::read() const {
  std::call_once(once_, [&] { done_ = read_(); });
  return done_;
}

std::string LinkBodies::take_warning() const {
  std::string warning;
  std::call_once(told_, [&] { warning = read().warning; });
  return warning;
}

}  // namespace soilvdb::inline v0
