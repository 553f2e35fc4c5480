// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What both pictures carry around the ground itself: caption, legend, scale bar, north arrow.
#pragma once

#include <string>

#include "io/draw/canvas.h"
#include "soilvdb/io/picture.h"
#include "soilvdb/types.h"

namespace soilvdb::inline v0::io {

inline constexpr double kEdge = 36;  ///< margin of a picture, pixels

/// The largest of 1, 2, 5 times a power of ten that is not above `about` (> 0).
double round_down_125(double about);

/// A number with the decimals its step calls for and thin spaces between thousands.
std::string number(double value, double step);

/// "20 cm", "5 m", "2 km".
std::string length_label(double length_m);

/// What changed as colour, lightness falling with it all the way: where there is no fill, cut from
/// amber to violet; else cut from amber to dark red, fill from pale to dark blue, which those who
/// can't tell red from green see as yellow and blue.
struct ChangeScale {
  double cut_m = 0, fill_m = 0;  ///< to which the scale goes, multiples of tick_m; 0: there is none
  double tick_m = 0;

  /// The scale for what was cut up to `deepest_m` and filled up to `highest_m`; none below
  /// `least_m`.
  static ChangeScale up_to(double deepest_m, double highest_m, double least_m);
  bool empty() const { return !(cut_m > 0 || fill_m > 0); }
  /// @param depth_m below the ground as it was; fill is negative
  Rgb color(double depth_m) const;
};

/// Title and detail line from x, y down, cut to the width. @return the height used, px.
double draw_caption(Canvas& canvas, double x, double y, double width, const Caption& caption);

/// Colour bar with ticks; its heading stands above. Upright: as heights go, cut down and fill up;
/// lying: as numbers go where there is fill, else depths. Ticks take up to 70 px right of it
/// (upright) or 24 px below (lying); the heading 26 px above.
void draw_legend(Canvas& canvas, const Area& bar, const ChangeScale& scale);

/// A swatch of loose soil on the ground's own colour, and what it is, from x, y down and to the
/// right.
inline constexpr double kSwatch_px = 24;
void draw_loose_key(Canvas& canvas, double x, double y, const Rgb& ground);

/// A bar of round length with its label above, from x rightwards, not longer than `width`;
/// y is the bar's top. @return its length, px.
double draw_scale_bar(Canvas& canvas, double x, double y, double width, double metres_per_px);

/// An arrow with an N. @param north, east how these unit directions show on screen, px per arrow
void draw_north(Canvas& canvas, double x, double y, const Vec2& north, const Vec2& east);

/// Draws a ring labelled "cut" or "fill" about what changed where that is smaller than
/// kSmallChange_px in the picture.
inline constexpr double kSmallChange_px = 26;
void draw_ring(Canvas& canvas, double x, double y, double right_end, const ChangeScale& scale);

}  // namespace soilvdb::inline v0::io
