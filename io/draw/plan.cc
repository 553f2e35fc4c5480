// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "io/draw/ground_source.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr double kPictureWidth = 1600, kTop = 102, kSideColumn = 218;
constexpr double kMaxMapHeight = 1060, kWideAspect = 1.9;

/// Round coordinates along one side of the frame.
struct Ticks {
  double step = 1;
  std::vector<double> at;

  Ticks(double low, double high, double at_least) {
    step = round_down_125(at_least);
    while (step < at_least * (1 - 1e-9)) step = round_down_125(step * 2.5);
    for (double k = std::ceil(low / step - 1e-6); k * step <= high + 1e-6 * step; ++k) {
      at.push_back(k * step);
    }
  }
};

struct Layout {
  Area map;
  bool beside = true;  ///< legend at the map's right; else below it
  int width = 0, height = 0;
};

Layout lay_out(const Eigen::AlignedBox2d& box, double label_width) {
  Layout l;
  const double aspect = box.sizes().x() / box.sizes().y();
  const double left = kEdge + 24 + label_width + 12;
  l.beside = aspect < kWideAspect;
  const double max_w = kPictureWidth - left - kEdge - (l.beside ? kSideColumn + 30 : 14);
  const double w = std::round(std::min(max_w, kMaxMapHeight * aspect));
  const double h = std::round(w / aspect);
  const double total = left + w + kEdge + (l.beside ? kSideColumn + 30 : 14);
  l.width = static_cast<int>(std::max(total, 760.0));
  l.map = {left + std::floor((l.width - total) / 2), kTop, w, std::max(h, 1.0)};
  l.height = static_cast<int>(kTop + l.map.h + 76 + (l.beside ? 0 : 112));
  return l;
}

void draw_frame(Canvas& canvas, const Area& map, const Eigen::AlignedBox2d& box, const Ticks& east,
                const Ticks& north) {
  cairo_t* cr = canvas.cr();
  cairo_set_line_width(cr, 1);
  const TextStyle label{.size = 13, .color = kFaintInk};
  const double bottom = map.y + map.h;
  for (const double x_m : east.at) {
    const double x = map.x + (x_m - box.min().x()) / box.sizes().x() * map.w;
    canvas.color({1, 1, 1}, 0.22);
    canvas.line(x, map.y, x, bottom);
    canvas.color(kInk);
    canvas.line(x, bottom, x, bottom + 6);
    TextStyle style = label;
    style.align_x = 0.5;
    style.align_y = 1;
    canvas.text(x, bottom + 12, number(x_m, east.step), style);
  }
  for (const double y_m : north.at) {
    const double y = bottom - (y_m - box.min().y()) / box.sizes().y() * map.h;
    canvas.color({1, 1, 1}, 0.22);
    canvas.line(map.x, y, map.x + map.w, y);
    canvas.color(kInk);
    canvas.line(map.x - 6, y, map.x, y);
    TextStyle style = label;
    style.align_x = 1;
    style.align_y = 0.5;
    canvas.text(map.x - 11, y, number(y_m, north.step), style);
  }
  canvas.color(kInk);
  cairo_rectangle(cr, map.x - 0.5, map.y - 0.5, map.w + 1, map.h + 1);
  cairo_stroke(cr);
}

std::vector<std::string> notes(const Relief& relief, const PlanStyle& style) {
  const auto range = height_range(relief);
  if (!range) return {"No ground here"};
  const double low = range->low + relief.datum_m, high = range->high + relief.datum_m;
  const double step = std::clamp(round_down_125(std::max(1e-3, high - low) / 5), 1e-3, 0.1);
  std::vector<std::string> lines;
  if (high - low < 5e-3) {
    lines.push_back(fmt::format("Ground at {} m", number(low, 0.01)));
  } else {
    lines.push_back(fmt::format("Ground {} to {} m", number(low, step), number(high, step)));
  }
  if (style.contour_m > 0) {
    lines.push_back(fmt::format("Contours every {}", length_label(style.contour_m)));
  }
  if (style.scale.empty()) lines.push_back("Nothing cut here");
  return lines;
}

void draw_notes(Canvas& canvas, double x, double y, double width,
                const std::vector<std::string>& lines) {
  const TextStyle style{.size = 14, .color = kFaintInk};
  for (const std::string& line : lines) {
    canvas.text(x, y, canvas.fitted(line, style, width), style);
    y += 22;
  }
}

}  // namespace

Canvas draw_plan(const DrawnGround& ground, const Eigen::AlignedBox2d& wanted,
                 const Caption& caption) {
  const Eigen::AlignedBox2d box = drawable(wanted, ground.voxel_size_m);
  Canvas ruler(1, 1);
  // Tick steps need the map's size, which needs the labels' width: one iteration suffices.
  double label_width = 0;
  Layout layout = lay_out(box, 70);
  for (int round = 0; round < 2; ++round) {
    const Ticks north(box.min().y(), box.max().y(), box.sizes().y() / layout.map.h * 64);
    label_width = 24;
    for (const double y : north.at) {
      label_width = std::max(label_width, ruler.text_width(number(y, north.step), {.size = 13}));
    }
    layout = lay_out(box, label_width);
  }
  const Area& map = layout.map;
  const double metres_per_px = box.sizes().x() / map.w;
  const Ticks north(box.min().y(), box.max().y(), 64 * metres_per_px);
  Ticks east(box.min().x(), box.max().x(), 90 * metres_per_px);
  for (double room = 90; room < 400; room += 20) {
    east = Ticks(box.min().x(), box.max().x(), room * metres_per_px);
    const double widest =
        std::max(ruler.text_width(number(box.min().x(), east.step), {.size = 13}),
                 ruler.text_width(number(box.max().x(), east.step), {.size = 13}));
    if (east.step / metres_per_px > widest + 26) break;
  }

  Relief relief = relief_of(ground, box, static_cast<int>(map.w), static_cast<int>(map.h));
  if (ground.loose) sample_loose(relief, ground.loose, ground.voxel_size_m);
  PlanStyle style{.voxel_size_m = ground.voxel_size_m, .scale = change_scale(ground, box)};
  if (const auto range = height_range(relief);
      range && range->high - range->low > std::max(1e-3, 2 * ground.voxel_size_m)) {
    style.contour_m = round_down_125((range->high - range->low) / 9);
  }

  Canvas canvas(layout.width, layout.height);
  canvas.blit(static_cast<int>(map.x), static_cast<int>(map.y), relief.nx, relief.ny,
              shade(relief, style).data());
  draw_frame(canvas, map, box, east, north);
  for (const ContourLabel& l : label_contours(relief, style)) {
    canvas.text(map.x + l.x, map.y + l.y, number(l.height_m, 5 * style.contour_m),
                {.size = 12,
                 .color = {0.30, 0.22, 0.15},
                 .align_x = 0.5,
                 .align_y = 0.5,
                 .angle = l.angle,
                 .halo = 2});
  }
  if (!ground.changed.isEmpty() && box.contains(ground.changed.center()) &&
      ground.changed.sizes().maxCoeff() < kSmallChange_px * metres_per_px) {
    draw_ring(canvas, map.x + (ground.changed.center().x() - box.min().x()) / metres_per_px,
              map.y + (box.max().y() - ground.changed.center().y()) / metres_per_px, map.x + map.w,
              style.scale);
  }

  const double bottom = map.y + map.h;
  const TextStyle axis{.size = 13, .color = kFaintInk, .align_x = 0.5};
  canvas.text(map.x + map.w / 2, bottom + 52, "East (m)", axis);
  TextStyle upright = axis;
  upright.angle = -std::numbers::pi / 2;
  canvas.text(map.x - 11 - label_width - 16, map.y + map.h / 2, "North (m)", upright);
  draw_caption(canvas, kEdge, 20, canvas.width() - 2 * kEdge, caption);

  const std::vector<std::string> lines = notes(relief, style);
  const bool legend = !style.scale.empty();
  const bool loose = std::any_of(relief.loose.begin(), relief.loose.end(),
                                 [](float share) { return share > 0.5f; });
  if (layout.beside) {
    const double x = map.x + map.w + 30;
    draw_north(canvas, x + 20, map.y + 56, {0, -34}, {34, 0});
    const double bar_top = map.y + 150;
    const double bar_h = std::min(340.0, bottom - bar_top - 150);
    if (legend) draw_legend(canvas, {x, bar_top, 24, bar_h}, style.scale);
    double y = legend ? bar_top + bar_h + 44 : bar_top;
    if (loose) {
      draw_loose_key(canvas, x, y - 12, kEarth);
      y += 48;
    }
    draw_notes(canvas, x, y, kSideColumn, lines);
    draw_scale_bar(canvas, x + 5, bottom - 8, kSideColumn - 40, metres_per_px);
  } else {
    const double y = bottom + 116;
    if (legend) draw_legend(canvas, {map.x, y, 380, 22}, style.scale);
    double x = map.x + (legend ? 430 : 0);
    if (loose) {
      draw_loose_key(canvas, x, y - 2, kEarth);
      x += 150;
    }
    draw_notes(canvas, x + (legend ? 40 : 0), y, 220, lines);
    draw_scale_bar(canvas, map.x + map.w - 420, y + 8, 280, metres_per_px);
    draw_north(canvas, map.x + map.w - 24, y + 10, {0, -28}, {28, 0});
  }
  return canvas;
}

void write_plan(const std::filesystem::path& file, const Ground& ground,
                const Eigen::AlignedBox2d& box, const Caption& caption) {
  Canvas canvas = draw_plan(ground_of(ground), box, caption);
  save(file, canvas);
}

}  // namespace soilvdb::inline v0::io
