// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A cairo image to draw on: pixels, text that never fails, PNG bytes.
#pragma once

#include <cairo/cairo.h>

#include <cstdint>
#include <memory>
#include <string>

namespace soilvdb::inline v0::io {

/// sRGB, each channel in [0, 1].
struct Rgb {
  double r = 0, g = 0, b = 0;
};
inline Rgb mix(const Rgb& a, const Rgb& b, double t) {
  return {a.r + t * (b.r - a.r), a.g + t * (b.g - a.g), a.b + t * (b.b - a.b)};
}
inline Rgb scaled(const Rgb& a, double s) { return {a.r * s, a.g * s, a.b * s}; }
std::uint32_t to_pixel(const Rgb& color);

/// A rectangle of the picture, px, y down.
struct Area {
  double x = 0, y = 0, w = 0, h = 0;
};

inline constexpr Rgb kInk{0.13, 0.13, 0.14};
inline constexpr Rgb kFaintInk{0.42, 0.42, 0.43};

struct TextStyle {
  double size = 14;  ///< px
  bool bold = false;
  Rgb color = kInk;
  double align_x = 0;  ///< 0: starts at the point, 0.5: centred on it, 1: ends there
  double align_y = 0;  ///< 0: baseline there, 0.5: digits centred on it, 1: digits hang below
  double angle = 0;    ///< rad, clockwise on screen
  double halo = 0;     ///< px of white around the letters
};

/// A white picture. Not copyable; one thread at a time.
class Canvas {
 public:
  /// @throw std::runtime_error if there is not enough memory.
  Canvas(int width, int height);

  int width() const { return width_; }
  int height() const { return height_; }
  cairo_t* cr() { return context_.get(); }
  void color(const Rgb& c, double alpha = 1) { cairo_set_source_rgba(cr(), c.r, c.g, c.b, alpha); }
  void rectangle(const Area& a) { cairo_rectangle(cr(), a.x, a.y, a.w, a.h); }
  void line(double x0, double y0, double x1, double y1);

  /// Copies w x h opaque pixels (0xffRRGGBB, row by row) to x, y.
  void blit(int x, int y, int w, int h, const std::uint32_t* pixels);

  void text(double x, double y, const std::string& utf8, const TextStyle& style = {});
  double text_width(const std::string& utf8, const TextStyle& style = {});
  /// The text, cut to `width` px with an ellipsis at its end if it is wider.
  std::string fitted(const std::string& utf8, const TextStyle& style, double width);

  /// @throw std::runtime_error if cairo fails.
  std::string png();

 private:
  int width_, height_;
  std::unique_ptr<cairo_surface_t, void (*)(cairo_surface_t*)> surface_;
  std::unique_ptr<cairo_t, void (*)(cairo_t*)> context_;
};

}  // namespace soilvdb::inline v0::io
