// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What both pictures carry around the ground itself: caption, legend, scale bar, north arrow.
#pragma once

#include <string>

#include "io/draw/canvas.h"
#include "soilvdb/io/picture.h"
#include "soilvdb/types.h"

namespace soilvdb::inline v0::io {

/// The largest of 1, 2, 5 times a power of ten that is not above `about` (> 0).
double round_down_125(double about);

/// A number with the decimals its step calls for and thin spaces between thousands.
std::string number(double value, double step);

/// "20 cm", "5 m", "2 km".
std::string length_label(double length_m);

/// Cut depth as colour: amber where shallow, violet where deep, lightness falling all the way.
struct DepthScale {
  double max_m = 0;  ///< a multiple of tick_m; 0: nothing was cut
  double tick_m = 0;

  /// The scale for depths up to `deepest_m`; none below `least_m`.
  static DepthScale up_to(double deepest_m, double least_m);
  Rgb color(double depth_m) const;
};

/// Title and detail line from x, y down, cut to the width. @return the height used, px.
double draw_caption(Canvas& canvas, double x, double y, double width, const Caption& caption);

/// Colour bar with ticks; its heading stands above. Upright: zero at the top, as depth goes.
/// Ticks take up to 70 px right of it (upright) or 24 px below (lying); the heading 26 px above.
void draw_legend(Canvas& canvas, const Area& bar, const DepthScale& scale);

/// A bar of round length with its label above, from x rightwards, not longer than `width`;
/// y is the bar's top. @return its length, px.
double draw_scale_bar(Canvas& canvas, double x, double y, double width, double metres_per_px);

/// An arrow with an N. @param north, east how these unit directions show on screen, px per arrow
void draw_north(Canvas& canvas, double x, double y, const Vec2& north, const Vec2& east);

/// Draws a ring labelled "cut" about a cut that is smaller than kSmallCut_px in the picture.
inline constexpr double kSmallCut_px = 26;
void draw_cut_ring(Canvas& canvas, double x, double y, double right_end);

}  // namespace soilvdb::inline v0::io
