// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Checks a bucket before it digs. Every message begins with the name of the field.
#include "core/bucket.h"

#include <fmt/format.h>

#include <cmath>
#include <numbers>
#include <stdexcept>

namespace soilvdb {
namespace {

constexpr double kMinSideM = 1e-3;
constexpr double kMaxSideM = 100.0;  // the largest buckets are 6 m wide
constexpr std::size_t kMaxProfilePoints = 1000;
constexpr double kSamePointM = 1e-9;  // rounding of decimal input

[[noreturn]] void refuse(const std::string& message) { throw std::invalid_argument(message); }

void check_side(const char* name, double side_m) {
  if (side_m >= kMinSideM && side_m <= kMaxSideM) return;
  refuse(fmt::format("{} is {} m; it must be from {} to {} m", name, side_m, kMinSideM, kMaxSideM));
}

double cross(const Vec2& a, const Vec2& b) { return a.x() * b.y() - a.y() * b.x(); }

bool on_segment(const Vec2& p, const Vec2& a, const Vec2& b) {
  return (p - a).dot(p - b) <= 0;  // p is known to be on the line
}

/// Do the closed segments ab and cd have a point in common?
bool meet(const Vec2& a, const Vec2& b, const Vec2& c, const Vec2& d) {
  const double abc = cross(b - a, c - a), abd = cross(b - a, d - a);
  const double cda = cross(d - c, a - c), cdb = cross(d - c, b - c);
  if (((abc > 0 && abd < 0) || (abc < 0 && abd > 0)) &&
      ((cda > 0 && cdb < 0) || (cda < 0 && cdb > 0))) {
    return true;
  }
  return (abc == 0 && on_segment(c, a, b)) || (abd == 0 && on_segment(d, a, b)) ||
         (cda == 0 && on_segment(a, c, d)) || (cdb == 0 && on_segment(b, c, d));
}

void check_profile(const std::vector<Vec2>& profile, double height_m) {
  const std::size_t n = profile.size();
  if (n < 3) {
    refuse(
        fmt::format("profile has {} point{}; it needs at least 3, from the lip [0, 0] to the "
                    "upper edge [0, {}]",
                    n, n == 1 ? "" : "s", height_m));
  }
  if (n > kMaxProfilePoints) {
    refuse(fmt::format("profile has {} points; it may have at most {}", n, kMaxProfilePoints));
  }
  for (const Vec2& p : profile) {
    if (!(p.cwiseAbs().maxCoeff() <= kMaxSideM)) {
      refuse(fmt::format("profile has the point [{}, {}]; coordinates must be within {} m", p.x(),
                         p.y(), kMaxSideM));
    }
    if (p.x() > 0) {
      refuse(
          fmt::format("profile has the point [{}, {}] in front of the mouth; x must be 0 or less",
                      p.x(), p.y()));
    }
  }
  if (profile.front().norm() > kSamePointM) {
    refuse(fmt::format("profile starts at [{}, {}]; it must start at the lip, [0, 0]",
                       profile.front().x(), profile.front().y()));
  }
  if ((profile.back() - Vec2(0, height_m)).norm() > kSamePointM) {
    refuse(fmt::format("profile ends at [{}, {}]; it must end at the upper edge, [0, {}]",
                       profile.back().x(), profile.back().y(), height_m));
  }
  // Edge i runs from point i to point i + 1; edge n - 1 is the mouth.
  const auto point = [&](std::size_t i) -> const Vec2& { return profile[i % n]; };
  for (std::size_t i = 0; i < n; ++i) {
    const Vec2 &a = point(i), &b = point(i + 1), &c = point(i + 2);
    if ((b - a).norm() <= kSamePointM) {
      refuse(fmt::format("profile has the point [{}, {}] twice in a row; leave one out", a.x(),
                         a.y()));
    }
    if (cross(b - a, c - b) == 0 && (b - a).dot(c - b) < 0) {
      refuse(
          fmt::format("profile turns back on itself at [{}, {}]; it must enclose an area with "
                      "the mouth",
                      b.x(), b.y()));
    }
  }
  for (std::size_t i = 0; i < n; ++i) {
    const Vec2 &a = point(i), &b = point(i + 1);
    for (std::size_t j = i + 2; j < n; ++j) {
      if (i == 0 && j == n - 1) continue;  // neighbours across the lip
      if (meet(a, b, point(j), point(j + 1))) {
        refuse(
            fmt::format("profile crosses itself between the edges that start at [{}, {}] and "
                        "[{}, {}]; it and the mouth must be a simple polygon",
                        a.x(), a.y(), point(j).x(), point(j).y()));
      }
    }
  }
}

}  // namespace

void Bucket::validate() const {
  check_side("width", width_m);
  check_side("height", height_m);
  if (!profile.empty()) check_profile(profile, height_m);
  if (dump_angle_rad && !(*dump_angle_rad >= 0 && *dump_angle_rad <= std::numbers::pi / 2)) {
    refuse(
        fmt::format("dump_angle is {} rad; it must be from 0 to 1.5708 (the mouth looks straight "
                    "down)",
                    *dump_angle_rad));
  }
}

}  // namespace soilvdb
