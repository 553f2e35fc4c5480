// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What the chunks of MCAP files are compressed with: lz4 and zstd frames.
#pragma once

#include <string>
#include <string_view>

namespace soilvdb::inline v0::io {

/// Takes memory as it comes to have content for it, so a wrong `size` costs none.
/// @param size of what was compressed, bytes
/// @throw std::invalid_argument if `bytes` aren't that: the rest of a sentence that began with them
std::string decompress_zstd(std::string_view bytes, std::size_t size);
std::string decompress_lz4(std::string_view bytes, std::size_t size);

/// The same bytes each time.
std::string compress_zstd(std::string_view bytes);

}  // namespace soilvdb::inline v0::io
