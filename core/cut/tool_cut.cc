// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/cut/tool_cut.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "core/constants.h"
#include "core/ground/ground_writer.h"
#include "core/lattice/chunk_math.h"
#include "soilvdb/chunk_range.h"
#include "soilvdb/motion.h"

namespace soilvdb::inline v0 {
namespace {

/// From a cell's middle to its corners, voxels.
const double kCellRadius = std::sqrt(3.0) / 2;

/// A path of the tool's frame in one segment, seen from the world: poses at -1, 0 and 1.
struct Segment {
  Eigen::Matrix3d axes[3];  // tool frame from index space
  Vec3 origin[3];
  Eigen::AlignedBox3d box;  // of the tool, world

  Vec3 at(std::size_t pose, const Vec3& index) const { return axes[pose] * index + origin[pose]; }
};

Eigen::AlignedBox3d box_at(const ToolShape& tool, const Pose& world_from_tool) {
  Eigen::AlignedBox3d box;
  for (int k = 0; k < 8; ++k)
    box.extend(world_from_tool *
               tool.box_m().corner(static_cast<Eigen::AlignedBox3d::CornerType>(k)));
  return box;
}

/// The first time, from -1 to 1, at which the tool is nearer to a point of index space than a
/// distance; empty: never.
std::optional<double> when_near(const ToolShape& tool, const Segment& segment, const Vec3& p,
                                double near_m, double least_m, double from = -1) {
  const Vec3 a = segment.at(0, p), middle = segment.at(1, p), b = segment.at(2, p);
  const Vec3 linear = (b - a) / 2, square = (a + b) / 2 - middle;
  const double most = linear.norm() + 2 * square.norm();  // speed
  for (double t = from;;) {
    const double left = tool.distance_m(middle + t * (linear + t * square)) - near_m;
    if (left < 0) return t;
    if (t >= 1 || most == 0) return std::nullopt;
    t = std::min(1.0, t + std::max(left / kToolSteepness, least_m) / most);
  }
}

class Sweep {
 public:
  Sweep(const Ground& ground, const ToolShape& tool) : ground_(ground), tool_(tool) {}

  void add(const Pose& from, const Pose& middle, const Pose& to) {
    Segment segment;
    const Pose* const poses[] = {&from, &middle, &to};
    for (std::size_t k = 0; k < 3; ++k) {
      const Pose tool_from_world = poses[k]->inverse();
      segment.axes[k] = ground_.voxel_size_m() * tool_from_world.rotation.toRotationMatrix();
      segment.origin[k] = tool_from_world * ground_.origin();
      segment.box.extend(box_at(tool_, *poses[k]));
    }
    const Vec3 bulge = Vec3::Constant(kMaxBend * ground_.voxel_size_m());
    segment.box = {segment.box.min() - bulge, segment.box.max() + bulge};
    if (!ground_.is_air(segment.box)) segments_.push_back(segment);
  }

  ToolCut dig(Ground& ground) const {
    std::vector<GroundWriter::Edit> edits;
    std::vector<std::vector<Near>> near;
    Eigen::AlignedBox3d whole;
    for (const Segment& segment : segments_) whole.extend(segment.box);
    if (segments_.empty()) return {};
    for_each_chunk({ground.index_from_world(whole.min()), ground.index_from_world(whole.max())},
                   [&](const Coord3& origin) {
                     std::vector<Near> some = near_chunk(origin);
                     if (some.empty()) return;
                     edits.push_back({origin, kToolChunkWork});
                     near.push_back(std::move(some));
                   });
    std::vector<ToolCut> cuts(edits.size());
    GroundWriter(ground).edit(GroundWriter::Operation::kRemove, edits, kParallelCutWork,
                              [&](std::size_t i, Samples& samples, Samples& loose) {
                                clear(edits[i].origin, kChunkSide, near[i], samples, loose,
                                      cuts[i]);
                                return cuts[i].samples > 0;
                              });
    ToolCut sum;
    for (const ToolCut& cut : cuts) {
      sum.samples += cut.samples;
      sum.loose += cut.loose;
    }
    return sum;
  }

 private:
  std::optional<double> when_near(const Segment& segment, const Vec3& index, double near,
                                  double from = -1) const {
    const double h = ground_.voxel_size_m();
    return soilvdb::when_near(tool_, segment, index, near * h, kMinToolStep * h, from);
  }

  /// A segment that comes near a block of cells, with the earliest such time.
  struct Near {
    const Segment* segment;
    double from = -1;
  };

  /// The segments that come near a block with a number of cells a side.
  std::vector<Near> near_block(const Coord3& low, int side, std::vector<Near> near) const {
    const Vec3 middle = low.cast<double>() + Vec3::Constant((side - 1) / 2.0);
    std::erase_if(near, [&](Near& one) {
      const auto from =
          when_near(*one.segment, middle, kToolSteepness * kCellRadius * side, one.from);
      if (from) one.from = *from;
      return !from;
    });
    return near;
  }

  std::vector<Near> near_chunk(const Coord3& origin) const {
    const Vec3 low = origin.cast<double>() - Vec3::Constant(0.5);
    const Eigen::AlignedBox3d chunk(ground_.world_from_index(low),
                                    ground_.world_from_index(low + Vec3::Constant(kChunkSide)));
    std::vector<Near> all;
    for (const Segment& segment : segments_)
      if (segment.box.intersects(chunk)) all.push_back({&segment});
    return near_block(origin, kChunkSide, std::move(all));
  }

  /// Removes the samples of a block that the tool passes.
  void clear(const Coord3& low, int side, const std::vector<Near>& near, Samples& samples,
             Samples& loose, ToolCut& cut) const {
    if (near.empty()) return;
    if (side == 1) return clear_cell(low, near, samples, loose, cut);
    const int half = side / 2;
    for (int k = 0; k < 8; ++k) {
      const Coord3 part = low + half * Coord3(k >> 2, k >> 1 & 1, k & 1);
      clear(part, half, near_block(part, half, near), samples, loose, cut);
    }
  }

  void clear_cell(const Coord3& voxel, const std::vector<Near>& near, Samples& samples,
                  Samples& loose, ToolCut& cut) const {
    const int n = cell_number(voxel);
    const std::uint64_t word = samples.word(n);
    if (word == 0) return;
    const std::uint64_t hit = passed(voxel, near, word);
    if (hit == 0) return;
    const std::uint64_t loose_word = loose.word(n);
    cut.samples += std::popcount(hit);
    cut.loose += std::popcount(hit & loose_word);
    samples.set_word(n, word & ~hit);
    loose.set_word(n, loose_word & ~hit);
  }

  /// The samples of soil of a cell that the tool passes.
  std::uint64_t passed(const Coord3& voxel, const std::vector<Near>& near,
                       std::uint64_t word) const {
    const Vec3 centre = voxel.cast<double>();
    const CellPoints& points = sample_points(voxel);
    std::uint64_t hit = 0;
    for (const Near& one : near) {
      if (when_near(*one.segment, centre, -kToolSteepness * kCellRadius, one.from)) return word;
      for (std::uint64_t left = word & ~hit; left != 0; left &= left - 1) {
        const int i = std::countr_zero(left);
        const Vec3 at(points.x[i], points.y[i], points.z[i]);
        if (when_near(*one.segment, centre + at - Vec3::Constant(0.5), 0, one.from))
          hit |= std::uint64_t{1} << i;
      }
    }
    return hit;
  }

  const Ground& ground_;
  const ToolShape& tool_;
  std::vector<Segment> segments_;
};

}  // namespace

void require_ground(const Ground& ground, const ToolShape& tool, std::span<const Pose> path) {
  for (const Pose& pose : path) {
    const Eigen::AlignedBox3d box = box_at(tool, pose);
    if (!ground.terrain().has_data(box))
      throw NoGroundError("the tool reaches ground without a height at x " +
                          std::to_string(box.min().x()) + " to " + std::to_string(box.max().x()) +
                          ", y " + std::to_string(box.min().y()) + " to " +
                          std::to_string(box.max().y()));
  }
}

ToolCut subtract_traced(Ground& ground, const ToolShape& tool, std::span<const Pose> path) {
  const auto dig = [&](std::size_t first, std::size_t last) {
    Sweep sweep(ground, tool);
    for (std::size_t i = first; i + 2 <= last; i += 2) sweep.add(path[i], path[i + 1], path[i + 2]);
    if (path.size() == 1) sweep.add(path[0], path[0], path[0]);
    return sweep.dig(ground);
  };
  if (path.size() == 1) return dig(0, 0);
  ToolCut sum;
  for (std::size_t first = 0; first + 2 < path.size(); first += 2 * kToolSegments) {
    const ToolCut cut = dig(first, std::min(first + 2 * kToolSegments, path.size() - 1));
    sum.samples += cut.samples;
    sum.loose += cut.loose;
  }
  return sum;
}

ToolCut subtract(Ground& ground, const ToolShape& tool, std::span<const Pose> path) {
  for (const Pose& pose : path)
    if (const std::string what = validation_error(pose); !what.empty())
      throw std::invalid_argument(what);
  if (path.empty()) return {};
  const double h = ground.voxel_size_m();
  const Bucket bucket = tool_of(tool);
  std::vector<Pose> all = {path[0]};
  for (std::size_t i = 1; i < path.size(); ++i) {
    trace(path[i - 1], path[i], bucket, kMaxBend * h, kPathStride * h, all);
    all.back() = path[i];  // to the bit, wherever a way is split
  }
  require_ground(ground, tool, all);
  return subtract_traced(ground, tool, all);
}

std::int64_t unite(Ground& ground, const ToolShape& body, const Pose& world_from_body) {
  if (const std::string what = validation_error(world_from_body); !what.empty())
    throw std::invalid_argument(what);
  require_ground(ground, body, {&world_from_body, 1});
  const Pose body_from_world = world_from_body.inverse();
  const Eigen::AlignedBox3d box = box_at(body, world_from_body);
  GroundWriter writer(ground);
  std::int64_t added = 0;
  for_each_chunk({ground.index_from_world(box.min()), ground.index_from_world(box.max())},
                 [&](const Coord3& origin) {
                   SampleWords words;
                   for (int n = 0; n < kChunkVoxels; ++n) {
                     const Coord3 voxel = origin + numbered_voxel(n);
                     const CellPoints& points = sample_points(voxel);
                     std::uint64_t in = 0;
                     for (int i = 0; i < 64; ++i) {
                       const Vec3 at(points.x[i], points.y[i], points.z[i]);
                       const Vec3 p =
                           ground.world_from_index(voxel.cast<double>() + at - Vec3::Constant(0.5));
                       in |= std::uint64_t{body.distance_m(body_from_world * p) < 0} << i;
                     }
                     words[static_cast<std::size_t>(n)] = in;
                   }
                   added += writer.add(origin, words);
                 });
  return added;
}

}  // namespace soilvdb::inline v0
