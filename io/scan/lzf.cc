// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// LZF, the compression of PCD files (as LibLZF has it): a byte below 32 precedes that many literal
// bytes plus one. Other bytes hold, in three bits, a length, and in five the upper bits of a
// distance back.
#include <algorithm>
#include <stdexcept>

#include "io/scan/scan_formats.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::size_t kMostGrowth = 264 / 3 + 1;  // three bytes repeat at most 264
constexpr std::size_t kLiteral = 32, kLongCopy = 7;

}  // namespace

std::string decompress_lzf(std::string_view block, std::size_t size) {
  if (size / kMostGrowth > block.size())
    throw std::invalid_argument("is too short for what it should hold");
  std::string out;
  out.reserve(size);
  std::size_t at = 0;
  const auto next = [&] {
    if (at == block.size()) throw std::invalid_argument("ends too early");
    return static_cast<std::size_t>(static_cast<unsigned char>(block[at++]));
  };
  while (at < block.size()) {
    const std::size_t control = next();
    std::size_t length = control + 1;
    if (control < kLiteral) {
      if (length > block.size() - at) throw std::invalid_argument("ends too early");
      if (length > size - out.size()) throw std::invalid_argument("holds more than it should");
      out.append(block, at, length);
      at += length;
      continue;
    }
    length = control >> 5;
    if (length == kLongCopy) length += next();
    length += 2;
    const std::size_t back = ((control & (kLiteral - 1)) << 8) + next() + 1;
    if (back > out.size()) throw std::invalid_argument("refers to bytes before its beginning");
    if (length > size - out.size()) throw std::invalid_argument("holds more than it should");
    for (const std::size_t end = out.size() + length; out.size() < end;)
      out.push_back(out[out.size() - back]);  // may overlap
  }
  if (out.size() != size) throw std::invalid_argument("holds less than it should");
  return out;
}

}  // namespace soilvdb::inline v0::io
