// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tests/support/families.h"

#include <cmath>
#include <numbers>
#include <random>
#include <utility>

namespace soilvdb::test {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kDegree = kPi / 180;
/// Rows of motions that rows only approximate. Chords cut about (angle per row)^2 / 12 of a bend's
/// volume short: below 1e-6.
constexpr int kRows = 2000;

Motion rows_of(const Family& f, const std::vector<double>& times, const Pose& world_from_family) {
  std::vector<Pose> poses;
  for (const double t : times) poses.push_back(world_from_family * f.pose(t));
  return {times, poses};
}

/// Gives a family a motion of many rows.
Family with_rows(Family f) {
  f.motion = [f](const Pose& world_from_family) {
    std::vector<double> times;
    for (int i = 0; i <= kRows; ++i) times.push_back(static_cast<double>(i) / kRows);
    return rows_of(f, times, world_from_family);
  };
  return f;
}

/// Where an arm's joint is.
struct Knot {
  Vec3 position;
  double angle = 0;
};

/// A joint that is carried about and turns, linearly between knots evenly spaced in time.
struct Arm {
  Vec3 axis = Vec3::UnitY();
  Pose joint_from_bucket;
  std::vector<Knot> knots;

  Pose pose(double t) const {
    const double last = static_cast<double>(knots.size() - 1);
    const std::size_t i = std::min(static_cast<std::size_t>(t * last), knots.size() - 2);
    const double s = t * last - static_cast<double>(i);
    const Knot &a = knots[i], &b = knots[i + 1];
    const Eigen::Quaterniond turn(Eigen::AngleAxisd(a.angle + s * (b.angle - a.angle), axis));
    return Pose{a.position + s * (b.position - a.position), turn} * joint_from_bucket;
  }
  std::vector<double> times() const {
    std::vector<double> all;
    for (std::size_t i = 0; i < knots.size(); ++i) {
      all.push_back(static_cast<double>(i) / static_cast<double>(knots.size() - 1));
    }
    return all;
  }
  Motion by_joints(const Pose& world_from_family) const {
    Chain chain;
    chain.world_from_root = world_from_family;
    chain.link_from_bucket = joint_from_bucket;
    for (int k = 0; k < 3; ++k) {
      chain.joints.push_back(
          {std::string(1, static_cast<char>('x' + k)), Joint::Type::kPrismatic, {}, Vec3::Unit(k)});
    }
    chain.joints.push_back({"turn", Joint::Type::kContinuous, {}, axis});
    std::vector<double> values;
    for (const Knot& k : knots) {
      values.insert(values.end(), {k.position.x(), k.position.y(), k.position.z(), k.angle});
    }
    return {times(), values, chain};
  }
};

/// A family that moves by an arm: by rows of poses where the lip is the joint, else by joints.
Family with_arm(Family f, const Arm& arm, bool by_joints) {
  f.pose = [arm](double t) { return arm.pose(t); };
  f.kinks = arm.times();
  if (by_joints) {
    f.motion = [arm](const Pose& world) { return arm.by_joints(world); };
  } else {
    f.motion = [f, times = arm.times()](const Pose& world) { return rows_of(f, times, world); };
  }
  return f;
}

Family named(std::string name, double width_m, double height_m) {
  Family f;
  f.name = std::move(name);
  f.bucket = {width_m, height_m, {}, {}};
  return f;
}

/// Lines of the oracle lean against the ground and against the mouth's normal: where they run along
/// a face of the swept set, lengths jump from line to line.
constexpr double kLean = 0.3;

Vec3 lines_at(double pitch) { return {std::cos(pitch + kLean), 0, -std::sin(pitch + kLean)}; }

/// Planar, by a lip that goes from point (x, z) to point at one pitch.
Family lip_path(Family f, const std::vector<Vec2>& lip, double pitch) {
  Arm arm;
  for (const Vec2& p : lip) arm.knots.push_back({{p.x(), 0, p.y()}, pitch});
  f.planar = true;
  f.direction = lines_at(pitch);
  return with_arm(std::move(f), arm, false);
}

struct Turn {
  double x, z, angle;
};

/// Planar, about a pin at (x, z) of the bucket frame that goes along; angles curl the bucket up.
Family pin_path(Family f, const Vec2& pin, const std::vector<Turn>& turns) {
  Arm arm;
  arm.axis = -Vec3::UnitY();
  arm.joint_from_bucket.position = {-pin.x(), 0, -pin.y()};
  for (const Turn& t : turns) arm.knots.push_back({{t.x, 0, t.z}, t.angle});
  f.planar = true;
  f.direction = lines_at(-(turns.front().angle + turns.back().angle) / 2);
  return with_arm(std::move(f), arm, true);
}

/// A half ellipse below z = 0: half length a, depth b; `there` is how far along at a time.
Family half_ellipse(Family f, double a, double b, const std::function<double(double)>& there) {
  f.pose = [=](double t) {
    const double angle = kPi * there(t);
    return Pose{{-a * std::cos(angle), 0, -b * std::sin(angle)}, Eigen::Quaterniond::Identity()};
  };
  f.planar = true;
  f.direction = lines_at(0);
  f.closed_form_m3 = f.bucket.width_m * kPi * a * b / 2;
  return with_rows(std::move(f));
}

Family drag() {
  Family f = named("drag", 0.6, 0.4);
  f.closed_form_m3 = 0.6 * 0.15 * (1.2 + 0.15 * 0.3 / 0.2);  // trapezoid
  return lip_path(f, {{-0.6, 0.05}, {-0.3, -0.15}, {0.9, -0.15}, {1.2, 0.05}}, 0);
}

Family curl_inside_pin() {
  Family f = named("curl_inside_pin", 0.6, 0.6);
  const double angle = 120 * kDegree, below = 0.25, above = 0.35;  // of the pin
  f.closed_form_m3 = 0.6 * angle / 2 * (below * below + above * above);
  return pin_path(f, {0, below}, {{0, -1, -angle / 2}, {0, -1, angle / 2}});
}

Family swing() {
  Family f = named("swing", 0.8, 0.5);
  const double radius = 3, depth = 0.2, angle = 40 * kDegree;
  f.closed_form_m3 = angle * radius * 0.8 * depth;
  Arm arm;
  arm.axis = Vec3::UnitZ();
  arm.joint_from_bucket = {{radius, 0, -depth}, from_rpy(0, 0, kPi / 2)};
  arm.knots = {{Vec3::Zero(), -angle / 2}, {Vec3::Zero(), angle / 2}};
  f.direction = {0.3, 1, 0.2};
  return with_arm(f, arm, true);
}

Family buried() {
  Family f = named("buried", 0.6, 0.35);
  const double pitch = 0.35;
  f.closed_form_m3 = 0.6 * 0.35 * (std::cos(pitch) + 0.2 * std::sin(pitch));  // normal . travel
  return lip_path(f, {{0, -0.9}, {1, -1.1}}, pitch);
}

Family repeated() {
  std::vector<Vec2> lip{{-0.3, 0.1}};
  for (int pass = 0; pass < 3; ++pass) {
    lip.insert(lip.end(),
               {{0, -0.2}, {1, -0.2}, {1.25, 0.1}, {1.25, 0.7}, {-0.3, 0.7}, {-0.3, 0.1}});
  }
  return lip_path(named("repeated", 0.7, 0.45), lip, 0.2);
}

Family overlapping() {
  Family f = named("overlapping", 0.7, 0.5);
  const double aside = 0.4 * 0.7, shallow = 0.12, deep = 0.22;
  Arm arm;
  for (const auto& [y, depth] : {std::pair{0.0, shallow}, std::pair{aside, deep}}) {
    for (const Vec2& p : {Vec2(-0.3, 0.1), Vec2(0, -depth), Vec2(1, -depth), Vec2(1.3, 0.1)}) {
      arm.knots.push_back({{p.x(), y, p.y()}, 0});
    }
    arm.knots.push_back({{1.3, y, 0.8}, 0});
    arm.knots.push_back({{-0.3, aside, 0.8}, 0});
  }
  const auto trapezoid = [](double depth) { return depth * (1 + depth * 0.3 / (depth + 0.1)); };
  f.closed_form_m3 = aside * trapezoid(shallow) + 0.7 * trapezoid(deep);  // deep holds shallow
  f.direction = {1, 0.3, 0.2};
  return with_arm(f, arm, false);
}

/// In under a bank of 60 degrees and out the same way: an overhang stays.
Family undercut() {
  Family f = named("undercut", 0.6, 0.3);
  f.slope = {std::tan(60 * kDegree), 0};
  return lip_path(f, {{-0.3, 0.1}, {0.7, 0}, {-0.3, 0.1}}, 0.1);
}

Family slope_drag() {
  Family f = named("slope_drag", 0.6, 0.6);
  f.slope = std::tan(30 * kDegree) * Vec2(std::cos(35 * kDegree), std::sin(35 * kDegree));
  const double rise = f.slope.x();
  return lip_path(
      f, {{-0.3, -0.3 * rise + 0.2}, {0, -0.25}, {1, rise - 0.25}, {1.3, 1.3 * rise + 0.2}},
      -std::atan(rise));
}

Family steep() {
  Family f = named("steep", 0.6, 0.5);
  const double rise = std::tan(60 * kDegree);
  f.slope = {rise, 0};
  return lip_path(
      f, {{-0.2, -0.2 * rise + 0.2}, {0, -0.4}, {0.6, 0.6 * rise - 0.4}, {0.8, 0.8 * rise + 0.2}},
      -60 * kDegree);
}

Family raster() {
  Family f = named("raster", 0.7, 0.6);
  Posts posts{16, 0.4, {}};
  std::mt19937 random(7);
  for (int i = 0; i < posts.side * posts.side; ++i) {
    // Binary fractions, so that a shift in z doesn't round them.
    posts.heights_m.push_back(static_cast<float>(static_cast<int>(random() % 256) - 128) / 1024);
  }
  f.posts = posts;
  return lip_path(f, {{-0.9, 0.25}, {-0.5, -0.2}, {0.6, -0.25}, {1, 0.25}}, 0.25);
}

/// A bend that rolls, pitches and heaves.
Family helix() {
  Family f = named("helix", 0.7, 0.45);
  f.pose = [](double t) {
    const double yaw = 0.8 * (t - 0.5), radius = 1.5;
    return Pose{
        {radius * std::sin(yaw), radius * (1 - std::cos(yaw)), -0.2 + 0.08 * std::sin(3 * t)},
        from_rpy(0.35 * std::sin(2.5 * t), 0.15 * std::cos(2 * t), yaw)};
  };
  f.direction = {1, 0.6, -0.4};
  return with_rows(f);
}

}  // namespace

const std::vector<Family>& all_families() {
  static const std::vector<Family> all{
      half_ellipse(named("half_sine", 0.2, 0.5), 0.5, 0.25, [](double t) { return t; }), drag(),
      pin_path(named("drag_curl", 1.0, 0.5), {0, 0.9},
               {{0, 0.65, -45 * kDegree}, {0.9, 0.65, 0}, {1, 0.65, 70 * kDegree}}),
      // The pin goes on while the mouth turns the other way: the lip falls behind.
      pin_path(named("drag_curl_retreat", 1.0, 0.5), {0, 0.3},
               {{0, -0.2, 0}, {0.8, -0.2, 0}, {0.95, -0.2, -70 * kDegree}}),
      pin_path(named("curl_outside_pin", 0.8, 0.5), {-0.15, 0.8},
               {{0, 0.55, -60 * kDegree}, {0, 0.55, 60 * kDegree}}),
      curl_inside_pin(), swing(),
      half_ellipse(named("reversal", 0.5, 0.4), 0.4, 0.2,
                   [](double t) { return t < 0.5 ? 2 * t : 2 - 2 * t; }),
      buried(), repeated(), overlapping(), undercut(), slope_drag(), steep(), raster(), helix()};
  return all;
}

Family random_family(std::uint64_t seed) {
  std::mt19937_64 random(seed);
  const auto between = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53;
  };
  Family f = named("random_" + std::to_string(seed), between(0.5, 1.1), between(0.35, 0.6));
  const double fall = std::tan(between(0, 12 * kDegree)), toward = between(0, 2 * kPi);
  f.slope = fall * Vec2(std::cos(toward), std::sin(toward));
  // A backhoe: the lip comes closer while it dips, curls and swings; the mouth faces the machine.
  const double far = between(4, 6), drag = between(0.8, 1.6), swing = between(-0.15, 0.15);
  const double depth = between(0.12, 0.3), pitch = between(0, 20 * kDegree);
  const double curl = between(20 * kDegree, 50 * kDegree), roll = between(-0.1, 0.1);
  f.pose = [=, slope = f.slope](double t) {
    const double yaw = swing * (t - 0.5), r = far - drag * t;
    const Vec2 at(r * std::cos(yaw) - far, r * std::sin(yaw));
    const double z = slope.dot(at) + 0.08 - (0.08 + depth) * std::sin(kPi * t);
    return Pose{{at.x(), at.y(), z}, from_rpy(roll, pitch - curl * t, yaw + kPi)};
  };
  // The mouth's pitch stays within 20 to -50 degrees, the ground's below 12.
  f.direction = {-std::cos(27 * kDegree), 0.45, -std::sin(27 * kDegree)};
  return with_rows(f);
}

}  // namespace soilvdb::test
