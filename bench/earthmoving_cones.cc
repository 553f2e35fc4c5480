// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Cones: how round and how steep they are, beside those of rules between neighbours.
#include <fmt/core.h>

#include <algorithm>

#include "bench/earthmoving.h"
#include "bench/peers/neighbour_rules.h"

namespace soilvdb::bench {
namespace {

constexpr double kConeVoxel = 0.05;

double cone_cells(double radius) { return std::numbers::pi * kSlope * std::pow(radius, 3) / 3; }
double cone_radius(double cells) { return std::cbrt(3 * cells / (std::numbers::pi * kSlope)); }

/// What a cone about (0, 0) would be in the same columns.
Heights exact_cone(const Heights& like, double radius) {
  Heights cone = like;
  std::size_t i = 0;
  for (int x = like.x0; x < like.x0 + like.nx; ++x)
    for (int y = like.y0; y < like.y0 + like.ny; ++y)
      cone.z[i++] = std::max(0.0, kSlope * (radius - std::hypot(x, y)));
  return cone;
}

/// Mean slope down a direction, between a quarter and three quarters of the radius: a pyramid of as
/// much soil has its toe at four fifths.
double slope_deg(const Heights& h, double radius, double turn) {
  const double r0 = 0.25 * radius, r1 = 0.75 * radius, c = std::cos(turn), s = std::sin(turn);
  return std::atan((h.at(r0 * c, r0 * s) - h.at(r1 * c, r1 * s)) / (r1 - r0)) / kDegree;
}

/// How far that is from an exact cone's in the worst of 48 directions: what interpolation between
/// columns errs by is in both.
double worst_slope_deg(const Heights& h, double radius) {
  constexpr int kDirections = 48;
  const Heights cone = exact_cone(h, radius);
  double worst = 0;
  for (int i = 0; i < kDirections; ++i) {
    const double turn = 2 * std::numbers::pi * i / kDirections;
    worst = std::max(worst, std::abs(slope_deg(h, radius, turn) - slope_deg(cone, radius, turn)));
  }
  return worst;
}

/// Over a cone about (0, 0) and a tenth of its radius beyond.
Off off_cone(const Heights& h, double radius) {
  std::vector<double> differences;
  for (int x = h.x0; x < h.x0 + h.nx; ++x) {
    for (int y = h.y0; y < h.y0 + h.ny; ++y) {
      const double d = std::hypot(x, y);
      if (d < 1.1 * radius)
        differences.push_back(h.cell(x, y) - std::max(0.0, kSlope * (radius - d)));
    }
  }
  return off(std::move(differences));
}

/// Radius at which a heap is a third of a cone's height, in a direction.
double outline(const Heights& h, double radius, double turn) {
  const double level = kSlope * radius / 3;
  double r = 0;
  while (r < -h.x0 - 2 && h.at(r * std::cos(turn), r * std::sin(turn)) > level) r += 0.01;
  return r;
}

Heights flat(int half) {
  const int n = 2 * half + 1;
  return {-half, -half, n, n, std::vector<double>(static_cast<std::size_t>(n * n))};
}

/// Soil that comes in parts, by the engine and by rules between neighbours: errors as it comes, and
/// outlines in the end.
void compare_peers(const Options& options, Goals& goals) {
  constexpr double kRadius = 24;
  constexpr int kParts = 100, kHalf = 40, kDirections = 192;
  const double cells = cone_cells(kRadius), part_m3 = cells * std::pow(kConeVoxel, 3) / kParts;
  Ground ground(kConeVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
  Tracker tracker(ground, {}, loam(std::vector<Pour>(kParts, {"part", {0, 0, 5}, 0, 0, part_m3})));
  NeighbourRule four(flat(kHalf), 4, kSlope), eight(flat(kHalf), 8, kSlope);
  Csv csv(options.out / "cone_error.csv", "poured_m3,soilvdb,four,eight");
  for (int part = 1; part <= kParts; ++part) {
    tracker.pour(static_cast<std::size_t>(part - 1), 0);
    for (NeighbourRule* rule : {&four, &eight}) {
      rule->add(0, 0, cells / kParts);
      rule->relax();
    }
    const double radius = cone_radius(cells * part / kParts);
    csv.row(fmt::format("{:.5g},{:.4g},{:.4g},{:.4g}", part * part_m3,
                        off_cone(heights(ground, kHalf), radius).rms,
                        off_cone(four.ground(), radius).rms, off_cone(eight.ground(), radius).rms));
  }
  const Heights ours = heights(ground, kHalf);
  Csv outlines(options.out / "outlines.csv", "turn_deg,circle,soilvdb,four,eight");
  for (int i = 0; i <= kDirections; ++i) {
    const double turn = 2 * std::numbers::pi * i / kDirections;
    outlines.row(fmt::format("{},{},{:.4g},{:.4g},{:.4g}", turn / kDegree, kRadius * 2 / 3,
                             outline(ours, kRadius, turn), outline(four.ground(), kRadius, turn),
                             outline(eight.ground(), kRadius, turn)));
  }
  goals.add({"cone of 24 voxels in 100 pours, slope in its worst direction",
             worst_slope_deg(ours, kRadius), "deg", 0.3});
  for (const auto& [name, rule, n] :
       {std::tuple("four", &four, 4), std::tuple("eight", &eight, 8)}) {
    double held = 0;
    for (const double z : rule->ground().z) held += z;
    // Is the rule what its authors have? It makes a pyramid, and loses nothing.
    const bool good = std::abs(held / cells - 1) < 1e-9 && rule->relax() == 1;
    goals.add({fmt::format("the same by {} neighbours", name),
               worst_slope_deg(rule->ground(), kRadius),
               "deg",
               {},
               {},
               fmt::format("a pyramid's: {:.2f}; {}", pyramid_error_deg(n, kSlope),
                           good ? "checked" : "THE RULE LOSES SOIL OR ISN'T AT REST")});
  }
}

}  // namespace

void measure_cones(const Options& options, Goals& goals) {
  Csv csv(options.out / "cones.csv",
          "radius_voxels,slope_error_deg,height_rms_voxels,height_p99_voxels,residual_samples,us");
  for (const double radius : {6.0, 8.0, 12.0, 18.0, 24.0}) {
    const double volume = cone_cells(radius) * std::pow(kConeVoxel, 3);
    Ground ground(kConeVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
    Tracker tracker(ground, {}, loam({{"pour", {0, 0, 5}, 0, 0, volume}}));
    const Update update = tracker.pour(0, 0);
    const Heights h = heights(ground, static_cast<int>(1.1 * radius) + 4);
    const Off error = off_cone(h, radius);
    const double worst = worst_slope_deg(h, radius);
    const double lost =
        ground.change_m3() / ground.sample_m3() - std::floor(volume / ground.sample_m3());
    csv.row(fmt::format("{},{:.4f},{:.4f},{:.4f},{},{:.1f}", radius, worst, error.rms, error.p99,
                        lost, update.us));
    const std::string name = fmt::format("cone of {} voxels", radius);
    goals.add({name + ", slope in its worst direction", worst, "deg", radius < 12 ? 0.6 : 0.3});
    add(goals, name, error, 0.25, 0.5);
    goals.add({name + ", samples more or less than poured", std::abs(lost), "", 0.0});
  }
  compare_peers(options, goals);
}

}  // namespace soilvdb::bench
