// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The parts around the ground in a picture: caption, legend, scale bar, north arrow.
#pragma once

#include <string>

#include "io/draw/canvas.h"
#include "soilvdb/io/picture.h"
#include "soilvdb/types.h"

namespace soilvdb::inline v0::io {

inline constexpr double kEdge = 36;  ///< margin of a picture, pixels

/// The largest of 1, 2, 5 times a power of ten that is not above `about` (> 0).
double round_down_125(double about);

/// A number with the decimals that `step` needs, and thin spaces between thousands.
std::string number(double value, double step);

/// "20 cm", "5 m", "2 km".
std::string length_label(double length_m);

/// Change as colour; lightness falls with the change. Without fill, cut goes from amber to violet.
/// With fill, cut goes from amber to dark red and fill from pale to dark blue, which colour-blind
/// people can tell apart.
struct ChangeScale {
  double cut_m = 0, fill_m = 0;  ///< ends of the scale, multiples of tick_m; 0: no such change
  double tick_m = 0;

  /// The scale for cut up to `deepest_m` and fill up to `highest_m`; changes below `least_m` get no
  /// scale.
  static ChangeScale up_to(double deepest_m, double highest_m, double least_m);
  bool empty() const { return !(cut_m > 0 || fill_m > 0); }
  /// @param depth_m below the ground before digging; negative for fill
  Rgb color(double depth_m) const;
};

/// Title and detail line, downwards from x, y, cut to the width. @return the height used, px.
double draw_caption(Canvas& canvas, double x, double y, double width, const Caption& caption);

/// Colour bar with ticks and a heading. Upright: cut down, fill up. Lying: from cut to fill, or by
/// depth. Ticks take up to 70 px to the right (upright) or 24 px below (lying), the heading 26 px
/// above.
void draw_legend(Canvas& canvas, const Area& bar, const ChangeScale& scale);

/// A swatch of loose soil on the ground's colour, with its label, from x, y to the right and down.
inline constexpr double kSwatch_px = 24;
void draw_loose_key(Canvas& canvas, double x, double y, const Rgb& ground);

/// A bar of round length with its label above, at most `width` long. x, y is its upper left corner.
/// @return its length, px.
double draw_scale_bar(Canvas& canvas, double x, double y, double width, double metres_per_px);

/// An arrow with an N. @param north, east these unit directions on screen, px per arrow
void draw_north(Canvas& canvas, double x, double y, const Vec2& north, const Vec2& east);

/// Draws a ring labelled "cut" or "fill" around changes that are smaller than kSmallChange_px in
/// the picture.
inline constexpr double kSmallChange_px = 26;
void draw_ring(Canvas& canvas, double x, double y, double right_end, const ChangeScale& scale);

}  // namespace soilvdb::inline v0::io
