// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Ground that was dug, as the initial terrain of ground with other voxels.
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "core/constants.h"
#include "core/lattice/chunk_math.h"
#include "core/surface/distance_window.h"
#include "soilvdb/chunk_range.h"
#include "soilvdb/initial_terrain.h"
#include "soilvdb/surface_height.h"

namespace soilvdb::inline v0 {
namespace {

class GroundTerrain final : public InitialTerrain {
 public:
  explicit GroundTerrain(std::shared_ptr<const Ground> ground)
      : ground_(std::move(ground)),
        ground_bytes_(ground_->memory_bytes() - ground_->terrain().memory_bytes()),
        tiles_(*ground_),
        heights_(surface_heights(*ground_)) {
    resident_ = ground_->origins();
  }

  Content classify(const Eigen::AlignedBox3d& box) const override {
    const Content base = ground_->terrain().classify(box);
    // The surface leaves the cells that hold it by less than a voxel.
    const Eigen::AlignedBox3d cells = indices(box, 1);
    if (!any_resident(cells)) return base;
    if ((cells.sizes() / kChunkSide).array().ceil().prod() > kMaxClassifyChunks)
      return base == Content::kAir && ground_->is_air(box) ? base : Content::kMixed;
    bool soil = false, air = false;
    for_each_chunk(cells, [&](const Coord3& at) {
      if (!(soil && air)) look(at, cells, soil, air);
    });
    return soil && air ? Content::kMixed : soil ? Content::kSoil : Content::kAir;
  }

  bool has_data(const Eigen::AlignedBox3d& box) const override {
    return ground_->terrain().has_data(box);
  }

  void distance(const Vec3& first, double h, double band, float* phi) const override {
    ground_->terrain().distance(first, h, band, phi);
    const Eigen::AlignedBox3d box = indices(voxels(first, h), 0);
    if (!is_dug(box)) return;
    View view(tiles_, box);
    for (int n = 0; n < kChunkVoxels; ++n) {
      const Vec3 p = ground_->index_from_world(first + h * numbered_voxel(n).cast<double>());
      const DistanceWindow::Value value = view.at(p);
      if ((value.flags & (DistanceWindow::kDifferent | DistanceWindow::kMissing)) !=
          DistanceWindow::kDifferent)
        continue;
      const double d = value.distance_m;
      // Beyond the band of the ground it says no more than which side it is.
      if (std::abs(d) >= ground_->band_m() && (d < 0) == (phi[n] < 0)) continue;
      phi[n] = static_cast<float>(std::clamp(d, -band, band));
    }
  }

  void samples(const Coord3& chunk, const Vec3& first, double h,
               SampleWords& words) const override {
    ground_->terrain().samples(chunk, first, h, words);
    const Eigen::AlignedBox3d box = indices(voxels(first, h), 0);
    if (!is_dug(box)) return;
    View view(tiles_, box);
    for (int n = 0; n < kChunkVoxels; ++n) {
      const Coord3 cell = numbered_voxel(n);
      const Vec3 low = first + h * (cell.cast<double>() - Vec3::Constant(0.5));
      const Vec3 from = ground_->index_from_world(low),
                 to = ground_->index_from_world(low + Vec3::Constant(h));
      if (!view.whole && !is_dug({from, to})) continue;
      std::uint64_t& word = words[static_cast<std::size_t>(n)];
      // Many cells take longer to look at than 64 points do.
      if (view.whole && h <= ground_->voxel_size_m()) {
        const DistanceWindow::Common common = view.window.common(from, to);
        if ((common.any & DistanceWindow::kChanged) == 0) continue;
        if ((common.all & DistanceWindow::kChanged) != 0 && common.soil != common.air) {
          word = common.soil ? kAllSoil : 0;
          continue;
        }
      }
      const CellPoints& points = sample_points(chunk + cell);
      std::uint64_t changed = 0, soil = 0;
      if (view.whole) {
        view.window.at(points, low, h, *ground_, changed, soil);
      } else {
        for (int i = 0; i < 64; ++i) {
          const Vec3 p =
              ground_->index_from_world(low + h * Vec3(points.x[i], points.y[i], points.z[i]));
          const DistanceWindow::Value value = view.at(p);
          changed |= std::uint64_t{(value.flags & DistanceWindow::kChanged) != 0} << i;
          soil |= std::uint64_t{value.distance_m < 0} << i;
        }
      }
      word = (word & ~changed) | (soil & changed);
    }
  }

  std::uint64_t memory_bytes() const override {
    return ground_bytes_ + ground_->terrain().memory_bytes() + tiles_.bytes() +
           resident_.capacity() * sizeof(Coord3);
  }
  void forget() const override {
    tiles_.forget();
    ground_->terrain().forget();
  }
  std::optional<double> height(double x, double y) const override { return heights_(x, y); }
  const Ground* ground() const override { return ground_.get(); }

 private:
  /// A box of the ground, read whole unless that is too much: then about each point.
  struct View {
    GroundTiles::Reader tiles;
    DistanceWindow window;
    bool whole;

    View(const GroundTiles& all, const Eigen::AlignedBox3d& box)
        : tiles(all), whole(DistanceWindow::cells(box) <= kMaxWindowVoxels) {
      if (whole) window.read(tiles, box);
    }
    DistanceWindow::Value at(const Vec3& index) {
      if (!whole) window.read(tiles, {index, index});
      return window.at(index);
    }
  };

  /// The box of a chunk's cells.
  static Eigen::AlignedBox3d voxels(const Vec3& first, double h) {
    return {first - Vec3::Constant(h / 2), first + Vec3::Constant(h * (kChunkSide - 0.5))};
  }
  Eigen::AlignedBox3d indices(const Eigen::AlignedBox3d& box, double margin) const {
    return {ground_->index_from_world(box.min()) - Vec3::Constant(margin),
            ground_->index_from_world(box.max()) + Vec3::Constant(margin)};
  }
  /// Is any chunk resident that a box in index space meets?
  bool any_resident(const Eigen::AlignedBox3d& box) const {
    const Coord3 first = chunk_of(box.min()), last = chunk_of(box.max());
    const auto from = std::lower_bound(resident_.begin(), resident_.end(), first.x(),
                                       [](const Coord3& c, int x) { return c.x() < x; });
    const auto to = std::upper_bound(from, resident_.end(), last.x(),
                                     [](int x, const Coord3& c) { return x < c.x(); });
    const double chunks = ((last - first) / kChunkSide + Coord3::Ones()).cast<double>().prod();
    if (chunks > static_cast<double>(to - from))
      return std::any_of(from, to, [&](const Coord3& c) {
        return (c.array() >= first.array()).all() && (c.array() <= last.array()).all();
      });
    for (int x = first.x(); x <= last.x(); x += kChunkSide)
      for (int y = first.y(); y <= last.y(); y += kChunkSide)
        for (int z = first.z(); z <= last.z(); z += kChunkSide)
          if (ground_->find({x, y, z}) != nullptr) return true;
    return false;
  }
  bool is_dug(const Eigen::AlignedBox3d& box) const {
    const Vec3 margin = Vec3::Constant(1);
    return any_resident({box.min() - margin, box.max() + margin});
  }
  /// Whether a chunk has soil and air in a box of index space.
  void look(const Coord3& origin, const Eigen::AlignedBox3d& box, bool& soil, bool& air) const {
    const Vec3 half = Vec3::Constant(0.5), first = origin.cast<double>();
    const Eigen::AlignedBox3d part =
        box.intersection({first - half, first + Vec3::Constant(kChunkSide - 0.5)});
    const Chunk* chunk = ground_->find(origin);
    if (chunk == nullptr) {
      const Content content = ground_->terrain().classify(
          {ground_->world_from_index(part.min()), ground_->world_from_index(part.max())});
      soil |= content != Content::kAir;
      air |= content != Content::kSoil;
      return;
    }
    if (chunk->soil_count == 0 || chunk->soil_count == 64 * kChunkVoxels) {
      (chunk->soil_count == 0 ? air : soil) = true;
      return;
    }
    SampleWords words;
    ground_->read_samples(origin, words);
    const Coord3 low = (part.min() + half - first).array().floor().max(0).matrix().cast<int>();
    const Coord3 high =
        (part.max() + half - first).array().floor().min(kChunkSide - 1).matrix().cast<int>();
    for (int x = low.x(); x <= high.x(); ++x)
      for (int y = low.y(); y <= high.y(); ++y)
        for (int z = low.z(); z <= high.z(); ++z) {
          const std::uint64_t word = words[static_cast<std::size_t>(x * 64 + y * 8 + z)];
          soil |= word != 0;
          air |= word != kAllSoil;
        }
  }

  std::shared_ptr<const Ground> ground_;
  std::uint64_t ground_bytes_;
  std::vector<Coord3> resident_;  // in order
  mutable GroundTiles tiles_;
  std::function<std::optional<double>(double, double)> heights_;
};

}  // namespace

std::unique_ptr<InitialTerrain> make_ground_terrain(std::shared_ptr<const Ground> ground) {
  return std::make_unique<GroundTerrain>(std::move(ground));
}

}  // namespace soilvdb::inline v0
