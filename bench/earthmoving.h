// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Parts of the benchmark of soil that moves, and what they share.
#pragma once

#include <cmath>
#include <functional>
#include <memory>
#include <numbers>
#include <vector>

#include "bench/report.h"
#include "soilvdb/tracker.h"

namespace soilvdb::bench {

inline constexpr double kDegree = std::numbers::pi / 180;
inline constexpr double kRepose = 35 * kDegree;
inline const double kSlope = std::tan(kRepose);

/// Loam whose angle of repose is kRepose.
Earthmoving loam(std::vector<Pour> pours = {});
/// The bucket of a 20 t excavator, with a body.
Bucket digger();
/// What came and what is there, units of mass: 0 if none was made or lost.
std::int64_t residual(const Tracker& tracker);

using Shape = std::function<double(double x_m, double y_m)>;
/// Posts over a rectangle of the plan: the ground, where it has no steps.
std::shared_ptr<const InitialTerrain> posts(const Shape& shape, const Eigen::AlignedBox2d& box_m,
                                            double spacing_m);
/// Makes bank soil of what is below a shape in a box of the world, to the sample, and air of the
/// rest.
void carve(Ground& ground, const Eigen::AlignedBox3d& box_m, const Shape& shape_m);
/// Makes loose soil of what is below a shape in a box, where there is none.
void add_loose(Ground& ground, const Eigen::AlignedBox3d& box_m, const Shape& shape_m);

/// Heights of columns of voxels, cells: column (x, y) is entry x * ny + y.
struct Heights {
  int x0, y0, nx, ny;
  std::vector<double> z;

  double cell(int x, int y) const { return z[static_cast<std::size_t>((x - x0) * ny + y - y0)]; }
  double at(double x, double y) const;  ///< bilinear
};
Heights heights(const Ground& ground, int x0, int y0, int nx, int ny);
/// Of columns about (0, 0).
Heights heights(const Ground& ground, int half);

/// How far heights are from the truth, cells.
struct Off {
  double rms = 0, p99 = 0;
};
Off off(std::vector<double> differences);
/// Adds both with their goals.
void add(Goals& goals, const std::string& what, const Off& off, double rms, double p99);

/// The median of what a few runs took, ms. @param f gives us
double median_ms(int times, const std::function<double()>& us);

void measure_cones(const Options& options, Goals& goals);
void measure_pours(const Options& options, Goals& goals);
void measure_collapse(const Options& options, Goals& goals);
void measure_cuts(const Options& options, Goals& goals);
void measure_buckets(const Options& options, Goals& goals);
void measure_tools(const Options& options, Goals& goals);
void measure_cycles(const Options& options, Goals& goals);
void measure_work(const Options& options, Goals& goals);
void measure_fleet(const Options& options, Goals& goals);

}  // namespace soilvdb::bench
