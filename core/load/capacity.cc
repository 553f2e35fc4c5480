// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Soil is lost in the Minkowski sum of the rim and an upright cone K with the slope of repose. If
// the mouth looks up and is flatter than repose, the sum contains no part of the body, and the soil
// above is a hipped roof. Otherwise the whole mouth may stand for the rim, because the way down the
// mouth's plane from any point ends at the rim:
//
//     mouth + K = (lower edge + ray) + K  -  (upper edge + ray) + K  +  upper edge + K
//
// The ray goes up along the side plates' edges; its part beyond the upper edge is subtracted. Seen
// from an edge's lower end, each of the three sums looks the same at any scale. A plane through the
// edge thus cuts its border in a line through that end. A fan of these planes goes from the edge to
// all points of the profile. In each plane soil is a rectangle minus a wedge, with an area in
// closed form. This is integrated along the profile between its kinks, which are roots of
// quadratics.
#include "soilvdb/capacity.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "core/tool/polygon.h"

namespace soilvdb::inline v0 {
namespace {

/// Share of the mouth's height up to which ground before it counts. Its upper edge is rim anyway.
constexpr double kMaxHeldShare = 0.95;
constexpr double kNoEntry = std::numeric_limits<double>::infinity();

// Written out, so that no vector unit adds in another order.
double dot(const Vec2& a, const Vec2& b) { return a.x() * b.x() + a.y() * b.y(); }
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
/// Gauss-Legendre on (0, 1), denser at both ends, where there may be square roots. Six nodes are
/// off by 1e-4 of a bucket at some attitudes, eight by 1e-5.
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

/// Kinks of a function of s in (0, 1).
class Kinks {
 public:
  void add(double s) {
    if (!(s > 0 && s < 1)) return;
    std::size_t i = size_++;
    for (; at_[i - 1] > s; --i) at_[i] = at_[i - 1];
    at_[i] = s;
  }
  /// Roots of a s^2 + 2 b s + c.
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

/// The first tau >= 0 at which p + tau * y is in the upright cone at the origin, whose sides rise
/// by `sine` of their length. The unit vector y is across p and rises by `rise` >= 0. p is `height`
/// above the origin, at a distance whose square is `length2`.
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

/// The planes through one edge of the mouth. Points are those of the profile relative to the edge:
/// x behind the mouth, y up along the side plates' edges.
class Fan {
 public:
  /// `up` is the world's, with axes mirrored so that edge and ray go up.
  Fan(double width_m, const Vec3& up, double sine) : width_m_(width_m), up_(up), sine_(sine) {
    if (!has_ray()) return;
    // Ray plus cone is above two planes; along the ray they look like a cone of two lines.
    const double across = std::sqrt(sine * sine - up.z() * up.z());
    entry_ = entry(-up.x(), 1, up.y(), across);
    reach_ = up.z() / across * std::sqrt(1 + entry_ * entry_);
  }

  /// A steeper ray is inside the cone of its end.
  bool has_ray() const { return up_.z() < sine_; }

  /// Volume of the body that edge and ray leave, m^3.
  double held_m3(const std::vector<Vec2>& profile) const {
    return integral(profile, 0, [this](const Vec2& p) { return share(past_both(p)); });
  }
  /// Volume that the ray takes besides the edge, m^3. @param up_m of the edge, from the profile's
  double lost_to_ray_m3(const std::vector<Vec2>& profile, double up_m) const {
    return integral(profile, up_m,
                    [this](const Vec2& p) { return share(past_edge(p)) - share(past_both(p)); });
  }

 private:
  double height(const Vec2& p) const { return up_.z() * p.y() - up_.x() * p.x(); }

  /// Bound of the lost soil in p's plane: above the line through (0, 0) and (1, tau). Coordinates
  /// are the distance from the edge, in units of p's, and the way from the edge's lower end. Beyond
  /// it all soil along the edge is lost, because the edge does not go down.
  double past_edge(const Vec2& p) const { return entry(height(p), dot(p, p), up_.y(), sine_); }
  double past_both(const Vec2& p) const {
    const bool on_ray = entry_ < kNoEntry && p.y() >= reach_ * p.x();
    return on_ray ? entry_ * p.x() : past_edge(p);
  }
  /// Share below that line: the integral of r * min(width, tau * r) over r in (0, 1).
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
      const double twice_m2 = cross2(a, step);
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
    // Where (height + up)^2 is slope2 times the squared distance plus more2.
    const auto add = [&](double up, double slope2, double more2) {
      const double from = h + up;
      kinks.add_roots(hs * hs - slope2 * ss, hs * from - slope2 * as,
                      from * from - slope2 * (aa + more2));
    };
    add(0, sine2, 0);                                     // all of p's plane begins to be lost
    add(width_m_ * up_.y(), sine2, width_m_ * width_m_);  // only a triangle begins to be lost
    if (rise2 < sine2)
      add(0, sine2 - rise2, 0);  // the plane touches the cone
    else
      kinks.add(-h / hs);     // tau turns quickly if the two are nearly equal
    if (entry_ < kNoEntry) {  // from the cone to the ray's planes; and the triangle
      kinks.add((a.y() - reach_ * a.x()) / (reach_ * step.x() - step.y()));
      kinks.add((width_m_ - entry_ * a.x()) / (entry_ * step.x()));
    }
    return kinks;
  }

  double width_m_;
  Vec3 up_;
  double sine_;
  double entry_ = kNoEntry;  // of the ray's planes, per x
  double reach_ = 0;         // least y per x at which they hold, beyond the cone of the end
};

/// Is the mouth flatter than repose, looking up or down?
bool is_flat(const Vec3& up, const ReposeLine& repose) {
  return up.y() * up.y() + up.z() * up.z() < repose.sine * repose.sine;
}

/// Volume of the roof with the slope of repose on all sides of an opening that is flatter and looks
/// up. p and q are the sums of the inverse slopes of opposite sides, seen in the opening.
double roof_m3(double width_m, double height_m, const Vec3& up, const ReposeLine& repose) {
  const double y2 = up.y() * up.y(), z2 = up.z() * up.z(), sine2 = repose.sine * repose.sine;
  const double c = 2 * repose.cosine * up.x() / (sine2 - (y2 + z2));  // as in is_flat(): not 0
  const double p = c * std::sqrt(sine2 - y2) / height_m, q = c * std::sqrt(sine2 - z2) / width_m;
  return width_m * height_m * up.x() * (0.5 - std::min(p, q) / std::max(p, q) / 6) / std::max(p, q);
}

/// The point of an edge where height + slope * horizontal distance from `to` is least.
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
    const double triangle_m2 = cross2(a, b) / 2;
    area_m2_ += triangle_m2;
    middle_ += triangle_m2 / 3 * Vec3(-a.x() - b.x(), 0, a.y() + b.y());
  }
  middle_ /= area_m2_;
}

double Capacity::hold_m3(const Vec3& up, double repose_slope, double held_m) const {
  const ReposeLine repose(repose_slope);
  if (up.x() > 0 && is_flat(up, repose))
    return struck_m3() + roof_m3(width_m_, height_m_, up, repose);
  const Fan fan(width_m_, {up.x(), std::abs(up.y()), std::abs(up.z())}, repose.sine);
  std::vector<Vec2> profile = up.z() < 0 ? from_upper_edge_ : from_lip_;
  double edges_m = height_m_;  // from the lower edge to the upper one
  if (up.z() > 0) {            // The ground before the mouth is the lower edge.
    const double held = std::clamp(held_m, 0.0, kMaxHeldShare * height_m_);
    for (Vec2& p : profile) p.y() -= held;
    edges_m -= held;
  }
  double sum_m3 = fan.held_m3(profile);
  // Only the body beyond the ray's end can be lost to the subtracted part.
  const bool beyond =
      std::any_of(profile.begin(), profile.end(), [&](const Vec2& p) { return p.y() > edges_m; });
  if (beyond && fan.has_ray()) sum_m3 += fan.lost_to_ray_m3(profile, edges_m);
  return std::clamp(sum_m3, 0.0, struck_m3());
}

Capacity::Edge Capacity::spill_edge(const Vec3& up, double repose_slope) const {
  const ReposeLine repose(repose_slope);
  const double half_m = width_m_ / 2;
  if (up.x() < 0 && is_flat(up, repose)) {  // Soil may fall straight through the mouth.
    const Vec3 below = middle_ - middle_.x() / up.x() * up;
    if (std::abs(below.y()) <= half_m && below.z() >= 0 && below.z() <= height_m_)
      return {{0, -half_m, below.z()}, Vec3::UnitY(), width_m_, {0, below.y(), below.z()}};
  }
  std::array<Edge, 4> edges = {Edge{{0, -half_m, 0}, Vec3::UnitY(), width_m_, {}},
                               {{0, -half_m, height_m_}, Vec3::UnitY(), width_m_, {}},
                               {{0, -half_m, 0}, Vec3::UnitZ(), height_m_, {}},
                               {{0, half_m, 0}, Vec3::UnitZ(), height_m_, {}}};
  for (Edge& e : edges) e.least = least_point(e.from, e.along, e.length_m, middle_, up, repose);
  const auto sum_m = [&](const Edge& edge) {
    const Vec3 way = middle_ - edge.least;
    const double rise = dot(up, way);
    return repose_slope * std::sqrt(std::max(0.0, dot(way, way) - rise * rise)) - rise;
  };
  return *std::min_element(edges.begin(), edges.end(),
                           [&](const Edge& a, const Edge& b) { return sum_m(a) < sum_m(b); });
}

std::array<Vec3, 2> Capacity::spill_line(const Eigen::Quaterniond& world_from_bucket,
                                         double repose_slope, double level_m) const {
  const Vec3 up = world_from_bucket.toRotationMatrix().row(2);
  const Edge edge = spill_edge(up, repose_slope);
  const Vec3 to = edge.from + edge.length_m * edge.along;
  const double rise = dot(up, edge.along), length_m = level_m / std::abs(rise);
  if (!(length_m < edge.length_m)) return {edge.from, to};
  return rise > 0 ? std::array{edge.from, Vec3(edge.from + length_m * edge.along)}
                  : std::array{Vec3(to - length_m * edge.along), to};
}

BucketCapacity Capacity::at(const Eigen::Quaterniond& world_from_bucket, double repose_slope,
                            double held_m) const {
  const Vec3 up = world_from_bucket.toRotationMatrix().row(2);
  return {hold_m3(up, repose_slope, held_m), spill_edge(up, repose_slope).least};
}

}  // namespace soilvdb::inline v0
