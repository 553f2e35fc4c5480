// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The sample points of a chunk, kept small: most cells are all soil or all air.
#pragma once

#include <bit>
#include <cstdint>
#include <vector>

#include "core/base_surface.h"

namespace soilvdb {

/// SampleWords with a word only for the cells that are neither all soil nor all air.
class Samples {
 public:
  void assign(const SampleWords& words) {
    mixed_words_.clear();
    for (int g = 0; g < kGroups; ++g) {
      std::uint64_t soil = 0, mixed = 0;
      for (int i = 0; i < 64; ++i) {
        const std::uint64_t word = words[static_cast<std::size_t>(64 * g + i)];
        soil |= std::uint64_t{word == kAllSoil} << i;
        mixed |= std::uint64_t{word != 0 && word != kAllSoil} << i;
      }
      soil_[g] = soil;
      mixed_[g] = mixed;
      before_[g] = static_cast<std::uint16_t>(mixed_words_.size());
      for (; mixed != 0; mixed &= mixed - 1) {
        mixed_words_.push_back(words[static_cast<std::size_t>(64 * g + std::countr_zero(mixed))]);
      }
    }
    trim();
  }

  void expand(SampleWords& words) const {
    const std::uint64_t* next = mixed_words_.data();
    for (int g = 0; g < kGroups; ++g) {
      std::uint64_t* out = &words[static_cast<std::size_t>(64 * g)];
      for (int i = 0; i < 64; ++i) out[i] = soil_[g] >> i & 1 ? kAllSoil : 0;
      for (std::uint64_t mixed = mixed_[g]; mixed != 0; mixed &= mixed - 1) {
        out[std::countr_zero(mixed)] = *next++;
      }
    }
  }

  /// Bit i: cell `first` + i holds soil; `first` a multiple of 8, i < 8.
  std::uint32_t any_of_row(int first) const {
    return (soil_[first >> 6] | mixed_[first >> 6]) >> (first & 63) & 0xff;
  }
  /// Bit i: row i of eight cells of group `g`, which is 64 cells, holds soil.
  std::uint32_t rows_with_soil(int g) const {
    std::uint64_t any = soil_[g] | mixed_[g];
    any |= any >> 4;
    any |= any >> 2;
    any |= any >> 1;
    any &= 0x0101010101010101u;
    return static_cast<std::uint32_t>(any * 0x0102040810204080u >> 56);
  }

  std::uint64_t word(int n) const {
    const std::uint64_t bit = std::uint64_t{1} << (n & 63);
    if (soil_[n >> 6] & bit) return kAllSoil;
    return mixed_[n >> 6] & bit ? mixed_words_[index(n)] : 0;
  }

  void set_word(int n, std::uint64_t word) {
    const std::uint64_t bit = std::uint64_t{1} << (n & 63);
    const std::size_t at = index(n);
    const bool was_mixed = mixed_[n >> 6] & bit, mixed = word != 0 && word != kAllSoil;
    if (mixed && was_mixed) {
      mixed_words_[at] = word;
    } else if (mixed) {
      mixed_words_.insert(mixed_words_.begin() + static_cast<std::ptrdiff_t>(at), word);
    } else if (was_mixed) {
      mixed_words_.erase(mixed_words_.begin() + static_cast<std::ptrdiff_t>(at));
    }
    if (mixed != was_mixed) {
      for (int g = (n >> 6) + 1; g < kGroups; ++g) {
        before_[g] = static_cast<std::uint16_t>(before_[g] + mixed - was_mixed);
      }
      mixed_[n >> 6] ^= bit;
    }
    soil_[n >> 6] = word == kAllSoil ? soil_[n >> 6] | bit : soil_[n >> 6] & ~bit;
  }

  /// Samples of soil.
  std::uint32_t count() const {
    int sum = 0;
    for (const std::uint64_t soil : soil_) sum += 64 * std::popcount(soil);
    for (const std::uint64_t word : mixed_words_) sum += std::popcount(word);
    return static_cast<std::uint32_t>(sum);
  }

  /// Gives back memory that removed words held.
  void trim() {
    if (mixed_words_.capacity() > mixed_words_.size() + mixed_words_.size() / 4 + 8) {
      mixed_words_.shrink_to_fit();
    }
  }

  std::size_t heap_bytes() const { return mixed_words_.capacity() * sizeof(std::uint64_t); }
  bool operator==(const Samples&) const = default;

 private:
  static constexpr int kGroups = kLeafSize / 64;

  /// Where the word of cell n is, or would be.
  std::size_t index(int n) const {
    const std::uint64_t below = mixed_[n >> 6] & ((std::uint64_t{1} << (n & 63)) - 1);
    return before_[n >> 6] + static_cast<std::size_t>(std::popcount(below));
  }

  std::uint64_t soil_[kGroups] = {}, mixed_[kGroups] = {};
  std::uint16_t before_[kGroups] = {};      // words of the groups before each
  std::vector<std::uint64_t> mixed_words_;  // in the order of cells
};

}  // namespace soilvdb
