// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/draw/canvas.h"

#include <algorithm>
#include <cstring>
#include <stdexcept>

namespace soilvdb::inline v0::io {
namespace {

/// Bytes of the UTF-8 character at `at`, 0 if there is none.
std::size_t utf8_length(const std::string& s, std::size_t at) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(s[i]); };
  const unsigned char c = byte(at);
  const std::size_t n = c < 0x80                ? 1
                        : c >= 0xc2 && c < 0xe0 ? 2
                        : c >= 0xe0 && c < 0xf0 ? 3
                        : c >= 0xf0 && c < 0xf5 ? 4
                                                : 0;
  if (n == 0 || at + n > s.size()) return 0;
  for (std::size_t i = 1; i < n; ++i) {
    if ((byte(at + i) & 0xc0) != 0x80) return 0;
  }
  // Overlong forms, surrogates and beyond U+10FFFF.
  if (n == 3 && ((c == 0xe0 && byte(at + 1) < 0xa0) || (c == 0xed && byte(at + 1) >= 0xa0)))
    return 0;
  if (n == 4 && ((c == 0xf0 && byte(at + 1) < 0x90) || (c == 0xf4 && byte(at + 1) >= 0x90)))
    return 0;
  return n;
}

/// After one invalid byte cairo draws nothing more.
std::string printable_glyphs(const std::string& s) {
  std::string out;
  for (std::size_t i = 0; i < s.size();) {
    const std::size_t n = utf8_length(s, i);
    if (n == 0) {
      out += "\xef\xbf\xbd";
      ++i;
    } else {
      const bool control = n == 1 && (static_cast<unsigned char>(s[i]) < 0x20 || s[i] == 0x7f);
      out += control ? " " : s.substr(i, n);
      i += n;
    }
  }
  return out;
}

void select(cairo_t* cr, const TextStyle& style) {
  cairo_select_font_face(cr, "DejaVu Sans", CAIRO_FONT_SLANT_NORMAL,
                         style.bold ? CAIRO_FONT_WEIGHT_BOLD : CAIRO_FONT_WEIGHT_NORMAL);
  cairo_set_font_size(cr, style.size);
}

double advance(cairo_t* cr, const std::string& text) {
  cairo_text_extents_t extents;
  cairo_text_extents(cr, text.c_str(), &extents);
  return extents.x_advance;
}

void check(cairo_status_t status) {
  if (status != CAIRO_STATUS_SUCCESS) {
    throw std::runtime_error(std::string("can't draw the picture: ") +
                             cairo_status_to_string(status));
  }
}

}  // namespace

std::uint32_t to_pixel(const Rgb& c) {
  const auto byte = [](double v) {
    return static_cast<std::uint32_t>(std::clamp(v, 0.0, 1.0) * 255 + 0.5);
  };
  return 0xff000000u | byte(c.r) << 16 | byte(c.g) << 8 | byte(c.b);
}

Canvas::Canvas(int width, int height)
    : width_(width),
      height_(height),
      surface_(cairo_image_surface_create(CAIRO_FORMAT_RGB24, width, height),
               cairo_surface_destroy),
      context_(nullptr, cairo_destroy) {
  check(cairo_surface_status(surface_.get()));
  context_.reset(cairo_create(surface_.get()));
  check(cairo_status(cr()));
  // Grey antialiasing without hinting: the same letters on every desktop's font settings.
  std::unique_ptr<cairo_font_options_t, void (*)(cairo_font_options_t*)> options(
      cairo_font_options_create(), cairo_font_options_destroy);
  cairo_font_options_set_antialias(options.get(), CAIRO_ANTIALIAS_GRAY);
  cairo_font_options_set_hint_style(options.get(), CAIRO_HINT_STYLE_NONE);
  cairo_font_options_set_hint_metrics(options.get(), CAIRO_HINT_METRICS_OFF);
  cairo_set_font_options(cr(), options.get());
  color({1, 1, 1});
  cairo_paint(cr());
}

void Canvas::line(double x0, double y0, double x1, double y1) {
  cairo_move_to(cr(), x0, y0);
  cairo_line_to(cr(), x1, y1);
  cairo_stroke(cr());
}

void Canvas::blit(int x, int y, int w, int h, const std::uint32_t* pixels) {
  cairo_surface_flush(surface_.get());
  unsigned char* data = cairo_image_surface_get_data(surface_.get());
  const int stride = cairo_image_surface_get_stride(surface_.get());
  const int x0 = std::max(0, -x), x1 = std::min(w, width_ - x);
  for (int row = std::max(0, -y); row < std::min(h, height_ - y) && x0 < x1; ++row) {
    std::memcpy(data + static_cast<std::ptrdiff_t>(y + row) * stride + 4 * (x + x0),
                pixels + static_cast<std::ptrdiff_t>(row) * w + x0,
                4 * static_cast<std::size_t>(x1 - x0));
  }
  cairo_surface_mark_dirty(surface_.get());
}

void Canvas::text(double x, double y, const std::string& utf8, const TextStyle& style) {
  const std::string shown = printable_glyphs(utf8);
  select(cr(), style);
  const double digit_height = 0.73 * style.size;
  cairo_save(cr());
  cairo_translate(cr(), x, y);
  cairo_rotate(cr(), style.angle);
  cairo_move_to(cr(), -style.align_x * advance(cr(), shown), style.align_y * digit_height);
  if (style.halo > 0) {
    cairo_text_path(cr(), shown.c_str());
    color({1, 1, 1}, 0.75);
    cairo_set_line_width(cr(), 2 * style.halo);
    cairo_set_line_join(cr(), CAIRO_LINE_JOIN_ROUND);
    cairo_stroke_preserve(cr());
    color(style.color);
    cairo_fill(cr());
  } else {
    color(style.color);
    cairo_show_text(cr(), shown.c_str());
  }
  cairo_new_path(cr());
  cairo_restore(cr());
}

double Canvas::text_width(const std::string& utf8, const TextStyle& style) {
  select(cr(), style);
  return advance(cr(), printable_glyphs(utf8));
}

std::string Canvas::fitted(const std::string& utf8, const TextStyle& style, double width) {
  std::string s = printable_glyphs(utf8);
  if (text_width(s, style) <= width) return s;
  while (!s.empty()) {
    do {
      const bool continuation = (static_cast<unsigned char>(s.back()) & 0xc0) == 0x80;
      s.pop_back();
      if (!continuation) break;
    } while (!s.empty());
    if (text_width(s + "…", style) <= width) break;
  }
  return s + "…";
}

std::string Canvas::png() {
  check(cairo_status(cr()));
  cairo_surface_flush(surface_.get());
  std::string bytes;
  check(cairo_surface_write_to_png_stream(
      surface_.get(),
      [](void* out, const unsigned char* data, unsigned int n) {
        static_cast<std::string*>(out)->append(reinterpret_cast<const char*>(data), n);
        return CAIRO_STATUS_SUCCESS;
      },
      &bytes));
  return bytes;
}

}  // namespace soilvdb::inline v0::io
