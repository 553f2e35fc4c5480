// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/resistance.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>
#include <stdexcept>

#include "core/constants.h"
#include "core/force/wedge.h"

namespace soilvdb::inline v0 {
namespace {

/// Factors of the pressure on a blunt edge: of a strip footing (Prandtl, Reissner, Vesic).
struct BearingFactors {
  double q, c, g;        // of depth, cohesion and thickness
  double d_q, d_c, d_g;  // by friction

  explicit BearingFactors(double friction) {
    const double phi = std::max(friction, kLeastFriction), t = std::tan(phi), sine = std::sin(phi);
    const double root = std::tan(std::numbers::pi / 4 + phi / 2);
    q = std::exp(std::numbers::pi * t) * root * root;
    c = (q - 1) / t;
    g = 2 * (q + 1) * t;
    d_q = q * (std::numbers::pi * (1 + t * t) + 2 / std::cos(phi));
    d_c = d_q / t - (q - 1) / (sine * sine);
    d_g = 2 * d_q * t + 2 * (q + 1) * (1 + t * t);
  }
};

/// Pressure on an edge, Pa, and its derivatives in the order of WedgeSoil.
struct BearingPressure {
  double value;
  std::array<double, kWedgeParameters> by;

  BearingPressure(const BearingFactors& n, const WedgeSoil& soil, double depth, double thickness) {
    const double of_weight = depth * n.q + thickness * n.g / 2;
    value = soil.cohesion * n.c + soil.unit_weight * of_weight;
    by = {of_weight, n.c,
          soil.cohesion * n.d_c + soil.unit_weight * (depth * n.d_q + thickness * n.d_g / 2), 0, 0};
  }
};

}  // namespace

SoilStrength SoilStrength::of(const SoilProperties& soil) {
  if (!soil.friction_rad && soil.repose_rad == 0)
    throw std::invalid_argument("a force needs the soil's angle of friction or of repose");
  SoilProperties given = soil;
  if (given.repose_rad == 0) given.repose_rad = 0.5;  // of no concern here
  Earthmoving{given, {}, {}}.validate();
  const double friction = soil.friction_rad.value_or(soil.repose_rad);
  return {soil.density_kg_m3, soil.cohesion_pa.value_or(0), friction,
          soil.tool_friction_rad.value_or(2 * friction / 3), soil.adhesion_pa};
}

Wrench turned(const Wrench& wrench, const Eigen::Quaterniond& rotation) {
  return {rotation * wrench.force, rotation * wrench.moment};
}

std::string Resistance::limited() const {
  std::string why;
  const auto add = [&](bool holds, const char* word) {
    if (holds) why += (why.empty() ? "" : ", ") + std::string(word);
  };
  add(steep, "steep blade");
  add(pressed, "heel");
  add(open, "ground ends ahead");
  add(stuck, "no failure plane");
  add(lifts, "lifts");
  add(buried, "blade below ground");
  add(rolled, "rolled over");
  return why;
}

Resistance CutGeometry::resistance(const SoilStrength& given, bool crescents) const noexcept {
  const WedgeSoil soil{given.density_kg_m3 * kGravity, given.cohesion_pa, given.friction_rad,
                       given.tool_friction_rad, given.adhesion_pa};
  const BearingFactors factors(soil.friction);
  const Vec3 up = Vec3::UnitZ();
  const Vec3 back = -std::cos(rake_rad_) * ahead_ + std::sin(rake_rad_) * up;
  Resistance all;
  Eigen::Matrix<double, 3, 5> by = Eigen::Matrix<double, 3, 5>::Zero();
  const auto add = [](Wrench& to, const Vec3& force, const Vec3& at) {
    to.force += force;
    to.moment += at.cross(force);
  };
  // On an area against a direction.
  const auto add_pressure = [&](Wrench& to, const BearingPressure& p, double area, const Vec3& at,
                                const Vec3& against) {
    add(to, -p.value * area * against, at);
    for (std::size_t i = 0; i < p.by.size(); ++i)
      by.col(static_cast<Eigen::Index>(i)) -= p.by[i] * area * against;
  };
  double above_m3 = 0, by_force = 0;  // of the wedges, above the blade
  Vec3 above_m4 = Vec3::Zero();       // its first moment
  all.rolled = rolled_;
  // The middle of the blade says whether soil may ride before it.
  BodyGuess body;
  // An edge that slides along itself doesn't press.
  const Vec3 lip = pose_.rotation * Vec3::UnitY();
  const Vec3 across_lip = (way_ - way_.dot(lip) * lip).stableNormalized();
  // Soil beside the blade pushes at its corners.
  const double sides = open_left_ + open_right_;
  const Vec3 beside = sides > 0 ? Vec3((open_left_ - open_right_) / sides * width_m_ / 2 *
                                       (pose_.rotation * Vec3::UnitY()))
                                : Vec3(Vec3::Zero());
  const auto slice_of = [&](const Strip& strip) {
    SoilSlice slice{strip.first_x, step_m_, std::span(heights_).subspan(strip.first, strip.count),
                    rake_rad_, face_m_};
    slice.open_sides = crescents ? open_left_ + open_right_ : 0;
    slice.width = width_m_;
    return slice;
  };
  if (cuts_ && rake_rad_ + soil.friction + soil.tool_friction > kLeastAngleWithBody)
    wedge_force(slice_of(strips_[strips_.size() / 2]), soil, body);
  for (const Strip& strip : strips_) {
    const std::span<const double> heights = std::span(heights_).subspan(strip.first, strip.count);
    const double share = 1.0 / static_cast<double>(strips_.size());
    if (heights.size() < 2) {
      all.open = all.open || cuts_;
      continue;
    }
    double depth = 0;
    if (cuts_) {
      const WedgeForce wedge = wedge_force(slice_of(strip), soil, body);
      depth = wedge.depth;
      const Vec3 force = -strip_m_ * (wedge.ahead * ahead_ + wedge.up * up);
      const Vec3 of_sides = -strip_m_ * (wedge.side_ahead * ahead_ + wedge.side_up * up);
      add(all.cut, force - of_sides, strip.lip + wedge.arm * back);
      add(all.cut, of_sides, beside + wedge.arm * back);
      for (std::size_t i = 0; i < wedge.d_ahead.size(); ++i)
        by.col(static_cast<Eigen::Index>(i)) -=
            strip_m_ * (wedge.d_ahead[i] * ahead_ + wedge.d_up[i] * up);
      if (!wedge.steep && wedge.above > 0) {
        above_m3 += wedge.above * strip_m_;
        above_m4 += wedge.above * strip_m_ * (strip.lip + wedge.above_x * ahead_);
      }
      all.angle_rad += wedge.failure * force.norm();
      by_force += force.norm();
      all.steep = all.steep || wedge.steep;
      all.open = all.open || wedge.open;
      all.stuck = all.stuck || wedge.stuck;
      all.buried = all.buried || wedge.buried;
    } else {
      const double at =
          std::clamp(-strip.first_x / step_m_, 0.0, static_cast<double>(heights.size() - 1));
      depth = std::max(0.0, heights[static_cast<std::size_t>(at)]);
    }
    all.depth_m += share * depth;
    if (edge_m_ > 0 && depth > 0) {
      // As much of the edge as is below the ground.
      const double upright = std::max(std::abs(std::cos(rake_rad_)), kNearlyUpright);
      const double edge = std::min(edge_m_, depth / upright);
      add_pressure(all.edge, {factors, soil, depth, edge}, lip_share_ * edge * strip_m_, strip.lip,
                   across_lip);
    }
  }
  if (by_force > 0) {
    all.angle_rad /= by_force;
    all.lifts = std::atan2(way_.z(), way_.dot(ahead_)) > all.angle_rad;
  }
  if (plates_m2_ > 0)
    add_pressure(all.edge, {factors, soil, all.depth_m / 2, plate_m_}, plates_share_ * plates_m2_,
                 plates_at_, pose_.rotation * Vec3::UnitX());
  for (const Heel& heel : heels_) {
    const BearingPressure pressure(factors, soil, heel.depth, std::min(heel.length, width_m_));
    // Soil slides along the face, but where that goes straight into it.
    const Vec3 slides = way_ - way_.dot(heel.out) * heel.out;
    const Vec3 along = slides / std::max(slides.norm(), kFullPress);
    const double tangent = std::tan(soil.tool_friction);
    add_pressure(all.heel, pressure, heel.area, heel.at, heel.out + tangent * along);
    by.col(3) -= (1 + tangent * tangent) * pressure.value * heel.area * along;
    all.pressed = true;
  }
  // The load without what the wedges count: less there, not evenly.
  const double counted = above_m3 > load_m3_ ? load_m3_ / above_m3 : 1;
  add(all.load, -soil.unit_weight * load_m3_ * up, load_at_);
  if (above_m3 > 0) {
    const double counted_m3 = counted * above_m3;
    add(all.load, soil.unit_weight * counted_m3 * up, above_m4 / above_m3);
    by.col(0) += counted_m3 * up;
  }
  by.col(0) -= load_m3_ * up;
  by.col(0) *= kGravity;  // by density, not by weight

  const Eigen::Quaterniond to_bucket = pose_.rotation.conjugate();
  for (Wrench* part : {&all.cut, &all.edge, &all.load, &all.heel}) *part = turned(*part, to_bucket);
  all.by_strength = to_bucket.toRotationMatrix() * by;
  // In the order of SoilStrength: density, cohesion, friction, tool friction, adhesion.
  return all;
}

}  // namespace soilvdb::inline v0
