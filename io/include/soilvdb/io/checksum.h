// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Checksums against accidental damage, not against forgery.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

namespace soilvdb::inline v0::io {

/// CRC-64/XZ.
/// @param before the CRC-64 of the bytes before `bytes`
std::uint64_t crc64(std::string_view bytes, std::uint64_t before = 0);

/// CRC-32 (ISO 3309, as in zlib), as other programs' formats use it.
std::uint32_t crc32(std::string_view bytes, std::uint32_t before = 0);

/// A fingerprint of a file, in milliseconds for any size: 16 hex digits of its size and of 64
/// blocks of 64 KiB spread evenly over it (all of it, up to 4 MiB).
/// @param whole use all bytes, for files that crash their reader when a byte is damaged
/// @throw InputError if the file can't be read.
std::string file_fingerprint(const std::filesystem::path& file, bool whole = false);

/// Size and CRC-64 of a whole file.
struct FileDigest {
  std::uint64_t size = 0, crc = 0;
  bool operator==(const FileDigest&) const = default;
};
/// @throw InputError if the file can't be read.
FileDigest file_digest(const std::filesystem::path& file);

}  // namespace soilvdb::inline v0::io
