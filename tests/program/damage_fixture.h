// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Damages files' bytes.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <iterator>
#include <random>
#include <string>
#include <vector>

namespace soilvdb::test {

inline constexpr double kHang_s = 2;

/// A file's bytes, damaged in one way or another so that they differ.
class Damage {
 public:
  explicit Damage(unsigned seed) : random_(seed) {}

  std::string cut_off(const std::string& good) { return good.substr(0, below(good.size())); }
  std::string flipped(std::string bytes) {
    const std::size_t at = below(bytes.size());
    bytes[at] = static_cast<char>(bytes[at] ^ (1 << below(8)));
    return bytes;
  }
  /// A page or a sector of zeros.
  std::string zeroed(const std::string& good) {
    for (;;) {
      const std::size_t size = below(2) ? 4096 : 512;
      const std::size_t at = below(good.size()) / size * size;
      std::string bytes = good;
      std::fill_n(bytes.begin() + static_cast<std::ptrdiff_t>(at),
                  std::min(size, bytes.size() - at), '\0');
      if (bytes != good) return bytes;
    }
  }
  /// One of the numbers that may be the size of a part, as another one.
  std::string resized(std::string bytes) {
    std::vector<std::size_t> places;
    std::int64_t number = 0;
    for (std::size_t at = 0; at + sizeof number <= bytes.size(); ++at) {
      std::memcpy(&number, bytes.data() + at, sizeof number);
      if (number > 0 && number < (1 << 16)) places.push_back(at);
    }
    const std::size_t at = places[below(places.size())];
    std::memcpy(&number, bytes.data() + at, sizeof number);
    const std::int64_t numbers[] = {-number, number + 1, number - 1, std::int64_t{1} << 40,
                                    -2056,   -(1 << 16), 2049,       number ^ (-1ll << 62)};
    std::memcpy(bytes.data() + at, &numbers[below(std::size(numbers))], sizeof number);
    return bytes;
  }
  /// Eight bytes of which a reader may think that they are a number.
  std::string overwritten(std::string bytes) {
    const std::uint64_t numbers[] = {0, ~0ull, 1ull << 63, (1ull << 31) - 1, random_()};
    std::memcpy(bytes.data() + below(bytes.size() - 8), &numbers[below(5)], 8);
    return bytes;
  }
  std::string any(const std::string& good) {
    const std::size_t kind = below(3);
    return kind == 0 ? cut_off(good) : kind == 1 ? flipped(good) : zeroed(good);
  }
  std::size_t below(std::size_t end) { return static_cast<std::size_t>(random_() % end); }

 private:
  std::mt19937_64 random_;
};

}  // namespace soilvdb::test
