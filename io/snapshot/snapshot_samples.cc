// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Numbers are little-endian, as on x86-64. First the number of dropped chunks, their origins, and
// the number of parts. Then the parts, each with its number of chunks, its size, and its size in
// the file; both are equal if Blosc did not make it smaller.
//
// A part holds, each for all its chunks: origins; base counts, and flags for soil above the base
// surface and for loose soil; a bit per cell that is all soil, and a bit per mixed cell; for chunks
// with loose soil the same bits for the loose soil; the words of mixed cells in this order, with
// the first bytes of all words first, then the second bytes and so on.
#include "io/snapshot/snapshot_samples.h"

#include <openvdb/points/StreamCompression.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <stdexcept>

#include "core/ground/ground_writer.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::size_t kChunksPerPart = 1024;
constexpr int kGroups = kChunkVoxels / 64;
constexpr std::uint32_t kAbove = 1u << 16, kLoose = 1u << 17, kFlags = 1u << 18;

using Masks = std::array<std::uint64_t, kGroups>;
using Origin = std::array<std::int32_t, 3>;

struct PartHead {
  std::uint64_t chunks, size, stored;
};

template <typename T>
void put_bytes(std::string& out, const T& value) {
  out.append(reinterpret_cast<const char*>(&value), sizeof value);
}

[[noreturn]] void refuse() { throw std::runtime_error("its samples are not what was written"); }

/// Takes values off the front of a byte string.
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
  std::string_view rest() const { return left_; }

 private:
  std::string_view left_;
};

/// Words as bytes: all first bytes, all second bytes and so on.
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

/// A bit per full cell, and a bit per mixed cell.
struct CellMasks {
  Masks full{}, mixed{};
};

/// @param mixed_words receives the words of mixed cells
CellMasks masks_of(const SampleWords& words, std::vector<std::uint64_t>& mixed_words) {
  CellMasks masks;
  for (std::size_t n = 0; n < kChunkVoxels; ++n) {
    const std::uint64_t word = words[n], bit = std::uint64_t{1} << (n & 63);
    if (word == kAllSoil) {
      masks.full[n >> 6] |= bit;
    } else if (word != 0) {
      masks.mixed[n >> 6] |= bit;
      mixed_words.push_back(word);
    }
  }
  return masks;
}

std::string part_bytes(const Ground& ground, const Chunk* const* chunks, std::size_t count) {
  std::string origins, bases, masks, loose_masks;
  std::vector<std::uint64_t> mixed_words, loose_words;
  SampleWords words;
  for (std::size_t i = 0; i < count; ++i) {
    const Chunk& chunk = *chunks[i];
    put_bytes(origins, Origin{chunk.origin.x(), chunk.origin.y(), chunk.origin.z()});
    put_bytes(bases, std::uint32_t{chunk.base_count} + (chunk.above ? kAbove : 0) +
                         (chunk.loose_count > 0 ? kLoose : 0));
    ground.read_samples(chunk.origin, words);
    put_bytes(masks, masks_of(words, mixed_words));
    if (chunk.loose_count == 0) continue;
    ground.read_loose(chunk.origin, words);
    put_bytes(loose_masks, masks_of(words, loose_words));
  }
  mixed_words.insert(mixed_words.end(), loose_words.begin(), loose_words.end());
  return origins + bases + masks + loose_masks + planes(mixed_words);
}

/// Takes the words of mixed cells in order.
class MixedWords {
 public:
  explicit MixedWords(std::string_view planes) : planes_(planes) {
    if (planes.size() % 8 != 0) refuse();
  }
  void expand(const CellMasks& masks, SampleWords& words) {
    for (std::size_t n = 0; n < kChunkVoxels; ++n) {
      words[n] = (masks.full[n >> 6] >> (n & 63) & 1) != 0 ? kAllSoil : 0;
      if ((masks.mixed[n >> 6] >> (n & 63) & 1) == 0) continue;
      if (next_ == planes_.size() / 8) refuse();
      words[n] = word_of(planes_, next_++);
    }
  }
  bool empty() const { return next_ == planes_.size() / 8; }

 private:
  std::string_view planes_;
  std::size_t next_ = 0;
};

void restore_part(std::string_view bytes, std::size_t count, Ground& ground) {
  if (count > kChunksPerPart) refuse();
  Reader in(bytes);
  Reader origins(in.take(count * sizeof(Origin)));
  std::vector<std::uint32_t> bases(count);
  for (std::uint32_t& base : bases) {
    base = in.get<std::uint32_t>();
    if (base >= kFlags) refuse();
  }
  const auto loose_chunks = static_cast<std::uint64_t>(
      std::count_if(bases.begin(), bases.end(), [](auto base) { return (base & kLoose) != 0; }));
  Reader masks(in.take(count * sizeof(CellMasks)));
  Reader loose_masks(in.take(loose_chunks * sizeof(CellMasks)));
  MixedWords mixed_words(in.rest());
  std::vector<Chunk> chunks(count);
  SampleWords words;
  for (std::size_t i = 0; i < count; ++i) {
    Chunk& chunk = chunks[i];
    const auto origin = origins.get<Origin>();
    chunk.origin = {origin[0], origin[1], origin[2]};
    if ((origin[0] | origin[1] | origin[2]) % kChunkSide != 0) refuse();
    chunk.base_count = static_cast<std::uint16_t>(bases[i]);
    chunk.above = (bases[i] & kAbove) != 0;
    mixed_words.expand(masks.get<CellMasks>(), words);
    chunk.samples.assign(words);
  }
  for (std::size_t i = 0; i < count; ++i) {
    if ((bases[i] & kLoose) == 0) continue;
    mixed_words.expand(loose_masks.get<CellMasks>(), words);
    for (int n = 0; n < kChunkVoxels; ++n)
      if ((words[static_cast<std::size_t>(n)] & ~chunks[i].samples.word(n)) != 0) refuse();
    chunks[i].loose.assign(words);
  }
  if (!mixed_words.empty()) refuse();
  GroundWriter writer(ground);
  for (Chunk& chunk : chunks) {
    if (ground.find(chunk.origin) != nullptr) refuse();
    writer.put(std::move(chunk));
  }
}

/// Compressed if Blosc makes it smaller.
std::string compressed(std::string bytes) {
  if (bytes.size() > std::numeric_limits<int>::max() / 2 ||
      !openvdb::compression::bloscCanCompress())
    return bytes;
  std::size_t size = 0;
  const auto smaller = openvdb::compression::bloscCompress(bytes.data(), bytes.size(), size);
  return smaller && size < bytes.size() ? std::string(smaller.get(), size) : bytes;
}

}  // namespace

std::string samples_bytes(const Ground& ground, const std::vector<Coord3>& dropped) {
  const std::vector<const Chunk*> chunks = ground.chunks();
  const std::size_t parts = (chunks.size() + kChunksPerPart - 1) / kChunksPerPart;
  std::vector<std::string> bytes(parts);
  tbb::parallel_for(std::size_t{0}, parts, [&](std::size_t i) {
    const std::size_t first = i * kChunksPerPart;
    const std::size_t count = std::min(kChunksPerPart, chunks.size() - first);
    const std::string plain = part_bytes(ground, &chunks[first], count);
    const std::string small = compressed(plain);
    put_bytes(bytes[i], PartHead{count, plain.size(), small.size()});
    bytes[i] += small;
  });
  std::string all;
  put_bytes(all, std::uint64_t{dropped.size()});
  for (const Coord3& c : dropped) put_bytes(all, Origin{c.x(), c.y(), c.z()});
  put_bytes(all, std::uint64_t{parts});
  for (const std::string& part : bytes) all += part;
  return all;
}

std::vector<Coord3> restore_samples(std::string_view bytes, Ground& ground) {
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
      restore_part(stored, head.chunks, ground);
      continue;
    }
    constexpr std::size_t kMost = kChunksPerPart * (sizeof(Origin) + 4 + 4 * sizeof(SampleWords));
    if (head.size > kMost || head.stored < 16) refuse();
    // Blosc's header has the sizes at 4 and 12.
    std::uint32_t plain = 0, small = 0;
    std::memcpy(&plain, stored.data() + 4, 4);
    std::memcpy(&small, stored.data() + 12, 4);
    if (plain != head.size || small != head.stored) refuse();
    const auto whole = openvdb::compression::bloscDecompress(stored.data(), head.size);
    if (!whole) refuse();
    restore_part({whole.get(), head.size}, head.chunks, ground);
  }
  if (!in.empty()) refuse();
  return dropped;
}

}  // namespace soilvdb::inline v0::io
