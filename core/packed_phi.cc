// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/packed_phi.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "core/affine.h"
#include "core/lanes.h"

namespace soilvdb {
namespace {

/// A row, and a lane for each of its voxels.
using Row = std::int16_t __attribute__((vector_size(kLeafSide * sizeof(std::int16_t))));
constexpr Row kVoxel = {0, 1, 2, 3, 4, 5, 6, 7};

SOILVDB_INLINE Row all_of(std::int16_t v) { return Row{} + v; }

/// Halves of a row's lanes, each lane all ones or zero.
struct Lanes16 {
  std::uint64_t low, high;
  SOILVDB_INLINE explicit Lanes16(Row mask) { std::memcpy(this, &mask, sizeof(mask)); }
  SOILVDB_INLINE int first() const {
    return low ? std::countr_zero(low) / 16 : 4 + std::countr_zero(high) / 16;
  }
  SOILVDB_INLINE int after_last() const {
    return high ? 8 - std::countl_zero(high) / 16 : 4 - std::countl_zero(low) / 16;
  }
};

}  // namespace

SOILVDB_FOR_CPUS void PackedPhi::assign(const Phi& phi) {
  std::uint8_t rows[kRows];
  std::int16_t values[kLeafSize + kLeafSide];
  std::size_t size = 0;
  for (std::size_t r = 0; r < kRows; ++r) {
    Row row;
    std::memcpy(&row, &phi[r * kLeafSide], sizeof(row));
    const int first = Lanes16(row != all_of(-kPhiMax)).first();
    const int end = Lanes16(row != all_of(kPhiMax)).after_last();
    rows[r] = static_cast<std::uint8_t>(first | end << 4);
    // Eight at once; the next row goes over those that are too many.
    const auto from = r * kLeafSide + static_cast<std::size_t>(first);
    std::memcpy(values + size, phi.data() + from,
                std::min(sizeof(row), (kLeafSize - from) * sizeof(phi[0])));
    size += static_cast<std::size_t>(end - first);
  }
  const std::size_t fixed = sizeof(Head) + kPad * sizeof(std::int16_t);
  const std::size_t bytes = heap_size(fixed + size * sizeof(std::int16_t));
  if (!block_ || block_->bytes() != bytes) {
    block_.reset();
    block_.resize(bytes);
    std::memset(block_.get() + 1, 0, bytes - sizeof(Head));
  }
  block_->size = static_cast<std::uint16_t>(size);
  block_->capacity = static_cast<std::uint16_t>((bytes - fixed) / sizeof(std::int16_t));
  std::memcpy(block_->rows, rows, sizeof(rows));
  std::memcpy(block_.get() + 1, values, size * sizeof(std::int16_t));
}

SOILVDB_FOR_CPUS void PackedPhi::expand(Phi& phi) const {
  const char* values = reinterpret_cast<const char*>(block_.get() + 1);
  for (std::size_t r = 0; r < kRows; ++r) {
    const int first = block_->rows[r] & 15, end = block_->rows[r] >> 4;
    Row row;  // the values that come before the first are within the head
    std::memcpy(&row, values - first * static_cast<int>(sizeof(phi[0])), sizeof(row));
    row = kVoxel < all_of(static_cast<std::int16_t>(first)) ? all_of(-kPhiMax) : row;
    row = kVoxel < all_of(static_cast<std::int16_t>(end)) ? row : all_of(kPhiMax);
    std::memcpy(&phi[r * kLeafSide], &row, sizeof(row));
    values += (end - first) * static_cast<int>(sizeof(phi[0]));
  }
}

bool PackedPhi::operator==(const PackedPhi& other) const {
  if (!block_ || !other.block_) return !block_ && !other.block_;
  return block_->size == other.block_->size &&
         std::memcmp(block_->rows, other.block_->rows, sizeof(block_->rows)) == 0 &&
         std::memcmp(block_.get() + 1, other.block_.get() + 1,
                     block_->size * sizeof(std::int16_t)) == 0;
}

}  // namespace soilvdb
