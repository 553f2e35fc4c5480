// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The pose of the lip for a machine's joint values.
#pragma once

#include <Eigen/Geometry>
#include <functional>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "soilvdb/types.h"

namespace soilvdb::inline v0 {

/// One joint between the machine's root link and the lip.
struct Joint {
  enum class Type { kFixed, kRevolute, kContinuous, kPrismatic };
  std::string name;
  Type type = Type::kFixed;
  Pose parent_from_joint;       ///< the URDF <origin>
  Vec3 axis = Vec3::UnitX();    ///< unit, in the joint frame
  double lower = 0, upper = 0;  ///< rad or m; equal: no limit
  double fastest = 0;           ///< rad/s or m/s; 0: no limit
  /// Joint of the same chain that this joint mimics, at `multiplier` times its value plus `offset`
  /// (rad or m). Empty: an independent joint.
  std::string mimics = {};
  double multiplier = 1, offset = 0;
  bool beside = false;  ///< a side joint: it moves the lip only through joints that mimic it

  /// Whether the joint has a value of its own.
  bool moves_itself() const { return type != Type::kFixed && mimics.empty(); }
};

class LinkBodies;

/// The boxes that cover a part of a machine, at a place.
struct PlacedBoxes {
  Pose world_from_boxes;
  std::span<const Eigen::AlignedBox3d> boxes_m;  ///< at least one
};

/// A serial chain. A configuration of it has a value of each movable joint, in order: those that
/// are neither fixed nor mimics. Of a machine that drives the pose of the root follows, as in
/// row_of(), in place of `world_from_root`.
struct Chain {
  Pose world_from_root;       ///< its base
  std::vector<Joint> joints;  ///< root to lip link
  Pose link_from_bucket;      ///< the bucket frame in the last joint's child link
  /// Shapes of the machine's links; null: not known.
  std::shared_ptr<const LinkBodies> bodies = {};

  /// Names of the movable joints, in order.
  std::vector<std::string> movable() const;
  std::size_t movable_count() const;

  /// May a configuration have so many numbers?
  bool takes(std::size_t numbers) const {
    return numbers == movable_count() || numbers == movable_count() + kPoseNumbers;
  }
  /// The pose of the root in a configuration; `world_from_root` if it has none.
  Pose base_of(std::span<const double> values) const;
  /// Appends the root's pose to a configuration without it.
  static void add_base(std::vector<double>& values, const Pose& base);
  /// The configuration at fraction `s` in [0, 1] of the way from `a` to `b`: joint values linear,
  /// the root as by interpolate().
  void between(std::span<const double> a, std::span<const double> b, double s, double* out) const;

  /// Pose of the bucket frame in the world.
  /// @param values a configuration, rad or m, not checked against the limits
  Pose world_from_bucket(std::span<const double> values) const;

  /// What a force on the bucket does to the movable joints, N m or N: positive the way that a
  /// joint's value grows. @param force N, world. @param moment about the bucket frame's origin, N m
  std::vector<double> joint_loads(std::span<const double> values, const Vec3& force,
                                  const Vec3& moment) const;

  /// Positions of the moving joints, from the root to the lip; world, m.
  std::vector<Vec3> joint_places(std::span<const double> values) const;

  /// Where the shapes of `bodies` are. Valid as long as these.
  std::vector<PlacedBoxes> placed_bodies(std::span<const double> values) const;
};

/// The shape of a link of a machine.
struct LinkBody {
  Chain link;                       ///< from the root; its bucket frame is that of the boxes
  std::vector<std::size_t> joints;  ///< of `link`: their numbers among the machine's
  std::vector<Eigen::AlignedBox3d> boxes_m;
};

/// Shapes of a machine's links. They are read when they are first needed, which is by a scan.
class LinkBodies {
 public:
  struct Read {
    std::vector<LinkBody> bodies = {};
    std::string warning = {};  ///< one line about what could not be read; else empty
  };
  explicit LinkBodies(std::function<Read()> read) : read_(std::move(read)) {}
  /// Thread-safe.
  const std::vector<LinkBody>& all() const { return read().bodies; }
  /// At its first call.
  std::string take_warning() const;

 private:
  const Read& read() const;

  std::function<Read()> read_;
  mutable std::once_flag once_, told_;
  mutable Read done_;
};

}  // namespace soilvdb::inline v0
