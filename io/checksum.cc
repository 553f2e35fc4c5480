// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/checksum.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/crc.hpp>
#include <fstream>

#include "io/text.h"

namespace soilvdb::io {
namespace {

using Crc64 =
    boost::crc_optimal<64, 0x42F0E1EBA9EA3693u, ~std::uint64_t{0}, ~std::uint64_t{0}, true, true>;

}  // namespace

std::uint64_t crc64(std::string_view bytes) {
  Crc64 crc;
  crc.process_bytes(bytes.data(), bytes.size());
  return crc.checksum();
}

std::string file_fingerprint(const std::filesystem::path& file) {
  constexpr std::uint64_t kBlock = 64 * 1024, kBlocks = 64;
  check_readable(file);
  const std::uint64_t size = std::filesystem::file_size(file);
  std::ifstream in(file, std::ios::binary);
  Crc64 crc;
  crc.process_bytes(&size, sizeof size);
  const std::uint64_t blocks = std::min(kBlocks, (size + kBlock - 1) / kBlock);
  std::string block;
  for (std::uint64_t i = 0; i < blocks; ++i) {
    // The first block starts at 0, the last one ends with the file.
    const std::uint64_t start =
        size <= kBlock * kBlocks ? i * kBlock : (size - kBlock) * i / (blocks - 1);
    block.resize(std::min(kBlock, size - start));
    in.seekg(static_cast<std::streamoff>(start));
    if (!in.read(block.data(), static_cast<std::streamsize>(block.size()))) {
      throw InputError(file, "can't be read");
    }
    crc.process_bytes(block.data(), block.size());
  }
  return fmt::format("{:016x}", crc.checksum());
}

FileDigest file_digest(const std::filesystem::path& file) {
  check_readable(file);
  std::ifstream in(file, std::ios::binary);
  Crc64 crc;
  FileDigest digest;
  std::string block(std::size_t{1} << 20, '\0');
  while (in) {
    in.read(block.data(), static_cast<std::streamsize>(block.size()));
    crc.process_bytes(block.data(), static_cast<std::size_t>(in.gcount()));
    digest.size += static_cast<std::uint64_t>(in.gcount());
  }
  if (in.bad()) throw InputError(file, "can't be read to its end");
  digest.crc = crc.checksum();
  return digest;
}

}  // namespace soilvdb::io
