// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/soil.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <stdexcept>
#include <string>

#include "core/affine.h"
#include "core/chunk_index.h"
#include "core/chunk_range.h"

namespace soilvdb {
namespace {

SOILVDB_FOR_CPUS std::uint16_t count(const SampleWords& words) {
  int sum = 0;
  for (const std::uint64_t word : words) sum += std::popcount(word);
  return static_cast<std::uint16_t>(sum);
}

/// Metres to units of phi.
SOILVDB_FOR_CPUS void quantise(const float* phi_m, float step_m, Phi& phi) {
  const float scale = 1 / step_m;
  for (int n = 0; n < kLeafSize; ++n) {
    const float units = phi_m[n] * scale;
    const float whole = units + (units < 0 ? -0.5f : 0.5f);
    phi[n] = static_cast<std::int16_t>(
        std::min(std::max(whole, -static_cast<float>(kPhiMax)), static_cast<float>(kPhiMax)));
  }
}

SOILVDB_FOR_CPUS void to_metres(const Phi& phi, float band_m, float* phi_m) {
  const float step_m = band_m / kPhiMax;
  for (int n = 0; n < kLeafSize; ++n) {
    const float inside = static_cast<float>(phi[n]) * step_m;
    phi_m[n] = phi[n] == kPhiMax ? band_m : phi[n] == -kPhiMax ? -band_m : inside;
  }
}

}  // namespace

Soil::Soil(double voxel_size_m, const Vec3& origin, std::shared_ptr<const BaseSurface> base)
    : h_(voxel_size_m), origin_(origin), base_(std::move(base)), index_(std::make_unique<Index>()) {
  if (!(std::isfinite(h_) && h_ > 0)) {
    throw std::invalid_argument("voxel size must be above 0 m, not " + std::to_string(h_));
  }
}

Soil::~Soil() = default;

const Chunk* Soil::find(const Coord3& origin) const { return index_->find(origin); }
Chunk* Soil::find(const Coord3& origin) { return index_->find(origin); }
Chunk& Soil::make(const Coord3& origin) {
  Chunk* chunk = find(origin);
  if (chunk == nullptr) {
    chunk = &index_->add(origin);
  } else {
    index_->touch(*chunk);
  }
  warm(*chunk);
  return *chunk;
}
void Soil::copy_from(const Soil& other, const Coord3& origin) {
  const Chunk* chunk = other.find(origin);
  if (chunk == nullptr) return drop(origin);
  Chunk &mine = make(origin), same = other.copy(*chunk);
  same.touched = mine.touched;
  same.used = mine.used;
  mine = std::move(same);
}
void Soil::drop(const Coord3& origin) {
  if (Chunk* chunk = find(origin)) warm(*chunk);
  index_->remove(origin);
}
std::vector<Coord3> Soil::take_touched() { return index_->take_touched(); }

Content Soil::classify(const Coord3& origin) const {
  const Vec3 low = world_from_index(origin.cast<double>() - Vec3::Constant(0.5));
  return base_->classify({low, low + Vec3::Constant(h_ * kLeafSide)});
}

void Soil::read_phi(const Coord3& origin, Phi& phi) const {
  const Chunk* chunk = find(origin);
  std::optional<Chunk> thawed;
  if (chunk != nullptr && chunk->piece != 0) chunk = &thawed.emplace(copy(*chunk));
  if (chunk != nullptr && chunk->phi) {
    chunk->phi.expand(phi);
  } else if (chunk != nullptr && chunk->air) {
    phi.fill(kPhiMax);
  } else {
    float phi_m[kLeafSize];
    base_->distance(world_from_index(origin.cast<double>()), h_, band_m(), phi_m);
    quantise(phi_m, phi_step_m(), phi);
  }
}

void Soil::read_phi(const Coord3& origin, float* phi_m) const {
  Phi phi;
  read_phi(origin, phi);
  to_metres(phi, static_cast<float>(band_m()), phi_m);
}

void Soil::set_phi(Chunk& chunk, const Phi& phi) const {
  chunk.air = *std::min_element(phi.begin(), phi.end()) == kPhiMax;
  if (chunk.air) {
    chunk.phi.reset();
  } else {
    chunk.phi.assign(phi);
  }
}

void Soil::read_samples(const Coord3& origin, SampleWords& samples) const {
  const Chunk* chunk = find(origin);
  if (chunk != nullptr && chunk->sampled) {
    return chunk->piece == 0 ? chunk->samples.expand(samples)
                             : copy(*chunk).samples.expand(samples);
  }
  const Content content = classify(origin);
  if (content == Content::kMixed) {
    base_->samples(origin, world_from_index(origin.cast<double>()), h_, samples);
  } else {
    samples.fill(content == Content::kSoil ? kAllSoil : 0);
  }
}

std::uint32_t Soil::base_samples(const Coord3& origin) const {
  const Chunk* chunk = find(origin);
  if (chunk != nullptr && chunk->sampled) return chunk->base;
  SampleWords words;
  read_samples(origin, words);
  return count(words);
}

Chunk* Soil::with_samples(const Coord3& origin) {
  Chunk* chunk = find(origin);
  if (chunk != nullptr) warm(*chunk);
  if (chunk != nullptr && chunk->sampled) {
    if (chunk->now > 0) index_->touch(*chunk);
    return chunk;
  }
  SampleWords words;
  read_samples(origin, words);
  const std::uint16_t soil = count(words);
  if (chunk == nullptr && soil == 0) return nullptr;
  if (chunk == nullptr || soil > 0) chunk = &make(origin);
  chunk->samples.assign(words);
  chunk->base = chunk->now = soil;
  chunk->sampled = true;
  return chunk;
}

void Soil::restore(const Coord3& origin, const float* phi_m, const SampleWords& samples,
                   std::uint32_t base) {
  if (find(origin) != nullptr) throw std::invalid_argument("the chunk is resident already");
  Chunk& chunk = make(origin);
  Phi phi;
  quantise(phi_m, phi_step_m(), phi);
  set_phi(chunk, phi);
  chunk.samples.assign(samples);
  chunk.now = static_cast<std::uint16_t>(chunk.samples.count());
  chunk.base = static_cast<std::uint16_t>(base);
  chunk.sampled = true;
}

std::size_t Soil::chunk_count() const { return index_->chunks().size(); }

std::vector<const Chunk*> Soil::chunks() const {
  std::vector<const Chunk*> all;
  all.reserve(index_->chunks().size());
  for (const Chunk& chunk : index_->chunks()) all.push_back(&chunk);
  std::sort(all.begin(), all.end(),
            [](const Chunk* a, const Chunk* b) { return before(a->origin, b->origin); });
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
    bool resident = false, known = false;
    int z = 0;
    Phi phi;
  } columns[4];
  const auto value = [&](int c, int k) -> std::optional<double> {
    const int ci = i + (c & 1), cj = j + (c >> 1);
    Column& column = columns[c];
    if (!column.known || column.z != floor8(k)) {
      const Coord3 origin(floor8(ci), floor8(cj), floor8(k));
      column.resident = find(origin) != nullptr;
      column.known = true;
      column.z = origin.z();
      if (column.resident) read_phi(origin, column.phi);
    }
    if (!column.resident) return std::nullopt;
    return column.phi[static_cast<std::size_t>((ci & 7) * 64 + (cj & 7) * 8 + (k & 7))];
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
  for (const Chunk& chunk : index_->chunks()) {
    if (!chunk.sampled) continue;
    const std::uint32_t now =
        chunk.piece == 0 ? chunk.samples.count() : copy(chunk).samples.count();
    change += std::int64_t{now} - chunk.base;
  }
  return static_cast<double>(change) * sample_m3();
}

std::uint64_t Soil::active_voxels() const {
  std::uint64_t active = 0;
  Phi phi;
  for (const Chunk& chunk : index_->chunks()) {
    if (chunk.air) continue;
    read_phi(chunk.origin, phi);
    active += static_cast<std::uint64_t>(
        std::count_if(phi.begin(), phi.end(), [](int v) { return std::abs(v) < kPhiMax; }));
  }
  return active;
}

double Soil::resident_m2() const {
  std::vector<std::uint64_t> columns;
  columns.reserve(index_->chunks().size());
  for (const Chunk& c : index_->chunks())
    columns.push_back(Index::key({c.origin.x(), c.origin.y(), 0}));
  std::sort(columns.begin(), columns.end());
  columns.erase(std::unique(columns.begin(), columns.end()), columns.end());
  return static_cast<double>(columns.size()) * h_ * h_ * kLeafSide * kLeafSide;
}

std::uint64_t Soil::state_hash() const {
  const auto all = chunks();
  std::vector<std::uint64_t> digests(all.size());
  tbb::parallel_for(std::size_t{0}, all.size(), [&](std::size_t i) {
    std::uint64_t digest = Index::key(all[i]->origin);
    SampleWords samples;
    Phi phi;
    read_samples(all[i]->origin, samples);
    read_phi(all[i]->origin, phi);
    for (std::size_t n = 0; n < kLeafSize; ++n) {
      digest = mix(digest ^ static_cast<std::uint16_t>(phi[n]));
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
