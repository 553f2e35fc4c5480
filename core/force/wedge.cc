// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Equilibrium of a wedge that slides along a failure plane at an angle beta, per metre of width:
//
//     P sin(rake + beta + delta + phi) = (g A + q B) sin(beta + phi) + c L cos phi
//                                        - c_a L_b cos(rake + beta + phi)
//
// A failure plane is given by the point (x, z) where it comes to the ground. With sines and cosines
// of beta as z / L and x / L both sides are polynomials of x along a straight piece of ground. So
// the least P is at a root of one derivative, at a bend of the ground, or where a plane passes a
// ridge.
#include "core/force/wedge.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>

#include "core/constants.h"
#include "core/lattice/affine.h"

namespace soilvdb::inline v0 {
namespace {

constexpr double kNoForce = std::numeric_limits<double>::infinity();

struct Angle {
  double sine, cosine;

  Angle(double sine_of, double cosine_of) : sine(sine_of), cosine(cosine_of) {}
  explicit Angle(double angle) : sine(std::sin(angle)), cosine(std::cos(angle)) {}
  Angle operator+(const Angle& o) const {
    return {sine * o.cosine + cosine * o.sine, cosine * o.cosine - sine * o.sine};
  }
};

/// Height of the ground at x from the lip.
double ground(const SoilSlice& slice, double x) {
  const std::span<const double> z = slice.heights;
  const double at =
      std::clamp((x - slice.first_x) / slice.step, 0.0, static_cast<double>(z.size() - 1));
  const auto i = std::min(static_cast<std::size_t>(at), z.size() - 2);
  const double share = at - static_cast<double>(i);
  return (1 - share) * z[i] + share * z[i + 1];
}

/// The plane face that pushes a wedge: from a toe up to the end of the blade in the soil.
struct PushingFace {
  double toe_x, rake_rad, length;
  double end_x, end_z;  // from the toe
  Angle rake;
};

/// A failure plane comes to the ground at (x, z) from the toe.
struct TrialPlane {
  double p = kNoForce;  // less than 0: the soil would fail without a push
  double x = 0, z = 0, area = 0, crescent = 0;
  bool last = false;  // at the end of the heights
};

/// What the force of a wedge depends on besides where its failure plane comes to the ground.
struct WedgeFactors {
  double unit_weight, surcharge;
  double cohesive;           // cohesion times the cosine of friction
  double stuck;              // adhesion of all of the face
  double end_x;              // of the face
  Angle phi, rake_phi, all;  // of friction, with the face's rake, and with tool friction, too
  double weight_share = 0, plane_share = 0;  // of a crescent's radius
};

/// Where a failure plane may come to the ground: P times `lever` is `resists` there. `flat` and
/// `rising` times the ground's rise have together the sign of P's change along the ground.
struct Exit {
  double x, z, area, crescent, resists, lever, flat, rising;

  double trend(double rise) const { return flat + rising * rise; }
};

/// @param area of the wedge
[[gnu::always_inline]] inline Exit exit_at(const WedgeFactors& of, double x, double z,
                                           double area) {
  const double r = x - of.end_x, square = x * x + z * z;
  const double sine = z * of.phi.cosine + x * of.phi.sine;
  const double lever = x * of.all.sine + z * of.all.cosine;
  const double crescent = std::sqrt(std::max(0.0, r * r - of.end_x * of.end_x));
  const double by_x = crescent > 0 ? r / crescent : 0;
  const double fg = 1 + of.weight_share * crescent, fc = 1 + of.plane_share * crescent;
  const double heavy = of.unit_weight * fg, sticky = of.cohesive * fc;
  const double weight = heavy * area + of.surcharge * r * fc;
  // By x, besides the area's.
  const double more_weight = of.unit_weight * area * of.weight_share * by_x +
                             of.surcharge * (fc + of.plane_share * by_x * r);
  const double more_sticky = of.cohesive * of.plane_share * by_x * square;
  const double resists =
      weight * sine + sticky * square - of.stuck * (of.rake_phi.cosine * x - of.rake_phi.sine * z);
  const double flat = (heavy * z / 2 + more_weight) * sine + weight * of.phi.sine + 2 * sticky * x +
                      more_sticky - of.stuck * of.rake_phi.cosine;
  const double rising =
      weight * of.phi.cosine - heavy * x / 2 * sine + 2 * sticky * z + of.stuck * of.rake_phi.sine;
  return {x,
          z,
          area,
          crescent,
          resists,
          lever,
          flat * lever - resists * of.all.sine,
          rising * lever - resists * of.all.cosine};
}

/// Bends of the ground one after another, and the failure planes that come out there.
struct Bends {
  static constexpr std::size_t kAtOnce = 16;
  using Values = std::array<double, kAtOnce + 1>;
  Values x, z, below;  // the area of the wedge and of (toe, exit, x axis)
  Values area, crescent, resists, lever, flat, rising;

  Exit exit(std::size_t k) const {
    return {x[k], z[k], area[k], crescent[k], resists[k], lever[k], flat[k], rising[k]};
  }
};

SOILVDB_FOR_CPUS void find_exits(const WedgeFactors& given, std::size_t count, Bends& bends) {
  const WedgeFactors of = given;
  for (std::size_t k = 0; k < count; ++k) {
    const double x = bends.x[k], z = bends.z[k];
    const Exit e = exit_at(of, x, z, bends.below[k] - x * z / 2);
    bends.area[k] = e.area;
    bends.crescent[k] = e.crescent;
    bends.resists[k] = e.resists;
    bends.lever[k] = e.lever;
    bends.flat[k] = e.flat;
    bends.rising[k] = e.rising;
  }
}

class TrialWedge {
 public:
  TrialWedge(const SoilSlice& slice, const PushingFace& face, const WedgeSoil& soil)
      : slice_(slice),
        face_(face),
        soil_(soil),
        phi_(soil.friction),
        rake_delta_(face.rake + Angle(soil.tool_friction)),
        of_{soil.unit_weight,
            slice.surcharge,
            soil.cohesion * phi_.cosine,
            soil.adhesion * face.length,
            face.end_x,
            phi_,
            face.rake + phi_,
            rake_delta_ + phi_} {
    if (slice.open_sides > 0) {
      of_.weight_share = slice.open_sides / (3 * slice.width);
      of_.plane_share = slice.open_sides / (2 * slice.width);
    }
  }

  /// The failure plane of least force. Planes that another part of the ground cuts short end there.
  TrialPlane least() const {
    TrialPlane best;
    const double kappa = face_.rake_rad + soil_.friction + soil_.tool_friction;
    if (kappa >= std::numbers::pi - kLeastWedgeAngle) return best;
    const std::span<const double> z = slice_.heights;
    const double begin = face_.toe_x + face_.end_x;
    const auto first =
        static_cast<std::size_t>(std::clamp(std::floor((begin - slice_.first_x) / slice_.step) + 1,
                                            0.0, static_cast<double>(z.size())));
    Bends bends;
    bends.x[0] = face_.end_x;
    bends.z[0] = ground(slice_, begin);
    // Of the wedge plus that of (toe, exit, x axis).
    bends.below[0] = face_.end_x * face_.end_z / 2;
    double steepest = std::numeric_limits<double>::infinity();
    for (std::size_t i = first; i < z.size();) {
      const std::size_t count = std::min(Bends::kAtOnce, z.size() - i);
      for (std::size_t k = 0; k < count; ++k) {
        const double x0 = bends.x[k], z0 = bends.z[k];
        const double x1 = slice_.first_x + static_cast<double>(i + k) * slice_.step - face_.toe_x;
        const double z1 = z[i + k];
        bends.x[k + 1] = x1;
        bends.z[k + 1] = z1;
        bends.below[k + 1] = bends.below[k] + (z0 + z1) / 2 * (x1 - x0);
      }
      find_exits(of_, count + 1, bends);
      for (std::size_t k = 1; k <= count; ++k) {
        const double x1 = bends.x[k], z1 = bends.z[k];
        if (x1 > 0 && z1 < steepest * x1) {
          try_piece(bends, k, steepest, i + k == z.size(), best);
          steepest = std::min(steepest, z1 / x1);
        }
        if (x1 > 0 &&
            (z1 <= 0 || is_less_than_beyond(best.p, x1, bends.area[k], bends.crescent[k])))
          return best;
      }
      bends.x[0] = bends.x[count];
      bends.z[0] = bends.z[count];
      bends.below[0] = bends.below[count];
      i += count;
    }
    return best;
  }

  /// @param pushes what counts of P: none of it if it is less than 0
  WedgeForce force(const TrialPlane& at, double pushes) const {
    const double length = std::sqrt(at.x * at.x + at.z * at.z);
    const double fg = 1 + of_.weight_share * at.crescent, fc = 1 + of_.plane_share * at.crescent;
    const Angle beta(at.z / length, at.x / length);
    const Angle beta_all = beta + of_.all, beta_phi = beta + phi_,
                beta_rake_phi = beta + of_.rake_phi;
    const double cotangent = beta_all.cosine / beta_all.sine;
    const double by_weight = fg * at.area * beta_phi.sine / beta_all.sine;
    const double by_cohesion = fc * length * phi_.cosine / beta_all.sine;
    const double by_adhesion = -face_.length * beta_rake_phi.cosine / beta_all.sine;
    const double load =
        soil_.unit_weight * fg * at.area + slice_.surcharge * fc * (at.x - face_.end_x);
    const double p = pushes * at.p;
    const double by_friction = (load * beta_phi.cosine - soil_.cohesion * fc * length * phi_.sine +
                                of_.stuck * beta_rake_phi.sine) /
                                   beta_all.sine -
                               at.p * cotangent;
    const double by_tool_friction = -at.p * cotangent;
    const std::array<double, kWedgeParameters> by = {by_weight, by_cohesion, by_friction,
                                                     by_tool_friction, by_adhesion};
    WedgeForce force;
    force.push = at.p;
    const double along = rake_delta_.sine, upward = rake_delta_.cosine;
    force.ahead = p * along + of_.stuck * face_.rake.cosine;
    force.up = p * upward - of_.stuck * face_.rake.sine;
    if (pushes > 0) {
      const double side = ((soil_.unit_weight * (fg - 1) * at.area +
                            slice_.surcharge * (fc - 1) * (at.x - face_.end_x)) *
                               beta_phi.sine +
                           of_.cohesive * (fc - 1) * length) *
                          pushes / beta_all.sine;
      force.side_ahead = side * along;
      force.side_up = side * upward;
    }
    for (std::size_t i = 0; i < by.size(); ++i) {
      force.d_ahead[i] = pushes * by[i] * along;
      force.d_up[i] = pushes * by[i] * upward;
    }
    force.d_ahead[3] += p * upward;
    force.d_up[3] -= p * along;
    force.d_ahead[4] += face_.length * face_.rake.cosine;
    force.d_up[4] -= face_.length * face_.rake.sine;
    force.failure = std::atan2(at.z, at.x);
    const double weight = soil_.unit_weight * by_weight;
    // The weight's pressure grows with depth below the ground, from the face's end down to the toe.
    const double deep = std::max(0.0, ground(slice_, face_.toe_x));
    const double cover = std::max(0.0, ground(slice_, face_.toe_x + face_.end_x) - face_.end_z);
    const double third = deep > 0 ? (deep + 2 * cover) / (3 * (deep + cover)) : 1.0 / 3;
    // Where adhesion takes off nearly all of P, the parts may act in opposite ways.
    const double share = p > 0 ? (weight * third + (p - weight) / 2) / p : third;
    force.arm = std::clamp(share, 0.0, 1.0) * face_.length;
    force.open = at.last;
    return force;
  }

 private:
  void try_exit(const Exit& e, bool last, TrialPlane& best) const {
    if (e.lever > 0 && e.resists < best.p * e.lever)
      best = {e.resists / e.lever, e.x, e.z, e.area, e.crescent, last};
  }

  /// The straight piece of ground that ends at a bend.
  void try_piece(const Bends& bends, std::size_t k, double steepest, bool last,
                 TrialPlane& best) const {
    const double x0 = bends.x[k - 1], z0 = bends.z[k - 1], x1 = bends.x[k], z1 = bends.z[k];
    const double m = (z1 - z0) / (x1 - x0);
    const auto exit = [&](double x) {
      const double z = z0 + m * (x - x0);
      return exit_at(of_, x, z, bends.below[k - 1] + (z0 + z) / 2 * (x - x0) - x * z / 2);
    };
    double low = std::max(x0, 0.0), high = x1;
    // Where the piece comes into sight from the toe.
    if (steepest < std::numeric_limits<double>::infinity() && z0 + m * (low - x0) > steepest * low)
      low = std::clamp((z0 - m * x0) / (steepest - m), low, high);
    if (z1 < 0) high = std::clamp(x0 - z0 / m, low, high);
    Exit begin = low == x0 ? bends.exit(k - 1) : exit(low);
    const Exit end = high == x1 ? bends.exit(k) : exit(high);
    // Steeper planes than this can't slide.
    if (begin.lever <= 0) {
      if (end.lever <= 0) return;
      low += -begin.lever / (of_.all.sine + m * of_.all.cosine) * (1 + kWedgeTolerance);
      begin = exit(low);
    }
    if (!(low < high)) return;
    last = last && high == x1;
    try_exit(begin, false, best);  // where crescents begin, P has no derivative
    double down = begin.trend(m), up = end.trend(m);
    if (!(down < 0 && up > 0)) return try_exit(end, last, best);
    // The root by false position; the end that stays counts half (Illinois).
    Exit other = begin;
    for (int n = 0, side = 0; n < kMaxWedgeSteps; ++n) {
      const double before = other.x;
      other = exit((low * up - high * down) / (up - down));
      const double at = other.trend(m);
      if (at == 0 || std::abs(other.x - before) < kWedgeTolerance * high) break;
      if (at < 0) {
        low = other.x;
        down = at;
        if (side < 0) up /= 2;
        side = -1;
      } else {
        high = other.x;
        up = at;
        if (side > 0) down /= 2;
        side = 1;
      }
    }
    try_exit(other, last && other.x == x1, best);
  }

  /// No plane that comes to the ground beyond x needs as little as p. `area` is of the wedge up to
  /// there, the crescent's radius of that or a nearer plane. The quotients of sines grow with beta,
  /// so they are least at 0.
  bool is_less_than_beyond(double p, double x, double area, double crescent) const {
    const double fg = 1 + of_.weight_share * crescent, fc = 1 + of_.plane_share * crescent;
    return soil_.unit_weight * fg * area * phi_.sine - of_.stuck * of_.rake_phi.cosine >
           (p - of_.cohesive * fc * x) * of_.all.sine;
  }

  const SoilSlice& slice_;
  PushingFace face_;
  WedgeSoil soil_;
  Angle phi_, rake_delta_;  // of friction, of rake and tool friction
  WedgeFactors of_;
};

/// Length of the blade up to where it comes out of the ground.
double length_in_soil(const SoilSlice& slice, const Angle& rake) {
  const double sine = rake.sine, cosine = rake.cosine;
  double from = 0, cover = ground(slice, 0);
  const double step = slice.step / std::max(std::abs(cosine), kNearlyUpright);
  // Bends of the ground are where x is a whole number of steps from the first height.
  const double steps = -slice.first_x / slice.step, share = steps - std::floor(steps);
  double to = (cosine > 0 ? share : 1 - share) * step;
  while (from < slice.face) {
    const double end = std::min(to, slice.face);
    const double over = ground(slice, -end * cosine) - end * sine;
    if (over <= 0) return from + (end - from) * cover / (cover - over);
    from = end;
    cover = over;
    to += step;
  }
  return slice.face;
}

/// A blade in a slice, and the soil.
struct SlicedBlade {
  const SoilSlice& slice;
  const WedgeSoil& soil;
  double end_x, end_z;  // of the blade in the soil
};

/// A body of soil rides before the blade; its face has this angle. Without what it presses on the
/// ground. @param pushes what counts of P; empty: all of it if it is a push
WedgeForce body_before(const SlicedBlade& cut, double angle, std::optional<double> pushes = {}) {
  const Angle rake(angle);
  const double toe = cut.end_x + cut.end_z * rake.cosine / rake.sine;
  const PushingFace face{toe, angle, cut.end_z / rake.sine, cut.end_x - toe, cut.end_z, rake};
  WedgeSoil inside = cut.soil;
  inside.tool_friction = cut.soil.friction;
  inside.adhesion = cut.soil.cohesion;
  const TrialWedge wedge(cut.slice, face, inside);
  const TrialPlane exit = wedge.least();
  WedgeForce force;
  if (exit.p == kNoForce) {
    force.ahead = kNoForce;
    return force;
  }
  force = wedge.force(exit, pushes.value_or(exit.p > 0 ? 1 : 0));
  force.arm /= face.length;  // a share of the face; of the blade, too
  // Friction in the soil is that of the face as well, and cohesion its adhesion.
  for (auto* by : {&force.d_ahead, &force.d_up}) {
    (*by)[1] += std::exchange((*by)[4], 0);
    (*by)[2] += std::exchange((*by)[3], 0);
  }
  const double area = cut.end_z * toe / 2;
  force.up += cut.soil.unit_weight * area;
  force.d_up[0] += area;
  force.ahead += cut.soil.cohesion * toe;
  force.d_ahead[1] += toe;
  force.steep = true;
  return force;
}

/// Of each newton up, so much acts ahead, and the rest on the ground. @param share by friction
void put_on_ground(WedgeForce& force, double share) {
  force.ahead += force.up * share;
  force.side_ahead += force.side_up * share;
  for (std::size_t i = 0; i < force.d_up.size(); ++i) force.d_ahead[i] += share * force.d_up[i];
  force.d_ahead[2] += force.up * (1 + share * share);
  force.up = force.side_up = 0;
  force.d_up.fill(0);
}

WedgeForce with_body(const SlicedBlade& cut, double angle, std::optional<double> pushes = {}) {
  WedgeForce force = body_before(cut, angle, pushes);
  if (force.up > 0) put_on_ground(force, std::tan(cut.soil.friction));
  return force;
}

/// The angle between two at which something changes its sign, where the least force has a kink.
struct Kink {
  static constexpr double kWidth = 2 * kBodyAngleStep;
  double to, rest;  // from the flatter angle to it, and on to the steeper

  /// @param of what it is at an angle from the flatter one, `flat` at 0 and `steep` at the steeper
  template <typename F>
  Kink(double flat, double steep, const F& of)
      : to(kWidth * flat / (flat - steep)), rest(kWidth - to) {
    const double here = of(to);
    const bool is_flat = (here < 0) == (flat < 0);
    to += ((is_flat ? kWidth : 0) - to) * here / (here - (is_flat ? steep : flat));
    rest = kWidth - to;
  }

  /// Of a smooth function, at the kink.
  double slope(double flat, double here, double steep) const {
    return ((steep - here) * to / rest + (here - flat) * rest / to) / kWidth;
  }
};

/// The body whose P is 0, between two angles. If its force is the least, that is because P is no
/// pull; then what counts of P is the multiplier of that.
std::optional<WedgeForce> body_without_push(const SlicedBlade& cut, double low,
                                            const WedgeForce& flat, const WedgeForce& steep) {
  const Kink kink(flat.push, steep.push,
                  [&](double at) { return body_before(cut, low + at).push; });
  const auto other = [&](double at) { return with_body(cut, low + at, 0.0); };
  const WedgeForce there = other(kink.to);
  const Angle way = Angle(low + kink.to) + Angle(cut.soil.friction);
  const bool presses = there.up == 0;
  const double by_push = way.sine + (presses ? std::tan(cut.soil.friction) * way.cosine : 0);
  const double share = -kink.slope(other(0).ahead, there.ahead, other(Kink::kWidth).ahead) /
                       (by_push * kink.slope(flat.push, there.push, steep.push));
  if (!(share >= 0 && share <= 1)) return {};
  return with_body(cut, low + kink.to, share);
}

/// The body of least force whose angle is nearly known, with derivatives. It presses on the ground,
/// is lifted off it, or is about to be lifted: then the angle is where it presses no more. Likewise
/// where P begins.
WedgeForce body_near(const SlicedBlade& cut, double angle, double steepest) {
  const double low = angle - kBodyAngleStep, high = angle + kBodyAngleStep;
  const bool is_flattest = low < kFlattestBody;
  if (is_flattest || high > steepest) {  // the least may be the last that is tried
    const WedgeForce there = with_body(cut, angle);
    const WedgeForce last = with_body(cut, is_flattest ? kFlattestBody : steepest);
    if (last.ahead < there.ahead) return last;
    if (!is_flattest) return there;
  }
  const WedgeForce flat = body_before(cut, low), steep = body_before(cut, high);
  if (flat.ahead == kNoForce || steep.ahead == kNoForce) return with_body(cut, angle);
  const double tangent = std::tan(cut.soil.friction), width = Kink::kWidth;
  if ((flat.push > 0) != (steep.push > 0))
    if (const auto force = body_without_push(cut, low, flat, steep)) return *force;
  if ((flat.up < 0) != (steep.up < 0)) {
    const Kink kink(flat.up, steep.up, [&](double at) { return body_before(cut, low + at).up; });
    WedgeForce force = body_before(cut, low + kink.to);
    const auto slope = [&](double WedgeForce::*of) {
      return kink.slope(flat.*of, force.*of, steep.*of);
    };
    // The multiplier of "it does not press": of force up for force ahead as the angle changes.
    const double share = -slope(&WedgeForce::ahead) / slope(&WedgeForce::up);
    if (share >= 0 && share <= tangent) {
      force.up = 0;
      put_on_ground(force, share);
      return force;
    }
    return with_body(cut, angle);
  }
  const WedgeForce middle = with_body(cut, angle);
  const bool presses = flat.up > 0;
  const auto ahead = [&](const WedgeForce& of) {
    return of.ahead + (presses ? tangent * of.up : 0);
  };
  const double slope = (ahead(steep) - ahead(flat)) / width;
  const double bend = (ahead(steep) - 2 * middle.ahead + ahead(flat)) / (width * width / 4);
  if (!(bend > 0)) return middle;
  WedgeForce force =
      with_body(cut, angle - std::clamp(slope / bend, -kBodyAngleStep, kBodyAngleStep));
  if (presses) return force;
  // The angle changes with the soil; that leaves the least force ahead alone.
  for (std::size_t i = 0; i < force.d_up.size(); ++i)
    force.d_up[i] -=
        (steep.up - flat.up) / width * (steep.d_ahead[i] - flat.d_ahead[i]) / width / bend;
  return force;
}

/// The body of least force, by Brent's method (Algorithms for Minimization without Derivatives,
/// 1973). Gives up once that is certainly far more than `direct`.
WedgeForce least_body(const SlicedBlade& cut, double direct, BodyGuess& guess) {
  constexpr double kGolden = 0.3819660112501051;
  const double steepest = std::min(cut.slice.rake, std::numbers::pi / 2);
  const bool guessed = guess.angle > kFlattestBody && guess.angle < steepest;
  double low = kFlattestBody, high = steepest;
  if (guessed) {
    low = std::max(low, guess.angle - kBodyGuessError);
    high = std::min(high, guess.angle + kBodyGuessError);
  }
  // The best angle, the next best, and the one before.
  double x = guessed ? guess.angle : low + kGolden * (high - low), w = x, v = x;
  double step = 0, before = 0;
  WedgeForce best = with_body(cut, x);
  double of_w = best.ahead, of_v = best.ahead;
  for (int n = 0; n < kMaxWedgeSteps; ++n) {
    const double middle = (low + high) / 2;
    if (std::abs(x - middle) + (high - low) / 2 <= 2 * kBodyAngleTolerance) break;
    if (n == kBodyTrials && best.ahead > kHopelessBody * direct) {
      guess.hopeless = true;
      return best;
    }
    const double r = (x - w) * (of_v - best.ahead), q = (x - v) * (of_w - best.ahead);
    const double p = (x - v) * q - (x - w) * r, d = 2 * (q - r);
    const double parabola = d != 0 ? -p / d : 0;
    if (d != 0 && std::abs(parabola) < std::abs(before) / 2 && x + parabola > low &&
        x + parabola < high) {
      before = std::exchange(step, parabola);
    } else {
      before = (x < middle ? high : low) - x;
      step = kGolden * before;
    }
    if (std::abs(step) < kBodyAngleTolerance) step = std::copysign(kBodyAngleTolerance, step);
    const double u = x + step;
    const WedgeForce force = with_body(cut, u);
    if (force.ahead <= best.ahead) {
      (u < x ? high : low) = x;
      v = std::exchange(w, std::exchange(x, u));
      of_v = std::exchange(of_w, best.ahead);
      best = force;
    } else {
      (u < x ? low : high) = u;
      if (force.ahead <= of_w || w == x) {
        v = std::exchange(w, u);
        of_v = std::exchange(of_w, force.ahead);
      } else if (force.ahead <= of_v || v == x || v == w) {
        v = u;
        of_v = force.ahead;
      }
    }
  }
  const bool outside = guessed && std::abs(x - guess.angle) > 0.9 * kBodyGuessError;
  guess.angle = x;
  if (!outside) return best.ahead < direct ? body_near(cut, x, steepest) : best;
  guess.angle = 0;
  return least_body(cut, direct, guess);
}

}  // namespace

WedgeForce wedge_force(const SoilSlice& slice, const WedgeSoil& soil, BodyGuess& guess) noexcept {
  WedgeForce force;
  if (!(slice.rake > 0 && slice.rake < std::numbers::pi) || slice.heights.size() < 2) return force;
  const double depth = ground(slice, 0);
  if (!(depth > 0)) return force;
  const Angle rake(slice.rake);
  const double length = length_in_soil(slice, rake);
  const double end_x = -length * rake.cosine, end_z = length * rake.sine;
  const TrialWedge wedge(slice, {0, slice.rake, length, end_x, end_z, rake}, soil);
  const TrialPlane exit = wedge.least();
  if (exit.p < kNoForce) force = wedge.force(exit, exit.p > 0 ? 1 : 0);
  const double all = slice.rake + soil.friction + soil.tool_friction;
  if (all > kLeastAngleWithBody && !guess.hopeless) {
    const double direct = exit.p < kNoForce ? force.ahead : kNoForce;
    WedgeForce body = least_body({slice, soil, end_x, end_z}, direct, guess);
    if (body.ahead < direct) {
      body.arm *= length;
      force = body;
    }
  }
  force.depth = depth;
  force.buried = ground(slice, end_x) - end_z > kBuriedShare * depth;
  force.stuck = exit.p == kNoForce && !force.steep;
  if (end_x < 0) {
    // Between the blade and the ground above it.
    double area = 0, moment = 0;
    const double slope = -rake.sine / rake.cosine;
    constexpr int kParts = 8;
    for (int i = 0; i < kParts; ++i) {
      const double x = end_x * (i + 0.5) / kParts;
      const double part = std::max(0.0, ground(slice, x) - x * slope) * -end_x / kParts;
      area += part;
      moment += part * x;
    }
    if (area > 0) force.above_x = moment / area;
    force.above = area;
  }
  return force;
}

}  // namespace soilvdb::inline v0
