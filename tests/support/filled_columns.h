// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a bucket holds by an integration that shares no code with soilvdb::Capacity.
#pragma once

#include <array>
#include <vector>

#include "soilvdb/bucket.h"

namespace soilvdb::test {

/// Vertical columns in the world through walls and mouth, filled up to the least cone of many
/// points of the rim.
class FilledColumns {
 public:
  /// @param bucket outlives it @param slope tangent of the angle of repose
  FilledColumns(const Bucket& bucket, const Eigen::Quaterniond& world_from_bucket, double slope);

  struct Sum {
    double volume_m3 = 0;
    double error_m3 = 0;  ///< by which corners and middles of cells differ
  };
  /// Cells are quartered until corners and middle agree to `fine_m3`.
  Sum sum(double fine_m3) const;

 private:
  struct Side {
    Vec3 from, way;
  };
  struct Crossing {
    double z;
    bool mouth;
    bool operator<(const Crossing& o) const { return z < o.z; }
  };
  void add(const Vec2& low, const Vec2& size, const std::array<double, 4>& c, double fine_m3,
           Sum& sum) const;
  double column_m(const Vec2& at) const;
  bool winds_about(const Vec2& q) const;
  double surface(const Vec2& at) const;

  const Bucket& bucket_;
  Eigen::Matrix3d turn_;
  double slope_;
  std::vector<Side> sides_;
  Eigen::AlignedBox2d box_;
  mutable std::vector<Crossing> crossings_;
};

}  // namespace soilvdb::test
