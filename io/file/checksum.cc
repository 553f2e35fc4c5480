// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/io/checksum.h"

#include <fmt/format.h>
#include <lzma.h>

#include <algorithm>
#include <fstream>

#include "io/file/file_part.h"
#include "io/file/text.h"

namespace soilvdb::inline v0::io {
std::uint64_t crc64(std::string_view bytes, std::uint64_t before) {
  return lzma_crc64(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size(), before);
}

std::uint32_t crc32(std::string_view bytes, std::uint32_t before) {
  return lzma_crc32(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size(), before);
}

std::string file_fingerprint(const std::filesystem::path& path, bool whole) {
  const auto [file, part] = file_part(path);
  constexpr std::uint64_t kBlock = 64 * 1024, kBlocks = 64;
  check_readable(file);
  const std::uint64_t size = std::filesystem::file_size(file);
  std::ifstream in(file, std::ios::binary);
  std::uint64_t crc = crc64({reinterpret_cast<const char*>(&size), sizeof size});
  whole = whole || size <= kBlock * kBlocks;
  const std::uint64_t blocks = whole ? (size + kBlock - 1) / kBlock : kBlocks;
  std::string block;
  for (std::uint64_t i = 0; i < blocks; ++i) {
    // The first block starts at 0, the last one ends with the file.
    const std::uint64_t start = whole ? i * kBlock : (size - kBlock) * i / (blocks - 1);
    block.resize(std::min(kBlock, size - start));
    in.seekg(static_cast<std::streamoff>(start));
    if (!in.read(block.data(), static_cast<std::streamsize>(block.size()))) {
      throw InputError(file, "can't be read");
    }
    crc = crc64(block, crc);
  }
  if (!part.empty()) crc = crc64(part, crc);  // surfaces of one file are not the same
  return fmt::format("{:016x}", crc);
}

FileDigest file_digest(const std::filesystem::path& file) {
  check_readable(file);
  std::ifstream in(file, std::ios::binary);
  FileDigest digest;
  std::string block(std::size_t{1} << 20, '\0');
  while (in) {
    in.read(block.data(), static_cast<std::streamsize>(block.size()));
    const auto read = static_cast<std::size_t>(in.gcount());
    digest.crc = crc64(std::string_view(block).substr(0, read), digest.crc);
    digest.size += read;
  }
  if (in.bad()) throw InputError(file, "can't be read to its end");
  return digest;
}

}  // namespace soilvdb::inline v0::io
