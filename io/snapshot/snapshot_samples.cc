// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Numbers are as x86-64 has them. First the number of dropped chunks, their origins, the number of
// parts; then the parts, each with its number of chunks, its size and its size in the file, which
// is the same where Blosc made it no smaller.
//
// A part holds, one after another for all its chunks: origins, base counts and whether soil is
// above the base surface's, a bit for each cell that is all soil, a bit for each that is mixed, and
// the words of mixed cells, of all words the first byte, then the second and so on.
#include "io/snapshot/snapshot_samples.h"

#include <openvdb/points/StreamCompression.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <limits>
#include <stdexcept>

#include "core/ground/soil_writer.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::size_t kPartChunks = 1024;
constexpr int kGroups = kChunkVoxels / 64;
constexpr std::uint32_t kAbove = 1u << 16;

using Masks = std::array<std::uint64_t, kGroups>;
using Origin = std::array<std::int32_t, 3>;

struct PartHead {
  std::uint64_t chunks, size, stored;
};

template <typename T>
void put(std::string& out, const T& value) {
  out.append(reinterpret_cast<const char*>(&value), sizeof value);
}

[[noreturn]] void refuse() { throw std::runtime_error("its samples are not what was written"); }

/// Takes values off the front of bytes.
class Reader {
 public:
  explicit Reader(std::string_view bytes) : left_(bytes) {}
  std::string_view take(std::uint64_t size) {
    if (size > left_.size()) refuse();
    const std::string_view taken = left_.substr(0, size);
    left_.remove_prefix(size);
    return taken;
  }
  template <typename T>
  T get() {
    T value;
    std::memcpy(&value, take(sizeof value).data(), sizeof value);
    return value;
  }
  bool empty() const { return left_.empty(); }

 private:
  std::string_view left_;
};

/// Words as all their first bytes, all their second bytes and so on.
std::string planes(const std::vector<std::uint64_t>& words) {
  std::string out(8 * words.size(), '\0');
  for (std::size_t b = 0; b < 8; ++b)
    for (std::size_t i = 0; i < words.size(); ++i)
      out[b * words.size() + i] = static_cast<char>(words[i] >> 8 * b);
  return out;
}

std::uint64_t word_of(std::string_view planes, std::size_t i) {
  std::uint64_t word = 0;
  for (std::size_t b = 0; b < 8; ++b)
    word |= std::uint64_t{static_cast<unsigned char>(planes[b * planes.size() / 8 + i])} << 8 * b;
  return word;
}

std::string part_bytes(const Soil& soil, const Chunk* const* chunks, std::size_t count) {
  std::string origins, bases, masks;
  std::vector<std::uint64_t> mixed_words;
  SampleWords words;
  for (std::size_t i = 0; i < count; ++i) {
    const Chunk& chunk = *chunks[i];
    put(origins, Origin{chunk.origin.x(), chunk.origin.y(), chunk.origin.z()});
    put(bases, std::uint32_t{chunk.base_count} + (chunk.above ? kAbove : 0));
    soil.read_samples(chunk.origin, words);
    Masks full{}, mixed{};
    for (std::size_t n = 0; n < kChunkVoxels; ++n) {
      const std::uint64_t word = words[n], bit = std::uint64_t{1} << (n & 63);
      if (word == kAllSoil) {
        full[n >> 6] |= bit;
      } else if (word != 0) {
        mixed[n >> 6] |= bit;
        mixed_words.push_back(word);
      }
    }
    put(masks, full);
    put(masks, mixed);
  }
  return origins + bases + masks + planes(mixed_words);
}

void restore_part(std::string_view bytes, std::size_t count, Soil& soil) {
  if (count > kPartChunks) refuse();
  Reader in(bytes);
  Reader origins(in.take(count * sizeof(Origin))), bases(in.take(count * sizeof(std::uint32_t))),
      masks(in.take(count * 2 * sizeof(Masks)));
  const std::string_view mixed_words =
      in.take(bytes.size() - count * (sizeof(Origin) + sizeof(std::uint32_t) + 2 * sizeof(Masks)));
  if (mixed_words.size() % 8 != 0) refuse();
  std::size_t next = 0;
  SoilWriter writer(soil);
  SampleWords words;
  for (std::size_t i = 0; i < count; ++i) {
    const auto origin = origins.get<Origin>();
    const auto base = bases.get<std::uint32_t>();
    const auto full = masks.get<Masks>(), mixed = masks.get<Masks>();
    Chunk chunk;
    chunk.origin = {origin[0], origin[1], origin[2]};
    if ((origin[0] | origin[1] | origin[2]) % kChunkSide != 0 || base >= 2 * kAbove ||
        soil.find(chunk.origin) != nullptr)
      refuse();
    chunk.base_count = static_cast<std::uint16_t>(base);
    chunk.above = (base & kAbove) != 0;
    for (std::size_t n = 0; n < kChunkVoxels; ++n) {
      words[n] = (full[n >> 6] >> (n & 63) & 1) != 0 ? kAllSoil : 0;
      if ((mixed[n >> 6] >> (n & 63) & 1) == 0) continue;
      if (next == mixed_words.size() / 8) refuse();
      words[n] = word_of(mixed_words, next++);
    }
    chunk.samples.assign(words);
    writer.put(std::move(chunk));
  }
  if (next != mixed_words.size() / 8) refuse();
}

/// Smaller, if Blosc can.
std::string compressed(std::string bytes) {
  if (bytes.size() > std::numeric_limits<int>::max() / 2 ||
      !openvdb::compression::bloscCanCompress())
    return bytes;
  std::size_t size = 0;
  const auto smaller = openvdb::compression::bloscCompress(bytes.data(), bytes.size(), size);
  return smaller && size < bytes.size() ? std::string(smaller.get(), size) : bytes;
}

}  // namespace

std::string samples_bytes(const Soil& soil, const std::vector<Coord3>& dropped) {
  const std::vector<const Chunk*> chunks = soil.chunks();
  const std::size_t parts = (chunks.size() + kPartChunks - 1) / kPartChunks;
  std::vector<std::string> bytes(parts);
  tbb::parallel_for(std::size_t{0}, parts, [&](std::size_t i) {
    const std::size_t first = i * kPartChunks;
    const std::size_t count = std::min(kPartChunks, chunks.size() - first);
    const std::string plain = part_bytes(soil, &chunks[first], count);
    const std::string small = compressed(plain);
    put(bytes[i], PartHead{count, plain.size(), small.size()});
    bytes[i] += small;
  });
  std::string all;
  put(all, std::uint64_t{dropped.size()});
  for (const Coord3& c : dropped) put(all, Origin{c.x(), c.y(), c.z()});
  put(all, std::uint64_t{parts});
  for (const std::string& part : bytes) all += part;
  return all;
}

std::vector<Coord3> restore_samples(std::string_view bytes, Soil& soil) {
  Reader in(bytes);
  std::vector<Coord3> dropped;
  for (auto left = in.get<std::uint64_t>(); left > 0; --left) {
    const auto origin = in.get<Origin>();
    dropped.emplace_back(origin[0], origin[1], origin[2]);
  }
  for (auto left = in.get<std::uint64_t>(); left > 0; --left) {
    const auto head = in.get<PartHead>();
    const std::string_view stored = in.take(head.stored);
    if (head.stored == head.size) {
      restore_part(stored, head.chunks, soil);
      continue;
    }
    constexpr std::size_t kMost = kPartChunks * (sizeof(Origin) + 4 + sizeof(SampleWords) * 2);
    if (head.size > kMost || head.stored < 16) refuse();
    // Blosc's own head: sizes at 4 and 12.
    std::uint32_t plain = 0, small = 0;
    std::memcpy(&plain, stored.data() + 4, 4);
    std::memcpy(&small, stored.data() + 12, 4);
    if (plain != head.size || small != head.stored) refuse();
    const auto whole = openvdb::compression::bloscDecompress(stored.data(), head.size);
    if (!whole) refuse();
    restore_part({whole.get(), head.size}, head.chunks, soil);
  }
  if (!in.empty()) refuse();
  return dropped;
}

}  // namespace soilvdb::inline v0::io
