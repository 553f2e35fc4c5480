// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Compression of the chunks in MCAP files: lz4 and zstd frames.
#pragma once

#include <string>
#include <string_view>

namespace soilvdb::inline v0::io {

/// Decompresses a frame. Memory grows with the content, so a wrong `size` costs none.
/// @param size of the content, bytes
/// @throw std::invalid_argument if `bytes` are no such frame; the message lacks its subject
std::string decompress_zstd(std::string_view bytes, std::size_t size);
std::string decompress_lz4(std::string_view bytes, std::size_t size);

/// Deterministic: the same bytes each time.
std::string compress_zstd(std::string_view bytes);

}  // namespace soilvdb::inline v0::io
