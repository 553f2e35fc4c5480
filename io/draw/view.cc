// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/draw/view.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "io/draw/cutout.h"
#include "io/draw/loose_soil.h"
#include "soilvdb/ground_grids.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr double kRound = 0.25;  // voxels: depth to which a level set rounds off a rim
constexpr int kWidth = 1600;
constexpr double kSide = 90, kViewTop = 104, kRulerRoom = 64, kFoot = 104;
constexpr double kMaxBlockHeight = 900;
constexpr double kElevation = 46 * std::numbers::pi / 180;
constexpr double kSunHeight = 55 * std::numbers::pi / 180;
/// With more columns, voxels are far finer than pixels: the block is then made of heights.
constexpr double kMaxColumns = 1.5e6;
constexpr int kHeightColumns = 900;
constexpr Rgb kTopSoil{0.79, 0.725, 0.63}, kSection{0.50, 0.40, 0.31},
    kSectionDark{0.43, 0.335, 0.26};

/// Square cells over the box, at most `most` along its longer side.
Relief heights(const DrawnGround& ground, const Eigen::AlignedBox2d& box, int most,
               double finest_m) {
  const double cell = std::max(box.sizes().maxCoeff() / most, finest_m);
  const Vec2 cells = (box.sizes() / cell).array().round().max(2.0);
  const Vec2 half = cells * cell / 2;
  return relief_of(ground, {box.center() - half, box.center() + half}, static_cast<int>(cells.x()),
                   static_cast<int>(cells.y()));
}

/// A camera that looks at the block; azimuth of its position, clockwise from north.
Camera look(const Vec3& low, const Vec3& high, double azimuth) {
  Camera c;
  const Vec3 to_eye(std::sin(azimuth) * std::cos(kElevation),
                    std::cos(azimuth) * std::cos(kElevation), std::sin(kElevation));
  c.eye = (low + high) / 2 + 1.7 * (high - low).norm() * to_eye;
  c.forward = -to_eye;
  c.right = c.forward.cross(Vec3::UnitZ()).normalized();
  c.up = c.right.cross(c.forward);
  return c;
}

/// Sets the camera's window so that the points fill the area, at most at its size.
/// @return the height of the points in the picture, px
double frame(Camera& c, const std::vector<Vec3>& points, Area area) {
  Eigen::AlignedBox2d seen_at;
  for (const Vec3& p : points) seen_at.extend(c.tangent(p));
  c.s = std::max(seen_at.sizes().x() / area.w, seen_at.sizes().y() / area.h);
  c.u0 = seen_at.center().x() - (area.x + area.w / 2) * c.s;
  c.v0 = seen_at.max().y() + area.y * c.s;
  return seen_at.sizes().y() / c.s;
}

/// Points whose hull contains the block: a coarse sample of its surface, and its lower corners.
std::vector<Vec3> hull(const Relief& relief, const Vec3& low, const Vec3& high,
                       const Vec3& origin) {
  std::vector<Vec3> points;
  for (const double x : {low.x(), high.x()}) {
    for (const double y : {low.y(), high.y()}) points.emplace_back(x, y, low.z());
  }
  const int stride = std::max(1, std::max(relief.nx, relief.ny) / 60);
  for (int j = 0; j < relief.ny; j += stride) {
    for (int i = 0; i < relief.nx; i += stride) {
      const float z = relief.height[relief.at(i, j)];
      if (std::isnan(z)) continue;
      // Cells at the rim stand for the rim.
      const double u = i == 0 ? 0 : i + stride >= relief.nx ? 1 : (i + 0.5) / relief.nx;
      const double v = j == 0 ? 1 : j + stride >= relief.ny ? 0 : 1 - (j + 0.5) / relief.ny;
      points.emplace_back(low.x() + u * (high.x() - low.x()), low.y() + v * (high.y() - low.y()),
                          z + relief.datum_m - origin.z());
    }
  }
  return points;
}

/// Colour of the block's cut sides, in layers.
Rgb section_color(double below_top_m, double size_m) {
  const double t = below_top_m / (0.03 * size_m);
  const double layers = 0.5 + 0.28 * std::sin(2.1 * t) + 0.22 * std::sin(5.3 * t + 1.1);
  return mix(kSection, kSectionDark, std::clamp(layers, 0.0, 1.0));
}

/// A ruler of round length along the block's longest edge that faces the camera.
void draw_ruler(Canvas& canvas, const Camera& camera, const Vec3& low, const Vec3& high) {
  const double z = low.z(), gap = 0.035 * (high - low).head<2>().norm();
  Vec3 from = Vec3::Zero(), along = Vec3::Zero(), out = Vec3::Zero();
  double longest = 0;
  for (int side = 0; side < 4; ++side) {
    const bool x_edge = side % 2 == 0, upper = side >= 2;
    const Vec3 normal = (x_edge ? Vec3::UnitY() : Vec3::UnitX()) * (upper ? 1.0 : -1.0);
    Vec3 a(low.x(), low.y(), z), b(high.x(), high.y(), z);
    (x_edge ? b.y() : b.x()) = (x_edge ? a.y() : a.x()) =
        x_edge ? (upper ? high.y() : low.y()) : (upper ? high.x() : low.x());
    if (normal.dot(camera.eye - a) <= 0) continue;
    const Vec2 shown = camera.project(b) - camera.project(a);
    if (std::abs(shown.x()) <= longest) continue;  // a more level edge is easier to read
    longest = std::abs(shown.x());
    if (shown.x() < 0) std::swap(a, b);
    from = a;
    along = b - a;
    out = normal;
  }
  if (!(longest > 0)) return;
  const double length = along.norm(), bar_m = round_down_125(0.62 * length);
  const Vec3 step = along / length, start = from + 0.5 * (length - bar_m) * step + gap * out;
  const double thick = 0.35 * gap;
  const double mantissa = bar_m / std::pow(10, std::floor(std::log10(bar_m) + 1e-9));
  const int parts = std::lround(mantissa) == 2 ? 4 : 5;
  cairo_t* cr = canvas.cr();
  const auto quad = [&](double s0, double s1) {
    for (const Vec3& p :
         {Vec3(start + s0 * step), Vec3(start + s1 * step), Vec3(start + s1 * step + thick * out),
          Vec3(start + s0 * step + thick * out)}) {
      const Vec2 at = camera.project(p);
      cairo_line_to(cr, at.x(), at.y());
    }
    cairo_close_path(cr);
  };
  for (int i = 0; i < parts; ++i) {
    quad(bar_m * i / parts, bar_m * (i + 1) / parts);
    canvas.color(i % 2 == 0 ? kInk : Rgb{1, 1, 1});
    cairo_fill(cr);
  }
  quad(0, bar_m);
  canvas.color(kInk);
  cairo_set_line_width(cr, 1);
  cairo_stroke(cr);
  const Vec2 near = camera.project(start + 0.5 * bar_m * step + thick * out);
  const Vec2 direction = camera.project(start + bar_m * step) - camera.project(start);
  const double angle = std::atan2(direction.y(), direction.x());
  canvas.text(near.x() - 20 * std::sin(angle), near.y() + 20 * std::cos(angle), length_label(bar_m),
              {.size = 16, .bold = true, .align_x = 0.5, .align_y = 0.5, .angle = angle});
}

}  // namespace

Canvas draw_view(const DrawnGround& ground, const MakeBlock& make_block, const Vec3& origin,
                 const Eigen::AlignedBox2d& wanted, const Caption& caption) {
  Eigen::AlignedBox2d box = drawable(wanted, ground.voxel_size_m);
  const double voxel = ground.voxel_size_m;
  const bool by_voxels = box.volume() / (voxel * voxel) <= kMaxColumns;
  const Relief relief = heights(ground, box, kHeightColumns, voxel);
  const auto range = height_range(relief);
  if (!range) {
    Canvas canvas(kWidth, 480);
    draw_caption(canvas, kEdge, 20, kWidth - 2 * kEdge, caption);
    canvas.text(kWidth / 2, 270, "No ground here",
                {.size = 20, .color = kFaintInk, .align_x = 0.5});
    return canvas;
  }
  box = relief.box;
  const double size = box.sizes().norm();
  const double bottom = range->low - std::max(0.07 * size, 4 * voxel);
  const Eigen::AlignedBox3d space(
      Vec3(box.min().x(), box.min().y(), bottom + relief.datum_m),
      Vec3(box.max().x(), box.max().y(), range->high + relief.datum_m + 2 * voxel));

  Scene scene;
  const Vec3 beyond = Vec3::Constant(6 * voxel);
  if (by_voxels) scene.ground = make_block({space.min() - beyond, space.max() + beyond});
  const bool coarse = !scene.ground;
  if (coarse) scene.ground = cutout_of_heights(relief, bottom, origin);
  scene.low = space.min() - origin;
  scene.high = space.max() - origin;
  scene.high.z() = range->high + relief.datum_m - origin.z();
  const ChangeScale scale = change_scale(ground, box);
  const auto depth = [&](const Vec3& p) {
    const double x = p.x() + origin.x(), y = p.y() + origin.y();
    if (scale.empty() || !ground.changed.contains(Vec2(x, y))) return 0.0;
    if (coarse) return depth_at(relief, x, y);
    const auto before = ground.base(x, y);
    const double d = before ? *before - (p.z() + origin.z()) : 0;
    return ground.filled ? d : std::max(0.0, d);
  };
  const double clod = clod_m(size, voxel);
  const auto clods = [&](const Rgb& color, const Vec3& p, const Vec3& normal) {
    if (!ground.loose) return color;
    return as_loose(color, p, clod, ground.loose(p + origin - 0.25 * voxel * normal));
  };
  const double rim = 1.1 * scene.ground->voxelSize().x();
  const double line_m = round_down_125(size / 6);
  scene.color = [&, rim, line_m](const Vec3& p, const Vec3& normal) -> Rgb {
    const bool section =
        normal.z() < 0.5 && (p.x() < scene.low.x() + rim || p.x() > scene.high.x() - rim ||
                             p.y() < scene.low.y() + rim || p.y() > scene.high.y() - rim);
    const double d = depth(p);
    const double x = p.x() + origin.x(), y = p.y() + origin.y();
    if (section) {
      const double u = std::clamp(x, box.min().x() + rim, box.max().x() - rim);
      const double v = std::clamp(y, box.min().y() + rim, box.max().y() - rim);
      const auto top = ground.base(u, v);
      const double below = top ? *top - (p.z() + origin.z()) : 0;
      return clods(section_color(below, size), p, normal);
    }
    if (const double changed = std::abs(d); changed > kRound * voxel) {
      return clods(mix(kTopSoil, scale.color(d), 0.6 + 0.4 * std::min(1.0, changed / voxel)), p,
                   normal);
    }
    const auto off = [&](double v) {
      return std::abs(v / line_m - std::round(v / line_m)) * line_m;
    };
    const bool line = std::min(off(x), off(y)) < 0.0007 * size;
    return clods(line ? scaled(kTopSoil, 0.93) : kTopSoil, p, normal);
  };

  const std::vector<Vec3> points = hull(relief, scene.low, scene.high, origin);
  Camera camera;
  double most = -1;
  for (const double degrees : {202.5, 157.5, 225.0, 135.0, 247.5, 112.5, 292.5, 67.5, 315.0, 45.0,
                               337.5, 22.5}) {  // oblique, preferably from the south
    const double azimuth = degrees * std::numbers::pi / 180;
    Camera candidate = look(scene.low, scene.high, azimuth);
    frame(candidate, points, {0, 0, 200, 130});
    const double share = scale.empty() ? 0 : seen(scene, candidate, 200, 130, [&](const Vec3& p) {
      const double d = std::abs(depth(p));
      const double part = d / std::max(scale.cut_m, scale.fill_m);
      return d > kRound * voxel ? 0.1 + part * part : 0.0;
    });
    if (share > 1.02 * most) {
      most = share;
      camera = candidate;
    }
  }
  const double block_h =
      frame(camera, points, {kSide, kViewTop, kWidth - 2 * kSide, kMaxBlockHeight});
  const double foot = kViewTop + block_h + kRulerRoom;
  Canvas canvas(kWidth, static_cast<int>(std::ceil(foot + kFoot)));
  // Sun from over the camera's left shoulder.
  scene.to_sun = (-0.62 * camera.right - 0.18 * camera.forward + 0.2 * camera.up).normalized();
  scene.to_sun = Vec3(scene.to_sun.x(), scene.to_sun.y(), 0).normalized() * std::cos(kSunHeight) +
                 Vec3::UnitZ() * std::sin(kSunHeight);
  canvas.blit(0, 0, canvas.width(), canvas.height(),
              render(scene, camera, canvas.width(), canvas.height()).data());
  draw_caption(canvas, kEdge, 20, kWidth - 2 * kEdge, caption);
  draw_ruler(canvas, camera, scene.low, scene.high);
  if (!ground.changed.isEmpty() && box.contains(ground.changed.center())) {
    const Vec2 c = ground.changed.center();
    if (const auto z = ground.now(c.x(), c.y())) {
      const Vec2 at = camera.project(Vec3(c.x(), c.y(), *z) - origin);
      const double px = (ground.changed.sizes().maxCoeff() /
                         (camera.eye - (Vec3(c.x(), c.y(), *z) - origin)).norm()) /
                        camera.s;
      if (px < kSmallChange_px) draw_ring(canvas, at.x(), at.y(), kWidth, scale);
    }
  }
  const double y = canvas.height() - 62;
  if (ground.loose) draw_loose_key(canvas, kEdge + 500, y - 2, kTopSoil);
  if (!scale.empty()) {
    draw_legend(canvas, {kEdge + 4, y, 420, 20}, scale);
  } else {
    canvas.text(kEdge + 4, y + 16, "Nothing cut here", {.size = 14, .color = kFaintInk});
  }
  draw_north(canvas, kWidth - 84, y - 6, 34 * Vec2(camera.right.y(), -camera.up.y()),
             34 * Vec2(camera.right.x(), -camera.up.x()));
  return canvas;
}

void write_view(const std::filesystem::path& file, const Ground& ground,
                const Eigen::AlignedBox2d& box, const Caption& caption) {
  const MakeBlock make_block = [&](const Eigen::AlignedBox3d& space) {
    return closed_level_set(ground, space);
  };
  Canvas canvas = draw_view(ground_of(ground), make_block, ground.origin(), box, caption);
  save(file, canvas);
}

}  // namespace soilvdb::inline v0::io
