// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/draw/map_parts.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "io/draw/loose_soil.h"

namespace soilvdb::inline v0::io {
namespace {

// Matplotlib's plasma from 7/8 down to 1/8. Its ends are too close to white paper, and too dark for
// shading.
constexpr std::array<Rgb, 7> kDepthColors{{{0.992, 0.773, 0.153},
                                           {0.973, 0.584, 0.251},
                                           {0.898, 0.420, 0.365},
                                           {0.800, 0.278, 0.471},
                                           {0.663, 0.137, 0.584},
                                           {0.494, 0.012, 0.659},
                                           {0.298, 0.008, 0.631}}};

// Amber as above, and ColorBrewer's RdBu with darker ends. Its white middle is left out, because
// the ground shows there.
constexpr std::array<Rgb, 5> kCutColors{{{0.976, 0.800, 0.420},
                                         {0.957, 0.604, 0.300},
                                         {0.839, 0.345, 0.230},
                                         {0.650, 0.080, 0.150},
                                         {0.380, 0.000, 0.110}}};
constexpr std::array<Rgb, 5> kFillColors{{{0.750, 0.870, 0.930},
                                          {0.500, 0.730, 0.860},
                                          {0.230, 0.520, 0.740},
                                          {0.110, 0.330, 0.600},
                                          {0.020, 0.150, 0.360}}};

template <std::size_t N>
Rgb along(const std::array<Rgb, N>& colors, double share) {
  const double at = std::clamp(share, 0.0, 1.0) * (N - 1);
  const auto i = std::min<std::size_t>(static_cast<std::size_t>(at), N - 2);
  return mix(colors[i], colors[i + 1], at - static_cast<double>(i));
}

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

ChangeScale ChangeScale::up_to(double deepest_m, double highest_m, double least_m) {
  const double cut = deepest_m > least_m ? deepest_m : 0;
  const double fill = highest_m > least_m ? highest_m : 0;
  if (!(cut + fill > 0)) return {};
  ChangeScale scale;
  scale.tick_m = round_down_125((cut + fill) / 3.5);
  const auto ticks = [&](double m) {
    return scale.tick_m * std::ceil(m / scale.tick_m * (1 - 1e-6));
  };
  scale.cut_m = ticks(cut);
  scale.fill_m = ticks(fill);
  return scale;
}

Rgb ChangeScale::color(double depth_m) const {
  const double most = std::max(cut_m, fill_m);
  const double share = most > 0 ? std::abs(depth_m) / most : 0;
  if (!(fill_m > 0)) return along(kDepthColors, share);
  return depth_m < 0 ? along(kFillColors, share) : along(kCutColors, share);
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

void draw_legend(Canvas& canvas, const Area& bar, const ChangeScale& scale) {
  const bool upright = bar.h > bar.w, fill = scale.fill_m > 0;
  const double span = scale.cut_m + scale.fill_m, length = upright ? bar.h : bar.w;
  const bool centimetres = span < 0.5;
  const double unit = centimetres ? 0.01 : 1;
  cairo_t* cr = canvas.cr();
  const std::string heading = fill ? "Cut (\u2212) and fill (+), " : "Cut depth (";
  canvas.text(bar.x, bar.y - 13, heading + (centimetres ? "cm" : "m") + (fill ? "" : ")"),
              {.size = 15, .bold = true});
  // Depth runs from the bar's left or top to its other end.
  const bool from_cut = fill && !upright;
  const auto depth = [&](double share) {
    return from_cut ? scale.cut_m - share * span : share * span - scale.fill_m;
  };
  const int steps = static_cast<int>(length);
  for (int i = 0; i < steps; ++i) {
    canvas.color(scale.color(depth((i + 0.5) / steps)));
    const double s = length / steps;
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
  const int ticks = static_cast<int>(std::lround(span / scale.tick_m));
  for (int i = 0; i <= ticks; ++i) {
    const double at = static_cast<double>(i) / ticks;
    const double shown = fill ? -depth(at) : depth(at);
    std::string label = number(shown / unit, scale.tick_m / unit);
    if (fill && shown > 0.5 * scale.tick_m) label = "+" + label;
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

void draw_loose_key(Canvas& canvas, double x, double y, const Rgb& ground) {
  constexpr int kSide = static_cast<int>(kSwatch_px);
  std::vector<std::uint32_t> pixels;
  for (int v = 0; v < kSide; ++v)
    for (int u = 0; u < kSide; ++u)
      pixels.push_back(to_pixel(as_loose(ground, Vec3(u, v, 0), kSide / 4.0, 1)));
  canvas.blit(static_cast<int>(x), static_cast<int>(y), kSide, kSide, pixels.data());
  canvas.color(kInk);
  cairo_set_line_width(canvas.cr(), 1);
  canvas.rectangle({std::floor(x), std::floor(y), kSwatch_px, kSwatch_px});
  cairo_stroke(canvas.cr());
  canvas.text(x + kSwatch_px + 10, y + kSwatch_px / 2, "Loose soil", {.align_y = 0.5});
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

void draw_ring(Canvas& canvas, double x, double y, double right_end, const ChangeScale& scale) {
  const bool cut = scale.cut_m > 0;
  const Rgb dark = cut ? kDepthColors[5] : kFillColors[3];
  cairo_t* cr = canvas.cr();
  for (const bool halo : {true, false}) {
    cairo_set_line_width(cr, halo ? 5 : 2);
    canvas.color(halo ? Rgb{1, 1, 1} : dark, halo ? 0.7 : 1);
    cairo_new_path(cr);
    cairo_arc(cr, x, y, 22, 0, 2 * std::numbers::pi);
    cairo_stroke(cr);
  }
  const bool left = x > right_end - 70;
  canvas.text(x + (left ? -30 : 30), y, cut ? "cut" : "fill",
              {.size = 15,
               .bold = true,
               .color = dark,
               .align_x = left ? 1.0 : 0.0,
               .align_y = 0.5,
               .halo = 2.5});
}

}  // namespace soilvdb::inline v0::io
