// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What writer and reader of journals agree on: numbers little-endian, a frame's head, tags.
#pragma once

#include <bit>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <type_traits>

#include "soilvdb/io/checksum.h"

namespace soilvdb::inline v0::io {

static_assert(std::endian::native == std::endian::little);

inline constexpr std::uint32_t kFrameMark = 0x334a5653;  // "SVJ3"
inline constexpr std::uint32_t kFormerFrameMarks[] = {0x324a5653, 0x314a5653};
inline constexpr char kConfigTag = 'C', kUpdateTag = 'U', kFileTag = 'F', kGoneTag = 'G',
                      kEndTag = 'E';

inline constexpr std::uint32_t kMostMachines = 100'000;

template <typename T>
void append_raw(std::string& bytes, const T& value) {
  static_assert(std::is_arithmetic_v<T>);
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

/// Takes a number off the front of `bytes`; false if there are too few.
template <typename T>
bool take_raw(std::string_view& bytes, T& value) {
  static_assert(std::is_arithmetic_v<T>);
  if (bytes.size() < sizeof value) return false;
  std::memcpy(&value, bytes.data(), sizeof value);
  bytes.remove_prefix(sizeof value);
  return true;
}

/// What stands before a frame's content.
struct FrameHead {
  std::uint32_t length = 0;  ///< of the content, bytes
  std::uint64_t synced = 0;  ///< bytes of the file that were on disk before
  std::uint64_t crc = 0;     ///< of the content
  static constexpr std::size_t kSize = 32;

  /// @param place of the frame in the file
  std::string bytes(std::uint64_t place) const {
    std::string head;
    append_raw(head, kFrameMark);
    append_raw(head, length);
    append_raw(head, synced);
    append_raw(head, crc);
    append_raw(head, checksum(head, place));
    return head;
  }
  /// @return is it the head of a frame at this place?
  bool parse(std::string_view head, std::uint64_t place) {
    std::uint32_t mark = 0;
    std::uint64_t own = 0;
    const std::string_view all = head;
    return head.size() >= kSize && take_raw(head, mark) && mark == kFrameMark &&
           take_raw(head, length) && take_raw(head, synced) && take_raw(head, crc) &&
           take_raw(head, own) && own == checksum(all.substr(0, kSize - sizeof own), place);
  }

 private:
  static std::uint64_t checksum(std::string_view head, std::uint64_t place) {
    std::string text(head);
    append_raw(text, place);
    return crc64(text);
  }
};

}  // namespace soilvdb::inline v0::io
