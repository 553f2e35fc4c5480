// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <stdexcept>
#include <utility>

#include "core/constants.h"
#include "soilvdb/ground.h"
#include "soilvdb/resistance.h"
#include "soilvdb/tool_shape.h"

namespace soilvdb::inline v0 {
namespace {

/// The end of the blade in the profile's plane: the farthest point that is reached without a bend.
Vec2 blade_end(const Bucket& bucket) {
  if (bucket.profile.size() < 3) return {0, bucket.height_m};
  const auto angle = [](const Vec2& d) { return std::atan2(d.y(), -d.x()); };
  std::size_t last = 1;
  const double first = angle(bucket.profile[last]);
  for (; last + 1 < bucket.profile.size(); ++last)
    if (std::abs(angle(bucket.profile[last + 1] - bucket.profile[last]) - first) > kBladeBend)
      break;
  return bucket.profile[last];
}

/// Where the load lies: the centroid of the lowest part of the body with an area. @param up
/// world's, in the profile's plane
Vec2 load_centre(const std::vector<Vec2>& profile, const Vec2& up, double area_m2) {
  const auto below = [&](double level) {
    double area = 0;
    Vec2 moment = Vec2::Zero(), last = moment;
    std::optional<Vec2> first;
    const auto add = [&](const Vec2& point) {
      if (!first) first = last = point;
      const double twice = last.x() * point.y() - last.y() * point.x();
      area += twice / 2;
      moment += twice / 6 * (last + point);
      last = point;
    };
    for (std::size_t i = 0; i < profile.size(); ++i) {
      const Vec2 &a = profile[i], &b = profile[(i + 1) % profile.size()];
      const double ha = a.dot(up) - level, hb = b.dot(up) - level;
      if (ha <= 0) add(a);
      if ((ha < 0) != (hb < 0) && ha != hb) add(a + ha / (ha - hb) * (b - a));
    }
    if (first) add(*first);
    return std::pair(std::abs(area), area != 0 ? Vec2(moment / area) : moment);
  };
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const Vec2& p : profile) {
    low = std::min(low, p.dot(up));
    high = std::max(high, p.dot(up));
  }
  if (area_m2 >= below(high).first) return below(high).second;
  constexpr int kHalvings = 20;
  for (int n = 0; n < kHalvings; ++n) {
    const double middle = (low + high) / 2;
    (below(middle).first < area_m2 ? low : high) = middle;
  }
  return below(high).second;
}

/// How much of its force an edge or a face has, by the sine of the angle with its way.
double share_of_force(double sine) { return std::clamp(sine / kFullPress, 0.0, 1.0); }

}  // namespace

/// One look at the ground around a bucket, step by step. Places are from the middle of the lip with
/// the world's axes; in a slice, x is ahead and y is up.
struct CutGeometry::Look {
  CutGeometry& of;
  HeightMap& map;
  const Ground& ground;
  const Bucket& bucket;
  const double h = ground.voxel_size_m();
  const Eigen::Matrix3d axes = of.pose_.rotation.toRotationMatrix();
  const Vec3 lip = axes.col(1);
  const double level = lip.head<2>().norm();
  const Vec2 mouth = slice(axes.col(2)), top = mouth * bucket.height_m;
  // Strips side by side, and one more on either side.
  const int strips = std::clamp(
      static_cast<int>(std::ceil(of.width_m_ * level / std::max(h, std::min(2 * h, kStrip_m)))), 1,
      kMostStrips);
  const Vec3 across = of.width_m_ / strips * lip;
  const Vec2 step = h * of.ahead_.head<2>();
  int behind = 0, count = 0;  // heights of a strip behind its lip, and all of them

  /// A direction in the slice: its part along the lip is taken off along the lip.
  Vec2 slice(const Vec3& d) const {
    const Vec3 left(-of.ahead_.y(), of.ahead_.x(), 0);
    const Vec3 in_slice = d - d.dot(left) / lip.dot(left) * lip;
    return {in_slice.dot(of.ahead_), in_slice.z()};
  }
  Vec3 lip_of(int strip) const { return (strip - (strips + 1) / 2.0) * across; }
  Vec3 in_world(const Vec2& p) const { return axes.col(0) * p.x() + axes.col(2) * p.y(); }
  double x_of(int j) const { return (j - behind) * h; }

  /// A face of the body that the bucket's way presses on soil.
  struct Face {
    Vec2 from, along;
    Vec3 out;      // unit
    double press;  // part of the way along `out`
  };
  template <typename Each>
  void each_pressing_face(const Each& each) const {
    for (std::size_t i = 0; i + 1 < bucket.profile.size(); ++i) {
      const Vec2 &from = bucket.profile[i], along = bucket.profile[i + 1] - from;
      const Vec3 out = (-along.y() * axes.col(0) + along.x() * axes.col(2)) / along.norm();
      const double press = out.dot(of.way_);
      if (press > kLeastPress) each(Face{from, along, out, press});
    }
  }

  void find_blade() {
    const Vec2 blade = slice(in_world(blade_end(bucket)));
    of.face_m_ = blade.norm();
    of.rake_rad_ = std::atan2(blade.y(), -blade.x());
    const Vec2 moves(of.way_.dot(of.ahead_), of.way_.z());
    const double sine = std::sin(of.rake_rad_), cosine = std::cos(of.rake_rad_);
    // Not where it goes back, or is lifted off.
    of.cuts_ = of.rake_rad_ > 0 && moves.x() > kLeastPress &&
               moves.x() * sine + moves.y() * cosine > kLeastPress;
    of.lip_share_ = share_of_force(moves.x() * cosine - moves.y() * sine);
    of.plates_share_ = share_of_force(of.way_.dot(axes.col(0)));
    double back = std::min({0.0, blade.x(), top.x()});
    each_pressing_face([&](const Face& face) {
      for (const Vec2& p : {face.from, Vec2(face.from + face.along)})
        back = std::min(back, slice(in_world(p)).x());
    });
    behind = static_cast<int>(std::ceil(-back / h)) + 2;
  }

  void read_heights() {
    const auto read = [&](const Vec3& from, int lines) {
      const auto size = static_cast<std::size_t>(lines * count);
      if (lines > 1 || of.heights_.size() < size) of.heights_.resize(size);
      const std::span<double> heights = std::span(of.heights_).first(size);
      map.lines((of.pose_.position + from).head<2>() - behind * step, step, count, across.head<2>(),
                lines, heights);
      return heights;
    };
    // How deep the lip is, from a few columns ahead, says how far ahead soil matters.
    const int before = behind + static_cast<int>(std::ceil(std::max(0.0, top.x()) / h));
    count = before + kLeastSliceSteps;
    double deepest = 0;
    for (const double z : read(Vec3::Zero(), 1))
      if (!std::isnan(z)) deepest = std::max(deepest, z - of.pose_.position.z());
    deepest += of.width_m_ / 2 * std::abs(lip.z());
    count = before + std::clamp(static_cast<int>(std::ceil(kSliceDepths * deepest / h)),
                                kLeastSliceSteps, kMostSliceSteps);
    read(lip_of(0), strips + 2);
  }

  /// The number of a height of a strip, and the ground's there, m. @param place from the lip
  std::pair<std::size_t, double> height_over(int strip, const Vec3& place) const {
    const double x = std::clamp(slice(place).x() / h + behind, 0.0, count - 1.001);
    const auto j = static_cast<std::size_t>(strip * count) + static_cast<std::size_t>(x);
    return {j, of.heights_[j] + (x - std::floor(x)) * (of.heights_[j + 1] - of.heights_[j])};
  }

  /// Where faces press on the ground, while the heights are those of the ground itself: where it
  /// was dug and lies at the face. Where the lip does not press, faces may follow what they have
  /// cleared: then ground must lie a voxel ahead of them, too.
  void find_contacts() {
    const bool follows = of.lip_share_ <= 0;
    const Vec3 on = follows ? Vec3(h * of.way_) : Vec3(Vec3::Zero());
    each_pressing_face([&](const Face& face) {
      const double length = face.along.norm();
      const double share =
          share_of_force((face.press - kLeastPress) / (1 - kLeastPress / kFullPress));
      const int parts = std::max(1, static_cast<int>(std::ceil(length / h)));
      of.heels_.emplace_back().out = face.out;
      for (int k = 1; k <= strips; ++k) {
        for (int n = 0; n < parts; ++n) {
          const Vec3 in_bucket = in_world(face.from + (n + 0.5) / parts * face.along);
          const Vec3 at = lip_of(k) + in_bucket, place = of.pose_.position + at;
          const auto [j, z] = height_over(k, in_bucket);
          // Not over the wall of a slot, which is as near as a voxel.
          const int inner = strips > 2 ? std::clamp(k, 2, strips - 1) : k;
          const double ahead =
              follows ? height_over(inner, in_bucket + on).second - kGoesInto * h : z;
          const double above = (place.z() + on.z() - ahead) / h;
          if (!(above < kFreeAbove)) continue;  // nor where there is no ground
          const auto initial = ground.terrain().height(place.x(), place.y());
          if (!initial || std::abs(*initial - z) < kMinHeightChange * h) continue;
          const double area = std::min((kFreeAbove - above) / (kFreeAbove - kPressesBelow), 1.0) *
                              share * length * of.width_m_ / strips / parts;
          of.contacts_.push_back({at, area, of.heels_.size() - 1, j});
        }
      }
    });
  }

  /// Ground that the bucket has dug is continued from ahead of it.
  void continue_ground(int k) {
    const Vec3 lip_at = lip_of(k);
    const Vec2 first = (of.pose_.position + lip_at).head<2>();
    const double lip_z = of.pose_.position.z() + lip_at.z(), margin = kCutMargin * h;
    double* z = of.heights_.data() + static_cast<std::ptrdiff_t>(k) * count;
    for (int j = 0; j < count; ++j) z[j] -= lip_z;
    // Columns over the blade lack what it has passed below.
    const double before = margin * mouth.norm(),
                 reach = (bucket.height_m + margin) * mouth.squaredNorm();
    const auto is_dug = [&](int j) {
      const double x = x_of(j);
      return (x < margin) | ((x * mouth.y() - z[j] * mouth.x() < before) &
                             (x * mouth.x() + z[j] * mouth.y() < reach));
    };
    int from = 0;
    for (int j = 0; j < count; ++j) from = is_dug(j) ? j + 1 : from;
    const auto terrain = [&](int j) {
      const Vec2 at = first + (j - behind) * step;
      return ground.terrain().height(at.x(), at.y());
    };
    while (from < count && std::isnan(z[from])) ++from;
    double sum = 0;
    int known = 0;
    bool has_terrain = true;
    for (int j = from; j < std::min(from + kHeightsAhead, count) && !std::isnan(z[j]); ++j) {
      const std::optional<double> initial = terrain(j);
      has_terrain = has_terrain && initial;
      sum += z[j] - (has_terrain ? *initial : 0);
      ++known;
    }
    int until = from + known;
    while (until < count && !std::isnan(z[until])) ++until;
    for (int j = 0; known > 0 && j < from; ++j) {
      const std::optional<double> initial = has_terrain ? terrain(j) : std::nullopt;
      z[j] = initial ? *initial + sum / known : z[from];
    }
    of.strips_.push_back({lip_at, x_of(0), static_cast<std::size_t>(k * count),
                          known > 0 ? static_cast<std::size_t>(until) : 0});
  }

  void find_heels() {
    for (const Contact& c : of.contacts_) {
      Heel& heel = of.heels_[c.heel];
      const double surface =
          of.heights_[c.height] + of.strips_[c.height / static_cast<std::size_t>(count)].lip.z();
      heel.area += c.area;
      heel.at += c.area * c.at;
      heel.depth += c.area * std::max(0.0, surface - c.at.z());
    }
    std::erase_if(of.heels_, [](const Heel& heel) { return heel.area <= 0; });
    for (Heel& heel : of.heels_) {
      heel.at /= heel.area;
      heel.depth /= heel.area;
      heel.length = heel.area / of.width_m_;
    }
    of.contacts_.clear();
  }

  /// Height of the ground above the middle of the lip; -1 where none is known.
  double height(int k, double x) const {
    const Strip& strip = of.strips_[static_cast<std::size_t>(k)];
    const auto j = static_cast<std::size_t>(std::max(0.0, x / h + behind));
    return j < strip.count ? of.heights_[strip.first + j] + strip.lip.z() : -1;
  }

  /// As far as soil stands beside the bucket, but is no wall of a slot: that doesn't move.
  void find_open_sides() {
    const double ahead = std::max(0.0, top.x()) + kCutMargin * h;
    const double middle = height((strips + 1) / 2, ahead);
    if (middle <= 0) return;
    // Side plates shield what is lower than they are.
    const double open =
        bucket.profile.empty() ? 1 : std::clamp((middle - top.y()) / middle, 0.0, 1.0);
    const auto open_by = [&](int side) {
      const double beside = height(side, ahead);
      return open * std::clamp((beside - lip_of(side).z()) / middle, 0.0, 1.0) *
             std::clamp((kHighWall - beside / middle) / (kHighWall - kLowWall), 0.0, 1.0);
    };
    of.open_right_ = open_by(0);
    of.open_left_ = open_by(strips + 1);
  }

  void find_plates() {
    if (bucket.profile.empty() || of.plates_share_ <= 0) return;
    const double deep = std::max(0.0, height((strips + 1) / 2, 0));
    const double length = std::min(bucket.height_m, deep / std::max(mouth.y(), kLeastPress));
    of.plates_m2_ = 2 * bucket.plate_m * length;
    of.plates_at_ = axes.col(2) * (length / 2);
  }
};

void CutGeometry::read(HeightMap& map, const Ground& ground, const Bucket& bucket,
                       const Pose& world_from_bucket, const Vec3& way, double load_m3,
                       double swell) {
  if (bucket.shape)
    throw std::invalid_argument("a closed tool has no blade; only a bucket's resistance is known");
  CutGeometry old = std::exchange(*this, {});  // but for its storage
  strips_.swap(old.strips_);
  heights_.swap(old.heights_);
  heels_.swap(old.heels_);
  contacts_.swap(old.contacts_);
  strips_.clear();
  heels_.clear();
  contacts_.clear();
  pose_ = world_from_bucket;
  width_m_ = bucket.width_m;
  edge_m_ = bucket.edge_m;
  plate_m_ = bucket.plate_m;
  step_m_ = ground.voxel_size_m();
  load_m3_ = load_m3;
  const Eigen::Matrix3d axes = pose_.rotation.toRotationMatrix();
  load_at_ = axes.col(2) * (bucket.height_m / 2);
  if (!bucket.profile.empty() && load_m3 > 0) {
    const Vec2 centre =
        load_centre(bucket.profile, {axes(2, 0), axes(2, 2)}, (1 + swell) * load_m3 / width_m_);
    load_at_ = axes.col(0) * centre.x() + axes.col(2) * centre.y();
  }
  const Vec2 flat = axes.col(1).head<2>();
  const double level = flat.norm();
  ahead_ = level > 0 ? Vec3(flat.y() / level, -flat.x() / level, 0) : Vec3(axes.col(0));
  way_ = way.isZero() ? ahead_ : Vec3(way.normalized());
  rolled_ = level < kLeastLevelLip;  // a slice across the lip isn't upright
  if (rolled_) return heights_.clear();

  Look look{*this, map, ground, bucket};
  strip_m_ = width_m_ * level / look.strips;
  look.find_blade();
  look.read_heights();
  look.find_contacts();
  for (int k = 0; k < look.strips + 2; ++k) look.continue_ground(k);
  look.find_heels();
  look.find_open_sides();
  look.find_plates();
  strips_.erase(strips_.begin());  // those beside
  strips_.pop_back();
}

}  // namespace soilvdb::inline v0
