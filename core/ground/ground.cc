// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/ground.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <stdexcept>
#include <string>

#include "core/ground/ground_state.h"
#include "core/lattice/affine.h"
#include "core/lattice/splitmix64.h"
#include "soilvdb/chunk_range.h"

namespace soilvdb::inline v0 {
namespace {

/// One word for a chunk's origin; 21 bits of chunk index per axis.
std::uint64_t key(const Coord3& origin) {
  constexpr std::uint64_t kMask = (1u << 21) - 1;
  return (std::uint64_t(origin.x() >> 3) & kMask) << 42 |
         (std::uint64_t(origin.y() >> 3) & kMask) << 21 | (std::uint64_t(origin.z() >> 3) & kMask);
}

}  // namespace

Ground::Ground(double voxel_size_m, const Vec3& origin,
               std::shared_ptr<const InitialTerrain> terrain)
    : h_(voxel_size_m), origin_(origin), terrain_(std::move(terrain)) {
  if (!(std::isfinite(h_) && h_ > 0)) {
    throw std::invalid_argument("voxel size must be above 0 m, not " + std::to_string(h_));
  }
  state_ = std::make_unique<State>();
  state_->grid->setTransform(openvdb::math::Transform::createLinearTransform(h_));
}

Ground::~Ground() = default;

/// A copy without memory limit. By leaves: OpenVDB's own copy starts tasks for each node.
Ground::State::State(const State& other)
    : grid(SampleGrid::create(static_cast<const openvdb::GridBase&>(*other.grid))),
      touched(other.touched),
      above(other.above),
      any_above(other.any_above.load()) {
  Accessor leaves(tree);
  for (auto leaf = other.tree.cbeginLeaf(); leaf; ++leaf) add(new SampleLeaf(*leaf), leaves);
}

std::unique_ptr<Ground> Ground::clone() const {
  const auto is_swapped = [](const Chunk* chunk) { return chunk->swap_record != 0; };
  if (store_ != nullptr) {
    const std::vector<const Chunk*> all = chunks();
    if (std::any_of(all.begin(), all.end(), is_swapped))
      throw std::logic_error("ground in a swap store can't be cloned: the store has one owner");
  }
  auto same = std::make_unique<Ground>(h_, origin_, terrain_);
  same->state_ = std::make_unique<State>(*state_);
  return same;
}

const Chunk* Ground::find(const Coord3& origin) const {
  const std::shared_lock lock(state_->mutex);
  const SampleLeaf* leaf = state_->find(origin);
  return leaf != nullptr ? &leaf->chunk : nullptr;
}

const SampleGrid& Ground::grid() const { return *state_->grid; }

Content Ground::classify(const Coord3& origin) const {
  const Vec3 low = world_from_index(origin.cast<double>() - Vec3::Constant(0.5));
  return terrain_->classify({low, low + Vec3::Constant(h_ * kChunkSide)});
}

bool Ground::is_air(const Eigen::AlignedBox3d& box) const {
  if (terrain_->classify(box) != Content::kAir) return false;
  if (!state_->any_above.load(std::memory_order_acquire)) return true;
  const auto cell = [&](const Vec3& p) -> Coord3 {
    return (index_from_world(p) + Vec3::Constant(0.5)).array().floor().matrix().cast<int>();
  };
  const std::shared_lock lock(state_->mutex);
  const auto part =
      Eigen::AlignedBox3i(cell(box.min()), cell(box.max())).intersection(state_->above);
  if (part.isEmpty()) return true;
  bool air = true;
  State::ConstAccessor leaves(state_->tree);
  for_each_chunk({part.min().cast<double>(), part.max().cast<double>()}, [&](const Coord3& origin) {
    if (!air) return;
    const SampleLeaf* leaf = leaves.probeConstLeaf(to_coord(origin));
    // Soil of other chunks is the initial terrain's, which has none here.
    if (leaf == nullptr || leaf->chunk.soil_count == 0 || !leaf->chunk.above) return;
    const Coord3 low = part.min().cwiseMax(origin);
    const Coord3 high = part.max().cwiseMin(origin + Coord3::Constant(kChunkSide - 1));
    for (int x = low.x(); x <= high.x(); ++x)
      for (int y = low.y(); y <= high.y(); ++y)
        for (int z = low.z(); z <= high.z(); ++z) air = air && !leaf->isValueOn({x, y, z});
  });
  return air;
}

Eigen::AlignedBox3i Ground::above_base() const {
  const std::shared_lock lock(state_->mutex);
  return state_->above;
}

void Ground::read_samples(const Coord3& origin, SampleWords& samples) const {
  const Chunk* chunk = find(origin);
  if (chunk == nullptr) return read_base(origin, samples);
  chunk->swap_record == 0 ? chunk->samples.expand(samples) : copy(*chunk).samples.expand(samples);
}

void Ground::read_loose(const Coord3& origin, SampleWords& loose) const {
  const Chunk* chunk = find(origin);
  if (chunk == nullptr || chunk->loose_count == 0) return loose.fill(0);
  chunk->swap_record == 0 ? chunk->loose.expand(loose) : copy(*chunk).loose.expand(loose);
}

void Ground::read_base(const Coord3& origin, SampleWords& samples) const {
  const Content content = classify(origin);
  if (content == Content::kMixed) {
    terrain_->samples(origin, world_from_index(origin.cast<double>()), h_, samples);
  } else {
    samples.fill(content == Content::kSoil ? kAllSoil : 0);
  }
}

std::size_t Ground::chunk_count() const { return state_->chunks; }

std::vector<const Chunk*> Ground::chunks() const {
  std::vector<const Chunk*> all;
  all.reserve(state_->chunks);
  for (auto leaf = state_->tree.cbeginLeaf(); leaf; ++leaf) all.push_back(&leaf->chunk);
  std::sort(all.begin(), all.end(),
            [](const Chunk* a, const Chunk* b) { return before(a->origin, b->origin); });
  return all;
}

std::vector<Coord3> Ground::origins() const {
  std::vector<Coord3> all;
  for (const Chunk* chunk : chunks()) all.push_back(chunk->origin);
  return all;
}

double Ground::change_m3() const {
  std::int64_t change = 0;
  for (const Chunk* c : chunks()) {
    const Chunk& chunk = *c;
    const std::uint32_t now =
        chunk.swap_record == 0 ? chunk.samples.count() : copy(chunk).samples.count();
    change += std::int64_t{now} - chunk.base_count;
  }
  return static_cast<double>(change) * sample_m3();
}

std::uint64_t Ground::active_voxels() const { return state_->tree.activeVoxelCount(); }

double Ground::resident_m2() const {
  std::vector<std::uint64_t> columns;
  columns.reserve(state_->chunks);
  for (auto leaf = state_->tree.cbeginLeaf(); leaf; ++leaf) {
    const Coord3& o = leaf->chunk.origin;
    columns.push_back(key({o.x(), o.y(), 0}));
  }
  std::sort(columns.begin(), columns.end());
  columns.erase(std::unique(columns.begin(), columns.end()), columns.end());
  return static_cast<double>(columns.size()) * h_ * h_ * kChunkSide * kChunkSide;
}

std::uint64_t Ground::state_hash() const {
  const auto all = chunks();
  std::vector<std::uint64_t> digests(all.size());
  tbb::parallel_for(std::size_t{0}, all.size(), [&](std::size_t i) {
    std::uint64_t digest = key(all[i]->origin);
    SampleWords samples;
    read_samples(all[i]->origin, samples);
    for (const std::uint64_t word : samples) digest = splitmix64(digest + word);
    if (all[i]->loose_count > 0) {
      read_loose(all[i]->origin, samples);
      for (const std::uint64_t word : samples) digest = splitmix64(digest + word);
    }
    digests[i] = digest;
  });
  std::uint64_t digest = splitmix64(std::bit_cast<std::uint64_t>(h_));
  for (int a = 0; a < 3; ++a)
    digest = splitmix64(digest ^ std::bit_cast<std::uint64_t>(origin_[a]));
  for (const std::uint64_t d : digests) digest = splitmix64(digest ^ d) + 1;
  return digest;
}

}  // namespace soilvdb::inline v0
