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

void Soil::read_samples(const Coord3& origin, SampleWords& samples) const {
  const Chunk* chunk = find(origin);
  if (chunk != nullptr) {
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
  if (chunk != nullptr) return chunk->base;
  SampleWords words;
  read_samples(origin, words);
  return count(words);
}

Chunk* Soil::with_samples(const Coord3& origin) {
  if (Chunk* chunk = find(origin)) {
    warm(*chunk);
    if (chunk->now > 0) index_->touch(*chunk);
    return chunk;
  }
  SampleWords words;
  read_samples(origin, words);
  const std::uint16_t soil = count(words);
  if (soil == 0) return nullptr;
  Chunk& chunk = make(origin);
  chunk.samples.assign(words);
  chunk.base = chunk.now = soil;
  return &chunk;
}

void Soil::restore(const Coord3& origin, const SampleWords& samples, std::uint32_t base) {
  if (find(origin) != nullptr) throw std::invalid_argument("the chunk is resident already");
  Chunk& chunk = make(origin);
  chunk.samples.assign(samples);
  chunk.now = static_cast<std::uint16_t>(chunk.samples.count());
  chunk.base = static_cast<std::uint16_t>(base);
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

double Soil::change_m3() const {
  std::int64_t change = 0;
  for (const Chunk& chunk : index_->chunks()) {
    const std::uint32_t now =
        chunk.piece == 0 ? chunk.samples.count() : copy(chunk).samples.count();
    change += std::int64_t{now} - chunk.base;
  }
  return static_cast<double>(change) * sample_m3();
}

std::uint64_t Soil::active_voxels() const {
  std::uint64_t active = 0;
  SampleWords words;
  for (const Chunk& chunk : index_->chunks()) {
    if (chunk.now == 0) continue;
    read_samples(chunk.origin, words);
    active += kLeafSize - static_cast<std::uint64_t>(std::count(words.begin(), words.end(), 0u));
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
    read_samples(all[i]->origin, samples);
    for (const std::uint64_t word : samples) digest = mix(digest + word);
    digests[i] = digest;
  });
  std::uint64_t digest = mix(std::bit_cast<std::uint64_t>(h_));
  for (int a = 0; a < 3; ++a) digest = mix(digest ^ std::bit_cast<std::uint64_t>(origin_[a]));
  for (const std::uint64_t d : digests) digest = mix(digest ^ d) + 1;
  return digest;
}

}  // namespace soilvdb
