// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tests/support/swept_samples.h"

#include <algorithm>
#include <cmath>

#include "core/lattice/chunk_math.h"

namespace soilvdb::test {
namespace {

/// Floats of the size of a bucket's coordinates in voxels are good to a tenth of it.
constexpr double kTie = 1e-4;

Eigen::Quaterniond turned_to(const Vec3& y, const Vec3& z) {
  Eigen::Matrix3d axes;
  axes << y.cross(z), y, z;
  return Eigen::Quaterniond(axes);
}

/// A face's frame at a pose, index space.
struct FaceFrame {
  Eigen::Matrix3d face_from_index;
  Vec3 position;

  FaceFrame(const Pose& world_from_bucket, const Face& face, double h) {
    const Pose world_from_face = world_from_bucket * face.bucket_from_face;
    face_from_index = world_from_face.rotation.toRotationMatrix().transpose();
    position = world_from_face.position / h;
  }
  Vec3 operator()(const Vec3& p) const { return face_from_index * (p - position); }
  double x(const Vec3& p) const { return face_from_index.row(0).dot(p - position); }
};

/// How far inside an outline a point is, negative outside: the distance to its nearest edge.
double depth(const std::vector<Vec2>& outline, const Vec2& p) {
  double least = 1e9, turns = 0;
  for (std::size_t i = 0; i < outline.size(); ++i) {
    const Vec2 &a = outline[i], &b = outline[(i + 1) % outline.size()], along = b - a;
    const double s = std::clamp((p - a).dot(along) / along.squaredNorm(), 0.0, 1.0);
    least = std::min(least, (a + s * along - p).norm());
    const Vec2 to_a = a - p, to_b = b - p;
    turns += std::atan2(to_a.x() * to_b.y() - to_a.y() * to_b.x(), to_a.dot(to_b));
  }
  return std::abs(turns) > 1 ? least : -least;
}

/// One face in one segment.
struct FaceStroke {
  FaceFrame from, middle, to;
  std::vector<Vec2> outline;  // voxels

  enum class Answer { kNo, kPerhaps, kYes };

  Answer passes(const Vec3& p, const Vec3& cell) const {
    const double u = from.x(p), v = to.x(p);
    const bool near_end = std::min(std::abs(u), std::abs(v)) < kTie;
    if ((u > 0) == (v > 0) && !near_end) return Answer::kNo;
    const Vec3 a = from(p), b = to(p), bend = middle(cell) - (from(cell) + to(cell)) / 2;
    const double straight = (u + v) / (u - v);
    const double bent = straight + 2 * bend.x() * (1 - straight * straight) / (u - v);
    const double t = std::clamp(bent, -1.0, 1.0);
    const Vec3 at = (a + b) / 2 + t * (b - a) / 2 + (1 - t * t) * bend;
    const double inside = depth(outline, {at.y(), at.z()});
    // The time is known as well as its parts, and where that is as well as the time.
    const double tie = kTie * (1 + (b - a).norm() / std::abs(u - v));
    if (inside < -tie) return near_end && std::abs(u - v) < 1e-2 ? Answer::kPerhaps : Answer::kNo;
    return near_end || !(inside > tie) ? Answer::kPerhaps : Answer::kYes;
  }
};

}  // namespace

Block::Block(const Bucket& bucket, double voxel_size_m)
    : ground(voxel_size_m, Vec3::Zero(), make_plane(1e4, {0, 0})), excavator(bucket) {}

void Block::sweep(std::span<const Pose> path) {
  const Cut part = excavator.sweep(ground, path);
  cut.all += part.all;
}

SampleSet Block::removed() const {
  SampleSet all;
  SampleWords words;
  for (const Chunk* chunk : ground.chunks()) {
    ground.read_samples(chunk->origin, words);
    for (std::uint64_t& word : words) word = ~word;
    if (words != SampleWords{}) all[chunk->origin] = words;
  }
  return all;
}

std::vector<Face> faces(const Bucket& bucket) {
  const double half = bucket.width_m / 2, top = bucket.height_m;
  const auto strip = [&](double length) {
    return std::vector<Vec2>{{-half, 0}, {half, 0}, {half, length}, {-half, length}};
  };
  std::vector<Face> all{{Pose{}, strip(top)}};
  for (std::size_t i = 1; i < bucket.profile.size(); ++i) {
    const Vec2 a = bucket.profile[i - 1], along = bucket.profile[i] - a;
    const Vec3 z = Vec3(along.x(), 0, along.y()) / along.norm();
    all.push_back({{{a.x(), 0, a.y()}, turned_to(Vec3::UnitY(), z)}, strip(along.norm())});
  }
  for (const double y : {-half, half}) {
    if (bucket.profile.empty()) break;
    Face side{{{0, y, 0}, turned_to(Vec3::UnitZ(), Vec3::UnitX())}, {}};
    for (const Vec2& p : bucket.profile) side.outline.emplace_back(p.y(), p.x());
    all.push_back(side);
  }
  return all;
}

Swept sweep_by_sample(const Bucket& bucket, double h, std::span<const Pose> path) {
  constexpr double kBeside = 1;  // voxels, far more than the bends
  std::vector<FaceStroke> strokes;
  Eigen::AlignedBox3d box;
  for (const Pose& pose : path) {
    for (const Vec3& p : extremes(bucket)) box.extend(pose * p / h);
  }
  for (std::size_t i = 2; i < path.size(); i += 2) {
    for (const Face& face : faces(bucket)) {
      FaceStroke stroke{
          {path[i - 2], face, h}, {path[i - 1], face, h}, {path[i], face, h}, face.outline};
      for (Vec2& p : stroke.outline) p /= h;
      strokes.push_back(stroke);
    }
  }
  Swept swept;
  const Vec3 beside = Vec3::Constant(kBeside);
  for_each_chunk({box.min() - beside, box.max() + beside}, [&](const Coord3& origin) {
    SampleWords surely{}, perhaps{};
    for (int n = 0; n < kChunkVoxels; ++n) {
      const Coord3 voxel = origin + numbered_voxel(n);
      const Vec3 cell = voxel.cast<double>();
      const CellPoints& points = sample_points(voxel);
      const auto word = static_cast<std::size_t>(n);
      for (int i = 0; i < 64; ++i) {
        const Vec3 p = cell - Vec3::Constant(0.5) + Vec3(points.x[i], points.y[i], points.z[i]);
        for (const FaceStroke& stroke : strokes) {
          const FaceStroke::Answer answer = stroke.passes(p, cell);
          surely[word] |= std::uint64_t{answer == FaceStroke::Answer::kYes} << i;
          perhaps[word] |= std::uint64_t{answer == FaceStroke::Answer::kPerhaps} << i;
        }
      }
    }
    if (surely != SampleWords{}) swept.surely[origin] = surely;
    if (perhaps != SampleWords{}) swept.perhaps[origin] = perhaps;
  });
  return swept;
}

}  // namespace soilvdb::test
