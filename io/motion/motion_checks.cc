// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/motion/motion_checks.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "io/file/text.h"
#include "io/motion/motion_angles.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr double kMaxTimeS = 1e11;             // seconds since 1970 are fine, milliseconds are not
constexpr double kQuaternionTolerance = 0.01;  // two decimals; more is no rotation
constexpr double kLimitTolerance = 1e-6;       // rounding of decimal input, rad or m
// No machine moves or turns its bucket this fast: large draglines swing theirs at 25 m/s, a
// clamshell falls 40 m to 28 m/s, buckets curl at 3 rad/s on a house that swings at 1.2 rad/s.
constexpr double kFastest_m_s = 50, kFastest_rad_s = 10;
// That sensors may add, however short the time: satellite positions step by a decimetre or two when
// a fix is lost or found, angles of inclinometers and gyroscopes by a few degrees under shocks.
constexpr double kJitter_m = 0.25, kJitter_rad = 0.25, kWrapJitter_rad = 0.2;
// A URDF's limits are rounded, to 5 degrees at times, which is off by 0.04 rad; sensors are mounted
// and set to zero within 3 degrees. The bucket's teeth stay within a bucket's height of the truth.
constexpr double kBeyondLimit_rad = 0.1, kBeyondLimit_m = 0.1;
// Velocities of a URDF are rated ones: loads push joints beyond, by a third at most.
constexpr double kBeyondFastest = 2, kJointJitter = 0.05;  // rad or m, of an encoder
// Of a joint in one row, however long it takes: what is surely a slip takes forever to sweep.
constexpr double kMostTurn_rad = 100, kMostShift_m = 1000;

// Of a joint that goes all the way round, which is slower than buckets curl: houses swing at 1.5
// rad/s.
constexpr double kFastestTurn_rad_s = 2;

/// Is it a turn too fast for a machine, and little but for the whole turn?
bool wraps(double travel, double after_s) {
  const double rest = std::abs(std::abs(travel) - kTurn);
  return std::abs(travel) > kFastestTurn_rad_s * after_s &&
         rest <= std::min(kFastestTurn_rad_s * after_s + kWrapJitter_rad, kTurn / 4);
}

/// Refuses what moves faster than machines do.
void check_speed(const RowPlace& lines, const std::string& what, double moved, double after_s,
                 bool turn) {
  const double fastest = turn ? kFastest_rad_s : kFastest_m_s;
  if (moved <= fastest * after_s + (turn ? kJitter_rad : kJitter_m)) return;
  const char* unit = turn ? "rad" : "m";
  lines.fail(
      fmt::format("{} {} {:.3g} {} in {:.3g} s since the row before; no machine does more "
                  "than {} {}/s",
                  what, turn ? "turns" : "moves", moved, unit, after_s, fastest, unit));
}

/// Refuses what is faster than the joint of this machine.
void check_joint_speed(const RowPlace& lines, const Joint& joint, double moved, double after_s) {
  if (joint.fastest == 0) return;
  if (moved <= kBeyondFastest * joint.fastest * after_s + kJointJitter) return;
  const bool turns = joint.type != Joint::Type::kPrismatic;
  const char* unit = turns ? "rad" : "m";
  lines.fail(fmt::format(
      "joint {} {} {:.3g} {} in {:.3g} s since the row before; its velocity limit in "
      "the urdf is {:g} {}/s, and none goes beyond twice that",
      joint.name, turns ? "turns" : "moves", moved, unit, after_s, joint.fastest, unit));
}

/// @param text of it, for messages
void check_range(const RowPlace& lines, const std::string& name, double value,
                 std::string_view text) {
  const double limit = name == "time" ? kMaxTimeS : kMaxNumber;
  if (!(std::abs(value) <= limit)) {
    lines.fail(fmt::format("{} is {}; it must be a number within {:g}{}", name, printable(text),
                           limit, name == "time" ? " (seconds)" : ""));
  }
  if (std::fpclassify(value) == FP_SUBNORMAL) {
    lines.fail(
        fmt::format("{} is {}, less than any sensor tells from 0; it must be 0 or a number "
                    "beyond 1e-300",
                    name, printable(text)));
  }
}

}  // namespace

double row_number(const RowPlace& lines, const std::string& name, std::string_view field) {
  const auto value = parse_number(field);
  if (!value) {
    lines.fail(fmt::format("{} is '{}'; it must be a number", name, printable(field)));
  }
  check_range(lines, name, *value, field);
  return *value;
}

void check_number(const RowPlace& lines, const std::string& name, double value) {
  check_range(lines, name, value, fmt::format("{}", value));
}

Pose row_pose(const RowPlace& lines, const std::vector<double>& v, bool quaternion) {
  Pose pose;
  pose.position = {v[1], v[2], v[3]};
  if (!quaternion) {
    pose.rotation = from_rpy(v[4], v[5], v[6]);
    return pose;
  }
  pose.rotation = Eigen::Quaterniond(v[7], v[4], v[5], v[6]);
  const double norm = pose.rotation.norm();
  if (!(std::abs(norm - 1) <= kQuaternionTolerance)) {
    lines.fail(fmt::format("the quaternion qx,qy,qz,qw has the norm {:.6g}; it must be 1", norm));
  }
  pose.rotation.normalize();
  return pose;
}

void check_limits(const RowPlace& lines, const Chain& chain, const std::vector<double>& row,
                  AngleUnit unit) {
  std::size_t i = 0;
  for (const Joint& joint : chain.joints) {
    if (joint.type == Joint::Type::kFixed) continue;
    ++i;
    if (joint.lower == joint.upper || may_wrap(joint)) continue;
    const bool turns = joint.type != Joint::Type::kPrismatic;
    const double beyond = std::max(joint.lower - row[i], row[i] - joint.upper);
    const double most = turns ? kBeyondLimit_rad : kBeyondLimit_m;
    if (beyond <= most) continue;
    const auto text = [&](double value) {
      return angle_text(value, turns ? unit : AngleUnit::kRadians);
    };
    const bool degrees = turns && unit == AngleUnit::kRadians && std::abs(row[i]) > kTurn;
    lines.fail(
        fmt::format("joint {} is at {} {}; the urdf limits it to {} to {}, and no more than {} "
                    "beyond is taken{}",
                    joint.name, text(row[i]), turns ? unit_name(unit) : "m", text(joint.lower),
                    text(joint.upper), text(most),
                    degrees ? "; if these are degrees, say 'angles: degrees' beside the "
                              "machine's 'motion:'"
                            : ""));
  }
}

void check_poses(const RowPlace& lines, const Pose& before, const Pose& pose, double after_s) {
  check_speed(lines, "the bucket", (pose.position - before.position).norm(), after_s, false);
  check_speed(lines, "the bucket", pose.rotation.angularDistance(before.rotation), after_s, true);
}

void check_joints(const RowPlace& lines, const Chain& chain, const std::vector<double>& before,
                  const std::vector<double>& row, AngleUnit unit) {
  std::size_t i = 0;
  for (const Joint& joint : chain.joints) {
    if (joint.type == Joint::Type::kFixed) continue;
    ++i;
    const bool turns = joint.type != Joint::Type::kPrismatic;
    const double moved = std::abs(row[i] - before[i]);
    const double most = turns ? kMostTurn_rad : kMostShift_m;
    if (moved > most) {
      const char* length = turns ? "rad" : "m";
      lines.fail(fmt::format("joint {} {} {:g} {} since the row before; at most {} {} in one row",
                             joint.name, turns ? "turns" : "moves", row[i] - before[i], length,
                             most, length));
    }
    const double after_s = row[0] - before[0];
    if (may_wrap(joint) && wraps(row[i] - before[i], after_s)) {
      const double on = before[i] + std::remainder(row[i] - before[i], kTurn);
      throw InputError(
          lines.file(), lines.number(),
          fmt::format("joint {} wraps from {} to {} {}; it must go on past a whole "
                      "turn, to {}",
                      joint.name, angle_text(before[i], unit), angle_text(row[i], unit),
                      unit_name(unit), angle_text(on, unit)));
    }
    check_joint_speed(lines, joint, moved, after_s);
    check_speed(lines, "joint " + joint.name, moved, after_s, turns);
  }
}

JointLimits::JointLimits(const Chain& chain) {
  for (const Joint& joint : chain.joints) {
    if (joint.type != Joint::Type::kFixed) joints_.push_back({joint});
  }
}

void JointLimits::row(const std::vector<double>& v, long line) {
  for (std::size_t i = 0; i < joints_.size(); ++i) {
    auto& [joint, rows, first, before, turns, first_turn] = joints_[i];
    if (may_wrap(joint) && std::abs(v[i + 1] - before) > kTurn / 2 && turns++ == 0)
      first_turn = line;
    before = v[i + 1];
    if (joint.type == Joint::Type::kContinuous || joint.lower == joint.upper) continue;
    if (v[i + 1] >= joint.lower - kLimitTolerance && v[i + 1] <= joint.upper + kLimitTolerance) {
      continue;
    }
    if (rows++ == 0) first = line;
  }
}

void JointLimits::warn(const RowPlace& place, std::vector<std::string>& warnings) const {
  for (const auto& [joint, rows, first, before, turns, first_turn] : joints_) {
    if (turns > 0) {
      warnings.push_back(fmt::format(
          "{}: joint {} turns more than half a turn at once in {} row{}, first at {} {}; if it "
          "wraps there, it must go on past a whole turn",
          place.file().string(), joint.name, turns, turns == 1 ? "" : "s", place.noun(),
          first_turn));
    }
    if (rows == 0) continue;
    warnings.push_back(fmt::format(
        "{}: joint {} exceeds its limits ({:.2f} to {:.2f} {}) in {} row{}, first at {} {}",
        place.file().string(), joint.name, joint.lower, joint.upper,
        joint.type == Joint::Type::kPrismatic ? "m" : "rad", rows, rows == 1 ? "" : "s",
        place.noun(), first));
  }
}

}  // namespace soilvdb::inline v0::io
