// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/mcap/compression.h"

#include <lz4frame.h>
#include <zstd.h>

#include <algorithm>
#include <memory>
#include <stdexcept>

namespace soilvdb::inline v0::io {
namespace {

constexpr std::size_t kStep = std::size_t{1} << 20;
constexpr int kZstdLevel = 3;

/// Calls `step(to, room)`, which fills part of the room and returns its size, until `size` bytes
/// are there.
/// @throw std::invalid_argument if the content is shorter or longer
template <typename F>
std::string grow(std::size_t size, F step) {
  std::string out;
  while (out.size() < size) {
    const std::size_t begin = out.size();
    out.resize(std::min(size, begin + std::max(kStep, begin)));
    std::size_t end = begin;
    while (end < out.size()) {
      const std::size_t made = step(out.data() + end, out.size() - end);
      if (made == 0) throw std::invalid_argument("are shorter than declared");
      end += made;
    }
  }
  char more = 0;
  if (step(&more, 1) > 0) throw std::invalid_argument("are longer than declared");
  return out;
}

}  // namespace

std::string decompress_zstd(std::string_view bytes, std::size_t size) {
  const std::unique_ptr<ZSTD_DCtx, decltype(&ZSTD_freeDCtx)> context(ZSTD_createDCtx(),
                                                                     &ZSTD_freeDCtx);
  ZSTD_inBuffer in{bytes.data(), bytes.size(), 0};
  return grow(size, [&](char* to, std::size_t room) {
    ZSTD_outBuffer out{to, room, 0};
    while (out.pos == 0) {
      const std::size_t before = in.pos;
      if (ZSTD_isError(ZSTD_decompressStream(context.get(), &out, &in)))
        throw std::invalid_argument("are not a zstd frame");
      if (out.pos == 0 && in.pos == before) break;
    }
    return out.pos;
  });
}

std::string decompress_lz4(std::string_view bytes, std::size_t size) {
  LZ4F_dctx* made = nullptr;
  if (LZ4F_isError(LZ4F_createDecompressionContext(&made, LZ4F_VERSION))) throw std::bad_alloc();
  const std::unique_ptr<LZ4F_dctx, decltype(&LZ4F_freeDecompressionContext)> context(
      made, &LZ4F_freeDecompressionContext);
  return grow(size, [&](char* to, std::size_t room) {
    while (true) {
      std::size_t out = room, in = bytes.size();
      if (LZ4F_isError(LZ4F_decompress(context.get(), to, &out, bytes.data(), &in, nullptr)))
        throw std::invalid_argument("are not an lz4 frame");
      bytes.remove_prefix(in);
      if (out > 0 || in == 0) return out;
    }
  });
}

std::string compress_zstd(std::string_view bytes) {
  std::string out(ZSTD_compressBound(bytes.size()), '\0');
  const std::size_t size =
      ZSTD_compress(out.data(), out.size(), bytes.data(), bytes.size(), kZstdLevel);
  if (ZSTD_isError(size)) throw std::bad_alloc();
  out.resize(size);
  return out;
}

}  // namespace soilvdb::inline v0::io
