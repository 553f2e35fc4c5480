// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The format of snapshots beyond .vdb, for writer and reader.
#pragma once

#include <fmt/format.h>

#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>

#include "soilvdb/io/checksum.h"

namespace soilvdb::inline v0::io {

// Format 1 had carved distances; format 2 had samples in grids that confuse other programs.
inline constexpr int kFormat = 3;

inline constexpr const char* kBaseGrid = "level_set_grid";  // the used grid of several in its file

inline constexpr const char* kParentKey = "soilvdb_since";
inline constexpr const char* kParentChecksumKey = "soilvdb_since_checksum";
inline std::string to_text(const FileDigest& digest) {
  return fmt::format("{:016x} {:016x}", digest.crc, digest.size);
}

// A .vdb begins with magic (8 bytes), format (4), library version (8), a flag (1), and a UUID of 36
// characters. A snapshot's UUID begins with a mark ("soilvdb", as a version 8 UUID) and ends with a
// checksum.
inline constexpr std::size_t kUuidAt = 21, kUuidSize = 36;
inline constexpr std::string_view kMark = "736f696c-7664-8200-8";
inline constexpr std::string_view kExportMark = "736f696c-7664-8201-8";  // for other programs
inline constexpr std::string_view kTrailerWord = "soilvdb-crc64 ";
inline constexpr std::size_t kTrailerSize = kTrailerWord.size() + 16 + 1 + 16 + 1;

// Before the checksum: the samples and, if present, the tracker's state, each followed by a line
// with its size.
inline constexpr std::string_view kSamplesWord = "soilvdb-samples ", kStateWord = "soilvdb-state ";
inline constexpr std::size_t kSizeDigits = 16;

inline std::string size_line(std::string_view word, std::string_view bytes) {
  return fmt::format("{}{:016x}\n", word, bytes.size());
}

inline std::string trailer(std::string_view bytes) {
  return fmt::format("{}{:016x} {:016x}\n", kTrailerWord, crc64(bytes), bytes.size());
}

/// Replaces OpenVDB's random UUID by a mark and a digest of all bytes after it, so that the same
/// content makes the same bytes.
inline void put_uuid(std::string& bytes, std::string_view mark) {
  if (bytes.size() < kUuidAt + kUuidSize || bytes[kUuidAt + 8] != '-' || bytes[kUuidAt + 23] != '-')
    throw std::runtime_error("this OpenVDB's file header is not the known one");
  const std::uint64_t digest = crc64(std::string_view(bytes).substr(kUuidAt + kUuidSize));
  bytes.replace(
      kUuidAt, kUuidSize,
      fmt::format("{}{:03x}-{:012x}", mark, digest >> 52, digest & ((std::uint64_t{1} << 48) - 1)));
}

}  // namespace soilvdb::inline v0::io
