// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/draw/relief.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "io/draw/loose_soil.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr float kNoHeight = std::numeric_limits<float>::quiet_NaN();
constexpr double kWallSlope = 2.5;
constexpr Rgb kNoGround{0.955, 0.955, 0.955};
constexpr Rgb kHatch{0.875, 0.875, 0.875};
constexpr Rgb kContour{0.33, 0.25, 0.17};

void for_rows(int rows, const std::function<void(int)>& row) {
  tbb::parallel_for(tbb::blocked_range<int>(0, rows, 4), [&](const tbb::blocked_range<int>& r) {
    for (int y = r.begin(); y < r.end(); ++y) row(y);
  });
}

/// dz/dx (east) and dz/dy (north) over up to `radius` cells to both sides, within the ground and
/// not across the rim of the cut.
struct Gradient {
  double east = 0, north = 0;
};
Gradient gradient(const Relief& r, int x, int y, int radius) {
  const auto difference = [&](int dx, int dy, double cell) {
    int a = 0, b = 0;
    // Steps to the next cell, but not across a rim: a wall belongs to its own pixels.
    const auto onward = [&](int from, int to) {
      const int px = x + to * dx, py = y + to * dy;
      if (px < 0 || px >= r.nx || py < 0 || py >= r.ny) return false;
      const float h = r.height[r.at(px, py)];
      const float step = h - r.height[r.at(x + from * dx, y + from * dy)];
      if (std::isnan(h) || std::abs(to) == 1) return !std::isnan(h);
      const bool rim = (r.depth[r.at(px, py)] > 0) != (r.depth[r.at(x, y)] > 0);
      return !rim && std::abs(step) < kWallSlope * cell;
    };
    while (a < radius && onward(a, a + 1)) ++a;
    while (b < radius && onward(-b, -b - 1)) ++b;
    if (a + b == 0) return 0.0;
    return (r.height[r.at(x + a * dx, y + a * dy)] - r.height[r.at(x - b * dx, y - b * dy)]) /
           ((a + b) * cell);
  };
  return {difference(1, 0, r.cell_x()), difference(0, -1, r.cell_y())};
}

/// Light from the north-west, softened by light from west, north and above; 1 on level ground.
double hillshade(const Gradient& g, double exaggeration) {
  const Vec3 normal = Vec3(-g.east * exaggeration, -g.north * exaggeration, 1).normalized();
  constexpr double kSin = std::numbers::sqrt2 / 2;
  const auto lambert = [&](double azimuth_rad) {
    const Vec3 light(std::sin(azimuth_rad) * kSin, std::cos(azimuth_rad) * kSin, kSin);
    return std::max(0.0, normal.dot(light)) / kSin;
  };
  constexpr double kNorthWest = -std::numbers::pi / 4, kWest = -std::numbers::pi / 2;
  return 0.55 * lambert(kNorthWest) + 0.15 * lambert(kWest) + 0.15 * lambert(0) + 0.15 * normal.z();
}

int radius_px(const Relief& r, double voxel_size_m) {
  return std::clamp(static_cast<int>(std::lround(0.5 * voxel_size_m / r.cell_x())), 1, 64);
}

/// Exaggerates gentle ground until its slopes show, at most fourfold.
double exaggeration(const Relief& r, int radius) {
  std::vector<double> slopes;
  const int stride =
      std::max(1, static_cast<int>(std::sqrt(static_cast<double>(r.height.size()) / 20000)));
  for (int y = 0; y < r.ny; y += stride) {
    for (int x = 0; x < r.nx; x += stride) {
      if (std::isnan(r.height[r.at(x, y)]) || r.depth[r.at(x, y)] != 0) continue;
      const Gradient g = gradient(r, x, y, radius);
      slopes.push_back(std::hypot(g.east, g.north));
    }
  }
  if (slopes.empty()) return 1;
  const auto steep = slopes.begin() + static_cast<std::ptrdiff_t>(slopes.size() * 9 / 10);
  std::nth_element(slopes.begin(), steep, slopes.end());
  return std::clamp(0.7 / std::max(*steep, 1e-9), 1.0, 4.0);
}

/// The share of a pixel that a contour covers, from the height and its change per pixel.
double contour_cover(double height_m, double change_per_px_m, double interval_m) {
  const double level = height_m / interval_m;
  const double per_px = change_per_px_m / interval_m;
  if (per_px < 1e-4) return 0;  // nearly level: a line would show only rounding
  const bool fifth = std::lround(level) % 5 == 0;
  const double distance_px = std::abs(level - std::round(level)) / per_px;
  const double width_px = fifth ? 1.5 : 0.9;
  const double cover = std::clamp(width_px / 2 + 0.5 - distance_px, 0.0, 1.0);
  // Contours closer than a few pixels would only darken the slope.
  const double apart = std::clamp((1 / per_px - 4) / 6, 0.0, 1.0);
  return cover * apart * (fifth ? 0.60 : 0.38);
}

}  // namespace

Relief sample_relief(const HeightFunction& now, const HeightFunction& base,
                     const Eigen::AlignedBox2d& box, int nx, int ny, double least_m, bool filled) {
  Relief r{.nx = nx, .ny = ny, .box = box, .height = {}, .depth = {}};
  r.height.assign(static_cast<std::size_t>(nx) * static_cast<std::size_t>(ny), kNoHeight);
  r.depth.assign(r.height.size(), 0.0f);
  for (int i = 0; i < 400; ++i) {  // the datum is the first ground found on a coarse lattice
    const Vec2 p = box.min() + Vec2((i % 20 * 7 % 20 + 0.5) / 20 * box.sizes().x(),
                                    (i / 20 * 7 % 20 + 0.5) / 20 * box.sizes().y());
    if (const auto z = base(p.x(), p.y())) {
      r.datum_m = std::round(*z);
      break;
    }
  }
  for_rows(ny, [&](int y) {
    const double world_y = box.max().y() - (y + 0.5) * r.cell_y();
    for (int x = 0; x < nx; ++x) {
      const double world_x = box.min().x() + (x + 0.5) * r.cell_x();
      const auto z = now(world_x, world_y);
      if (!z) continue;
      const double before = base(world_x, world_y).value_or(*z), depth = before - *z;
      const bool changed = depth > least_m || (filled && depth < -least_m);
      r.height[r.at(x, y)] = static_cast<float>((changed ? *z : before) - r.datum_m);
      if (changed) r.depth[r.at(x, y)] = static_cast<float>(depth);
    }
  });
  return r;
}

std::optional<HeightRange> height_range(const Relief& relief) {
  std::optional<HeightRange> range;
  for (const float h : relief.height) {
    if (std::isnan(h)) continue;
    if (!range) range = HeightRange{h, h};
    range->low = std::min(range->low, h);
    range->high = std::max(range->high, h);
  }
  return range;
}

float deepest(const Relief& relief) {
  return relief.depth.empty() ? 0 : *std::max_element(relief.depth.begin(), relief.depth.end());
}

float highest(const Relief& relief) {
  return relief.depth.empty() ? 0 : -*std::min_element(relief.depth.begin(), relief.depth.end());
}

void sample_loose(Relief& r, const std::function<double(const Vec3&)>& loose, double voxel_size_m) {
  r.loose.assign(r.height.size(), 0.0f);
  for_rows(r.ny, [&](int y) {
    for (int x = 0; x < r.nx; ++x) {
      const std::size_t at = r.at(x, y);
      if (std::isnan(r.height[at])) continue;
      const Vec2 p = r.middle(x, y);
      const double z = r.height[at] + r.datum_m - 0.25 * voxel_size_m;
      r.loose[at] = static_cast<float>(loose({p.x(), p.y(), z}));
    }
  });
}

double depth_at(const Relief& r, double x, double y) {
  const double u = std::clamp((x - r.box.min().x()) / r.cell_x() - 0.5, 0.0, r.nx - 1.0);
  const double v = std::clamp((r.box.max().y() - y) / r.cell_y() - 0.5, 0.0, r.ny - 1.0);
  const int i = std::min(static_cast<int>(u), std::max(0, r.nx - 2));
  const int j = std::min(static_cast<int>(v), std::max(0, r.ny - 2));
  const int i1 = std::min(i + 1, r.nx - 1), j1 = std::min(j + 1, r.ny - 1);
  const double a = u - i, b = v - j;
  return (1 - b) * ((1 - a) * r.depth[r.at(i, j)] + a * r.depth[r.at(i1, j)]) +
         b * ((1 - a) * r.depth[r.at(i, j1)] + a * r.depth[r.at(i1, j1)]);
}

std::vector<std::uint32_t> shade(const Relief& r, const PlanStyle& style) {
  std::vector<std::uint32_t> pixels(r.height.size());
  const int radius = radius_px(r, style.voxel_size_m);
  const double half = 0.5 * style.voxel_size_m;
  const double steeper = exaggeration(r, radius);
  const double clod = clod_m(r.box.sizes().norm(), style.voxel_size_m);
  for_rows(r.ny, [&](int y) {
    for (int x = 0; x < r.nx; ++x) {
      const std::size_t at = r.at(x, y);
      if (std::isnan(r.height[at])) {
        pixels[at] = to_pixel((x + y) % 12 < 2 ? kHatch : kNoGround);
        continue;
      }
      const Gradient g = gradient(r, x, y, radius);
      const double depth = r.depth[at];
      // Where the colour shows depth, light only models the shape.
      const double light =
          depth != 0 ? 0.6 + 0.4 * std::min(hillshade(g, 1), 1.1) : hillshade(g, steeper);
      Rgb color = kEarth;
      if (depth != 0 && !style.scale.empty()) {
        color = mix(color, style.scale.color(depth),
                    0.55 + 0.4 * std::min(1.0, std::abs(depth) / half));
      }
      if (!r.loose.empty()) {
        const Vec2 p = r.middle(x, y) - r.box.min();
        color = as_loose(color, {p.x(), p.y(), r.height[at]}, clod, r.loose[at]);
      }
      // Shadows darken towards a cool tone, sunlit slopes brighten towards white.
      color = light < 1 ? mix({0.16, 0.13, 0.17}, color, 0.12 + 0.88 * std::pow(light, 0.7))
                        : mix(color, {1, 0.99, 0.95}, std::min(0.6, 1.8 * (light - 1)));
      if (style.contour_m > 0) {
        const Gradient fine = gradient(r, x, y, 1);
        const double per_px = std::hypot(fine.east * r.cell_x(), fine.north * r.cell_y());
        color =
            mix(color, kContour, contour_cover(r.height[at] + r.datum_m, per_px, style.contour_m));
      }
      pixels[at] = to_pixel(color);
    }
  });
  return pixels;
}

std::vector<ContourLabel> label_contours(const Relief& r, const PlanStyle& style) {
  std::vector<ContourLabel> labels;
  const auto range = height_range(r);
  if (!range || !(style.contour_m > 0)) return labels;
  const double step = 5 * style.contour_m;
  constexpr int kRoom = 46;  // px around a label
  const auto clear = [&](int x, int y) {
    if (x < kRoom || y < kRoom || x >= r.nx - kRoom || y >= r.ny - kRoom) return false;
    for (int dy = -kRoom; dy <= kRoom; dy += 8) {
      for (int dx = -kRoom; dx <= kRoom; dx += 8) {
        const std::size_t at = r.at(x + dx, y + dy);
        if (std::isnan(r.height[at]) || r.depth[at] != 0) return false;
      }
    }
    return std::none_of(labels.begin(), labels.end(), [&](const ContourLabel& l) {
      return std::hypot(l.x - x, l.y - y) < 3 * kRoom;
    });
  };
  for (double level = std::ceil((range->low + r.datum_m) / step) * step;
       level <= range->high + r.datum_m && labels.size() < 40; level += step) {
    ContourLabel best;
    double best_score = 0;
    for (int y = 0; y < r.ny; y += 3) {
      for (int x = 0; x < r.nx; x += 3) {
        const std::size_t at = r.at(x, y);
        if (std::isnan(r.height[at])) continue;
        const Gradient g = gradient(r, x, y, 3);
        const double per_px = std::hypot(g.east * r.cell_x(), g.north * r.cell_y());
        const double off = level - r.datum_m - r.height[at];
        if (!(per_px > 1e-4 * step) || std::abs(off) > 3 * per_px) continue;
        // Prefers the middle of the picture, where neighbouring contours leave room.
        const double apart_px = style.contour_m / per_px;
        const double middle = 1 - std::hypot((x - 0.5 * r.nx) / r.nx, (y - 0.5 * r.ny) / r.ny);
        const double score = std::min(1.0, apart_px / 16) * middle;
        if (apart_px < 9 || score <= best_score || !clear(x, y)) continue;
        // From the pixel onto the contour, along the gradient (screen y points south).
        const Vec2 uphill(g.east * r.cell_x() / per_px, -g.north * r.cell_y() / per_px);
        double angle = std::atan2(uphill.x(), -uphill.y());
        if (angle > std::numbers::pi / 2) angle -= std::numbers::pi;
        if (angle < -std::numbers::pi / 2) angle += std::numbers::pi;
        best_score = score;
        best = {x + 0.5 + uphill.x() * off / per_px, y + 0.5 + uphill.y() * off / per_px, angle,
                level};
      }
    }
    if (best_score > 0) labels.push_back(best);
  }
  return labels;
}

}  // namespace soilvdb::inline v0::io
