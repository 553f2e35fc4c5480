// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/tracker.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include "core/chunk_range.h"
#include "core/cut_surface.h"
#include "core/excavate.h"
#include "core/motion.h"

namespace soilvdb {
namespace {

// In voxels; a bucket's travel is that of its fastest corner.
constexpr double kTolerance = 2.5e-4;  ///< bend of a path between poses
constexpr double kStride = 16;         ///< between poses, so that boxes around segments stay small
constexpr double kRefresh = 4;         ///< travel after which phi is carved anew
constexpr double kSpacing = 1;         ///< travel between the poses that phi is carved by
constexpr double kBend = 0.1;          ///< of the path between those poses
constexpr double kHistory = 12;        ///< travel a window remembers: four bands

/// How far below the horizontal the mouth looks, rad.
double looks_down(const Pose& world_from_bucket) {
  return std::asin(std::clamp(-(world_from_bucket.rotation * Vec3::UnitX()).z(), -1.0, 1.0));
}

}  // namespace

/// One bucket: its load, and as much of its path as phi still needs.
struct Tracker::Machine {
  Bucket bucket;
  std::vector<Facet> facets;
  Ledger ledger;
  bool placed = false;
  Pose current;
  std::vector<Pose> kept;                    // the path before `current`, thinned
  std::vector<Pose> between;                 // some of those since the last kept one
  std::size_t fresh = 0;                     // the first kept pose that no surface cut has seen
  bool begins = true;                        // kept reaches back to where the path starts
  bool mouth_cut = false, body_cut = false;  // soil, since the last surface cut
  double moved_m = 0;                        // since the last surface cut
  std::optional<SurfaceCut> carving;         // of the path before `fresh`
  std::size_t carving_chunks = 0;

  struct Before {
    Coord3 origin;
    std::optional<std::array<float, kLeafSize>> phi;  // of a chunk that was resident
  };
  std::vector<Before> ahead;  // what flush() changed, to be undone by the next update

  /// Moves on, and keeps the pose left where the path bends or the last kept one is far enough.
  void move_to(const Pose& pose, double voxel_size_m) {
    moved_m += travel(bucket, current, pose);
    const double since = kept.empty() ? 0 : travel(bucket, kept.back(), current);
    if (kept.empty() || since >= kSpacing * voxel_size_m || bends(pose, kBend * voxel_size_m)) {
      kept.push_back(current);
      between.clear();
    } else if (travel(bucket, between.empty() ? kept.back() : between.back(), current) >=
               kBend * voxel_size_m) {
      between.push_back(current);
    }
    current = pose;
  }

  /// Is a pose since the last kept one off the straight way from there to `pose`?
  bool bends(const Pose& pose, double tolerance_m) const {
    const auto off = [&](const Pose& mid) {
      for (const Vec3& p : mouth_corners(bucket)) {
        const Vec3 a = kept.back() * p, along = pose * p - a, to = mid * p - a;
        const double length2 = along.squaredNorm();
        const double s = length2 > 0 ? std::clamp(to.dot(along) / length2, 0.0, 1.0) : 0.0;
        if ((to - s * along).squaredNorm() > tolerance_m * tolerance_m) return true;
      }
      return false;
    };
    return off(current) || std::any_of(between.begin(), between.end(), off);
  }

  /// Carves on in step with the path, so that no single update bears it all: what the last stretch
  /// swept is out of phi by the end of this one.
  void carve(Soil& soil, std::vector<Coord3>& changed) {
    const double stretch_m = kRefresh * soil.voxel_size_m();
    if (carving) {
      const double left = std::max(0.0, 1 - moved_m / stretch_m);
      const auto keep = static_cast<std::size_t>(static_cast<double>(carving_chunks) * left);
      const std::size_t pending = carving->pending().size();
      if (pending > keep) carving->carve(soil, pending - keep, changed);
      if (keep == 0) carving.reset();
    }
    if (moved_m < stretch_m) return;
    carving = cut_since_stretch(soil);
    carving_chunks = carving ? carving->pending().size() : 0;
    mouth_cut = body_cut = false;
    moved_m = 0;
    forget(kHistory * soil.voxel_size_m());
  }

  /// What has cut soil since the last stretch began, up to the current pose.
  std::optional<SurfaceCut> cut_since_stretch(const Soil& soil) {
    if (!mouth_cut && !body_cut) return std::nullopt;
    kept.push_back(current);
    SurfaceCut cut(soil, bucket, SweepWindow{kept, fresh, begins, mouth_cut, body_cut});
    kept.pop_back();
    return cut;
  }

  /// Carves all that has been swept so far, until take_back().
  void carve_ahead(Soil& soil, std::vector<Coord3>& changed) {
    for (std::optional<SurfaceCut> cut : {carving, cut_since_stretch(soil)}) {
      if (!cut) continue;
      for (const Coord3& origin : cut->pending()) {
        Before& before = ahead.emplace_back();
        before.origin = origin;
        if (const Chunk* chunk = soil.find(origin)) {
          before.phi.emplace();
          std::copy_n(chunk->phi, kLeafSize, before.phi->data());
        }
      }
      cut->carve(soil, cut->pending().size(), changed);
    }
  }

  void take_back(Soil& soil, std::vector<Coord3>& changed) {
    for (; !ahead.empty(); ahead.pop_back()) {
      const Before& before = ahead.back();
      Chunk* chunk = soil.find(before.origin);
      if (chunk == nullptr) continue;
      changed.push_back(before.origin);
      if (before.phi) {
        std::copy_n(before.phi->data(), kLeafSize, chunk->phi);
        soil.phi_changed(*chunk);
      } else {
        soil.drop(before.origin);
      }
    }
  }

  /// Drops what is farther back than `length_m`.
  void forget(double length_m) {
    double length = kept.empty() ? 0 : travel(bucket, kept.back(), current);
    std::size_t first = kept.size();
    while (first > 0 && length < length_m) {
      --first;
      if (first > 0) length += travel(bucket, kept[first - 1], kept[first]);
    }
    if (first > 0) begins = false;
    kept.erase(kept.begin(), kept.begin() + static_cast<std::ptrdiff_t>(first));
    fresh = kept.size();
  }
};

Tracker::Tracker(Soil& soil, std::vector<Bucket> buckets) : soil_(soil) {
  for (Bucket& bucket : buckets) {
    bucket.validate();
    auto machine = std::make_unique<Machine>();
    machine->facets = facets(bucket);
    machine->bucket = std::move(bucket);
    machine->ledger.sample_m3 = soil.sample_m3();
    machines_.push_back(std::move(machine));
  }
}

Tracker::~Tracker() = default;

double Tracker::tolerance_m() const { return kTolerance * soil_.voxel_size_m(); }
double Tracker::stride_m() const { return kStride * soil_.voxel_size_m(); }

Update Tracker::update(std::size_t machine, const Pose& world_from_bucket) {
  Machine& m = *machines_.at(machine);
  std::vector<Pose> path{m.placed ? m.current : world_from_bucket};
  if (m.placed) trace(m.current, world_from_bucket, m.bucket, tolerance_m(), stride_m(), path);
  return update(machine, path);
}

Update Tracker::update(std::size_t machine, std::span<const Pose> path) {
  Machine& m = *machines_.at(machine);
  const std::int64_t cut_before = m.ledger.captured + m.ledger.displaced;
  // So that the ground is the same whether or not anyone read it on the way.
  for (auto it = machines_.rbegin(); it != machines_.rend(); ++it) {
    (*it)->take_back(soil_, changed_);
  }
  if (!m.placed && !path.empty()) {
    const Cut cut = stamp(soil_, m.bucket, path.front());
    m.ledger.displaced += cut.displaced;
    m.body_cut = cut.displaced > 0;
    m.current = path.front();
    m.placed = true;
  }
  // A load leaves at a pose, so the path is dug from each pose that dumps to the next.
  for (std::size_t from = 0, i = 0; i < path.size(); ++i) {
    const bool dumps = m.bucket.dump_angle_rad && looks_down(path[i]) >= *m.bucket.dump_angle_rad;
    if (!dumps && i + 1 < path.size()) continue;
    const Cut cut = excavate(soil_, m.facets, path.subspan(from, i - from + 1));
    m.ledger.captured += cut.captured;
    m.ledger.displaced += cut.displaced;
    if (dumps) m.ledger.dumped = m.ledger.captured;
    m.mouth_cut |= cut.captured > 0;
    m.body_cut |= cut.displaced > 0;
    from = i;
  }
  for (std::size_t i = 1; i < path.size(); ++i) {
    m.move_to(path[i], soil_.voxel_size_m());
  }
  m.carve(soil_, changed_);
  if (changed_.size() > 2 * changed_unique_ + 1024) compact_changed();
  const std::int64_t cut = m.ledger.captured + m.ledger.displaced - cut_before;
  return {static_cast<double>(cut) * soil_.sample_m3(), m.ledger.bucket_m3()};
}

void Tracker::flush() {
  for (auto& machine : machines_) {
    if (machine->ahead.empty()) machine->carve_ahead(soil_, changed_);
  }
}

const Ledger& Tracker::ledger(std::size_t machine) const { return machines_.at(machine)->ledger; }

Ledger Tracker::total() const {
  Ledger sum;
  sum.sample_m3 = soil_.sample_m3();
  for (const auto& machine : machines_) {
    sum.captured += machine->ledger.captured;
    sum.displaced += machine->ledger.displaced;
    sum.dumped += machine->ledger.dumped;
  }
  return sum;
}

void Tracker::compact_changed() {
  std::sort(changed_.begin(), changed_.end(), before);
  changed_.erase(std::unique(changed_.begin(), changed_.end()), changed_.end());
  changed_unique_ = changed_.size();
}

std::vector<Coord3> Tracker::take_changed() {
  flush();
  compact_changed();
  changed_unique_ = 0;
  return std::exchange(changed_, {});
}

}  // namespace soilvdb
