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
#include <utility>

#include "core/constants.h"

namespace soilvdb::inline v0 {
namespace {

constexpr double kNoForce = std::numeric_limits<double>::infinity();

struct AlongGround {
  double value, change;  // change per x
};

/// The plane face that pushes a wedge: from a toe up to the end of the blade in the soil.
struct PushingFace {
  double toe_x, rake, length;
  double end_x, end_z;  // from the toe
};

/// A failure plane comes to the ground at (x, z) from the toe.
struct TrialPlane {
  double p = kNoForce;
  double x = 0, z = 0, area = 0, crescent = 0;
  bool last = false;  // at the end of the heights
};

class TrialWedge {
 public:
  TrialWedge(const SoilSlice& slice, const PushingFace& face, const WedgeSoil& soil)
      : slice_(slice),
        face_(face),
        soil_(soil),
        sin_phi_(std::sin(soil.friction)),
        cos_phi_(std::cos(soil.friction)),
        sin_all_(std::sin(face.rake + soil.friction + soil.tool_friction)),
        cos_all_(std::cos(face.rake + soil.friction + soil.tool_friction)),
        sin_rake_phi_(std::sin(face.rake + soil.friction)),
        cos_rake_phi_(std::cos(face.rake + soil.friction)) {
    if (slice.open_sides > 0) {
      weight_share_ = slice.open_sides / (3 * slice.width);
      plane_share_ = slice.open_sides / (2 * slice.width);
    }
  }

  /// The failure plane of least force. Planes that another part of the ground cuts short end there.
  TrialPlane least() const {
    TrialPlane best;
    const double kappa = face_.rake + soil_.friction + soil_.tool_friction;
    if (kappa >= std::numbers::pi - kLeastWedgeAngle) return best;
    const std::span<const double> z = slice_.heights;
    const double begin = face_.toe_x + face_.end_x;
    const auto first =
        static_cast<std::size_t>(std::clamp(std::floor((begin - slice_.first_x) / slice_.step) + 1,
                                            0.0, static_cast<double>(z.size())));
    double x0 = face_.end_x, z0 = ground(begin);
    double area = face_.end_x * face_.end_z / 2;  // of the wedge plus that of (toe, exit, x axis)
    double steepest = std::numeric_limits<double>::infinity();
    for (std::size_t i = first; i < z.size(); ++i) {
      const double x1 = slice_.first_x + static_cast<double>(i) * slice_.step - face_.toe_x;
      const double z1 = z[i];
      if (x1 > 0 && z1 < steepest * x1) {
        try_piece({x0, z0, x1, z1, area, i + 1 == z.size()}, steepest, best);
        steepest = std::min(steepest, z1 / x1);
      }
      area += (z0 + z1) / 2 * (x1 - x0);
      x0 = x1;
      z0 = z1;
      if (x1 > 0 && (z1 <= 0 || least_beyond(x1, area - x1 * z1 / 2) > best.p)) break;
    }
    return best;
  }

  WedgeForce force(const TrialPlane& at) const {
    const double length = std::hypot(at.x, at.z), beta = std::atan2(at.z, at.x);
    const double fg = 1 + weight_share_ * at.crescent, fc = 1 + plane_share_ * at.crescent;
    const double rake = face_.rake, phi = soil_.friction, delta = soil_.tool_friction;
    const double sine = std::sin(rake + beta + delta + phi),
                 cotangent = std::cos(rake + beta + delta + phi) / sine;
    const double by_weight = fg * at.area * std::sin(beta + phi) / sine;
    const double by_cohesion = fc * length * std::cos(phi) / sine;
    const double by_adhesion = -face_.length * std::cos(rake + beta + phi) / sine;
    const double load =
        soil_.unit_weight * fg * at.area + slice_.surcharge * fc * (at.x - face_.end_x);
    const double p = at.p;
    const double by_friction =
        (load * std::cos(beta + phi) - soil_.cohesion * fc * length * std::sin(phi) +
         soil_.adhesion * face_.length * std::sin(rake + beta + phi)) /
            sine -
        p * cotangent;
    const double by_tool_friction = -p * cotangent;
    const std::array<double, kWedgeParameters> by = {by_weight, by_cohesion, by_friction,
                                                     by_tool_friction, by_adhesion};
    WedgeForce force;
    const double along = std::sin(rake + delta), upward = std::cos(rake + delta);
    const double stuck = soil_.adhesion * face_.length;
    force.ahead = p * along + stuck * std::cos(rake);
    force.up = p * upward - stuck * std::sin(rake);
    for (std::size_t i = 0; i < by.size(); ++i) {
      force.d_ahead[i] = by[i] * along;
      force.d_up[i] = by[i] * upward;
    }
    force.d_ahead[3] += p * upward;
    force.d_up[3] -= p * along;
    force.d_ahead[4] += face_.length * std::cos(rake);
    force.d_up[4] -= face_.length * std::sin(rake);
    force.failure = beta;
    const double weight = soil_.unit_weight * by_weight;
    force.arm = p > 0 ? (weight / 3 + (p - weight) / 2) / p * face_.length : 0;
    force.open = at.last;
    return force;
  }

  /// Height of the ground at x from the lip.
  double ground(double x) const {
    const std::span<const double> z = slice_.heights;
    const double at =
        std::clamp((x - slice_.first_x) / slice_.step, 0.0, static_cast<double>(z.size() - 1));
    const auto i = std::min(static_cast<std::size_t>(at), z.size() - 2);
    const double share = at - static_cast<double>(i);
    return (1 - share) * z[i] + share * z[i + 1];
  }

 private:
  /// A straight piece of ground.
  struct Piece {
    double x0, z0, x1, z1;
    double area;  // as in least(), up to x0
    bool last;

    double rise() const { return (z1 - z0) / (x1 - x0); }
    double z(double x) const { return z0 + rise() * (x - x0); }
    double wedge(double x) const { return area + (z0 + z(x)) / 2 * (x - x0) - x * z(x) / 2; }
  };

  double crescent(double x) const {
    if (slice_.open_sides == 0) return 0;
    const double r = x - face_.end_x;
    return std::sqrt(std::max(0.0, r * r - face_.end_x * face_.end_x));
  }

  /// The equation's right side times the plane's length, along the ground.
  AlongGround load(const Piece& piece, double x) const {
    const double m = piece.rise(), z = piece.z(x), area = piece.wedge(x);
    const double d_area = (z - x * m) / 2, r = x - face_.end_x, s = crescent(x);
    const double d_s = s > 0 ? r / s : 0;
    const double fg = 1 + weight_share_ * s, fc = 1 + plane_share_ * s;
    const double d_fg = weight_share_ * d_s, d_fc = plane_share_ * d_s;
    const double sine = z * cos_phi_ + x * sin_phi_, d_sine = m * cos_phi_ + sin_phi_;
    const double weight = soil_.unit_weight * fg * area + slice_.surcharge * fc * r;
    const double d_weight =
        soil_.unit_weight * (fg * d_area + d_fg * area) + slice_.surcharge * (fc + d_fc * r);
    const double square = x * x + z * z, d_square = 2 * (x + z * m);
    const double c = soil_.cohesion * cos_phi_, stuck = soil_.adhesion * face_.length;
    return {weight * sine + c * fc * square - stuck * (cos_rake_phi_ * x - sin_rake_phi_ * z),
            d_weight * sine + weight * d_sine + c * (fc * d_square + d_fc * square) -
                stuck * (cos_rake_phi_ - sin_rake_phi_ * m)};
  }
  /// The factor of P on its left side, times the plane's length.
  AlongGround lever(const Piece& piece, double x) const {
    return {x * sin_all_ + piece.z(x) * cos_all_, sin_all_ + piece.rise() * cos_all_};
  }
  /// Has the sign of the change of P along the ground.
  double trend(const Piece& piece, double x) const {
    const AlongGround n = load(piece, x), d = lever(piece, x);
    return n.change * d.value - n.value * d.change;
  }

  void try_exit(const Piece& piece, double x, TrialPlane& best) const {
    const double d = lever(piece, x).value;
    if (d <= 0) return;
    const double p = std::max(0.0, load(piece, x).value / d);
    if (p < best.p)
      best = {p, x, piece.z(x), piece.wedge(x), crescent(x), piece.last && x == piece.x1};
  }

  void try_piece(const Piece& piece, double steepest, TrialPlane& best) const {
    double low = std::max(piece.x0, 0.0), high = piece.x1;
    const double m = piece.rise();
    // Where the piece comes into sight from the toe.
    if (steepest < std::numeric_limits<double>::infinity() && piece.z(low) > steepest * low)
      low = std::clamp((piece.z0 - m * piece.x0) / (steepest - m), low, high);
    if (piece.z1 < 0) high = std::clamp(piece.x0 - piece.z0 / m, low, high);
    // Steeper planes than this can't slide.
    const AlongGround d = lever(piece, low);
    if (d.value <= 0) {
      if (lever(piece, high).value <= 0) return;
      low += -d.value / d.change * (1 + kWedgeTolerance);
    }
    if (!(low < high)) return;
    double down = trend(piece, low), up = trend(piece, high);
    if (!(down < 0 && up > 0)) {
      try_exit(piece, low, best);
      try_exit(piece, high, best);
      return;
    }
    // The root by false position; the end that stays counts half (Illinois).
    double x = low;
    for (int n = 0, side = 0; n < kMaxWedgeSteps; ++n) {
      x = (low * up - high * down) / (up - down);
      const double at = trend(piece, x);
      if (at == 0 || high - low < kWedgeTolerance * high) break;
      if (at < 0) {
        low = x;
        down = at;
        if (side < 0) up /= 2;
        side = -1;
      } else {
        high = x;
        up = at;
        if (side > 0) down /= 2;
        side = 1;
      }
    }
    try_exit(piece, x, best);
  }

  /// No plane that comes to the ground beyond x needs less. `area` is of the wedge up to there. The
  /// quotients of sines grow with beta, so they are least at 0.
  double least_beyond(double x, double area) const {
    return (soil_.unit_weight * area * sin_phi_ - soil_.adhesion * face_.length * cos_rake_phi_) /
               sin_all_ +
           soil_.cohesion * x * cos_phi_;
  }

  const SoilSlice& slice_;
  PushingFace face_;
  WedgeSoil soil_;
  double sin_phi_, cos_phi_;
  double sin_all_, cos_all_;            // of rake + friction + tool friction
  double sin_rake_phi_, cos_rake_phi_;  // of rake + friction
  double weight_share_ = 0, plane_share_ = 0;
};

/// Length of the blade up to where it comes out of the ground.
double length_in_soil(const SoilSlice& slice, const TrialWedge& wedge) {
  const double sine = std::sin(slice.rake), cosine = std::cos(slice.rake);
  double from = 0, cover = wedge.ground(0);
  const double step = slice.step / std::max(std::abs(cosine), kNearlyUpright);
  const double offset = std::fmod(-slice.first_x, slice.step);
  // Bends of the ground are where x is a whole number of steps from the first height.
  double to = (cosine > 0 ? offset : slice.step - offset) / slice.step * step;
  while (from < slice.face) {
    const double end = std::min(to, slice.face);
    const double over = wedge.ground(-end * cosine) - end * sine;
    if (over <= 0) return from + (end - from) * cover / (cover - over);
    from = end;
    cover = over;
    to += step;
  }
  return slice.face;
}

/// A body of soil rides before the blade; its face has this angle.
WedgeForce with_body(const SoilSlice& slice, const WedgeSoil& soil, double end_x, double end_z,
                     double angle) {
  const double toe = end_x + end_z / std::tan(angle);
  const PushingFace face{toe, angle, end_z / std::sin(angle), end_x - toe, end_z};
  WedgeSoil inside = soil;
  inside.tool_friction = soil.friction;
  inside.adhesion = soil.cohesion;
  const TrialWedge wedge(slice, face, inside);
  const TrialPlane exit = wedge.least();
  WedgeForce force;
  if (exit.p == kNoForce) {
    force.ahead = kNoForce;
    return force;
  }
  force = wedge.force(exit);
  force.arm /= face.length;  // a share of the face; of the blade, too
  // Friction in the soil is that of the face as well, and cohesion its adhesion.
  for (auto* by : {&force.d_ahead, &force.d_up}) {
    (*by)[1] += std::exchange((*by)[4], 0);
    (*by)[2] += std::exchange((*by)[3], 0);
  }
  const double area = end_z * toe / 2, tangent = std::tan(soil.friction);
  force.up += soil.unit_weight * area;
  force.d_up[0] += area;
  force.ahead += soil.cohesion * toe;
  force.d_ahead[1] += toe;
  if (force.up > 0) {  // it presses on the ground
    force.ahead += force.up * tangent;
    for (std::size_t i = 0; i < force.d_up.size(); ++i) force.d_ahead[i] += tangent * force.d_up[i];
    force.d_ahead[2] += force.up * (1 + tangent * tangent);
    force.up = 0;
    force.d_up.fill(0);
  }
  force.steep = true;
  return force;
}

/// The body of least force, by Brent's method (Algorithms for Minimization without Derivatives,
/// 1973). Gives up once that is certainly far more than `direct`.
WedgeForce least_body(const SoilSlice& slice, const WedgeSoil& soil, double end_x, double end_z,
                      double direct, BodyGuess& guess) {
  constexpr double kGolden = 0.3819660112501051;
  const double steepest = std::min(slice.rake, std::numbers::pi / 2);
  const bool guessed = guess.angle > kFlattestBody && guess.angle < steepest;
  double low = kFlattestBody, high = steepest;
  if (guessed) {
    low = std::max(low, guess.angle - kBodyGuessError);
    high = std::min(high, guess.angle + kBodyGuessError);
  }
  // The best angle, the next best, and the one before.
  double x = guessed ? guess.angle : low + kGolden * (high - low), w = x, v = x;
  double step = 0, before = 0;
  WedgeForce best = with_body(slice, soil, end_x, end_z, x);
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
    const WedgeForce force = with_body(slice, soil, end_x, end_z, u);
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
  if (!outside) return best;
  guess.angle = 0;
  return least_body(slice, soil, end_x, end_z, direct, guess);
}

}  // namespace

WedgeForce wedge_force(const SoilSlice& slice, const WedgeSoil& soil, BodyGuess& guess) noexcept {
  WedgeForce force;
  if (!(slice.rake > 0 && slice.rake < std::numbers::pi) || slice.heights.size() < 2) return force;
  const PushingFace whole{0, slice.rake, slice.face, 0, 0};
  const TrialWedge probe(slice, whole, soil);
  const double depth = probe.ground(0);
  if (!(depth > 0)) return force;
  const double length = length_in_soil(slice, probe);
  const double end_x = -length * std::cos(slice.rake), end_z = length * std::sin(slice.rake);
  const TrialWedge wedge(slice, {0, slice.rake, length, end_x, end_z}, soil);
  const TrialPlane exit = wedge.least();
  if (exit.p < kNoForce) force = wedge.force(exit);
  const double all = slice.rake + soil.friction + soil.tool_friction;
  if (all > kLeastAngleWithBody && !guess.hopeless) {
    const double direct = exit.p < kNoForce ? force.ahead : kNoForce;
    WedgeForce body = least_body(slice, soil, end_x, end_z, direct, guess);
    if (body.ahead < direct) {
      body.arm *= length;
      force = body;
    }
  }
  force.depth = depth;
  force.stuck = exit.p == kNoForce && !force.steep;
  if (end_x < 0) {
    // Between the blade and the ground above it.
    double area = 0, moment = 0;
    constexpr int kParts = 8;
    for (int i = 0; i < kParts; ++i) {
      const double x = end_x * (i + 0.5) / kParts;
      const double part =
          std::max(0.0, wedge.ground(x) + x * std::tan(slice.rake)) * -end_x / kParts;
      area += part;
      moment += part * x;
    }
    if (area > 0) force.above_x = moment / area;
    force.above = area;
  }
  return force;
}

}  // namespace soilvdb::inline v0
