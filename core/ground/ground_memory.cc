// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Memory of the ground, and its limit by the clock algorithm. A hand goes round all chunks and
// evicts those that were not used since its last visit. Chunks in use stand in a list, and the
// others in a sum, so the memory is known without a visit to all chunks. The leaf of a chunk stays,
// about a quarter of its memory, so lower limits cannot be kept.
#include <stdexcept>
#include <string>

#include "core/constants.h"
#include "core/ground/ground_state.h"

namespace soilvdb::inline v0 {
namespace {

/// The head of a record in the swap store, which identifies its chunk.
struct Label {
  std::int32_t origin[3];
  std::uint32_t soil_count;
  explicit Label(const Chunk& chunk)
      : origin{chunk.origin.x(), chunk.origin.y(), chunk.origin.z()},
        soil_count(chunk.soil_count) {}
};

}  // namespace

std::uint64_t Ground::memory_bytes() const {
  std::uint64_t bytes = state_->bytes() + terrain_->memory_bytes();
  for (auto leaf = state_->tree.cbeginLeaf(); leaf; ++leaf) bytes += leaf->chunk.heap_bytes();
  return bytes;
}

void Ground::set_memory_limit(std::uint64_t bytes, std::shared_ptr<SwapStore> store) {
  if (store_ != nullptr) throw std::logic_error("memory is limited already");
  limit_bytes_ = bytes;
  store_ = std::move(store);
  for (SampleLeaf* leaf : state_->leaves()) {
    leaf->chunk.used = State::kUsed;
    state_->idle_bytes += leaf->chunk.heap_bytes();
  }
}

void Ground::evict() {
  if (store_ == nullptr) return;
  State& state = *state_;
  for (const Coord3& origin : state.in_use) {  // none is any more
    SampleLeaf* leaf = state.find(origin);
    if (leaf == nullptr || leaf->chunk.used != State::kInUse) continue;
    leaf->chunk.used = State::kUsed;
    state.idle_bytes += leaf->chunk.heap_bytes();
  }
  state.in_use.clear();
  const auto held = [&] { return state.bytes() + terrain_->memory_bytes() + state.idle_bytes; };
  if (held() <= limit_bytes_) return;
  // Unless other threads may read it.
  if (terrain_->memory_bytes() > limit_bytes_ / kBaseMemoryDivisor && terrain_.use_count() == 1)
    terrain_->forget();
  const std::vector<SampleLeaf*> leaves = state.leaves();
  for (std::size_t seen = 0; seen < 2 * leaves.size(); ++seen) {
    if (held() <= limit_bytes_ - limit_bytes_ / kPageOutDivisor) return;
    state.hand = state.hand + 1 < leaves.size() ? state.hand + 1 : 0;
    Chunk& chunk = leaves[state.hand]->chunk;
    const std::size_t bytes = chunk.heap_bytes();
    if (bytes == 0) continue;
    if (chunk.used == State::kUsed) {
      chunk.used = State::kIdle;
      continue;
    }
    store(chunk);
    state.idle_bytes -= bytes;
  }
  if (held() > limit_bytes_)
    throw std::runtime_error(
        "the ground needs more memory than " + std::to_string(limit_bytes_ >> 20) +
        " MB: a list of its " + std::to_string(state.chunks) +
        " chunks and its initial terrain take " + std::to_string((held() >> 20) + 1) + " MB");
}

Chunk Ground::copy(const Chunk& chunk) const {
  Chunk same;  // but for what the ground notes of it
  same.origin = chunk.origin;
  same.swap_record = chunk.swap_record;
  same.base_count = chunk.base_count;
  same.soil_count = chunk.soil_count;
  same.loose_count = chunk.loose_count;
  same.above = chunk.above;
  same.samples = chunk.samples;
  same.loose = chunk.loose;
  if (same.swap_record != 0) load(same);
  return same;
}

void Ground::store(Chunk& chunk) {
  const Label label(chunk);
  std::string bytes(reinterpret_cast<const char*>(&label), sizeof(label));
  chunk.samples.put(bytes);
  chunk.loose.put(bytes);
  chunk.swap_record = store_->put(bytes);
  chunk.samples = {};
  chunk.loose = {};
}

/// Reads a chunk's record in the swap store, which stays there. @return its size
std::size_t Ground::load(Chunk& chunk) const {
  std::string bytes;
  store_->get(chunk.swap_record, bytes);
  const Label label(chunk);
  std::string_view rest = bytes;
  Samples samples, loose;
  const bool good = rest.starts_with({reinterpret_cast<const char*>(&label), sizeof(label)}) &&
                    (rest.remove_prefix(sizeof(label)), samples.take(rest) && loose.take(rest)) &&
                    rest.empty() && samples.count() == chunk.soil_count &&
                    loose.count() == chunk.loose_count;
  if (!good) throw std::runtime_error("the swap store returned another chunk");
  chunk.samples = std::move(samples);
  chunk.loose = std::move(loose);
  chunk.swap_record = 0;
  return bytes.size();
}

}  // namespace soilvdb::inline v0
