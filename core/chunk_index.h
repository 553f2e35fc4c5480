// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Resident chunks by origin.
#pragma once

#include <atomic>
#include <deque>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "core/chunk_list.h"
#include "core/mix.h"
#include "core/soil.h"

namespace soilvdb {

/// Open addressing, power-of-two size, never shrinks. find() takes no lock and may run beside
/// add(): it sees every chunk that its own thread added. remove() may run beside nothing.
class Soil::Index {
 public:
  Index() : table_(new_table(1024)) {}

  Chunk* find(const Coord3& origin) const {
    return table_.load(std::memory_order_acquire)->slot(origin).load(std::memory_order_acquire);
  }

  /// The chunk, made if there is none.
  Chunk& add(const Coord3& origin) {
    const std::lock_guard lock(mutex_);
    Table* table = table_.load(std::memory_order_relaxed);
    std::atomic<Chunk*>& slot = table->slot(origin);
    if (Chunk* chunk = slot.load(std::memory_order_relaxed)) return *chunk;
    Chunk& chunk = chunks_.emplace_back();
    chunk.origin = origin;
    chunk.touched = true;
    touched_.add(origin);
    if (chunks_.size() * 2 <= table->slots.size()) {
      slot.store(&chunk, std::memory_order_release);
      return chunk;
    }
    // The old table stays for those who look into it now.
    Table* larger = new_table(2 * table->slots.size());
    for (Chunk& c : chunks_) larger->slot(c.origin).store(&c, std::memory_order_relaxed);
    table_.store(larger, std::memory_order_release);
    return chunk;
  }

  void remove(const Coord3& origin) {
    Table& table = *table_.load();
    const std::size_t mask = table.slots.size() - 1;
    std::size_t gap = table.index(origin);
    Chunk* const gone = table.slots[gap];
    if (gone == nullptr) return;
    if (!gone->touched) touched_.add(origin);
    if (gone->used != kInUse) idle_bytes_ -= gone->samples.heap_bytes();
    // Chunks behind the gap move up unless that would put them before their home.
    for (std::size_t i = (gap + 1) & mask; table.slots[i] != nullptr; i = (i + 1) & mask) {
      const std::size_t from_home = (i - home(table.slots[i].load()->origin)) & mask;
      if (from_home < ((i - gap) & mask)) continue;
      table.slots[gap] = table.slots[i].load();
      gap = i;
    }
    table.slots[gap] = nullptr;
    if (gone != &chunks_.back()) {
      table.slot(chunks_.back().origin) = gone;
      *gone = std::move(chunks_.back());
    }
    chunks_.pop_back();
  }

  /// May run beside all but remove() and take_touched() where other chunks are concerned.
  void touch(Chunk& chunk) {
    if (chunk.touched) return;
    chunk.touched = true;
    const std::lock_guard lock(mutex_);
    touched_.add(chunk.origin);
  }
  std::vector<Coord3> take_touched() {
    std::vector<Coord3> touched = touched_.take();
    for (const Coord3& origin : touched) {
      if (Chunk* chunk = find(origin)) chunk->touched = false;
    }
    return touched;
  }

  /// Notes that a chunk is in use, which may change what it holds. As touch().
  void use(Chunk& chunk) {
    if (chunk.used == kInUse) return;
    const std::lock_guard lock(mutex_);
    idle_bytes_ -= chunk.samples.heap_bytes();
    chunk.used = kInUse;
    in_use_.push_back(chunk.origin);
  }
  /// What the chunks hold beside themselves; none is in use any more. Runs beside nothing.
  std::uint64_t count_heap_bytes() {
    for (const Coord3& origin : in_use_) {
      Chunk* chunk = find(origin);
      if (chunk == nullptr || chunk->used != kInUse) continue;
      chunk->used = kUsed;
      idle_bytes_ += chunk->samples.heap_bytes();
    }
    in_use_.clear();
    return idle_bytes_;
  }
  /// Counts all anew.
  void begin_counting() {
    in_use_.clear();
    idle_bytes_ = 0;
    for (Chunk& chunk : chunks_) {
      chunk.used = kUsed;
      idle_bytes_ += chunk.samples.heap_bytes();
    }
  }
  /// The next chunk that was not used since this came by it last, or null if none is left.
  Chunk* next_unused() {
    for (std::size_t seen = 0; seen < 2 * chunks_.size(); ++seen) {
      hand_ = hand_ + 1 < chunks_.size() ? hand_ + 1 : 0;
      Chunk& chunk = chunks_[hand_];
      if (chunk.piece != 0 || chunk.samples.heap_bytes() == 0) continue;
      if (chunk.used == kIdle) return &chunk;
      chunk.used = kIdle;
    }
    return nullptr;
  }
  void sent_away(std::uint64_t bytes) { idle_bytes_ -= bytes; }
  /// Those who looked into them are done. Runs beside nothing.
  void drop_old_tables() { tables_.erase(tables_.begin(), tables_.end() - 1); }

  std::deque<Chunk>& chunks() { return chunks_; }
  const std::deque<Chunk>& chunks() const { return chunks_; }
  std::size_t bytes() const {
    // A deque's pieces are of 512 bytes, with the allocator's word and one in the deque's map.
    constexpr std::size_t kPiece = 512, kInPiece = kPiece / sizeof(Chunk);
    std::size_t sum = chunks_.size() * (kPiece + 16 + sizeof(void*)) / kInPiece;
    sum += touched_.bytes() + in_use_.capacity() * sizeof(Coord3);
    for (const auto& table : tables_) sum += table->slots.size() * sizeof(Chunk*);
    return sum;
  }

  /// One word for a chunk's origin; 21 bits of chunk index per axis.
  static std::uint64_t key(const Coord3& origin) {
    constexpr std::uint64_t kMask = (1u << 21) - 1;
    return (std::uint64_t(origin.x() >> 3) & kMask) << 42 |
           (std::uint64_t(origin.y() >> 3) & kMask) << 21 |
           (std::uint64_t(origin.z() >> 3) & kMask);
  }

 private:
  struct Table {
    explicit Table(std::size_t size) : slots(size) {}
    /// Where the chunk is, or the free slot where it would go.
    std::size_t index(const Coord3& origin) const {
      const std::size_t mask = slots.size() - 1;
      std::size_t i = home(origin) & mask;
      for (;; i = (i + 1) & mask) {
        const Chunk* chunk = slots[i].load(std::memory_order_acquire);
        if (chunk == nullptr || chunk->origin == origin) return i;
      }
    }
    std::atomic<Chunk*>& slot(const Coord3& origin) { return slots[index(origin)]; }
    std::vector<std::atomic<Chunk*>> slots;
  };

  static std::size_t home(const Coord3& origin) { return mix(key(origin)); }
  Table* new_table(std::size_t size) {
    return tables_.emplace_back(std::make_unique<Table>(size)).get();
  }

  std::vector<std::unique_ptr<Table>> tables_;  // the last is in use
  std::atomic<Table*> table_;
  std::deque<Chunk> chunks_;  // stable addresses; the last may move into a gap
  std::mutex mutex_;
  ChunkList touched_;  // a chunk that comes and goes is added each time

  // Where memory is limited.
  enum : std::uint8_t { kIdle, kUsed, kInUse };  // Chunk::used
  std::vector<Coord3> in_use_;
  std::uint64_t idle_bytes_ = 0;  // beside the chunks that are not in use
  std::size_t hand_ = 0;          // of a clock: the chunk next_unused() came by last
};

}  // namespace soilvdb
