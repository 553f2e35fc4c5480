// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/draw/map_parts.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace soilvdb::inline v0::io {
namespace {

// Matplotlib's plasma from 7/8 down to 1/8: without the ends, which are too near white paper and
// too dark to carry shading.
constexpr std::array<Rgb, 7> kDepthColors{{{0.992, 0.773, 0.153},
                                           {0.973, 0.584, 0.251},
                                           {0.898, 0.420, 0.365},
                                           {0.800, 0.278, 0.471},
                                           {0.663, 0.137, 0.584},
                                           {0.494, 0.012, 0.659},
                                           {0.298, 0.008, 0.631}}};

}  // namespace

double round_down_125(double about) {
  const double decade = std::pow(10, std::floor(std::log10(about) + 1e-9));
  const double mantissa = about / decade * (1 + 1e-9);
  return decade * (mantissa >= 5 ? 5 : mantissa >= 2 ? 2 : 1);
}

std::string number(double value, double step) {
  int decimals = 0;
  for (double s = step; decimals < 9 && std::abs(s - std::round(s)) > 1e-6 * s; s *= 10) ++decimals;
  std::string s = fmt::format("{:.{}f}", std::abs(value), decimals);
  const bool zero = s.find_first_not_of("0.") == std::string::npos;
  const std::size_t whole = std::min(s.find('.'), s.size());
  for (std::size_t i = whole; whole > 4 && i > 3;) s.insert(i -= 3, "\u2009");
  return value < 0 && !zero ? "\u2212" + s : s;
}

std::string length_label(double length_m) {
  if (length_m >= 999.5) return fmt::format("{:g} km", length_m / 1000);
  if (length_m >= 0.995) return fmt::format("{:g} m", length_m);
  if (length_m >= 0.00995) return fmt::format("{:g} cm", length_m * 100);
  return fmt::format("{:g} mm", length_m * 1000);
}

DepthScale DepthScale::up_to(double deepest_m, double least_m) {
  if (!(deepest_m > least_m)) return {};
  DepthScale scale;
  scale.tick_m = round_down_125(deepest_m / 3.5);
  scale.max_m = scale.tick_m * std::ceil(deepest_m / scale.tick_m * (1 - 1e-6));
  return scale;
}

Rgb DepthScale::color(double depth_m) const {
  const double at =
      max_m > 0 ? std::clamp(depth_m / max_m, 0.0, 1.0) * (kDepthColors.size() - 1) : 0;
  const auto i = std::min<std::size_t>(static_cast<std::size_t>(at), kDepthColors.size() - 2);
  return mix(kDepthColors[i], kDepthColors[i + 1], at - static_cast<double>(i));
}

double draw_caption(Canvas& canvas, double x, double y, double width, const Caption& caption) {
  TextStyle title{.size = 30, .bold = true};
  while (title.size > 20 && canvas.text_width(caption.title, title) > width) title.size -= 1;
  canvas.text(x, y + 28, canvas.fitted(caption.title, title, width), title);
  TextStyle detail{.size = 16, .color = kFaintInk};
  while (detail.size > 12 && canvas.text_width(caption.detail, detail) > width) detail.size -= 0.5;
  canvas.text(x, y + 56, canvas.fitted(caption.detail, detail, width), detail);
  return 62;
}

void draw_legend(Canvas& canvas, const Area& bar, const DepthScale& scale) {
  const bool upright = bar.h > bar.w;
  const bool centimetres = scale.max_m < 0.5;
  const double unit = centimetres ? 0.01 : 1;
  cairo_t* cr = canvas.cr();
  canvas.text(bar.x, bar.y - 13, centimetres ? "Cut depth (cm)" : "Cut depth (m)",
              {.size = 15, .bold = true});
  const int steps = static_cast<int>(upright ? bar.h : bar.w);
  for (int i = 0; i < steps; ++i) {
    canvas.color(scale.color((i + 0.5) / steps * scale.max_m));
    const double s = (upright ? bar.h : bar.w) / steps;
    if (upright) {
      cairo_rectangle(cr, bar.x, bar.y + i * s, bar.w, s + 0.5);
    } else {
      cairo_rectangle(cr, bar.x + i * s, bar.y, s + 0.5, bar.h);
    }
    cairo_fill(cr);
  }
  canvas.color(kInk);
  cairo_set_line_width(cr, 1);
  canvas.rectangle(bar);
  cairo_stroke(cr);
  const int ticks = static_cast<int>(std::lround(scale.max_m / scale.tick_m));
  for (int i = 0; i <= ticks; ++i) {
    const std::string label = number(i * scale.tick_m / unit, scale.tick_m / unit);
    const double at = static_cast<double>(i) / ticks;
    canvas.color(kInk);
    if (upright) {
      const double y = bar.y + at * bar.h;
      canvas.line(bar.x + bar.w, y, bar.x + bar.w + 6, y);
      canvas.text(bar.x + bar.w + 11, y, label, {.align_y = 0.5});
    } else {
      const double x = bar.x + at * bar.w;
      canvas.line(x, bar.y + bar.h, x, bar.y + bar.h + 6);
      canvas.text(x, bar.y + bar.h + 10, label, {.align_x = 0.5, .align_y = 1});
    }
  }
}

double draw_scale_bar(Canvas& canvas, double x, double y, double width, double metres_per_px) {
  const double length_m = round_down_125(width * metres_per_px);
  const double length = length_m / metres_per_px;
  const double first = length_m / std::pow(10, std::floor(std::log10(length_m) + 1e-9));
  const int parts = std::lround(first) == 5 ? 5 : 4;
  cairo_t* cr = canvas.cr();
  canvas.text(x, y - 7, "0", {.align_x = 0.5});
  canvas.text(x + length, y - 7, length_label(length_m), {.align_x = 0.5});
  for (int i = 0; i < parts; ++i) {
    cairo_rectangle(cr, x + i * length / parts, y, length / parts, 7);
    canvas.color(i % 2 == 0 ? kInk : Rgb{1, 1, 1});
    cairo_fill(cr);
  }
  canvas.color(kInk);
  cairo_set_line_width(cr, 1);
  cairo_rectangle(cr, x, y, length, 7);
  cairo_stroke(cr);
  return length;
}

void draw_north(Canvas& canvas, double x, double y, const Vec2& north, const Vec2& east) {
  const Vec2 along = north.normalized(), tip = north, tail = -north;
  cairo_t* cr = canvas.cr();
  cairo_set_line_width(cr, 1);
  for (const double s : {-1.0, 1.0}) {
    const Vec2 wing = tail + s * 0.32 * east, notch = tail + 0.3 * north;
    cairo_move_to(cr, x + tip.x(), y + tip.y());
    cairo_line_to(cr, x + wing.x(), y + wing.y());
    cairo_line_to(cr, x + notch.x(), y + notch.y());
    cairo_close_path(cr);
    canvas.color(s < 0 ? kInk : Rgb{1, 1, 1});
    cairo_fill_preserve(cr);
    canvas.color(kInk);
    cairo_stroke(cr);
  }
  canvas.text(x + tip.x() + 13 * along.x(), y + tip.y() + 13 * along.y(), "N",
              {.size = 16, .bold = true, .align_x = 0.5, .align_y = 0.5});
}

void draw_cut_ring(Canvas& canvas, double x, double y, double right_end) {
  cairo_t* cr = canvas.cr();
  for (const bool halo : {true, false}) {
    cairo_set_line_width(cr, halo ? 5 : 2);
    canvas.color(halo ? Rgb{1, 1, 1} : kDepthColors[5], halo ? 0.7 : 1);
    cairo_new_path(cr);
    cairo_arc(cr, x, y, 22, 0, 2 * std::numbers::pi);
    cairo_stroke(cr);
  }
  const bool left = x > right_end - 70;
  canvas.text(x + (left ? -30 : 30), y, "cut",
              {.size = 15,
               .bold = true,
               .color = {0.36, 0.01, 0.50},
               .align_x = left ? 1.0 : 0.0,
               .align_y = 0.5,
               .halo = 2.5});
}

}  // namespace soilvdb::inline v0::io
