// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tests/support/filled_columns.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace soilvdb::test {

FilledColumns::FilledColumns(const Bucket& bucket, const Eigen::Quaterniond& world_from_bucket,
                             double slope)
    : bucket_(bucket), turn_(world_from_bucket.toRotationMatrix()), slope_(slope) {
  const double y = bucket.width_m / 2, z = bucket.height_m;
  const std::array<Vec3, 5> corners = {Vec3(0, -y, 0), Vec3(0, y, 0), Vec3(0, y, z), Vec3(0, -y, z),
                                       Vec3(0, -y, 0)};
  for (std::size_t i = 0; i < 4; ++i)
    sides_.push_back({turn_ * corners[i], turn_ * (corners[i + 1] - corners[i])});
  for (const Vec3& p : extremes(bucket)) box_.extend((turn_ * p).head<2>().eval());
}

/// Cells are quartered until corners and middle agree to `fine_m3`.
FilledColumns::Sum FilledColumns::sum(double fine_m3) const {
  constexpr int kCells = 32;
  Sum sum;
  const Vec2 size = box_.sizes() / kCells;
  std::vector<double> corners_m;
  for (int i = 0; i <= kCells; ++i) {
    for (int j = 0; j <= kCells; ++j)
      corners_m.push_back(column_m(box_.min() + size.cwiseProduct(Vec2(i, j))));
  }
  for (int i = 0; i < kCells; ++i) {
    for (int j = 0; j < kCells; ++j) {
      const double* c = &corners_m[static_cast<std::size_t>(i * (kCells + 1) + j)];
      add(box_.min() + size.cwiseProduct(Vec2(i, j)), size,
          {c[0], c[1], c[kCells + 1], c[kCells + 2]}, fine_m3, sum);
    }
  }
  return sum;
}

void FilledColumns::add(const Vec2& low, const Vec2& size, const std::array<double, 4>& c,
                        double fine_m3, Sum& sum) const {
  constexpr double kSmallest = 1e-4;
  const auto at = [&](double i, double j) {
    return column_m(low + Vec2(i * size.x(), j * size.y()));
  };
  const double middle = at(0.5, 0.5), mean = (c[0] + c[1] + c[2] + c[3]) / 4, area = size.prod();
  const double change_m3 = std::abs(middle - mean) * area;
  if (change_m3 > fine_m3 && size.maxCoeff() > kSmallest) {
    const Vec2 half = size / 2, x(half.x(), 0), y(0, half.y());
    const double west = at(0, 0.5), east = at(1, 0.5), south = at(0.5, 0), north = at(0.5, 1);
    add(low, half, {c[0], west, south, middle}, fine_m3, sum);
    add(low + y, half, {west, c[1], middle, north}, fine_m3, sum);
    add(low + x, half, {south, middle, c[2], east}, fine_m3, sum);
    add(low + half, half, {middle, north, east, c[3]}, fine_m3, sum);
    return;
  }
  sum.volume_m3 += (2 * middle + mean) / 3 * area;
  sum.error_m3 += change_m3;
}

double FilledColumns::column_m(const Vec2& at) const {
  crossings_.clear();
  // The bucket's coordinates along the column are p + z * d.
  const Vec3 p = turn_.transpose() * Vec3(at.x(), at.y(), 0), d = turn_.row(2).transpose();
  const double half = bucket_.width_m / 2;
  const auto& outline = bucket_.profile;
  for (std::size_t i = 0; i < outline.size(); ++i) {
    const bool mouth = i + 1 == outline.size();
    const Vec2 &a = outline[i], &b = outline[mouth ? 0 : i + 1];
    const Vec2 normal(b.y() - a.y(), a.x() - b.x());
    const double speed = normal.x() * d.x() + normal.y() * d.z();
    if (speed == 0) continue;
    const double z = (normal.x() * (a.x() - p.x()) + normal.y() * (a.y() - p.z())) / speed;
    if (std::abs(p.y() + z * d.y()) > half) continue;
    const Vec2 q(p.x() + z * d.x(), p.z() + z * d.z());
    if ((q - a).dot(b - a) >= 0 && (q - b).dot(a - b) > 0) crossings_.push_back({z, mouth});
  }
  for (const double y : {-half, half}) {
    if (d.y() == 0) continue;
    const double z = (y - p.y()) / d.y();
    if (winds_about({p.x() + z * d.x(), p.z() + z * d.z()})) crossings_.push_back({z, false});
  }
  std::sort(crossings_.begin(), crossings_.end());
  if (crossings_.size() % 2 != 0) return 0;  // along an edge
  if (crossings_.empty() || crossings_[0].mouth) return 0;
  const double top = surface(at);
  double sum = 0;
  for (std::size_t i = 0; i < crossings_.size(); i += 2) {
    const Crossing &floor = crossings_[i], &roof = crossings_[i + 1];
    sum += std::max(0.0, (roof.mouth ? top : std::min(top, roof.z)) - floor.z);
  }
  return sum;
}

bool FilledColumns::winds_about(const Vec2& q) const {
  double turns = 0;
  for (std::size_t i = 0; i < bucket_.profile.size(); ++i) {
    const Vec2 &a = bucket_.profile[i], &b = bucket_.profile[(i + 1) % bucket_.profile.size()];
    const bool up = a.y() <= q.y() && q.y() < b.y(), down = b.y() <= q.y() && q.y() < a.y();
    if (!up && !down) continue;
    const double left = (b.x() - a.x()) * (q.y() - a.y()) - (q.x() - a.x()) * (b.y() - a.y());
    if (up && left > 0) turns += 1;
    if (down && left < 0) turns -= 1;
  }
  return turns != 0;
}

/// Points of each side at equal distances, then again as many about the least of them: along a
/// straight line a cone is convex.
double FilledColumns::surface(const Vec2& at) const {
  constexpr int kPoints = 12;
  double least = std::numeric_limits<double>::infinity();
  for (const auto& [from, way] : sides_) {
    const Vec2 to = from.head<2>() - at;
    const double c = to.squaredNorm(), b = to.dot(way.head<2>());
    const double a = way.head<2>().squaredNorm();
    double middle = 0.5, reach = 0.5, best = least, best_s = 0.5;
    for (int level = 0; level < 3; ++level) {
      for (int i = 0; i <= kPoints; ++i) {
        const double s = std::clamp(middle + reach * (2.0 * i / kPoints - 1), 0.0, 1.0);
        const double z =
            from.z() + s * way.z() + slope_ * std::sqrt(std::max(0.0, c + s * (2 * b + s * a)));
        if (i == 0 || z < best) best = z, best_s = s;
      }
      middle = best_s, reach *= 2.0 / kPoints;
    }
    least = std::min(least, best);
  }
  return least;
}

}  // namespace soilvdb::test
