// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The format of journals, for writer and reader: little-endian numbers, frame heads, tags.
#pragma once

#include <bit>
#include <cstdint>
#include <string>
#include <string_view>

#include "core/lattice/bytes.h"
#include "soilvdb/io/checksum.h"

namespace soilvdb::inline v0::io {

static_assert(std::endian::native == std::endian::little);

inline constexpr std::uint32_t kFrameMark = 0x334a5653;  // "SVJ3"
inline constexpr std::uint32_t kFormerFrameMarks[] = {0x324a5653, 0x314a5653};
inline constexpr char kConfigTag = 'C', kUpdateTag = 'U', kFileTag = 'F', kGoneTag = 'G',
                      kEndTag = 'E';

inline constexpr std::uint32_t kMostMachines = 100'000;

/// The head of a frame.
struct FrameHead {
  std::uint32_t length = 0;  ///< of the content, bytes
  std::uint64_t synced = 0;  ///< bytes of the file that were on disk before this frame
  std::uint64_t crc = 0;     ///< of the content
  static constexpr std::size_t kSize = 32;

  /// @param place of the frame in the file
  std::string bytes(std::uint64_t place) const {
    std::string head;
    put(head, kFrameMark, length, synced, crc);
    put(head, checksum(head, place));
    return head;
  }
  /// @return is it the head of a frame at this place?
  bool parse(std::string_view head, std::uint64_t place) {
    std::uint32_t mark = 0;
    std::uint64_t own = 0;
    const std::string_view all = head;
    return head.size() >= kSize && try_take(head, mark) && mark == kFrameMark &&
           try_take(head, length) && try_take(head, synced) && try_take(head, crc) &&
           try_take(head, own) && own == checksum(all.substr(0, kSize - sizeof own), place);
  }

 private:
  static std::uint64_t checksum(std::string_view head, std::uint64_t place) {
    std::string text(head);
    put(text, place);
    return crc64(text);
  }
};

}  // namespace soilvdb::inline v0::io
