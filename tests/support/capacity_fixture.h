// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Buckets, attitudes, and random ones.
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <stdexcept>
#include <vector>

#include "soilvdb/capacity.h"

namespace soilvdb::test {

inline constexpr double kRounding = 1e-12;   // m and m^3, of buckets of about 1 m
inline constexpr double kQuadrature = 2e-5;  // of the struck volume, where the lip isn't level

inline const std::vector<Vec2> kRound = {{0, 0},        {-0.45, 0.09}, {-0.80, 0.32}, {-0.92, 0.62},
                                         {-0.85, 0.90}, {-0.55, 1.10}, {0, 1.15}};
/// Reaches beyond both edges of the mouth.
inline const std::vector<Vec2> kBulging = {{0, 0},      {-0.5, -0.3}, {-0.9, 0.2}, {-0.6, 0.5},
                                           {-1.0, 0.9}, {-0.4, 1.5},  {0, 1.15}};

inline Bucket round_bucket() { return {1.2, 1.15, kRound, {}}; }
inline Bucket bulging_bucket() { return {1.2, 1.15, kBulging, {}}; }
inline Bucket box(double width, double height, double depth) {
  return {width, height, {{0, 0}, {-depth, 0}, {-depth, height}, {0, height}}, {}};
}
inline Capacity capacity(const Bucket& bucket) { return Capacity::of(bucket).value(); }

/// An attitude in which the world's up is this direction of the bucket.
inline Eigen::Quaterniond with_up(const Vec3& up) {
  const Vec3 axis = up.cross(Vec3::UnitZ());
  return Eigen::Quaterniond(Eigen::AngleAxisd(std::atan2(axis.norm(), up.z()), axis.normalized()));
}
inline Eigen::Quaterniond pitched(double angle) { return from_rpy(0, angle, 0); }

class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  double operator()(double low, double high) {
    return low + (high - low) * static_cast<double>(engine_() >> 11) * 0x1p-53;
  }
  Eigen::Quaterniond attitude() {
    for (;;) {
      Eigen::Vector4d q;
      for (double& part : q) part = draw();
      if (q.norm() > 0.1 && q.norm() < 1) return Eigen::Quaterniond(q.normalized());
    }
  }
  /// Any, or level along the lip, or nearly so.
  Eigen::Quaterniond machines_attitude() {
    const double kind = (*this)(0, 3);
    if (kind < 1) return attitude();
    const double bank = kind < 2 ? 0 : 0.4 * draw();
    return from_rpy(bank, 0, 0) * pitched((*this)(-2.8, 1.2));
  }
  /// Round about the middle of the mouth, or ragged.
  Bucket bucket() {
    for (;;) {
      Bucket b{(*this)(0.4, 2), (*this)(0.4, 1.5), {}, {}};
      const int points = 1 + static_cast<int>((*this)(0, 9));
      const double depth = (*this)(0.4, 1.3), ragged = (*this)(-0.5, 0.8);
      std::vector<double> angles;
      for (int i = 0; i < points; ++i) angles.push_back((*this)(0.02, std::numbers::pi - 0.02));
      std::sort(angles.begin(), angles.end());
      b.profile.emplace_back(0, 0);
      for (const double a : angles) {
        const double r = 1 - std::max(0.0, ragged) * (*this)(0, 1);
        const double wide = b.height_m * (0.5 + 0.2 * std::max(0.0, ragged));
        b.profile.emplace_back(-depth * r * std::sin(a), b.height_m / 2 - wide * r * std::cos(a));
      }
      b.profile.emplace_back(0, b.height_m);
      try {
        b.validate();
        return b;
      } catch (const std::invalid_argument&) {
      }
    }
  }

 private:
  double draw() { return (*this)(-1, 1); }
  std::mt19937_64 engine_;
};

}  // namespace soilvdb::test
