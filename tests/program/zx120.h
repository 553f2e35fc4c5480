// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A 12 t excavator as its maker describes it, not as the program reads it, and what the loads it
// digs must be.
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <random>
#include <string>
#include <vector>

namespace soilvdb::test {

using Pose = Eigen::Isometry3d;
using Eigen::Vector2d, Eigen::Vector3d;

inline constexpr double kWidth_m = 0.70, kHeight_m = 1.10;
inline const std::vector<Vector2d> kProfile = {
    {0, 0},        {-0.16, 0.095}, {-0.32, 0.245}, {-0.68, 0.53}, {-0.765, 0.64},
    {-0.79, 0.78}, {-0.775, 0.93}, {-0.72, 1.02},  {-0.60, 1.10}, {0, kHeight_m}};
inline constexpr std::array kBase = {321757.0, 4297525.0, 11.342, -0.129, 0.041, 0.349};
using Joints = std::array<double, 4>;  ///< swing, boom, arm, bucket, rad

inline Pose turn(double angle, const Vector3d& axis) {
  return Pose(Eigen::AngleAxisd(angle, axis));
}
inline Pose shift(double x, double y, double z) { return Pose(Eigen::Translation3d(x, y, z)); }

/// The bucket's mouth seen from the foot of the base: x east, y north.
inline Pose site_from_bucket(const Joints& q) {
  const Vector3d x = Vector3d::UnitX(), y = Vector3d::UnitY(), z = Vector3d::UnitZ();
  return shift(0, 0, kBase[2]) * turn(kBase[5], z) * turn(kBase[4], y) * turn(kBase[3], x) *
         shift(0, 0, 1) * turn(q[0], z) * shift(0.14, -0.16443, 0.424) *
         turn(1.57079632679 + q[1], y) * shift(0, 0, 4.6) * turn(q[2], y) * shift(0, 0, 2.519) *
         turn(q[3], y) * shift(0, 0, 1.23) * turn(std::numbers::pi, x);
}

struct Row {
  double time_s;
  Joints joints;
};

inline std::vector<Row> motion() {
  std::ifstream in(std::filesystem::path(SOILVDB_SOURCE_DIR) / "tests/data/zx120_dig.csv");
  std::vector<Row> rows;
  std::string line;
  std::getline(in, line);
  while (std::getline(in, line)) {
    Row row;
    if (std::sscanf(line.c_str(), "%lf,%lf,%lf,%lf,%lf", &row.time_s, &row.joints[0],
                    &row.joints[1], &row.joints[2], &row.joints[3]) == 5)
      rows.push_back(row);
  }
  return rows;
}

/// Heights from the cells as gdal_translate lists them, bilinear between their centres.
class Heights {
 public:
  explicit Heights(const std::filesystem::path& ascii_grid) {
    std::ifstream in(ascii_grid);
    std::string key;
    for (double* value : {&nx_, &ny_, &west_, &south_, &cell_m_}) in >> key >> *value;
    if (in >> std::ws; std::isalpha(in.peek())) in >> key >> key;
    cells_.resize(static_cast<std::size_t>(nx_ * ny_));
    for (double& z : cells_) in >> z;
    good_ = static_cast<bool>(in);
  }
  bool good() const { return good_; }
  double operator()(double east, double north) const {
    const double u = (east - west_) / cell_m_ - 0.5, v = (north - south_) / cell_m_ - 0.5;
    const double i = std::floor(u), j = std::floor(v), a = u - i, b = v - j;
    return (1 - b) * ((1 - a) * at(i, j) + a * at(i + 1, j)) +
           b * ((1 - a) * at(i, j + 1) + a * at(i + 1, j + 1));
  }

 private:
  double at(double i, double j) const {
    return cells_.at(static_cast<std::size_t>((ny_ - 1 - j) * nx_ + i));
  }
  double nx_ = 0, ny_ = 0, west_ = 0, south_ = 0, cell_m_ = 0;
  std::vector<double> cells_;
  bool good_ = false;
};

/// Is a point with x <= 0 inside the bucket? Seen from the side.
inline bool in_profile(const Vector3d& p) {
  bool inside = false;
  for (std::size_t i = 0, j = kProfile.size() - 1; i < kProfile.size(); j = i++) {
    const Vector2d &a = kProfile[i], &b = kProfile[j];
    if ((a.y() > p.z()) != (b.y() > p.z()) &&
        p.x() < a.x() + (p.z() - a.y()) / (b.y() - a.y()) * (b.x() - a.x()))
      inside = !inside;
  }
  return inside;
}

/// One point at random in each cell of the dig: those that the bucket ever reaches, load by load.
class Points {
 public:
  struct Volume {
    double cut_m3 = 0, captured_m3 = 0;
  };

  explicit Points(const Heights& heights) : reached_(kSide * kSide * kHigh) {
    for (std::size_t i = 0; i < kSide; ++i)
      for (std::size_t j = 0; j < kSide; ++j) {
        const Vector3d p = corner(i, j, 0);
        column_.push_back(heights(kBase[0] + p.x(), kBase[1] + p.y()));
      }
    heights_ = &heights;
  }

  /// The volume reached first between two poses that are close together.
  void sweep(const Pose& before, const Pose& after, Volume& volume) {
    Eigen::AlignedBox3d box;
    for (const Pose* pose : {&before, &after})
      for (const double y : {-kWidth_m / 2, kWidth_m / 2})
        for (const Vector2d& p : kProfile) box.extend(*pose * Vector3d(p.x(), y, p.y()));
    const Vector3d low = (box.min() - kLow) / kCell_m, high = (box.max() - kLow) / kCell_m;
    const Pose bucket_before = before.inverse(), bucket_after = after.inverse();
    for (std::size_t i = index(low.x(), kSide); i < index(high.x() + 1, kSide); ++i)
      for (std::size_t j = index(low.y(), kSide); j < index(high.y() + 1, kSide); ++j) {
        // The slope is well below 1: one cell more than the corner's height is above the ground.
        const double top = (column_[i * kSide + j] - kLow.z()) / kCell_m + 2;
        for (std::size_t k = index(low.z(), kHigh); k < index(std::min(high.z() + 1, top), kHigh);
             ++k)
          visit(i, j, k, bucket_before, bucket_after, volume);
      }
  }

 private:
  static constexpr std::size_t kSide = 640, kHigh = 128;
  static constexpr double kCell_m = 0.025;
  inline static const Vector3d kLow{-8, -8, 10.4};  ///< the tests see if this is enough

  static std::size_t index(double at, std::size_t end) {
    return static_cast<std::size_t>(std::clamp(std::floor(at), 0.0, static_cast<double>(end)));
  }
  static Vector3d corner(std::size_t i, std::size_t j, std::size_t k) {
    return kLow + kCell_m * Vector3d(static_cast<double>(i), static_cast<double>(j),
                                     static_cast<double>(k));
  }

  void visit(std::size_t i, std::size_t j, std::size_t k, const Pose& bucket_before,
             const Pose& bucket_after, Volume& volume) {
    std::uint8_t& reached = reached_[(i * kSide + j) * kHigh + k];
    if (reached) return;
    std::minstd_rand random(static_cast<unsigned>(1 + (i * kSide + j) * kHigh + k));
    random.discard(3);
    std::uniform_real_distribution<> within(0, kCell_m);
    const double x = within(random), y = within(random), z = within(random);
    const Vector3d p = corner(i, j, k) + Vector3d(x, y, z);
    const Vector3d a = bucket_before * p, b = bucket_after * p;
    const double s = a.x() / (a.x() - b.x());  // where it meets the plane of the mouth
    const Vector3d m = a + s * (b - a);
    const bool through_mouth = a.x() > 0 && b.x() <= 0 && std::abs(m.y()) <= kWidth_m / 2 &&
                               m.z() >= 0 && m.z() <= kHeight_m;
    const bool in_body = std::abs(b.y()) <= kWidth_m / 2 && b.x() <= 0 && in_profile(b);
    if (!through_mouth && !in_body) return;
    if (p.z() >= (*heights_)(kBase[0] + p.x(), kBase[1] + p.y())) return;
    reached = 1;
    volume.cut_m3 += std::pow(kCell_m, 3);
    if (through_mouth) volume.captured_m3 += std::pow(kCell_m, 3);
  }

  const Heights* heights_ = nullptr;
  std::vector<double> column_;
  std::vector<std::uint8_t> reached_;
};

/// What each load must be, from the motion and the terrain alone. A load ends where the bucket
/// dumps, which it does on the far side.
inline std::vector<Points::Volume> true_loads(const Heights& heights) {
  constexpr int kSteps = 8;          // of at most 7 mm
  constexpr double kDumpSide = 1.0;  // rad of swing
  Points points(heights);
  std::vector<Points::Volume> loads(1);
  const std::vector<Row> rows = motion();
  Pose before = site_from_bucket(rows.front().joints);
  bool dumped = false;
  for (std::size_t r = 1; r < rows.size(); ++r)
    for (int k = 1; k <= kSteps; ++k) {
      Joints q;
      for (std::size_t i = 0; i < q.size(); ++i)
        q[i] = std::lerp(rows[r - 1].joints[i], rows[r].joints[i], static_cast<double>(k) / kSteps);
      const Pose after = site_from_bucket(q);
      points.sweep(before, after, loads.back());
      before = after;
      if (q[0] > kDumpSide) dumped = true;
      if (dumped && q[0] < kDumpSide) loads.emplace_back(), dumped = false;
    }
  return loads;
}

}  // namespace soilvdb::test
