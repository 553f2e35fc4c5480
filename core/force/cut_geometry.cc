// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <limits>
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
  std::vector<Vec2> part;
  const auto below = [&](double level) {
    double area = 0;
    Vec2 moment = Vec2::Zero();
    part.clear();
    for (std::size_t i = 0; i < profile.size(); ++i) {
      const Vec2 &a = profile[i], &b = profile[(i + 1) % profile.size()];
      const double ha = a.dot(up) - level, hb = b.dot(up) - level;
      if (ha <= 0) part.push_back(a);
      if ((ha < 0) != (hb < 0) && ha != hb) part.push_back(a + ha / (ha - hb) * (b - a));
    }
    for (std::size_t i = 0; i < part.size(); ++i) {
      const Vec2 &a = part[i], &b = part[(i + 1) % part.size()];
      const double twice = a.x() * b.y() - a.y() * b.x();
      area += twice / 2;
      moment += twice / 6 * (a + b);
    }
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

/// A direction of the bucket in the slice: its part along the lip is taken off along the lip.
struct SliceAxes {
  Vec3 ahead, left, lip;

  Vec2 operator()(const Vec3& d) const {
    const Vec3 in_slice = d - d.dot(left) / lip.dot(left) * lip;
    return {in_slice.dot(ahead), in_slice.z()};
  }
};

}  // namespace

CutGeometry::CutGeometry(HeightMap& map, const Ground& ground, const Bucket& bucket,
                         const Pose& world_from_bucket, const Vec3& way, double load_m3)
    : pose_(world_from_bucket),
      width_m_(bucket.width_m),
      edge_m_(bucket.edge_m),
      plate_m_(bucket.plate_m) {
  if (bucket.shape)
    throw std::invalid_argument("a closed tool has no blade; only a bucket's resistance is known");
  const Eigen::Matrix3d axes = pose_.rotation.toRotationMatrix();
  const double h = step_m_ = ground.voxel_size_m();
  const Vec3 lip = axes.col(1);
  const Vec2 flat = lip.head<2>();
  // The load.
  load_m3_ = load_m3;
  load_at_ = axes.col(2) * (bucket.height_m / 2);
  if (!bucket.profile.empty() && load_m3 > 0) {
    const Vec2 centre = load_centre(bucket.profile, {axes(2, 0), axes(2, 2)}, load_m3 / width_m_);
    load_at_ = axes.col(0) * centre.x() + axes.col(2) * centre.y();
  }
  const double level = flat.norm();
  ahead_ = level > 0 ? Vec3(flat.y() / level, -flat.x() / level, 0) : Vec3(axes.col(0));
  way_ = way.isZero() ? ahead_ : Vec3(way.normalized());
  rolled_ = level < kLeastLevelLip;  // a slice across the lip isn't upright
  if (rolled_) return;
  const SliceAxes slice{ahead_, Vec3(-ahead_.y(), ahead_.x(), 0), lip};

  const Vec2 end = blade_end(bucket);
  const Vec2 blade = slice(axes.col(0) * end.x() + axes.col(2) * end.y());
  const Vec2 mouth = slice(axes.col(2));
  face_m_ = blade.norm();
  rake_rad_ = std::atan2(blade.y(), -blade.x());
  const Vec2 moves(way_.dot(ahead_), way_.z());
  const double sine = std::sin(rake_rad_), cosine = std::cos(rake_rad_);
  // Not where it goes back, or is lifted off.
  cuts_ = rake_rad_ > 0 && moves.x() > kLeastPress &&
          moves.x() * sine + moves.y() * cosine > kLeastPress;
  const auto share = [](double sine_of_angle) {
    return std::clamp(sine_of_angle / kFullPress, 0.0, 1.0);
  };
  lip_share_ = share(moves.x() * cosine - moves.y() * sine);
  plates_share_ = share(way_.dot(axes.col(0)));

  // Strips side by side, and one more on either side.
  const int strips = std::clamp(
      static_cast<int>(std::ceil(width_m_ * level / std::max(h, std::min(2 * h, kStrip_m)))), 1,
      kMostStrips);
  strip_m_ = width_m_ * level / strips;
  const Vec3 across = width_m_ / strips * lip;
  const Vec3 first_lip = -(strips + 1) / 2.0 * across;  // of the strip beside
  const Vec2 top = mouth * bucket.height_m;
  double back = std::min({0.0, blade.x(), top.x()});
  for (std::size_t i = 0; i + 1 < bucket.profile.size(); ++i) {
    const Vec2 &a = bucket.profile[i], d = bucket.profile[i + 1] - a;
    const Vec3 out = -d.y() * axes.col(0) + d.x() * axes.col(2);  // as long as the face
    if (out.dot(way_) <= kLeastPress * d.norm()) continue;
    for (const Vec2& p : {a, bucket.profile[i + 1]})
      back = std::min(back, slice(axes.col(0) * p.x() + axes.col(2) * p.y()).x());
  }
  const int behind = static_cast<int>(std::ceil(-back / h)) + 1;
  const Vec2 step = h * ahead_.head<2>();
  const auto read = [&](const Vec3& from, int count, int lines) {
    heights_.resize(static_cast<std::size_t>(lines * count));
    map.lines((pose_.position + from).head<2>() - behind * step, step, count, across.head<2>(),
              lines, heights_);
  };
  // How deep the lip is, from a few columns ahead, says how far ahead soil matters.
  const int mouth_ahead = static_cast<int>(std::ceil(std::max(0.0, top.x()) / h));
  int count = behind + mouth_ahead + kLeastSliceSteps;
  read(Vec3::Zero(), count, 1);
  double deepest = 0;
  for (const double z : heights_)
    if (!std::isnan(z)) deepest = std::max(deepest, z - pose_.position.z());
  deepest += width_m_ / 2 * std::abs(lip.z());
  count = behind + mouth_ahead +
          std::clamp(static_cast<int>(std::ceil(kSliceDepths * deepest / h)), kLeastSliceSteps,
                     kMostSliceSteps);
  read(first_lip, count, strips + 2);

  // Faces that press on the ground, while the heights are those of the ground itself: where it was
  // dug and lies at the face.
  struct Contact {
    Vec3 at;
    double area;
    std::size_t height;
  };
  struct Face {
    Vec3 out;
    std::vector<Contact> parts;
  };
  std::vector<Face> contacts;
  for (std::size_t i = 0; i + 1 < bucket.profile.size() && lip_share_ > 0; ++i) {
    const Vec2 &a = bucket.profile[i], d = bucket.profile[i + 1] - a;
    const Vec3 out = -d.y() * axes.col(0) + d.x() * axes.col(2);
    const double press = out.dot(way_) / d.norm();
    if (press <= kLeastPress) continue;
    contacts.push_back({out / d.norm(), {}});
    const double face_share = share((press - kLeastPress) / (1 - kLeastPress / kFullPress));
    const int parts = std::max(1, static_cast<int>(std::ceil(d.norm() / h)));
    for (int k = 1; k <= strips; ++k) {
      for (int n = 0; n < parts; ++n) {
        const Vec2 p = a + (n + 0.5) / parts * d;
        const Vec3 in_bucket = axes.col(0) * p.x() + axes.col(2) * p.y();
        const Vec3 at = first_lip + k * across + in_bucket;
        const double x = std::clamp(slice(in_bucket).x() / h + behind, 0.0, count - 1.001);
        const auto j = static_cast<std::size_t>(k * count) + static_cast<std::size_t>(x);
        const double ground_z = heights_[j] + (x - std::floor(x)) * (heights_[j + 1] - heights_[j]);
        const Vec3 place = pose_.position + at;
        const auto initial = ground.terrain().height(place.x(), place.y());
        if (std::isnan(ground_z) || !initial ||
            std::abs(*initial - ground_z) < kMinHeightChange * h)
          continue;
        const double above = (place.z() - ground_z) / h;
        const double area =
            std::clamp((kFreeAbove - above) / (kFreeAbove - kPressesBelow), 0.0, 1.0) * face_share *
            d.norm() * width_m_ / strips / parts;
        if (area > 0) contacts.back().parts.push_back({at, area, j});
      }
    }
  }

  // Ground that the bucket has dug is continued from ahead of it.
  const double margin = kCutMargin * h;
  for (int k = 0; k < strips + 2; ++k) {
    const Vec3 lip_at = first_lip + k * across;
    const double lip_z = pose_.position.z() + lip_at.z();
    double* z = heights_.data() + static_cast<std::ptrdiff_t>(k) * count;
    const auto x_of = [&](int j) { return (j - behind) * h; };
    for (int j = 0; j < count; ++j) z[j] -= lip_z;
    int from = count;
    while (from > 0) {
      const double x = x_of(from - 1), s = x * mouth.x() + z[from - 1] * mouth.y();
      // Columns over the blade lack what it has passed below.
      const bool dug =
          x < margin || (x * mouth.y() - z[from - 1] * mouth.x() < margin * mouth.norm() &&
                         s < (bucket.height_m + margin) * mouth.squaredNorm());
      if (dug) break;
      --from;
    }
    const auto terrain = [&](int j) {
      const Vec2 at = (pose_.position + lip_at).head<2>() + (j - behind) * step;
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
    Strip strip{lip_at, x_of(0), static_cast<std::size_t>(k * count), 0};
    if (known > 0) {
      for (int j = 0; j < from; ++j) {
        const std::optional<double> initial = has_terrain ? terrain(j) : std::nullopt;
        z[j] = initial ? *initial + sum / known : z[from];
      }
      strip.count = static_cast<std::size_t>(until);
    }
    strips_.push_back(strip);
  }

  for (const Face& face : contacts) {
    Heel heel;
    heel.out = face.out;
    for (const Contact& c : face.parts) {
      heel.area += c.area;
      heel.at += c.area * c.at;
      const double surface =
          heights_[c.height] + strips_[c.height / static_cast<std::size_t>(count)].lip.z();
      heel.depth += c.area * std::max(0.0, surface - c.at.z());
    }
    if (heel.area <= 0) continue;
    heel.at /= heel.area;
    heel.depth /= heel.area;
    heel.length = heel.area / width_m_;
    heels_.push_back(heel);
  }

  const auto height = [&](int k, double x) {
    const Strip& strip = strips_[static_cast<std::size_t>(k)];
    const auto j = static_cast<std::size_t>(std::max(0.0, x / h + behind));
    return j < strip.count ? heights_[strip.first + j] + strip.lip.z() : -1;
  };
  const double ahead_m = std::max(0.0, top.x()) + margin;
  const double middle = height((strips + 1) / 2, ahead_m);
  const bool has_plates = !bucket.profile.empty();
  // Side plates shield what is lower than they are.
  const double open = has_plates ? std::clamp((middle - top.y()) / middle, 0.0, 1.0) : 1;
  if (middle > 0 && open > 0)
    for (const int side : {0, strips + 1}) {
      // As far as soil stands beside the bucket, but is no wall of a slot: that doesn't move.
      const double beside = height(side, ahead_m);
      const double lip_z = strips_[static_cast<std::size_t>(side)].lip.z();
      open_sides_ += open * std::clamp((beside - lip_z) / middle, 0.0, 1.0) *
                     std::clamp((kHighWall - beside / middle) / (kHighWall - kLowWall), 0.0, 1.0);
    }
  if (has_plates && plates_share_ > 0) {
    const double deep = std::max(0.0, height((strips + 1) / 2, 0));
    const double length = std::min(bucket.height_m, deep / std::max(mouth.y(), kLeastPress));
    plates_m2_ = 2 * bucket.plate_m * length;
    plates_at_ = axes.col(2) * (length / 2);
  }
  strips_.erase(strips_.begin());
  strips_.pop_back();
}

}  // namespace soilvdb::inline v0
