// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/motion/motion_checks.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "io/file/instant.h"
#include "io/file/text.h"
#include "io/motion/motion_angles.h"
#include "soilvdb/io/motion_rows.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr double kMaxTimeS = 1e11;             // allows seconds since 1970, not milliseconds
constexpr double kQuaternionTolerance = 0.01;  // two decimals; beyond, it is no rotation
constexpr double kDecimalTolerance = 1e-6;     // rounding of decimal input, rad or m
// Faster than any bucket: those of large draglines swing at 25 m/s, a clamshell reaches 28 m/s in a
// fall of 40 m, and buckets curl at 3 rad/s on a house that swings at 1.2 rad/s.
constexpr double kFastest_m_s = 50, kFastest_rad_s = 10;
// Noise of sensors over any short time: satellite positions step by one or two decimetres when a
// fix is lost or found, and inclinometers and gyroscopes by a few degrees under shocks.
constexpr double kJitter_m = 0.25, kJitter_rad = 0.25, kWrapJitter_rad = 0.2;
// A URDF's limits are rounded, sometimes to 5 degrees, an error of 0.04 rad. Sensors are mounted
// and zeroed within 3 degrees. In sum, the teeth stay within a bucket's height of the truth.
constexpr double kBeyondLimit_rad = 0.1, kBeyondLimit_m = 0.1;
// URDF velocities are rated values; loads push joints beyond them by at most a third.
constexpr double kBeyondFastest = 2, kJointJitter = 0.05;  // rad or m, of an encoder
// Limit for a joint in one row, at any time difference: sweeping a wrong value would take hours.
constexpr double kMostTurn_rad = 100, kMostShift_m = 1000;

// Limit for joints that turn all the way round. They are slower than a curling bucket: houses swing
// at 1.5 rad/s.
constexpr double kFastestTurn_rad_s = 2;

/// Is this travel a whole turn, nearly, and too fast for a machine?
bool wraps(double travel, double after_s) {
  const double rest = std::abs(std::abs(travel) - kTurn);
  return std::abs(travel) > kFastestTurn_rad_s * after_s &&
         rest <= std::min(kFastestTurn_rad_s * after_s + kWrapJitter_rad, kTurn / 4);
}

/// A message if the movement is faster than any machine; else empty. @param noun name of the row
/// before
std::string speed_fault(const std::string& what, double moved, double after_s, bool turn,
                        const char* noun) {
  const double fastest = turn ? kFastest_rad_s : kFastest_m_s;
  if (moved <= fastest * after_s + (turn ? kJitter_rad : kJitter_m)) return {};
  const char* unit = turn ? "rad" : "m";
  return fmt::format(
      "{} {} {:.3g} {} in {:.3g} s since the {} before; no machine does more "
      "than {} {}/s",
      what, turn ? "turns" : "moves", moved, unit, after_s, noun, fastest, unit);
}

/// A message if the movement is faster than this machine's joint; else empty.
std::string joint_speed_fault(const Joint& joint, double moved, double after_s, const char* noun) {
  if (joint.fastest == 0) return {};
  if (moved <= kBeyondFastest * joint.fastest * after_s + kJointJitter) return {};
  const bool turns = joint.type != Joint::Type::kPrismatic;
  const char* unit = turns ? "rad" : "m";
  return fmt::format(
      "joint {} {} {:.3g} {} in {:.3g} s since the {} before; its velocity limit in the urdf is "
      "{:g} {}/s, and at most twice that is accepted",
      joint.name, turns ? "turns" : "moves", moved, unit, after_s, noun, joint.fastest, unit);
}

std::string wrap_fault(const Joint& joint, double before, double value, double after_s) {
  if (!may_wrap(joint) || !wraps(value - before, after_s)) return {};
  const double on = before + std::remainder(value - before, kTurn);
  return fmt::format(
      "joint {} wraps from {:.4g} to {:.4g} rad; it must go on past a whole turn, "
      "to {:.4g}",
      joint.name, before, value, on);
}

/// A message if a joint moves too far in one row; else empty.
std::string far_fault(const Joint& joint, double way, const char* noun) {
  const bool turns = joint.type != Joint::Type::kPrismatic;
  const double most = turns ? kMostTurn_rad : kMostShift_m;
  if (std::abs(way) <= most) return {};
  const char* unit = turns ? "rad" : "m";
  return fmt::format("joint {} {} {:g} {} since the {} before; at most {} {} in one {}", joint.name,
                     turns ? "turns" : "moves", way, unit, noun, most, unit, noun);
}

/// @param advice for angles that may be in degrees
std::string limit_fault(const Joint& joint, double value, AngleUnit unit, const char* advice) {
  if (joint.lower == joint.upper || may_wrap(joint)) return {};
  const bool turns = joint.type != Joint::Type::kPrismatic;
  const double beyond = std::max(joint.lower - value, value - joint.upper);
  const double most = turns ? kBeyondLimit_rad : kBeyondLimit_m;
  if (beyond <= most) return {};
  const auto text = [&](double angle) {
    return angle_text(angle, turns ? unit : AngleUnit::kRadians);
  };
  const bool degrees = turns && unit == AngleUnit::kRadians && std::abs(value) > kTurn;
  return fmt::format(
      "joint {} is at {} {}; the urdf limits it to {} to {}, and at most {} beyond is accepted{}",
      joint.name, text(value), turns ? unit_name(unit) : "m", text(joint.lower), text(joint.upper),
      text(most), degrees ? advice : "");
}

/// The first message of `look`, called with each movable joint and its index; else empty.
std::string first_fault(const Chain& chain, const auto& look) {
  std::size_t i = 0;
  for (const Joint& joint : chain.joints) {
    if (!joint.moves_itself()) continue;
    if (std::string why = look(joint, i++); !why.empty()) return why;
  }
  return {};
}

/// @param what "the bucket"
std::string poses_fault(const char* what, const Pose& before, const Pose& pose, double after_s,
                        const char* noun) {
  std::string why =
      speed_fault(what, (pose.position - before.position).norm(), after_s, false, noun);
  if (!why.empty()) return why;
  return speed_fault(what, pose.rotation.angularDistance(before.rotation), after_s, true, noun);
}

std::string joint_fault(const Joint& joint, double before, double value, double after_s,
                        const char* noun) {
  const double moved = std::abs(value - before);
  std::string why = joint_speed_fault(joint, moved, after_s, noun);
  if (!why.empty()) return why;
  return speed_fault("joint " + joint.name, moved, after_s, joint.type != Joint::Type::kPrismatic,
                     noun);
}

void fail_if(const RowPlace& lines, const std::string& why) {
  if (!why.empty()) lines.fail(why);
}

/// @param text the value's text, for messages
void check_range(const RowPlace& lines, const std::string& name, double value,
                 std::string_view text) {
  const double limit = name == "time" ? kMaxTimeS : kMaxNumber;
  if (!(std::abs(value) <= limit)) {
    lines.fail(fmt::format("{} is {}; it must be a number within {:g}{}", name, printable(text),
                           limit, name == "time" ? " (seconds)" : ""));
  }
  if (std::fpclassify(value) == FP_SUBNORMAL) {
    lines.fail(
        fmt::format("{} is {}, too small for any sensor; it must be 0 or a number beyond 1e-300",
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

double row_time(const RowPlace& lines, std::string_view field) {
  if (!is_date(field)) return row_number(lines, "time", field);
  try {
    return date_time_s(field);
  } catch (const std::invalid_argument& e) {
    lines.fail(fmt::format("time: {}", e.what()));
  }
}

void check_number(const RowPlace& lines, const std::string& name, double value) {
  check_range(lines, name, value, fmt::format("{}", value));
}

Pose row_pose(const RowPlace& lines, std::span<const double> v, bool quaternion,
              const char* prefix) {
  if (!quaternion) return {{v[0], v[1], v[2]}, from_rpy(v[3], v[4], v[5])};
  Pose pose = pose_of(v.data());
  const double norm = pose.rotation.norm();
  if (!(std::abs(norm - 1) <= kQuaternionTolerance)) {
    lines.fail(fmt::format(
        "the quaternion {0}qx,{0}qy,{0}qz,{0}qw has the norm {1:.6g}; it must be 1", prefix, norm));
  }
  pose.rotation.normalize();
  return pose;
}

void check_limits(const RowPlace& lines, const Chain& chain, const std::vector<double>& row,
                  AngleUnit unit) {
  fail_if(lines, first_fault(chain, [&](const Joint& joint, std::size_t i) {
            return limit_fault(joint, row[i + 1], unit,
                               "; if these are degrees, say 'angles: degrees' beside the "
                               "machine's 'motion:'");
          }));
}

void check_poses(const RowPlace& lines, const Pose& before, const Pose& pose, double after_s) {
  fail_if(lines, poses_fault("the bucket", before, pose, after_s, "row"));
}

void check_joints(const RowPlace& lines, const Chain& chain, const std::vector<double>& before,
                  const std::vector<double>& row) {
  const double after_s = row[0] - before[0];
  fail_if(lines, first_fault(chain, [&](const Joint& joint, std::size_t i) {
            const double from = before[i + 1], to = row[i + 1];
            std::string why = far_fault(joint, to - from, "row");
            return why.empty() ? joint_fault(joint, from, to, after_s, "row") : why;
          }));
  const auto base = [&](const std::vector<double>& of) {
    return chain.base_of(std::span(of).subspan(1));
  };
  fail_if(lines, poses_fault("the base", base(before), base(row), after_s, "row"));
}

bool same_values(std::span<const double> a, std::span<const double> b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](double x, double y) { return std::abs(x - y) <= kDecimalTolerance; });
}

void go_on_past_turns(const Chain& chain, const std::vector<double>& before,
                      std::vector<double>& row, std::vector<int>& turns) {
  const double after_s = row[0] - before[0];
  std::size_t i = 0;
  for (const Joint& joint : chain.joints) {
    if (!joint.moves_itself()) continue;
    ++i;
    if (!may_wrap(joint)) continue;
    turns.resize(row.size() - 1);
    int& made = turns[i - 1];
    const double as_read = row[i];
    row[i] = as_read + made * kTurn;
    if (!wraps(row[i] - before[i], after_s)) continue;
    made += row[i] > before[i] ? -1 : 1;
    row[i] = as_read + made * kTurn;
  }
}

std::string state_fault(const Chain& chain, std::span<const double> values) {
  return first_fault(chain, [&](const Joint& joint, std::size_t i) {
    return limit_fault(joint, values[i], AngleUnit::kRadians, "; are these degrees?");
  });
}

std::string state_fault(const Chain& chain, std::span<const double> before,
                        std::span<const double> values, double after_s) {
  std::string fault = first_fault(chain, [&](const Joint& joint, std::size_t i) {
    std::string why = far_fault(joint, values[i] - before[i], "state");
    if (why.empty()) why = wrap_fault(joint, before[i], values[i], after_s);
    return why.empty() ? joint_fault(joint, before[i], values[i], after_s, "state") : why;
  });
  if (!fault.empty()) return fault;
  return poses_fault("the base", chain.base_of(before), chain.base_of(values), after_s, "state");
}

std::string state_fault(const Pose& before, const Pose& pose, double after_s) {
  return poses_fault("the bucket", before, pose, after_s, "state");
}

JointLimits::JointLimits(const Chain& chain) {
  for (const Joint& joint : chain.joints) {
    if (joint.moves_itself()) joints_.push_back({joint});
  }
}

void JointLimits::row(const std::vector<double>& v, const std::vector<int>& turns_made, long line) {
  for (std::size_t i = 0; i < joints_.size(); ++i) {
    auto& [joint, rows, first, before, turns, first_turn] = joints_[i];
    if (may_wrap(joint) && std::abs(v[i + 1] - before) > kTurn / 2 && turns++ == 0)
      first_turn = line;
    before = v[i + 1];
    if (joint.type == Joint::Type::kContinuous || joint.lower == joint.upper) continue;
    const double as_read = v[i + 1] - (turns_made.empty() ? 0 : turns_made[i] * kTurn);
    if (as_read >= joint.lower - kDecimalTolerance && as_read <= joint.upper + kDecimalTolerance)
      continue;
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

void Gaps::row(const RowPlace& place, double gap_s, double moved) {
  constexpr double kStands = 0.1;  // m or rad
  if (!most_s_ || gap_s <= *most_s_ || moved <= kStands) return;
  ++count_;
  if (gap_s <= longest_s_) return;
  longest_s_ = gap_s;
  longest_ = fmt::format("{}:{}: comes {:.3g} s after the row before", place.file().string(),
                         place.number(), gap_s);
}

void Gaps::warn(std::vector<std::string>& warnings) const {
  if (count_ == 0) return;
  const std::string more = count_ == 1 ? "" : fmt::format(", the longest of {} such gaps", count_);
  warnings.push_back(fmt::format(
      "{}{}; the machine moved meanwhile, and is assumed to have moved straight", longest_, more));
}

}  // namespace soilvdb::inline v0::io
