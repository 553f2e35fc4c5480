// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Soil is lost where it is above a point of the rim by more than repose allows: in the sum of the
// rim and an upright cone K. Where the mouth looks up and is flatter than repose nothing of the
// body is in it, and what may lie above is a hipped roof. Else the rim may as well be the whole
// mouth, for from any point of it the way down its plane ends at the rim, and
//
//     mouth + K = (lower edge + ray) + K  -  (upper edge + ray) + K  +  upper edge + K
//
// where the ray goes up along the side plates' edges, and what of it is beyond the upper edge is
// taken off again. Seen from an edge's lower end each of the three looks the same at any scale, so
// a plane through the edge cuts its border in a line through that end. A fan of such planes goes
// from the edge to all points of the profile; in each of them soil is a rectangle less a wedge,
// whose area is in closed form. That is integrated along the profile, between the kinks that it
// has, which are roots of quadratics.
#include "soilvdb/capacity.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace soilvdb::inline v0 {
namespace {

constexpr double kNoEntry = std::numeric_limits<double>::infinity();

// Written out, so that no vector unit adds in another order.
double dot(const Vec2& a, const Vec2& b) { return a.x() * b.x() + a.y() * b.y(); }
double cross_product(const Vec2& a, const Vec2& b) { return a.x() * b.y() - a.y() * b.x(); }
double dot(const Vec3& a, const Vec3& b) { return a.x() * b.x() + a.y() * b.y() + a.z() * b.z(); }

/// An angle of repose.
struct ReposeLine {
  double sine, cosine;
  explicit ReposeLine(double slope) : cosine(1 / std::sqrt(1 + slope * slope)) {
    sine = slope * cosine;
  }
};

struct Node {
  double at, weight;
};
/// Gauss-Legendre on (0, 1), drawn to both ends, where there may be square roots. Six are off
/// by 1e-4 of a bucket at some attitudes, eight by 1e-5.
constexpr std::array<Node, 8> kNodes = [] {
  constexpr std::array<Node, 4> half = {{{0.1834346424956498, 0.3626837833783620},
                                         {0.5255324099163290, 0.3137066458778873},
                                         {0.7966664774136267, 0.2223810344533745},
                                         {0.9602898564975363, 0.1012285362903763}}};
  std::array<Node, 8> nodes{};
  std::size_t size = 0;
  for (const Node& node : half) {
    for (const double v : {(1 - node.at) / 2, (1 + node.at) / 2})
      nodes[size++] = {v * v * (3 - 2 * v), 3 * node.weight * v * (1 - v)};
  }
  return nodes;
}();

/// Where a function of s has kinks in (0, 1).
class Kinks {
 public:
  void add(double s) {
    if (!(s > 0 && s < 1)) return;
    std::size_t i = size_++;
    for (; at_[i - 1] > s; --i) at_[i] = at_[i - 1];
    at_[i] = s;
  }
  /// Where a s^2 + 2 b s + c is zero.
  void add_roots(double a, double b, double c) {
    const double root2 = b * b - a * c;
    if (root2 < 0) return;
    const double far = -(b + std::copysign(std::sqrt(root2), b));
    if (a != 0) add(far / a);
    if (far != 0) add(c / far);
  }
  /// The integral of f over (0, 1).
  template <typename Function>
  double integral(const Function& f) const {
    double sum = 0;
    for (std::size_t i = 0; i < size_; ++i) {
      const double from = at_[i], length = (i + 1 < size_ ? at_[i + 1] : 1) - from;
      double mean = 0;
      for (const Node& node : kNodes) mean += node.weight * f(from + node.at * length);
      sum += length * mean;
    }
    return sum;
  }

 private:
  std::array<double, 9> at_{};  // 0, then in order: two each of three quadratics, two of lines
  std::size_t size_ = 1;
};

/// Along p + tau * y, where y is a unit vector across p that rises by `rise` >= 0: the first
/// tau >= 0 in the upright cone on the origin whose sides rise by `sine` of their length. p is
/// `height` above the origin and at a distance whose square is `length2`.
double entry(double height, double length2, double rise, double sine) {
  const double root2 = height * height - (sine * sine - rise * rise) * length2;
  if (root2 < 0) return kNoEntry;
  const double root = sine * std::sqrt(root2);
  if (height >= 0) {
    const double outside = sine * sine * length2 - height * height;
    return outside <= 0 ? 0 : outside / (height * rise + root);
  }
  return rise > sine ? (root - height * rise) / (rise * rise - sine * sine) : kNoEntry;
}

/// The planes through one of the mouth's edges. Points are those of the profile, seen from the
/// edge: x behind the mouth, y up along the side plates' edges.
class Fan {
 public:
  /// `up` is the world's; with mirrored axes, so that edge and ray go up.
  Fan(double width_m, const Vec3& up, double sine) : width_m_(width_m), up_(up), sine_(sine) {
    if (!has_ray()) return;
    // What the ray sweeps is above two planes; seen along the ray they are a cone of two lines.
    const double across = std::sqrt(sine * sine - up.z() * up.z());
    entry_ = entry(-up.x(), 1, up.y(), across);
    reach_ = up.z() / across * std::sqrt(1 + entry_ * entry_);
  }

  /// A steeper one is in the cone of its end.
  bool has_ray() const { return up_.z() < sine_; }

  /// What edge and ray leave of the body, m^3.
  double held_m3(const std::vector<Vec2>& profile) const {
    return integral(profile, 0, [this](const Vec2& p) { return share(past_both(p)); });
  }
  /// What the edge alone leaves of it besides. @param up_m of the edge, from the profile's
  double lost_to_ray_m3(const std::vector<Vec2>& profile, double up_m) const {
    return integral(profile, up_m,
                    [this](const Vec2& p) { return share(past_edge(p)) - share(past_both(p)); });
  }

 private:
  double height(const Vec2& p) const { return up_.z() * p.y() - up_.x() * p.x(); }

  /// Where soil is lost in p's plane: above the line through (0, 0) and (1, tau), by its distance
  /// from the edge, in units of p's, and from the edge's lower end. From there on it is lost along
  /// all of the edge, which doesn't go down.
  double past_edge(const Vec2& p) const { return entry(height(p), dot(p, p), up_.y(), sine_); }
  double past_both(const Vec2& p) const {
    const bool on_ray = entry_ < kNoEntry && p.y() >= reach_ * p.x();
    return on_ray ? entry_ * p.x() : past_edge(p);
  }
  /// What is below that line: the integral of r * min(width, tau * r) over r in (0, 1).
  double share(double tau) const {
    if (tau <= width_m_) return tau / 3;
    const double f = width_m_ / tau;
    return width_m_ * (0.5 - f * f / 6);
  }

  template <typename Share>
  double integral(const std::vector<Vec2>& profile, double up_m, const Share& share_of) const {
    double sum = 0;
    for (std::size_t i = 0; i + 1 < profile.size(); ++i) {
      const Vec2 a = profile[i] - Vec2(0, up_m), step = profile[i + 1] - profile[i];
      const double twice_m2 = cross_product(a, step);
      if (twice_m2 == 0) continue;
      sum += twice_m2 * kinks(a, step).integral([&](double s) { return share_of(a + s * step); });
    }
    return sum;
  }

  Kinks kinks(const Vec2& a, const Vec2& step) const {
    const double sine2 = sine_ * sine_, rise2 = up_.y() * up_.y();
    const double h = height(a), hs = height(step);
    const double aa = dot(a, a), as = dot(a, step), ss = dot(step, step);
    Kinks kinks;
    // Where (height + up)^2 is slope2 times the square of the distance, which is more2 larger.
    const auto add = [&](double up, double slope2, double more2) {
      const double from = h + up;
      kinks.add_roots(hs * hs - slope2 * ss, hs * from - slope2 * as,
                      from * from - slope2 * (aa + more2));
    };
    add(0, sine2, 0);                                     // all of p's plane begins to be lost
    add(width_m_ * up_.y(), sine2, width_m_ * width_m_);  // nothing but a triangle does
    if (rise2 < sine2)
      add(0, sine2 - rise2, 0);  // the plane touches the cone
    else
      kinks.add(-h / hs);     // tau turns as quickly, if the two are nearly equal
    if (entry_ < kNoEntry) {  // from the cone to the planes on the ray; as the triangle
      kinks.add((a.y() - reach_ * a.x()) / (reach_ * step.x() - step.y()));
      kinks.add((width_m_ - entry_ * a.x()) / (entry_ * step.x()));
    }
    return kinks;
  }

  double width_m_;
  Vec3 up_;
  double sine_;
  double entry_ = kNoEntry;  // of the planes on the ray, per x
  double reach_ = 0;         // y per x from which on they hold there, not yet the cone of its end
};

/// Is the mouth flatter than repose, whether it looks up or down?
bool is_flat(const Vec3& up, const ReposeLine& repose) {
  return up.y() * up.y() + up.z() * up.z() < repose.sine * repose.sine;
}

/// Volume of the roof with the slope of repose on all sides of an opening that is flatter and looks
/// up: p and q are what the inverse slopes of opposite sides, seen in the opening, add up to.
double roof_m3(double width_m, double height_m, const Vec3& up, const ReposeLine& repose) {
  const double y2 = up.y() * up.y(), z2 = up.z() * up.z(), sine2 = repose.sine * repose.sine;
  const double c = 2 * repose.cosine * up.x() / (sine2 - (y2 + z2));  // as in is_flat(): not 0
  const double p = c * std::sqrt(sine2 - y2) / height_m, q = c * std::sqrt(sine2 - z2) / width_m;
  return width_m * height_m * up.x() * (0.5 - std::min(p, q) / std::max(p, q) / 6) / std::max(p, q);
}

/// Of an edge: where height + slope * horizontal distance from `to` is least.
/// @param along unit
Vec3 least_point(const Vec3& from, const Vec3& along, double length_m, const Vec3& to,
                 const Vec3& up, const ReposeLine& repose) {
  const double rise = dot(up, along);
  if (rise != 0 && std::abs(rise) >= repose.sine) return rise > 0 ? from : from + length_m * along;
  const Vec3 way = to - from;
  const double flat2 = 1 - rise * rise, way_up = dot(up, way);
  const double foot_m = (dot(way, along) - way_up * rise) / flat2;
  double at_m = foot_m;
  if (rise != 0) {
    const double across2 = dot(way, way) - way_up * way_up - flat2 * foot_m * foot_m;
    at_m -= rise * repose.cosine *
            std::sqrt(std::max(0.0, across2) / (flat2 * (repose.sine * repose.sine - rise * rise)));
  }
  return from + std::clamp(at_m, 0.0, length_m) * along;
}

}  // namespace

std::optional<Capacity> Capacity::of(const Bucket& bucket) {
  if (bucket.profile.empty()) return std::nullopt;
  return Capacity(bucket);
}

Capacity::Capacity(const Bucket& bucket) : width_m_(bucket.width_m), height_m_(bucket.height_m) {
  for (const Vec2& p : bucket.profile) from_lip_.emplace_back(-p.x(), p.y());
  for (auto p = from_lip_.rbegin(); p != from_lip_.rend(); ++p)
    from_upper_edge_.emplace_back(p->x(), height_m_ - p->y());
  for (std::size_t i = 0; i + 1 < from_lip_.size(); ++i) {
    const Vec2 &a = from_lip_[i], &b = from_lip_[i + 1];
    const double triangle_m2 = cross_product(a, b) / 2;
    area_m2_ += triangle_m2;
    middle_ += triangle_m2 / 3 * Vec3(-a.x() - b.x(), 0, a.y() + b.y());
  }
  middle_ /= area_m2_;
}

double Capacity::hold_m3(const Vec3& up, double repose_slope) const {
  const ReposeLine repose(repose_slope);
  if (up.x() > 0 && is_flat(up, repose))
    return struck_m3() + roof_m3(width_m_, height_m_, up, repose);
  const Fan fan(width_m_, {up.x(), std::abs(up.y()), std::abs(up.z())}, repose.sine);
  const std::vector<Vec2>& profile = up.z() < 0 ? from_upper_edge_ : from_lip_;
  double sum_m3 = fan.held_m3(profile);
  // Body that isn't beyond the ray's end is too low to be lost to what is.
  const bool beyond = std::any_of(profile.begin(), profile.end(),
                                  [this](const Vec2& p) { return p.y() > height_m_; });
  if (beyond && fan.has_ray()) sum_m3 += fan.lost_to_ray_m3(profile, height_m_);
  return std::clamp(sum_m3, 0.0, struck_m3());
}

Vec3 Capacity::spill(const Vec3& up, double repose_slope) const {
  const ReposeLine repose(repose_slope);
  const double half_m = width_m_ / 2;
  if (up.x() < 0 && is_flat(up, repose)) {  // Soil may fall straight through the mouth.
    const Vec3 below = middle_ - middle_.x() / up.x() * up;
    if (std::abs(below.y()) <= half_m && below.z() >= 0 && below.z() <= height_m_)
      return {0, below.y(), below.z()};
  }
  const std::array<Vec3, 4> points = {
      least_point({0, -half_m, 0}, Vec3::UnitY(), width_m_, middle_, up, repose),
      least_point({0, -half_m, height_m_}, Vec3::UnitY(), width_m_, middle_, up, repose),
      least_point({0, -half_m, 0}, Vec3::UnitZ(), height_m_, middle_, up, repose),
      least_point({0, half_m, 0}, Vec3::UnitZ(), height_m_, middle_, up, repose)};
  const auto sum_m = [&](const Vec3& rim) {
    const Vec3 way = middle_ - rim;
    const double rise = dot(up, way);
    return repose_slope * std::sqrt(std::max(0.0, dot(way, way) - rise * rise)) - rise;
  };
  return *std::min_element(points.begin(), points.end(),
                           [&](const Vec3& a, const Vec3& b) { return sum_m(a) < sum_m(b); });
}

BucketCapacity Capacity::at(const Eigen::Quaterniond& world_from_bucket,
                            double repose_slope) const {
  const Vec3 up = world_from_bucket.toRotationMatrix().row(2);
  return {hold_m3(up, repose_slope), spill(up, repose_slope)};
}

}  // namespace soilvdb::inline v0
