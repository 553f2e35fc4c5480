// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/survey_heights.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "core/constants.h"
#include "core/ground/ground_columns.h"
#include "core/lattice/bytes.h"

namespace soilvdb::inline v0 {

void SurveyHeights::validate() const {
  const auto most = static_cast<std::int64_t>(kMaxIndex);
  for (int axis = 0; axis < 2; ++axis)
    if (size[axis] < 0 || first[axis] <= -most || std::int64_t{first[axis]} + size[axis] >= most)
      throw std::invalid_argument("a survey must be within 2^23 voxels of the site's origin");
  const std::int64_t count = std::int64_t{size.x()} * size.y();
  if (count > kMostSurveyedColumns || static_cast<std::size_t>(count) != heights.size())
    throw std::invalid_argument("a part of a survey must have a height for each of its columns, " +
                                std::to_string(kMostSurveyedColumns) + " at most");
  for (const std::int32_t height : heights)
    if (height != kNone && std::abs(std::int64_t{height}) >= 64 * most)
      throw std::invalid_argument("a survey must be within 2^23 voxels of the site's origin");
}

void SurveyHeights::save(std::string& out) const {
  for (const Coord2& pair : {first, size})
    for (const int value : pair) put(out, value);
  std::uint32_t before = 0;
  for (const std::int32_t height : heights) {  // differences, which are compressed to less
    const auto bits = static_cast<std::uint32_t>(height);
    put(out, bits - before);
    before = bits;
  }
}

SurveyHeights SurveyHeights::load(std::string_view& in) {
  SurveyHeights loaded;
  for (Coord2* pair : {&loaded.first, &loaded.size})
    for (int& value : *pair) take(in, value);
  const std::int64_t count = std::int64_t{loaded.size.x()} * loaded.size.y();
  if (loaded.size.minCoeff() < 0 || count > static_cast<std::int64_t>(in.size() / sizeof(int)))
    throw std::invalid_argument("the record of a survey ends too early");
  std::uint32_t bits = 0;
  for (std::int64_t i = 0; i < count; ++i) {
    std::uint32_t more = 0;
    take(in, more);
    bits += more;
    loaded.heights.push_back(static_cast<std::int32_t>(bits));
  }
  loaded.validate();
  return loaded;
}

SurveyHeights column_heights(const Ground& ground, const Coord2& first, const Coord2& size) {
  SurveyHeights out{first, size, {}};
  out.heights.assign(static_cast<std::size_t>(size.x()) * static_cast<std::size_t>(size.y()),
                     SurveyHeights::kNone);
  out.validate();
  BaseColumns base(ground);
  const Coord2 end = first + size;
  for (int cx = floor_to(first.x(), kChunkSide); cx < end.x(); cx += kChunkSide) {
    for (int cy = floor_to(first.y(), kChunkSide); cy < end.y(); cy += kChunkSide) {
      const ColumnTile tile = read_tile_exactly(base, cx, cy, kNoCeiling, false);
      for (int x = std::max(cx, first.x()); x < std::min(cx + kChunkSide, end.x()); ++x) {
        for (int y = std::max(cy, first.y()); y < std::min(cy + kChunkSide, end.y()); ++y) {
          const GroundColumn& column =
              tile.columns[static_cast<std::size_t>((x - cx) * kChunkSide + y - cy)];
          if (column.known && std::abs(column.top) < kMaxIndex)
            out.heights[out.number(x - first.x(), y - first.y())] =
                static_cast<std::int32_t>(std::lround(64 * column.top));
        }
      }
    }
  }
  return out;
}

}  // namespace soilvdb::inline v0
