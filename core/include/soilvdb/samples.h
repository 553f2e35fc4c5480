// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Compressed samples of a chunk: most cells are all soil or all air.
#pragma once

#include <bit>
#include <cstdint>
#include <cstring>
#include <string_view>

#include "soilvdb/heap_block.h"
#include "soilvdb/initial_terrain.h"

namespace soilvdb::inline v0 {

/// SampleWords that store words only for mixed cells, neither all soil nor all air. A chunk of air
/// is a null pointer. Copies share their words until one of them changes.
class Samples {
 public:
  void assign(const SampleWords& words) {
    Head head = kAir;
    std::uint64_t mixed_words[kChunkVoxels];
    for (int g = 0; g < kGroups; ++g) {
      std::uint64_t soil = 0, mixed = 0;
      for (int i = 0; i < 64; ++i) {
        const std::uint64_t word = words[static_cast<std::size_t>(64 * g + i)];
        soil |= std::uint64_t{word == kAllSoil} << i;
        mixed |= std::uint64_t{word != 0 && word != kAllSoil} << i;
      }
      head.soil[g] = soil;
      head.mixed[g] = mixed;
      head.before[g] = head.size;
      for (; mixed != 0; mixed &= mixed - 1) {
        mixed_words[head.size++] =
            words[static_cast<std::size_t>(64 * g + std::countr_zero(mixed))];
      }
    }
    block_.reset();
    if (head.empty()) return;
    head.reserve(head.size);
    block_.resize(head.bytes());
    *block_.own() = head;
    std::memcpy(block_.own() + 1, mixed_words, head.size * sizeof(std::uint64_t));
  }

  void expand(SampleWords& words) const {
    if (!block_) return words.fill(0);
    const std::uint64_t* next = tail();
    for (int g = 0; g < kGroups; ++g) {
      std::uint64_t* out = &words[static_cast<std::size_t>(64 * g)];
      for (int i = 0; i < 64; ++i) out[i] = block_->soil[g] >> i & 1 ? kAllSoil : 0;
      for (std::uint64_t mixed = block_->mixed[g]; mixed != 0; mixed &= mixed - 1) {
        out[std::countr_zero(mixed)] = *next++;
      }
    }
  }

  /// Bit i: cell `first` + i holds soil; `first` a multiple of 8, i < 8.
  std::uint32_t any_of_row(int first) const {
    const Head& h = head();
    return (h.soil[first >> 6] | h.mixed[first >> 6]) >> (first & 63) & 0xff;
  }
  /// Bit i: cell `first` + i is all soil; `first` a multiple of 8, i < 8.
  std::uint32_t full_of_row(int first) const {
    return head().soil[first >> 6] >> (first & 63) & 0xff;
  }
  /// Bit i: cell i of the 64 cells of group `g` holds soil.
  std::uint64_t occupied(int g) const { return head().soil[g] | head().mixed[g]; }
  /// Bit i: row i (eight cells) of the 64 cells of group `g` holds soil.
  std::uint32_t rows_with_soil(int g) const {
    std::uint64_t any = head().soil[g] | head().mixed[g];
    any |= any >> 4;
    any |= any >> 2;
    any |= any >> 1;
    any &= 0x0101010101010101u;
    return static_cast<std::uint32_t>(any * 0x0102040810204080u >> 56);
  }

  bool operator==(const Samples& other) const {
    const Head &a = head(), &b = other.head();
    const auto same = [](const auto& x, const auto& y) {
      return std::memcmp(x, y, sizeof(x)) == 0;
    };
    return same(a.soil, b.soil) && same(a.mixed, b.mixed) &&
           (a.size == 0 || std::memcmp(tail(), other.tail(), a.size * sizeof(kAllSoil)) == 0);
  }

  [[gnu::always_inline]] std::uint64_t word(int n) const {
    const std::uint64_t bit = std::uint64_t{1} << (n & 63);
    if (head().soil[n >> 6] & bit) return kAllSoil;
    return head().mixed[n >> 6] & bit ? tail()[head().index(n)] : 0;
  }

  /// Inline, so that kernels compiled for several CPUs use their own popcount.
  [[gnu::always_inline]] void set_word(int n, std::uint64_t word) {
    if (!block_) {
      if (word == 0) return;
      resize(word != kAllSoil);
    }
    const std::uint64_t bit = std::uint64_t{1} << (n & 63);
    const std::size_t at = block_->index(n);
    const bool was_mixed = block_->mixed[n >> 6] & bit, mixed = word != 0 && word != kAllSoil;
    if (mixed && !was_mixed && block_->size == block_->capacity) grow();
    Head& h = *block_.own();
    std::uint64_t* const here = reinterpret_cast<std::uint64_t*>(&h + 1) + at;
    const std::size_t behind = h.size - at;
    if (mixed && !was_mixed) {
      std::memmove(here + 1, here, behind * sizeof(word));
      ++h.size;
    } else if (!mixed && was_mixed) {
      std::memmove(here, here + 1, (behind - 1) * sizeof(word));
      --h.size;
    }
    if (mixed) *here = word;
    if (mixed != was_mixed) {
      for (int g = (n >> 6) + 1; g < kGroups; ++g) {
        h.before[g] = static_cast<std::uint16_t>(h.before[g] + mixed - was_mixed);
      }
      h.mixed[n >> 6] ^= bit;
    }
    h.soil[n >> 6] = word == kAllSoil ? h.soil[n >> 6] | bit : h.soil[n >> 6] & ~bit;
  }

  /// Number of soil samples.
  std::uint32_t count() const {
    int sum = 0;
    for (const std::uint64_t soil : head().soil) sum += 64 * std::popcount(soil);
    for (int i = 0; i < head().size; ++i) sum += std::popcount(tail()[i]);
    return static_cast<std::uint32_t>(sum);
  }

  /// Frees the memory of removed words.
  void trim() {
    if (!block_) return;
    if (block_->empty()) {
      block_.reset();
    } else if (block_->capacity > block_->size + block_->size / 4 + 16) {
      resize(block_->size);
    }
  }

  std::size_t heap_bytes() const { return block_ ? block_->bytes() + kHeapWord : 0; }

  /// Serialization, as HeapBlock.
  void put(std::string& out) const { block_.put(out); }
  bool take(std::string_view& in) { return block_.take(in); }

 private:
  static constexpr int kGroups = kChunkVoxels / 64;

  /// The words of the mixed cells follow, ordered by cell.
  struct Head {
    std::uint32_t owners;           ///< managed by HeapBlock
    std::uint16_t size, capacity;   ///< words
    std::uint16_t before[kGroups];  ///< number of words in all earlier groups
    std::uint64_t soil[kGroups], mixed[kGroups];

    std::size_t bytes() const { return sizeof(Head) + capacity * sizeof(std::uint64_t); }
    /// Sets the capacity to that of an allocation for `words` words.
    void reserve(int words) {
      const std::size_t bytes = sizeof(Head) + static_cast<std::size_t>(words) * 8;
      capacity = static_cast<std::uint16_t>((heap_size(bytes) - sizeof(Head)) / 8);
    }
    bool empty() const {
      std::uint64_t any = size;
      for (const std::uint64_t s : soil) any |= s;
      return any == 0;
    }
    /// Index of the word of cell n, or its insertion index.
    [[gnu::always_inline]] std::size_t index(int n) const {
      const std::uint64_t below = mixed[n >> 6] & ((std::uint64_t{1} << (n & 63)) - 1);
      return before[n >> 6] + static_cast<std::size_t>(std::popcount(below));
    }
  };
  static constexpr Head kAir{1, 0, 0, {}, {}, {}};

  const Head& head() const { return block_ ? *block_.get() : kAir; }
  const std::uint64_t* tail() const {
    return reinterpret_cast<const std::uint64_t*>(block_.get() + 1);
  }
  void grow() { resize(block_->size + block_->size / 8 + 1); }
  void resize(int words) {
    Head resized = kAir;
    resized.reserve(words);
    block_.resize(resized.bytes());  // before capacity changes: it may throw
    block_.own()->capacity = resized.capacity;
  }

  HeapBlock<Head> block_;
};

}  // namespace soilvdb::inline v0
