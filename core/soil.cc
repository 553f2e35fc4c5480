// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/soil.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <deque>
#include <set>
#include <stdexcept>
#include <string>

#include "core/soil_grids.h"

namespace soilvdb {
namespace {

using Leaf = openvdb::FloatTree::LeafNodeType;

/// A bijective mix of 64 bits (the finaliser of SplitMix64).
constexpr std::uint64_t mix(std::uint64_t v) {
  v = (v ^ (v >> 30)) * 0xbf58476d1ce4e5b9u;
  v = (v ^ (v >> 27)) * 0x94d049bb133111ebu;
  return v ^ (v >> 31);
}

/// One word for a chunk's origin; 21 bits of chunk index per axis.
std::uint64_t key_of(const Coord3& origin) {
  constexpr std::uint64_t kMask = (1u << 21) - 1;
  return (std::uint64_t(origin.x() >> 3) & kMask) << 42 |
         (std::uint64_t(origin.y() >> 3) & kMask) << 21 | (std::uint64_t(origin.z() >> 3) & kMask);
}

openvdb::Coord coord(const Coord3& c) { return {c.x(), c.y(), c.z()}; }

/// The rank-1 lattice i * (1, 7, 18) / 64 mod 1, turned and mirrored in 24 ways and shifted in 64.
///
/// A cell cut by a plane is counted with a root mean square error of 0.0168 of a cell over all
/// directions of the plane, 0.022 in the worst (random points: 0.042 and 0.054; a shifted 4 x 4 x 4
/// grid: 0.018 and 0.072; the lattice without turns: 0.017 and 0.049). The shifts are points of the
/// Kronecker sequence of the plastic number (Roberts 2018), which fills the cell evenly.
struct Patterns {
  CellPoints points[64];
  Patterns() {
    constexpr double kPlastic = 1.2207440846057596;  // root of x^4 = x + 1
    constexpr int kGenerator[3] = {1, 7, 18};
    constexpr int kTurns[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}};
    for (int s = 0; s < 64; ++s) {
      float* axes[3] = {points[s].x, points[s].y, points[s].z};
      for (int a = 0; a < 3; ++a) {
        const int step = kGenerator[kTurns[s % 6][a]] * ((s / 6 >> a & 1) != 0 ? -1 : 1);
        const double shift = s * std::pow(kPlastic, -(a + 1)) + 0.5 / 64;
        for (int i = 0; i < 64; ++i) {
          const double v = i * step / 64.0 + shift;
          axes[a][i] = static_cast<float>(v - std::floor(v));
        }
      }
    }
  }
};

}  // namespace

const CellPoints& sample_points(const Coord3& voxel) {
  static const Patterns patterns;
  const std::uint64_t xy = std::uint64_t{std::uint32_t(voxel.x())} << 32 | std::uint32_t(voxel.y());
  return patterns.points[mix(mix(xy) + std::uint32_t(voxel.z())) >> 58];
}

SoilGrids::SoilGrids(double voxel_size_m, double band_m) {
  surface_ = openvdb::FloatGrid::create(static_cast<float>(band_m));
  surface_->setTransform(openvdb::math::Transform::createLinearTransform(voxel_size_m));
  surface_->setGridClass(openvdb::GRID_LEVEL_SET);
  surface_->setName("surface");
}

/// Resident chunks by origin: open addressing, power-of-two size, never shrinks.
struct Soil::Index {
  std::vector<Chunk*> slots = std::vector<Chunk*>(1024);
  std::deque<Chunk> chunks;  // stable addresses; the last may move into a gap

  std::size_t home(const Coord3& origin) const { return mix(key_of(origin)) & (slots.size() - 1); }
  std::size_t after(std::size_t slot) const { return (slot + 1) & (slots.size() - 1); }
  /// The chunk's slot, or the free one where it would go.
  std::size_t slot(const Coord3& origin) const {
    std::size_t i = home(origin);
    while (slots[i] != nullptr && slots[i]->origin != origin) i = after(i);
    return i;
  }

  Chunk* find(const Coord3& origin) const { return slots[slot(origin)]; }

  Chunk& add(const Coord3& origin) {
    Chunk& chunk = chunks.emplace_back();
    chunk.origin = origin;
    if (chunks.size() * 2 > slots.size()) {
      slots.assign(slots.size() * 2, nullptr);
      for (Chunk& c : chunks) slots[slot(c.origin)] = &c;
    } else {
      slots[slot(origin)] = &chunk;
    }
    return chunk;
  }

  void remove(const Coord3& origin) {
    std::size_t gap = slot(origin);
    Chunk* const gone = slots[gap];
    // Chunks behind the gap move up unless that would put them before their home.
    for (std::size_t i = after(gap); slots[i] != nullptr; i = after(i)) {
      const std::size_t from_home = (i - home(slots[i]->origin)) & (slots.size() - 1);
      if (from_home < ((i - gap) & (slots.size() - 1))) continue;
      slots[gap] = slots[i];
      gap = i;
    }
    slots[gap] = nullptr;
    if (gone != &chunks.back()) {
      slots[slot(chunks.back().origin)] = gone;
      *gone = std::move(chunks.back());
    }
    chunks.pop_back();
  }
};

void Soil::drop(const Coord3& origin) {
  if (find(origin) == nullptr) return;
  index_->remove(origin);
  grids_->surface().tree().addTile(1, coord(origin), static_cast<float>(band_m()), false);
}

Soil::Soil(double voxel_size_m, const Vec3& origin, std::shared_ptr<const BaseSurface> base)
    : h_(voxel_size_m), origin_(origin), base_(std::move(base)), index_(std::make_unique<Index>()) {
  if (!(std::isfinite(h_) && h_ > 0)) {
    throw std::invalid_argument("voxel size must be above 0 m, not " + std::to_string(h_));
  }
  openvdb::initialize();
  grids_ = std::make_unique<SoilGrids>(h_, band_m());
}

Soil::~Soil() = default;

const Chunk* Soil::find(const Coord3& origin) const { return index_->find(origin); }
Chunk* Soil::find(const Coord3& origin) { return index_->find(origin); }

Content Soil::classify(const Coord3& origin) const {
  const Vec3 low = world_from_index(origin.cast<double>() - Vec3::Constant(0.5));
  return base_->classify({low, low + Vec3::Constant(h_ * kLeafSide)});
}

void Soil::read_phi(const Coord3& origin, float* phi) const {
  if (const Chunk* chunk = find(origin)) {
    std::copy_n(chunk->phi, kLeafSize, phi);
  } else {
    base_->distance(world_from_index(origin.cast<double>()), h_, band_m(), phi);
  }
}

void Soil::read_samples(const Coord3& origin, SampleWords& samples) const {
  if (const Chunk* chunk = find(origin)) {
    chunk->samples.expand(samples);
    return;
  }
  const Content content = classify(origin);
  if (content != Content::kMixed) {
    samples.fill(content == Content::kSoil ? Samples::kAllSoil : 0);
    return;
  }
  std::array<float, kLeafSize> phi;
  base_->distance(world_from_index(origin.cast<double>()), h_, band_m(), phi.data());
  // A voxel whose centre is farther from the surface than its corners are from it is all one.
  const float clear = static_cast<float>(h_ * 0.9);
  for (int n = 0; n < kLeafSize; ++n) {
    if (std::abs(phi[n]) > clear) {
      samples[n] = phi[n] < 0 ? Samples::kAllSoil : 0;
      continue;
    }
    const Coord3 voxel = origin + Coord3(n >> 6, n >> 3 & 7, n & 7);
    samples[n] = base_->occupancy(world_from_index(voxel.cast<double>() - Vec3::Constant(0.5)), h_,
                                  sample_points(voxel));
  }
}

Chunk& Soil::make(const Coord3& origin) {
  if (Chunk* chunk = find(origin)) return *chunk;
  std::array<float, kLeafSize> phi;
  SampleWords samples;
  read_phi(origin, phi.data());
  read_samples(origin, samples);
  restore(origin, phi.data(), samples, 0);
  Chunk& chunk = *find(origin);
  chunk.base = chunk.now;
  return chunk;
}

void Soil::restore(const Coord3& origin, const float* phi, const SampleWords& samples,
                   std::uint32_t base) {
  if (find(origin) != nullptr) throw std::invalid_argument("the chunk is resident already");
  auto* leaf = new Leaf(coord(origin), static_cast<float>(band_m()));
  grids_->surface().tree().addLeaf(leaf);
  Chunk& chunk = index_->add(origin);
  chunk.phi = leaf->buffer().data();
  std::copy_n(phi, kLeafSize, chunk.phi);
  chunk.samples.assign(samples);
  chunk.now = chunk.samples.count();
  chunk.base = base;
  phi_changed(chunk);
}

void Soil::phi_changed(const Chunk& chunk) {
  const float band = static_cast<float>(band_m());
  auto* leaf = grids_->surface().tree().probeLeaf(coord(chunk.origin));
  auto& mask = leaf->getValueMask();
  for (int word = 0; word < kLeafSize / 64; ++word) {
    std::uint64_t active = 0;
    for (int i = 0; i < 64; ++i) {
      active |= std::uint64_t{std::abs(chunk.phi[word * 64 + i]) < band} << i;
    }
    mask.template getWord<openvdb::Index64>(word) = active;
  }
}

std::vector<const Chunk*> Soil::chunks() const {
  std::vector<const Chunk*> all;
  all.reserve(index_->chunks.size());
  for (const Chunk& chunk : index_->chunks) all.push_back(&chunk);
  std::sort(all.begin(), all.end(), [](const Chunk* a, const Chunk* b) {
    return std::lexicographical_compare(a->origin.data(), a->origin.data() + 3, b->origin.data(),
                                        b->origin.data() + 3);
  });
  return all;
}

std::optional<double> Soil::height(double x, double y) const {
  const std::optional<double> base = base_->height(x, y);
  if (!base) return std::nullopt;  // soil only shrinks: none before, none now
  // Down from the base surface to the first change of sign, bilinear between four columns.
  const Vec3 top = index_from_world({x, y, *base});
  const int i = static_cast<int>(std::floor(top.x())), j = static_cast<int>(std::floor(top.y()));
  const double s = top.x() - i, t = top.y() - j;
  const auto floor8 = [](int v) { return v & ~(kLeafSide - 1); };
  struct Column {
    const Chunk* chunk = nullptr;
    int z = 0;
    bool known = false;
  } columns[4];
  const auto value = [&](int c, int k) -> std::optional<double> {
    const int ci = i + (c & 1), cj = j + (c >> 1);
    Column& column = columns[c];
    if (!column.known || column.z != floor8(k)) {
      column = {find({floor8(ci), floor8(cj), floor8(k)}), floor8(k), true};
    }
    if (column.chunk == nullptr) return std::nullopt;
    return column.chunk->phi[(ci & 7) * 64 + (cj & 7) * 8 + (k & 7)];
  };
  const auto layer = [&](int k) -> std::optional<double> {
    double sum = 0;
    for (int c = 0; c < 4; ++c) {
      const double weight = (c & 1 ? s : 1 - s) * (c >> 1 ? t : 1 - t);
      if (weight == 0) continue;
      const auto v = value(c, k);
      if (!v) return std::nullopt;
      sum += weight * *v;
    }
    return sum;
  };
  std::optional<double> above;
  for (int k = static_cast<int>(std::ceil(top.z()));; --k) {
    const std::optional<double> here = layer(k);
    if (here && *here <= 0) {
      if (!above || *above <= 0) return base;
      return world_from_index({0, 0, k + *here / (*here - *above)}).z();
    }
    if (!here && k < top.z() - 1) {  // the resident ground ends here
      return above ? world_from_index({0, 0, k + 1.0}).z() : *base;
    }
    above = here;
  }
}

double Soil::change_m3() const {
  std::int64_t change = 0;
  for (const Chunk& chunk : index_->chunks) {
    change += std::int64_t{chunk.samples.count()} - chunk.base;
  }
  return static_cast<double>(change) * sample_m3();
}

std::uint64_t Soil::active_voxels() const { return grids_->surface().activeVoxelCount(); }

double Soil::resident_m2() const {
  std::vector<std::uint64_t> columns;
  columns.reserve(index_->chunks.size());
  for (const Chunk& c : index_->chunks) columns.push_back(key_of({c.origin.x(), c.origin.y(), 0}));
  std::sort(columns.begin(), columns.end());
  columns.erase(std::unique(columns.begin(), columns.end()), columns.end());
  return static_cast<double>(columns.size()) * h_ * h_ * kLeafSide * kLeafSide;
}

std::uint64_t Soil::memory_bytes() const {
  std::uint64_t bytes = index_->slots.size() * sizeof(Chunk*) + grids_->surface().memUsage();
  for (const Chunk& chunk : index_->chunks) bytes += sizeof(Chunk) + chunk.samples.heap_bytes();
  return bytes;
}

std::uint64_t Soil::state_hash() const {
  const auto all = chunks();
  std::vector<std::uint64_t> digests(all.size());
  tbb::parallel_for(std::size_t{0}, all.size(), [&](std::size_t i) {
    std::uint64_t digest = key_of(all[i]->origin);
    SampleWords samples;
    all[i]->samples.expand(samples);
    for (std::size_t n = 0; n < kLeafSize; ++n) {
      digest = mix(digest ^ std::bit_cast<std::uint32_t>(all[i]->phi[n]));
      digest = mix(digest + samples[n]);
    }
    digests[i] = digest;
  });
  std::uint64_t digest = mix(std::bit_cast<std::uint64_t>(h_));
  for (int a = 0; a < 3; ++a) digest = mix(digest ^ std::bit_cast<std::uint64_t>(origin_[a]));
  for (const std::uint64_t d : digests) digest = mix(digest ^ d) + 1;
  return digest;
}

}  // namespace soilvdb
