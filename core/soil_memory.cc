// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What the ground holds of memory, and how it keeps to a limit.
#include <cstring>
#include <stdexcept>
#include <string>

#include "core/chunk_index.h"
#include "core/soil.h"

namespace soilvdb {
namespace {

/// What a piece in the cold store begins with, so that no other chunk's is taken for it.
struct Label {
  std::int32_t origin[3];
  std::uint32_t now;
  explicit Label(const Chunk& chunk)
      : origin{chunk.origin.x(), chunk.origin.y(), chunk.origin.z()}, now(chunk.now) {}
};

}  // namespace

std::uint64_t Soil::memory_bytes() const {
  std::uint64_t bytes = index_->bytes() + base_->memory_bytes();
  for (const Chunk& chunk : index_->chunks()) bytes += chunk.samples.heap_bytes();
  return bytes;
}

void Soil::limit_memory(std::uint64_t bytes, std::shared_ptr<ColdStore> store) {
  if (store_ != nullptr) throw std::logic_error("memory is limited already");
  limit_bytes_ = bytes;
  store_ = std::move(store);
  index_->begin_counting();
}

void Soil::settle() {
  if (store_ == nullptr) return;
  index_->drop_old_tables();
  std::uint64_t heap = index_->count_heap_bytes();
  const auto held = [&] { return index_->bytes() + base_->memory_bytes() + heap; };
  if (held() <= limit_bytes_) return;
  // Unless others may be reading it.
  if (base_->memory_bytes() > limit_bytes_ / 4 && base_.use_count() == 1) base_->forget();
  while (held() > limit_bytes_ - limit_bytes_ / 8) {
    Chunk* const chunk = index_->next_unused();
    if (chunk == nullptr) break;
    const std::size_t bytes = chunk->samples.heap_bytes();
    freeze(*chunk);
    index_->sent_away(bytes);
    heap -= bytes;
  }
  if (held() > limit_bytes_)
    throw std::runtime_error(
        "the ground needs more memory than " + std::to_string(limit_bytes_ >> 20) +
        " MB: a list of its " + std::to_string(index_->chunks().size()) +
        " chunks and what it began as take " + std::to_string((held() >> 20) + 1) + " MB");
}

Chunk Soil::copy(const Chunk& chunk) const {
  Chunk same = chunk;
  same.touched = false;
  same.used = 0;
  if (same.piece != 0) thaw(same);
  return same;
}

void Soil::use(Chunk& chunk) {
  index_->use(chunk);
  if (chunk.piece == 0) return;
  const std::uint32_t piece = chunk.piece;
  store_->drop(piece, thaw(chunk));
}

void Soil::freeze(Chunk& chunk) {
  const Label label(chunk);
  std::string bytes(reinterpret_cast<const char*>(&label), sizeof(label));
  chunk.samples.put(bytes);
  chunk.piece = store_->put(bytes);
  chunk.samples = {};
}

/// Reads what a chunk has in the cold store, and leaves it there. @return its size
std::size_t Soil::thaw(Chunk& chunk) const {
  std::string bytes;
  store_->get(chunk.piece, bytes);
  const Label label(chunk);
  std::string_view rest = bytes;
  Samples samples;
  const bool good = rest.starts_with({reinterpret_cast<const char*>(&label), sizeof(label)}) &&
                    (rest.remove_prefix(sizeof(label)), samples.take(rest)) && rest.empty() &&
                    samples.count() == chunk.now;
  if (!good) throw std::runtime_error("what comes back from the cold store is another chunk");
  chunk.samples = std::move(samples);
  chunk.piece = 0;
  return bytes.size();
}

}  // namespace soilvdb
