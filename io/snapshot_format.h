// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What writer and reader of snapshots agree on beyond the .vdb format itself.
#pragma once

#include <fmt/format.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "io/checksum.h"

namespace soilvdb::io {

inline constexpr int kFormat = 2;  // 1 had distances that were carved, and a path behind them

inline constexpr const char* kSinceKey = "soilvdb_since";
inline constexpr const char* kSinceChecksumKey = "soilvdb_since_checksum";
// In grid `base_samples`, besides a count.
inline constexpr std::int32_t kDropped = -1;
inline constexpr std::int32_t kAbove = 1 << 16;  // added: Chunk::above

inline std::string to_text(const FileDigest& digest) {
  return fmt::format("{:016x} {:016x}", digest.crc, digest.size);
}

// A .vdb starts with magic (8 bytes), format (4), library version (8) and a flag (1), and a UUID as
// 36 letters. Ours starts with a mark ("soilvdb", as a UUID of version 8) and ends with a checksum.
inline constexpr std::size_t kUuidAt = 21, kUuidSize = 36;
inline constexpr std::string_view kMark = "736f696c-7664-8200-8";
inline constexpr std::string_view kTrailerWord = "soilvdb-crc64 ";
inline constexpr std::size_t kTrailerSize = kTrailerWord.size() + 16 + 1 + 16 + 1;

// Before the checksum, where there is one: the tracker's state, and its size.
inline constexpr std::string_view kStateWord = "soilvdb-state ";
inline constexpr std::size_t kStateLine = kStateWord.size() + 16 + 1;

inline std::string state_line(std::string_view state) {
  return fmt::format("{}{:016x}\n", kStateWord, state.size());
}

inline std::string trailer(std::string_view bytes) {
  return fmt::format("{}{:016x} {:016x}\n", kTrailerWord, crc64(bytes), bytes.size());
}

}  // namespace soilvdb::io
