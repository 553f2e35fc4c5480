// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The force on a blade in one slice against published factors, closed forms, and a search over all
// failure planes that shares nothing with it.
#include "core/force/wedge.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

#include "tests/support/sanitized.h"

namespace soilvdb::test {
namespace wedge_test {

constexpr double kDeg = std::numbers::pi / 180;
using Point = Eigen::Vector2d;

struct Scene {
  double first_x, step;
  std::vector<double> heights;

  SoilSlice slice(double rake_deg, double face = 10) const {
    SoilSlice slice;
    slice.first_x = first_x;
    slice.step = step;
    slice.heights = heights;
    slice.rake = rake_deg * kDeg;
    slice.face = face;
    return slice;
  }
};

Scene scene(const std::function<double(double)>& z, double step = 0.05, double to = 8) {
  Scene made{-3, step, {}};
  const auto count = static_cast<int>(std::lround((to + 3) / step));
  for (int i = 0; i <= count; ++i) made.heights.push_back(z(-3 + i * step));
  return made;
}
Scene sloped(double depth, double slope_deg = 0) {
  return scene([=](double x) { return depth + x * std::tan(slope_deg * kDeg); }, 0.05, 20);
}

WedgeSoil soil(double unit_weight, double cohesion, double friction_deg, double tool_deg,
               double adhesion = 0) {
  return {unit_weight, cohesion, friction_deg * kDeg, tool_deg * kDeg, adhesion};
}

double cross(const Point& a, const Point& b) { return a.x() * b.y() - a.y() * b.x(); }

/// The distance to the ground from the lip in a direction, and the number of its piece.
std::pair<double, std::size_t> to_ground(const SoilSlice& slice, const Point& way) {
  for (std::size_t n = 0; n + 1 < slice.heights.size(); ++n) {
    // From the lip outwards, so that the first piece that is met counts.
    const std::size_t i = way.x() >= 0 ? n : slice.heights.size() - 2 - n;
    const Point a(slice.first_x + static_cast<double>(i) * slice.step, slice.heights[i]);
    const Point b(a.x() + slice.step, slice.heights[i + 1]);
    const double across = cross(way, b - a);
    if (std::abs(across) < 1e-15) continue;
    const double distance = cross(a, b - a) / across, share = cross(a, way) / across;
    if (distance > 1e-9 && share >= -1e-12 && share <= 1 + 1e-12) return {distance, i};
  }
  return {std::numeric_limits<double>::infinity(), 0};
}

/// The least P of many failure planes, by the area of a polygon each.
/// @param near the planes: about the angle of least P, which it becomes, to so much of a right
/// angle
double least_of_planes(const SoilSlice& slice, const WedgeSoil& s, double& near, double around) {
  constexpr int kPlanes = 2000;
  const Point up_blade(-std::cos(slice.rake), std::sin(slice.rake));
  const auto [out, first] = to_ground(slice, up_blade);
  const double length = std::min(out, slice.face);
  const Point end = length * up_blade;
  const double all = slice.rake + s.friction + s.tool_friction;
  double least = std::numeric_limits<double>::infinity();
  std::vector<double> angles;
  for (int n = 0; n <= kPlanes; ++n)
    angles.push_back(near + around * std::numbers::pi / 2 * (2. * n / kPlanes - 1));
  for (std::size_t i = 0; i < slice.heights.size(); ++i)  // beside each bend of the ground
    for (const double side : {-1e-8, 1e-8})
      angles.push_back(
          std::atan2(slice.heights[i], slice.first_x + static_cast<double>(i) * slice.step) + side);
  for (const double beta : angles) {
    if (beta <= 0 || beta >= std::numbers::pi - all || beta > std::numbers::pi / 2) continue;
    const auto [distance, last] = to_ground(slice, {std::cos(beta), std::sin(beta)});
    if (!std::isfinite(distance)) continue;
    const Point exit(distance * std::cos(beta), distance * std::sin(beta));
    std::vector<Point> ring = {Point(0, 0), exit};
    for (std::size_t i = last; slice.first_x + static_cast<double>(i) * slice.step > end.x(); --i)
      ring.emplace_back(slice.first_x + static_cast<double>(i) * slice.step, slice.heights[i]);
    const double at = (end.x() - slice.first_x) / slice.step;
    const auto i = static_cast<std::size_t>(at);
    ring.emplace_back(end.x(), slice.heights[i] + (at - static_cast<double>(i)) *
                                                      (slice.heights[i + 1] - slice.heights[i]));
    ring.push_back(end);
    double area = 0;
    for (std::size_t k = 0; k < ring.size(); ++k)
      area += cross(ring[k], ring[(k + 1) % ring.size()]) / 2;
    double fg = 1, fc = 1;
    if (slice.open_sides > 0) {
      const double r = exit.x() - end.x(), c = std::sqrt(std::max(0.0, r * r - end.x() * end.x()));
      fg += slice.open_sides * c / (3 * slice.width);
      fc += slice.open_sides * c / (2 * slice.width);
    }
    const double p = ((s.unit_weight * fg * area + slice.surcharge * fc * (exit.x() - end.x())) *
                          std::sin(beta + s.friction) +
                      s.cohesion * fc * distance * std::cos(s.friction) -
                      s.adhesion * length * std::cos(slice.rake + beta + s.friction)) /
                     std::sin(all + beta);
    if (p < least) near = beta;
    least = std::min(least, std::max(0.0, p));
  }
  return least;
}

struct Case {
  const char* what;
  Scene ground;
  double rake;
  WedgeSoil soil;
  double beta, ahead, up, moment, surcharge = 0, width = 0;
};

/// Made by a search over 20 001 angles on exact geometry.
TEST(Wedge, HasTheForcesOfTwelveCases) {
  const auto loam = soil(18e3, 10e3, 30, 20), sticky = soil(18e3, 10e3, 30, 20, 4e3);
  const Scene heap =
      scene([](double x) { return 0.3 + std::max(0.0, 0.2 - 0.5 * std::abs(x - 0.6)); });
  const Scene drop = scene([](double x) { return x < 0.30005 ? 0.3 : 0.05; }, 1e-4, 2);
  const Case cases[] = {
      {"upright, smooth, sand", sloped(.3), 90, soil(18e3, 0, 30, 0), 30, 2430, 0, 243},
      {"upright, smooth, clay", sloped(.3), 90, soil(18e3, 20e3, 0, 0), 45, 12810, 0, 1881},
      {"sand", sloped(.3), 45, soil(16e3, 0, 35, 70. / 3), 30.881, 2276.87, 904.54, 318.14},
      {"loam", sloped(.3), 60, loam, 34.045, 10296.96, 1815.63, 1563.33},
      {"adhesion", sloped(.3), 60, sticky, 30.904, 12188.54, 827.01, 1763.02},
      {"surcharge", sloped(.3), 60, sticky, 30.601, 16788.60, 1638.12, 2523.34, 5e3},
      {"uphill", sloped(.3, 15), 60, loam, 42.363, 14955.91, 2637.13, 1980.11},
      {"downhill", sloped(.3, -15), 60, loam, 24.833, 7327.03, 1291.95, 1309.61},
      {"narrow", sloped(.3), 60, loam, 42.728, 26659.96, 4700.87, 4096.35, 0, .3},
      {"wide", sloped(.3), 60, loam, 38.628, 14652.55, 2583.64, 2236.30, 0, 1.2},
      {"heap ahead", heap, 60, loam, 47.381, 14314.06, 2523.96, 2192.08},
      {"drop ahead", drop, 60, loam, 9.461, 4383.84, 773.00, 647.20},  // its foot is no angle's
  };
  for (const Case& c : cases) {
    SCOPED_TRACE(c.what);
    SoilSlice slice = c.ground.slice(c.rake);
    slice.surcharge = c.surcharge;
    slice.open_sides = c.width > 0 ? 2 : 0;
    slice.width = c.width;
    const WedgeForce force = wedge_force(slice, c.soil);
    EXPECT_NEAR(force.ahead, c.ahead, 2e-6 * c.ahead + 0.005);
    EXPECT_NEAR(force.up, c.up, 2e-6 * c.ahead + 0.005);
    EXPECT_NEAR(force.failure / kDeg, c.beta, 0.01);
    const double moment =
        force.arm * (force.ahead * std::sin(slice.rake) + force.up * std::cos(slice.rake));
    EXPECT_NEAR(moment, c.moment, 3e-5 * c.moment);  // not least at that angle: less exact
    EXPECT_NEAR(force.depth, 0.3, 1e-12);
    EXPECT_FALSE(force.steep);
    EXPECT_FALSE(force.open);
  }
}

/// The pressure of sand grows with depth, also along a blade whose end is below the ground.
TEST(Wedge, ActsWhereItsPressureDoes) {
  const Scene ground = sloped(0.5);
  for (const double face : {0.1, 0.3, 0.6, 2.0}) {
    SoilSlice slice = ground.slice(45);
    slice.face = face;
    const double end = std::max(0.0, 0.5 - face * std::sin(45 * kDeg));  // below the ground
    const double length = (0.5 - end) / std::sin(45 * kDeg);
    double sum = 0, moment = 0;
    constexpr int kParts = 1000;
    for (int n = 0; n < kParts; ++n) {
      const double s = (n + 0.5) / kParts * length, pressure = 0.5 - s * std::sin(45 * kDeg);
      sum += pressure;
      moment += pressure * s;
    }
    EXPECT_NEAR(wedge_force(slice, soil(18e3, 0, 30, 20)).arm, moment / sum, 1e-5) << face;
  }
}

/// Beside a blade of little friction the least plane may be the upright one.
TEST(Wedge, TriesTheUprightPlaneWithCrescents) {
  const Scene ground = sloped(0.3);
  SoilSlice slice = ground.slice(40);
  slice.open_sides = 2;
  slice.width = 1.2;
  const WedgeForce force = wedge_force(slice, soil(18e3, 10e3, 5, 0));
  EXPECT_NEAR(force.failure / kDeg, 90, 1e-6);
}

TEST(Wedge, HasClosedForms) {
  for (const double phi : {20., 30., 40.}) {
    const double kp = std::pow(std::tan((45 + phi / 2) * kDeg), 2);
    const Scene ground = sloped(1);
    const SoilSlice slice = ground.slice(90);
    EXPECT_NEAR(wedge_force(slice, soil(1, 0, phi, 0)).ahead, kp / 2, 1e-9);  // Rankine
    EXPECT_NEAR(wedge_force(slice, soil(0, 1, phi, 0)).ahead, 2 * std::sqrt(kp), 1e-9);
  }
  struct Line {
    double rake, tool, phi, slope;
  };
  for (const Line& l : std::vector<Line>{{60, 20, 30, 0},
                                         {60, 20, 30, 15},
                                         {60, 20, 30, -15},
                                         {45, 70. / 3, 35, 0},
                                         {75, 15, 25, 10},
                                         {90, 10, 30, 0}}) {
    const Scene ground = sloped(1, l.slope);
    const double a = l.rake * kDeg, de = l.tool * kDeg, ph = l.phi * kDeg, i = l.slope * kDeg;
    const double height = 1 / (1 + std::tan(i) / std::tan(a));  // the blade comes out there
    const double root =
        std::sqrt(std::sin(ph + de) * std::sin(ph + i) / (std::sin(a + de) * std::sin(a + i)));
    const double kp = std::pow(std::sin(a - ph) / std::sin(a) / (1 - root), 2) / std::sin(a + de);
    const WedgeForce force = wedge_force(ground.slice(l.rake), soil(1, 0, l.phi, l.tool));
    EXPECT_NEAR(std::hypot(force.ahead, force.up), height * height / 2 * kp, 1e-8 * kp);  // Coulomb
  }
  for (const Line& l :
       std::vector<Line>{{60, 20, 30, 0}, {45, 20, 35, 0}, {75, 10, 25, 0}, {30, 15, 40, 0}}) {
    const double k = (l.rake + l.tool + l.phi) * kDeg;
    const Scene ground = sloped(1);
    const WedgeForce force = wedge_force(ground.slice(l.rake), soil(0, 1, l.phi, l.tool));
    EXPECT_NEAR(std::hypot(force.ahead, force.up),
                std::cos(l.phi * kDeg) / std::pow(std::cos(k / 2), 2), 1e-8);
    EXPECT_NEAR(force.failure, std::numbers::pi / 2 - k / 2, 1e-6);
  }
}

/// Blades and soils of all kinds on rough ground.
struct Draw {
  std::mt19937_64 random;
  double operator()(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  }
  Scene ground() {
    const double depth = (*this)(0.1, 0.8), slope = (*this)(-0.4, 0.4);
    const double rough = (*this)(0, 0.05), heap = (*this)(0, 0.6), at = (*this)(0.3, 2);
    const double drop = (*this)(0, 0.4), drop_at = (*this)(0.5, 4);
    return scene([&, depth](double x) {
      const double ahead = x > 0 ? slope * x : 0;
      return depth + ahead + (x > 0 ? (*this)(-rough, rough) : 0) +
             std::max(0.0, heap - 0.7 * std::abs(x - at)) - (x > drop_at ? drop : 0);
    });
  }
  WedgeSoil strength() {
    const double phi = (*this)(0, 42), unit_weight = (*this)(12e3, 21e3);
    const double cohesion = random() % 3 == 0 ? 0 : (*this)(0, 3e4), tool = phi * (*this)(0, 1);
    return soil(unit_weight, cohesion, phi, tool, random() % 3 == 0 ? (*this)(0, 5e3) : 0);
  }
};

TEST(Wedge, IsTheLeastOverAllPlanesOnAnyGround) {
  Draw draw{std::mt19937_64(3)};
  int direct = 0;
  const int scenes = kLong ? 1000 : 200;
  for (int n = 0; n < scenes; ++n) {
    SCOPED_TRACE(n);
    const Scene ground = draw.ground();
    SoilSlice slice = ground.slice(draw(15, 95), n % 2 == 0 ? 10 : draw(0.1, 0.6));
    if (n % 5 == 0) {
      slice.open_sides = 1 + n % 2;
      slice.width = draw(0.2, 2);
    }
    if (n % 7 == 0) slice.surcharge = draw(0, 5e3);
    const WedgeSoil s = draw.strength();
    const WedgeForce force = wedge_force(slice, s);
    if (force.steep || force.open) continue;
    ++direct;
    const double stuck = s.adhesion;  // on the length that the force's arm is seen from
    const double angle = slice.rake + s.tool_friction;
    const auto length = [&] {
      return std::min(slice.face,
                      to_ground(slice, {-std::cos(slice.rake), std::sin(slice.rake)}).first);
    }();
    const double ahead = force.ahead - stuck * length * std::cos(slice.rake);
    const double up = force.up + stuck * length * std::sin(slice.rake);
    const double p = ahead * std::sin(angle) + up * std::cos(angle);
    double near = std::numbers::pi / 4;
    least_of_planes(slice, s, near, 0.5);
    const double brute = least_of_planes(slice, s, near, 1e-3);
    EXPECT_LE(p, brute * (1 + 1e-7) + 1e-6);
    EXPECT_GE(p, brute * (1 - 5e-5) - 0.05);
  }
  EXPECT_GT(direct, 7 * scenes / 10);
}

TEST(Wedge, HasExactDerivatives) {
  Draw draw{std::mt19937_64(4)};
  int compared = 0;
  for (int n = 0; n < 300; ++n) {
    SCOPED_TRACE(n);
    const Scene ground = n % 3 == 0 ? sloped(draw(0.1, 0.6), draw(-20, 20)) : draw.ground();
    SoilSlice slice = ground.slice(draw(20, 90), draw(0.2, 1));
    slice.open_sides = n % 3;
    slice.width = 0.8;
    WedgeSoil s = draw.strength();
    s.friction = std::max(s.friction, 0.1);
    s.tool_friction = std::max(s.tool_friction, 0.05);
    const WedgeForce force = wedge_force(slice, s);
    if (force.steep || force.ahead == 0) continue;
    double* const members[] = {&s.unit_weight, &s.cohesion, &s.friction, &s.tool_friction,
                               &s.adhesion};
    for (int k = 0; k < kWedgeParameters; ++k) {
      const double at = *members[k], d = std::max(1e-5 * at, k < 2 || k == 4 ? 1e-2 : 1e-6);
      *members[k] = at + d;
      const WedgeForce more = wedge_force(slice, s);
      *members[k] = at - d;
      const WedgeForce less = wedge_force(slice, s);
      *members[k] = at;
      if (at < d || std::abs(more.failure - less.failure) > 1e-3) continue;  // to another ridge
      const double scale = std::max(force.ahead / std::max(at, d) * 1e-2, 1e-9);
      EXPECT_NEAR(force.d_ahead[k], (more.ahead - less.ahead) / (2 * d),
                  1e-5 * std::abs(force.d_ahead[k]) + 1e-5 * scale);
      EXPECT_NEAR(force.d_up[k], (more.up - less.up) / (2 * d),
                  1e-5 * std::abs(force.d_up[k]) + 1e-5 * scale);
      ++compared;
    }
  }
  EXPECT_GT(compared, 800);
}

/// A body presses on the ground, is lifted off it, or is about to be, by soil and blade.
TEST(Wedge, HasDerivativesOfABodyOfSoil) {
  Draw draw{std::mt19937_64(7)};
  int pressing = 0, lifted = 0;
  for (int n = 0; n < 300; ++n) {
    SCOPED_TRACE(n);
    const Scene ground = sloped(draw(0.1, 0.6), draw(-10, 10));
    const SoilSlice slice = ground.slice(draw(80, 115), 2);
    WedgeSoil s = soil(draw(12e3, 21e3), n % 2 == 0 ? draw(0, 1e3) : draw(0, 40e3), draw(20, 40),
                       draw(5, 20));
    const WedgeForce force = wedge_force(slice, s);
    if (!force.steep) continue;
    ++(force.up < 0 ? lifted : pressing);
    double* const members[] = {&s.unit_weight, &s.cohesion, &s.friction};
    for (int k = 0; k < 3; ++k) {
      const double at = *members[k], d = std::max(1e-3 * at, k == 1 ? 1.0 : 1e-4);
      *members[k] = at + d;
      const WedgeForce more = wedge_force(slice, s);
      *members[k] = at - d;
      const WedgeForce less = wedge_force(slice, s);
      *members[k] = at;
      // Not where soil stops to be lifted between.
      if (at < d || !more.steep || !less.steep || (more.up < 0) != (less.up < 0)) continue;
      const auto i = static_cast<std::size_t>(k);
      const double scale = std::max(force.ahead, 1.0) / std::max(at, d);
      EXPECT_NEAR(force.d_ahead[i], (more.ahead - less.ahead) / (2 * d), 2e-4 * scale) << k;
      EXPECT_NEAR(force.d_up[i], (more.up - less.up) / (2 * d), 2e-3 * scale) << k;
    }
  }
  EXPECT_GT(pressing, 50);
  EXPECT_GT(lifted, 20);
}

/// Where the ground that is known ends, so do planes.
TEST(Wedge, EndsWhereTheHeightsDo) {
  const Scene ground = scene([](double) { return 0.3; }, 0.05, 0.2);
  const WedgeForce force = wedge_force(ground.slice(90), soil(18e3, 0, 30, 0));
  const double beta = std::atan2(0.3, 0.2), area = 0.3 * 0.2 / 2;
  EXPECT_NEAR(force.ahead, 18e3 * area * std::sin(beta + 30 * kDeg) / std::sin(beta + 120 * kDeg),
              1e-6);
  EXPECT_TRUE(force.open);
  EXPECT_NEAR(force.failure, beta, 1e-9);
  // Not where they are below the lip by then.
  const Scene bank = scene([](double x) { return x < 0.5 ? 0.3 : -1.0; }, 0.25, 0.75);
  const WedgeForce level = wedge_force(bank.slice(30), soil(18e3, 0, 30, 0));
  EXPECT_FALSE(level.open);
}

/// A plane's force grows evenly with the soil beside it, and the least does as its plane does.
TEST(Wedge, KnowsThePartOfSoilBesideIt) {
  Draw draw{std::mt19937_64(6)};
  int compared = 0, steep = 0;
  for (int n = 0; n < 2000; ++n) {
    SCOPED_TRACE(n);
    const double depth = draw(0.1, 0.6), slope_deg = draw(-20, 20);
    const Scene ground = n % 3 == 0 ? sloped(depth, slope_deg) : draw.ground();
    const double rake_deg = draw(20, 100), face = draw(0.2, 1);
    SoilSlice slice = ground.slice(rake_deg, face);
    if (n % 4 == 0) slice.surcharge = draw(0, 5e3);
    slice.open_sides = draw(0.2, 1.8);
    slice.width = draw(0.3, 2);
    const WedgeSoil s = draw.strength();
    const WedgeForce force = wedge_force(slice, s);
    const double d = 1e-4, sides = slice.open_sides;
    slice.open_sides = sides + d;
    const WedgeForce more = wedge_force(slice, s);
    slice.open_sides = sides - d;
    const WedgeForce less = wedge_force(slice, s);
    if (force.ahead == 0 || more.steep != less.steep ||
        std::abs(more.failure - less.failure) > 1e-3)
      continue;  // to another ridge
    const double by_side = sides * (more.ahead - less.ahead) / (2 * d);
    if (force.steep) {  // on rough ground a body's angle jumps
      if (n % 3 != 0) continue;
      EXPECT_NEAR(force.side_ahead, by_side, 2e-4 * force.ahead);
      ++steep;
    } else {
      EXPECT_NEAR(force.side_ahead, by_side, 1e-5 * force.ahead);
      EXPECT_NEAR(force.side_up, sides * (more.up - less.up) / (2 * d), 1e-5 * force.ahead);
      ++compared;
    }
    slice.open_sides = 0;
    const WedgeForce alone = wedge_force(slice, s);
    EXPECT_EQ(alone.side_ahead, 0);
    EXPECT_EQ(alone.side_up, 0);
  }
  EXPECT_GT(compared, 1000);
  EXPECT_GT(steep, 50);
}

TEST(Wedge, GrowsWithItsSizeAndItsSoil) {
  Draw draw{std::mt19937_64(5)};
  for (int n = 0; n < 200; ++n) {
    SCOPED_TRACE(n);
    const Scene small = draw.ground();
    Scene large = small;
    large.first_x *= 2;
    large.step *= 2;
    for (double& z : large.heights) z *= 2;
    const double rake = draw(20, 110), face = draw(0.2, 1);
    WedgeSoil s = draw.strength();
    const WedgeForce of_weight =
        wedge_force(small.slice(rake, face), {s.unit_weight, 0, s.friction, s.tool_friction, 0});
    const WedgeForce larger = wedge_force(large.slice(rake, 2 * face),
                                          {s.unit_weight, 0, s.friction, s.tool_friction, 0});
    EXPECT_NEAR(larger.ahead, 4 * of_weight.ahead, 1e-6 * larger.ahead);
    const double before = wedge_force(small.slice(rake, face), s).ahead;
    s.cohesion += 1000;
    const double stickier = wedge_force(small.slice(rake, face), s).ahead;
    EXPECT_GT(stickier, before);
    const Scene level = sloped(draw(0.1, 0.6));
    s.adhesion = 0;
    s.tool_friction = 2 * s.friction / 3;
    const double weaker = wedge_force(level.slice(rake, face), s).ahead;
    s.friction += 0.05;
    s.tool_friction = 2 * s.friction / 3;
    EXPECT_GT(wedge_force(level.slice(rake, face), s).ahead, weaker);
  }
}

/// Made by a scan of the body's face in steps of half a degree.
TEST(Wedge, OfASteepBladeIsThatOfABodyOfSoil) {
  struct Line {
    double rake, cohesive, sand;
  };
  for (const Line& l : std::vector<Line>{{45, 7315, 2108},
                                         {60, 10297, 2482},
                                         {75, 15359, 3186},
                                         {80, 17004, 3316},
                                         {90, 17616, 3399},
                                         {100, 18227, 3481},
                                         {110, 18878, 3569},
                                         {120, 19618, 3669}}) {
    SCOPED_TRACE(l.rake);
    const Scene ground = sloped(.3);
    for (const auto& [cohesion, expected] : {std::pair(1e4, l.cohesive), std::pair(0., l.sand)}) {
      const WedgeForce force = wedge_force(ground.slice(l.rake), soil(18e3, cohesion, 30, 20));
      EXPECT_NEAR(force.ahead, expected, 1e-3 * expected);
      EXPECT_EQ(force.steep, l.rake > 77);
    }
  }
}

TEST(Wedge, ChangesSmoothlyWithDepth) {
  const Scene ground = scene([](double x) { return 0.1 * std::sin(x) + 0.02 * x; });
  const WedgeSoil loam = soil(18e3, 10e3, 30, 20);
  for (const double rake : {35., 60., 85., 100.}) {
    double last = 0;
    for (double depth = 0.1; depth < 0.5; depth += 0.001) {
      Scene lower = ground;
      for (double& z : lower.heights) z += depth;
      const double force = wedge_force(lower.slice(rake, 0.35), loam).ahead;
      if (last > 0) {
        EXPECT_LT(std::abs(force / last - 1), 0.03) << rake << " " << depth;
        EXPECT_GT(force, last) << rake << " " << depth;
      }
      last = force;
    }
  }
}

TEST(Wedge, IsNothingWithoutSoil) {
  const WedgeSoil loam = soil(18e3, 10e3, 30, 20);
  EXPECT_EQ(wedge_force(sloped(-0.1).slice(60), loam).ahead, 0);
  EXPECT_EQ(wedge_force(sloped(0.3).slice(0), loam).ahead, 0);
  EXPECT_EQ(wedge_force(sloped(0.3).slice(180), loam).ahead, 0);
  SoilSlice nothing;
  EXPECT_EQ(wedge_force(nothing, loam).ahead, 0);
}

}  // namespace wedge_test
}  // namespace soilvdb::test
