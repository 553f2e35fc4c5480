// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/motion.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <string>

namespace soilvdb {
namespace {

constexpr int kMaxBisections = 40;

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

/// Appends poses after `a` up to and including `b`, middles of segments and their ends; `at(s)` is
/// the pose at fraction s between them.
template <typename At>
void bisect(const Pose& a, double sa, const Pose& b, double sb, const At& at,
            const std::vector<Vec3>& points, double tolerance_m, double stride_m, int depth,
            std::vector<Pose>& out) {
  const double sm = (sa + sb) / 2;
  const Pose m = at(sm);
  if (depth < kMaxBisections && sm > sa && sm < sb) {
    const Pose bucket_a = a.inverse(), bucket_b = b.inverse();
    for (const Vec3& p : points) {
      const Vec3 world = m * p;
      const double bend = ((bucket_a * world + bucket_b * world) / 2 - p).norm();
      if (bend > tolerance_m || (b * p - a * p).norm() > stride_m) {
        bisect(a, sa, m, sm, at, points, tolerance_m, stride_m, depth + 1, out);
        bisect(m, sm, b, sb, at, points, tolerance_m, stride_m, depth + 1, out);
        return;
      }
    }
  }
  out.push_back(m);
  out.push_back(b);
}

}  // namespace

Motion::Motion(std::vector<double> times_s, std::vector<Pose> world_from_bucket)
    : times_s_(std::move(times_s)), poses_(std::move(world_from_bucket)) {
  check_times(times_s_, poses_.size());
}

Motion::Motion(std::vector<double> times_s, std::vector<double> joint_values, Chain chain)
    : times_s_(std::move(times_s)),
      joint_values_(std::move(joint_values)),
      chain_(std::move(chain)) {
  const std::size_t joints = chain_.movable().size();
  if (joint_values_.size() != joints * times_s_.size()) {
    throw std::invalid_argument("a motion needs a value for each movable joint in each row");
  }
  check_times(times_s_, times_s_.size());
}

Pose Motion::pose(double time_s) const {
  const auto after = std::upper_bound(times_s_.begin(), times_s_.end(), time_s);
  const auto j = std::min(static_cast<std::size_t>(after - times_s_.begin()), times_s_.size() - 1);
  return between(j == 0 ? 0 : j - 1, j, time_s);
}

/// The pose at a time, interpolated between rows i and j.
Pose Motion::between(std::size_t i, std::size_t j, double time_s) const {
  const double span = times_s_[j] - times_s_[i];
  const double s = span > 0 ? std::clamp((time_s - times_s_[i]) / span, 0.0, 1.0) : 0.0;
  if (!poses_.empty()) return interpolate(poses_[i], poses_[j], s);
  const std::size_t n = joint_values_.size() / times_s_.size();
  constexpr std::size_t kFew = 16;
  std::array<double, kFew> few;
  std::vector<double> many(n > kFew ? n : 0);
  double* q = n > kFew ? many.data() : few.data();
  for (std::size_t k = 0; k < n; ++k) {
    const double a = joint_values_[i * n + k], b = joint_values_[j * n + k];
    q[k] = a + s * (b - a);
  }
  return chain_.world_from_bucket({q, n});
}

Motion Motion::simplified(const Bucket& bucket, double tolerance_m) const {
  const std::vector<Vec3> points = extremes(bucket);
  const auto straight = [&](std::size_t i, std::size_t j) {
    for (std::size_t k = i + 1; k < j; ++k) {
      const Pose is = between(k, k, times_s_[k]), would_be = between(i, j, times_s_[k]);
      for (const Vec3& p : points) {
        if ((is * p - would_be * p).norm() > tolerance_m) return false;
      }
    }
    return true;
  };
  const std::size_t last = times_s_.size() - 1;
  std::vector<std::size_t> kept{0};
  while (kept.back() < last) {
    // Twice as far each time, then back: rows are looked at a few times each, however many.
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
  const std::size_t n = joint_values_.size() / times_s_.size();
  std::vector<double> times, joints;
  std::vector<Pose> poses;
  for (const std::size_t i : kept) {
    times.push_back(times_s_[i]);
    if (!poses_.empty()) poses.push_back(poses_[i]);
    const auto row = joint_values_.begin() + static_cast<std::ptrdiff_t>(i * n);
    joints.insert(joints.end(), row, row + static_cast<std::ptrdiff_t>(n));
  }
  if (!poses_.empty()) return {std::move(times), std::move(poses)};
  return {std::move(times), std::move(joints), chain_};
}

/// Pieces of the way from row j - 1 to row j in which no joint moves more than a radian.
std::size_t Motion::row_pieces(std::size_t j) const {
  if (joint_values_.empty() || j == 0) return 1;
  const std::size_t n = joint_values_.size() / times_s_.size();
  double most = 0;
  for (std::size_t k = 0; k < n; ++k) {
    most = std::max(most, std::abs(joint_values_[j * n + k] - joint_values_[(j - 1) * n + k]));
  }
  return std::max<std::size_t>(1, static_cast<std::size_t>(std::ceil(most)));
}

std::vector<Pose> Motion::trace(double t0, double t1, const Bucket& bucket, double tolerance_m,
                                double stride_m) const {
  const std::vector<Vec3> points = extremes(bucket);
  std::vector<Pose> out{pose(t0)};
  double from = t0;
  auto row = std::upper_bound(times_s_.begin(), times_s_.end(), t0);
  const auto at = [this](double t) { return pose(t); };
  while (from < t1) {
    const double to = row == times_s_.end() ? t1 : std::min(*row, t1);
    // A turn and its half may look like standing still, so joints start from pieces of a turn.
    const auto j = static_cast<std::size_t>(row - times_s_.begin());
    const std::size_t pieces = row == times_s_.end() ? 1 : row_pieces(j);
    for (std::size_t k = 1; k <= pieces; ++k) {
      const double s = static_cast<double>(k) / static_cast<double>(pieces);
      const double until = k == pieces ? to : from + s * (to - from);
      const double since =
          k == 1 ? from : from + (s - 1.0 / static_cast<double>(pieces)) * (to - from);
      const Pose a = out.back();
      bisect(a, since, pose(until), until, at, points, tolerance_m, stride_m, 0, out);
    }
    from = to;
    if (row != times_s_.end()) ++row;
  }
  return out;
}

void trace(const Pose& a, const Pose& b, const Bucket& bucket, double tolerance_m, double stride_m,
           std::vector<Pose>& out) {
  const auto at = [&](double s) { return interpolate(a, b, s); };
  bisect(a, 0.0, b, 1.0, at, extremes(bucket), tolerance_m, stride_m, 0, out);
}

}  // namespace soilvdb
