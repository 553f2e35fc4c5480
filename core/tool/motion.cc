// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/motion.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <string>

#include "core/constants.h"
#include "core/lattice/text.h"

namespace soilvdb::inline v0 {
namespace {

std::string point_text(const Vec3& p) {
  return "(" + text(p.x()) + ", " + text(p.y()) + ", " + text(p.z()) + ")";
}

bool is_within(const Vec3& position_m, const Vec3& middle_m, double farthest_m) {
  return (position_m - middle_m).cwiseAbs().maxCoeff<Eigen::PropagateNaN>() <= farthest_m;
}

bool is_unit(const Eigen::Quaterniond& rotation) {
  return std::abs(rotation.squaredNorm() - 1) <= kMaxUnitError;
}

[[noreturn]] void refuse_row(std::size_t i, const char* what) {
  throw std::invalid_argument("row " + std::to_string(i) + " of a motion has " + what);
}

void check_times(const std::vector<double>& times_s, std::size_t rows) {
  if (times_s.empty()) throw std::invalid_argument("a motion needs at least one row");
  if (times_s.size() != rows) {
    throw std::invalid_argument("a motion needs as many times as rows, not " +
                                std::to_string(times_s.size()) + " and " + std::to_string(rows));
  }
  for (std::size_t i = 0; i < times_s.size(); ++i) {
    if (!std::isfinite(times_s[i]) || (i > 0 && !(times_s[i] > times_s[i - 1]))) {
      throw std::invalid_argument("times must be finite and increase, row " + std::to_string(i) +
                                  " doesn't");
    }
  }
}

/// Points of a bucket that move farthest, and their largest distance from the bucket's origin.
struct Extremes {
  std::vector<Vec3> points;  // the mouth's corners and the body's outline
  double radius_m = 0;

  explicit Extremes(const Bucket& bucket) : points(extremes(bucket)) {
    for (const Vec3& p : points) radius_m = std::max(radius_m, p.norm());
  }

  /// Does the map p -> turn p + shift move no point farther than `limit_m` from zero?
  bool within(const Eigen::Matrix3d& turn, const Vec3& shift, double limit_m) const {
    if (shift.norm() + turn.norm() * radius_m <= limit_m) return true;
    return std::all_of(points.begin(), points.end(),
                       [&](const Vec3& p) { return (turn * p + shift).norm() <= limit_m; });
  }
};

/// A pose as a matrix, for many points.
struct Frame {
  Pose pose;
  Eigen::Matrix3d axes;

  Frame(const Pose& p) : pose(p), axes(p.rotation.toRotationMatrix()) {}
};

/// How close together poses must be: see Motion::trace().
struct Closeness {
  Extremes extremes;
  double tolerance_m, stride_m;

  bool holds(const Frame& a, const Frame& middle, const Frame& b) const {
    const Vec3 &from = a.pose.position, &mid = middle.pose.position, &to = b.pose.position;
    // A point p of the bucket halfway, seen from both ends: their mean is p on a straight way.
    const Eigen::Matrix3d turn =
        (a.axes + b.axes).transpose() * middle.axes / 2 - Eigen::Matrix3d::Identity();
    const Vec3 bend = (a.axes.transpose() * (mid - from) + b.axes.transpose() * (mid - to)) / 2;
    return extremes.within(turn, bend, tolerance_m) &&
           extremes.within(b.axes - a.axes, to - from, stride_m);
  }
};

/// Appends poses after `a` up to and including `b`: middles of segments and their ends. `at(s)` is
/// the pose at fraction s between them.
template <typename At>
void bisect(const Frame& a, double sa, const Frame& b, double sb, const At& at,
            const Closeness& close, int depth, std::vector<Pose>& out) {
  const double sm = (sa + sb) / 2;
  const Frame m = at(sm);
  if (depth < kMaxHalvings && sm > sa && sm < sb) {
    if (!close.holds(a, m, b)) {
      bisect(a, sa, m, sm, at, close, depth + 1, out);
      bisect(m, sm, b, sb, at, close, depth + 1, out);
      return;
    }
  }
  out.push_back(m.pose);
  out.push_back(b.pose);
}

}  // namespace

bool is_valid(const Pose& pose) {
  return is_within(pose.position, Vec3::Zero(), kMaxMotionValue) && is_unit(pose.rotation);
}

std::string validation_error(const Vec3& position_m, const Vec3& middle_m, double farthest_m) {
  if (is_within(position_m, middle_m, farthest_m)) return {};
  const std::string is = "the position is " + point_text(position_m) + " m; it must be ";
  if (!position_m.allFinite()) return is + "finite";
  return is + "within " + text(farthest_m) + " m of " + point_text(middle_m);
}

std::string validation_error(const Pose& pose) {
  std::string position = validation_error(pose.position, Vec3::Zero(), kMaxMotionValue);
  if (!position.empty() || is_unit(pose.rotation)) return position;
  return "the rotation is a quaternion of length " + text(pose.rotation.norm()) +
         "; it must be of length 1";
}

Motion::Motion(std::vector<double> times_s, std::vector<Pose> world_from_bucket)
    : times_s_(std::move(times_s)), poses_(std::move(world_from_bucket)) {
  check_times(times_s_, poses_.size());
  for (std::size_t i = 0; i < poses_.size(); ++i) {
    if (!is_valid(poses_[i])) refuse_row(i, "a pose with an invalid position or rotation");
  }
}

Motion::Motion(std::vector<double> times_s, std::vector<double> joint_values, Chain chain)
    : times_s_(std::move(times_s)),
      joint_values_(std::move(joint_values)),
      chain_(std::move(chain)) {
  const std::size_t joints = chain_.movable_count(), rows = times_s_.size();
  const bool drives = joint_values_.size() != joints * rows;
  if (drives && joint_values_.size() != (joints + kPoseNumbers) * rows) {
    throw std::invalid_argument("a motion needs a value for each movable joint in each row");
  }
  check_times(times_s_, rows);
  for (std::size_t i = 0; i < rows; ++i) {
    const std::span<const double> row = configuration(i);
    for (const double value : row.first(joints)) {
      if (!(std::abs(value) <= kMaxMotionValue))
        refuse_row(i, "a joint that isn't finite, or beyond 1e9");
    }
    if (drives && !is_valid(pose_of(&row[joints])))
      refuse_row(i, "a base with an invalid position or rotation");
    if (row_pieces(i) > kMaxRowPieces) refuse_row(i, "a joint that jumps");
  }
}

std::pair<std::size_t, std::size_t> Motion::rows_around(double time_s) const {
  const auto after = std::upper_bound(times_s_.begin(), times_s_.end(), time_s);
  const auto j = std::min(static_cast<std::size_t>(after - times_s_.begin()), times_s_.size() - 1);
  return {j == 0 ? 0 : j - 1, j};
}

double Motion::share_of(std::size_t i, std::size_t j, double time_s) const {
  const double span = times_s_[j] - times_s_[i];
  return span > 0 ? std::clamp((time_s - times_s_[i]) / span, 0.0, 1.0) : 0.0;
}

Pose Motion::pose(double time_s) const {
  const auto [i, j] = rows_around(time_s);
  return between(i, j, time_s);
}

Pose Motion::between(std::size_t i, std::size_t j, double time_s) const {
  const double s = share_of(i, j, time_s);
  if (!poses_.empty()) return interpolate(poses_[i], poses_[j], s);
  const std::size_t n = columns();
  std::array<double, kStackJoints> few;
  std::vector<double> many(n > kStackJoints ? n : 0);
  double* q = n > kStackJoints ? many.data() : few.data();
  chain_.between(configuration(i), configuration(j), s, q);
  return chain_.world_from_bucket({q, n});
}

std::vector<double> Motion::joint_values(double time_s) const {
  std::vector<double> values(columns());
  const auto [i, j] = rows_around(time_s);
  if (!values.empty())
    chain_.between(configuration(i), configuration(j), share_of(i, j, time_s), values.data());
  return values;
}

Motion Motion::simplified(const Bucket& bucket, double tolerance_m) const {
  const Extremes extremes(bucket);
  const bool drives = poses_.empty() && columns() > chain_.movable_count();
  // Joints may make up for the base's way at the bucket, but not at sensors on other links.
  const auto base_is_near = [&](std::size_t i, std::size_t j, std::size_t k,
                                const Vec3& bucket_position) {
    const Pose is = chain_.base_of(configuration(k));
    const Pose would_be =
        interpolate(chain_.base_of(configuration(i)), chain_.base_of(configuration(j)),
                    share_of(i, j, times_s_[k]));
    const double arm_m = (bucket_position - is.position).norm();
    return (is.position - would_be.position).norm() <= tolerance_m &&
           arm_m * is.rotation.angularDistance(would_be.rotation) <= tolerance_m;
  };
  const auto straight = [&](std::size_t i, std::size_t j) {
    for (std::size_t k = i + 1; k < j; ++k) {
      const Frame is = row(k), would_be = between(i, j, times_s_[k]);
      if (!extremes.within(is.axes - would_be.axes, is.pose.position - would_be.pose.position,
                           tolerance_m))
        return false;
      if (drives && !base_is_near(i, j, k, is.pose.position)) return false;
    }
    return true;
  };
  const std::size_t last = times_s_.size() - 1;
  std::vector<std::size_t> kept{0};
  while (kept.back() < last) {
    // Double the step, then halve it: each row is checked a few times, for any number of rows.
    const std::size_t i = kept.back();
    std::size_t good = 1, step = 2;
    while (i + good < last && straight(i, std::min(i + step, last))) {
      good = std::min(step, last - i);
      step *= 2;
    }
    for (std::size_t half = good / 2; half > 0; half /= 2) {
      const std::size_t further = std::min(good + half, last - i);
      if (further > good && straight(i, i + further)) good = further;
    }
    kept.push_back(i + good);
  }
  std::vector<double> times, values;
  std::vector<Pose> poses;
  for (const std::size_t i : kept) {
    times.push_back(times_s_[i]);
    if (!poses_.empty()) poses.push_back(poses_[i]);
    const std::span<const double> row = configuration(i);
    values.insert(values.end(), row.begin(), row.end());
  }
  if (!poses_.empty()) return {std::move(times), std::move(poses)};
  return {std::move(times), std::move(values), chain_};
}

std::size_t Motion::row_pieces(std::size_t i) const {
  if (joint_values_.empty() || i == 0) return 1;
  const std::size_t joints = chain_.movable_count();
  const std::span<const double> from = configuration(i - 1), to = configuration(i);
  double most = 0;
  for (std::size_t k = 0; k < joints; ++k) most = std::max(most, std::abs(to[k] - from[k]));
  if (to.size() > joints)
    most = std::max(most,
                    pose_of(&from[joints]).rotation.angularDistance(pose_of(&to[joints]).rotation));
  return std::max<std::size_t>(1, static_cast<std::size_t>(std::ceil(most)));
}

std::vector<Pose> Motion::trace(double t0, double t1, const Bucket& bucket, double tolerance_m,
                                double stride_m) const {
  const Closeness close{Extremes(bucket), tolerance_m, stride_m};
  const auto first = std::upper_bound(times_s_.begin(), times_s_.end(), t0);
  auto row = static_cast<std::size_t>(first - times_s_.begin());
  const std::size_t last = times_s_.size() - 1;
  std::vector<Pose> out{pose(t0)};
  Frame a = out.front();
  for (double t = t0; t < t1; ++row) {
    const double to = row > last ? t1 : std::min(times_s_[row], t1);
    const std::size_t i = row == 0 ? 0 : std::min(row - 1, last), j = std::min(row, last);
    const auto at = [&](double time_s) { return between(i, j, time_s); };
    // A full turn and its half may look like rest, so joints start from pieces of a turn.
    for (std::size_t left = row > last ? 1 : row_pieces(row); left > 0; --left) {
      const double until = left == 1 ? to : t + (to - t) / static_cast<double>(left);
      const Frame b = at(until);
      bisect(a, t, b, until, at, close, 0, out);
      a = b;
      t = until;
    }
  }
  return out;
}

void trace(const Pose& a, const Pose& b, const Bucket& bucket, double tolerance_m, double stride_m,
           std::vector<Pose>& out) {
  const auto at = [&](double s) { return interpolate(a, b, s); };
  bisect(a, 0.0, b, 1.0, at, {Extremes(bucket), tolerance_m, stride_m}, 0, out);
}

}  // namespace soilvdb::inline v0
