// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// phi of a chunk, kept small: of most rows a part only is within the band.
#pragma once

#include <array>
#include <cstdint>

#include "core/base_surface.h"
#include "core/heap_block.h"

namespace soilvdb {

/// phi of a chunk's voxels in 1/32767 of the band, at voxel x*64 + y*8 + z.
using Phi = std::array<std::int16_t, kLeafSize>;
inline constexpr std::int16_t kPhiMax = 32767;

/// A Phi without the voxels that a row of eight, upwards, begins with at -band or ends with at
/// +band. Or none at all.
class PackedPhi {
 public:
  explicit operator bool() const { return static_cast<bool>(block_); }
  void reset() { block_.reset(); }
  void assign(const Phi& phi);
  void expand(Phi& phi) const;
  bool operator==(const PackedPhi& other) const;
  std::size_t heap_bytes() const { return block_ ? block_->bytes() + kHeapWord : 0; }

  /// To bytes and back, as HeapBlock.
  void put(std::string& out) const { block_.put(out); }
  bool take(std::string_view& in) { return block_.take(in); }

 private:
  static constexpr int kRows = kLeafSize / kLeafSide;

  /// The values that are kept follow, row by row, then kPad that are read but not looked at.
  struct Head {
    std::uint16_t size, capacity;  ///< values
    std::uint8_t rows[kRows];      ///< the first voxel that is kept, and 16 times the one after

    std::size_t bytes() const { return sizeof(Head) + (capacity + kPad) * sizeof(std::int16_t); }
  };
  static constexpr int kPad = kLeafSide;

  HeapBlock<Head> block_;
};

}  // namespace soilvdb
