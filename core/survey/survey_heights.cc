// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/survey_heights.h"

#include <algorithm>
#include <cmath>
#include <span>
#include <stdexcept>

#include "core/constants.h"
#include "core/ground/ground_columns.h"
#include "core/lattice/bytes.h"
#include "core/lattice/chunk_math.h"

namespace soilvdb::inline v0 {

void SurveyHeights::validate() const {
  const auto most = static_cast<std::int64_t>(kMaxIndex);
  for (int axis = 0; axis < 2; ++axis)
    if (size[axis] < 0 || first[axis] <= -most || std::int64_t{first[axis]} + size[axis] >= most)
      throw std::invalid_argument("a survey must be within 2^23 voxels of the site's origin");
  const std::int64_t count = std::int64_t{size.x()} * size.y();
  if (border < 0 || border > kMostSurveyedColumns || 2 * border > size.minCoeff())
    throw std::invalid_argument("a border of a survey's part must be within the part");
  if (count > kMostSurveyedColumns || static_cast<std::size_t>(count) != heights.size())
    throw std::invalid_argument("a part of a survey must have a height for each of its columns, " +
                                std::to_string(kMostSurveyedColumns) + " at most");
  for (const std::int32_t height : heights)
    if (height != kNone && std::abs(std::int64_t{height}) >= 64 * most)
      throw std::invalid_argument("a survey must be within 2^23 voxels of the site's origin");
}

namespace {

/// Differences, which are compressed to less.
void put_differences(std::string& out, std::span<const std::int32_t> heights) {
  std::uint32_t before = 0;
  for (const std::int32_t height : heights) {
    const auto bits = static_cast<std::uint32_t>(height);
    put(out, bits - before);
    before = bits;
  }
}
void take_differences(std::string_view& in, std::span<std::int32_t> heights) {
  std::uint32_t bits = 0;
  for (std::int32_t& height : heights) {
    std::uint32_t more = 0;
    take(in, more);
    bits += more;
    height = static_cast<std::int32_t>(bits);
  }
}

}  // namespace

void SurveyHeights::save(std::string& out) const {
  put(out, first, size, border);
  put_differences(out, heights);
}

SurveyHeights SurveyHeights::load(std::string_view& in) {
  SurveyHeights loaded;
  take(in, loaded.first, loaded.size, loaded.border);
  const std::int64_t count = std::int64_t{loaded.size.x()} * loaded.size.y();
  if (loaded.size.minCoeff() < 0 || count > static_cast<std::int64_t>(in.size() / sizeof(int)))
    throw std::invalid_argument("the record of a survey ends too early");
  loaded.heights.resize(static_cast<std::size_t>(count));
  take_differences(in, loaded.heights);
  loaded.validate();
  return loaded;
}

std::size_t SurveyedHeights::number(const Coord2& column) {
  const Coord2 in = column - floor_to(column, kSide);
  return static_cast<std::size_t>(in.x() * kSide + in.y());
}

void SurveyedHeights::add(const SurveyHeights& survey) {
  const Coord2 low = floor_to(survey.begin(), kSide), end = survey.end();
  for (int x = low.x(); x < end.x(); x += kSide) {
    for (int y = low.y(); y < end.y(); y += kSide) {
      const Coord2 first = survey.begin().cwiseMax(Coord2(x, y));
      const Coord2 last = end.cwiseMin(Coord2(x + kSide, y + kSide));
      std::shared_ptr<const Square>& square = squares_[{x, y}];
      auto now = square ? std::make_shared<Square>(*square) : std::make_shared<Square>();
      if (!square) now->fill(SurveyHeights::kNone);
      for (int i = first.x(); i < last.x(); ++i) {
        for (int j = first.y(); j < last.y(); ++j) {
          const std::int32_t height =
              survey.heights[survey.number(i - survey.first.x(), j - survey.first.y())];
          if (height != SurveyHeights::kNone) (*now)[number({i, j})] = height;
        }
      }
      square = std::move(now);
    }
  }
}

std::vector<Coord2> SurveyedHeights::squares() const {
  std::vector<Coord2> lows;
  for (const auto& [cell, square] : squares_) lows.emplace_back(cell.first, cell.second);
  return lows;
}

bool SurveyedHeights::are_of(const Coord2& column, double top) const {
  const Coord2 low = floor_to(column, kSide);
  const auto square = squares_.find({low.x(), low.y()});
  if (square == squares_.end()) return false;
  const std::int32_t height = (*square->second)[number(column)];
  return height != SurveyHeights::kNone && 64 * top == height;
}

void SurveyedHeights::save(std::string& out) const {
  put(out, std::uint64_t{squares_.size()});
  for (const auto& [cell, square] : squares_) {
    put(out, cell.first, cell.second);
    put_differences(out, *square);
  }
}

SurveyedHeights SurveyedHeights::load(std::string_view& in) {
  SurveyedHeights loaded;
  std::uint64_t count = 0;
  take(in, count);
  for (; count > 0; --count) {
    std::pair<int, int> cell;
    take(in, cell.first, cell.second);
    const auto square = std::make_shared<Square>();
    take_differences(in, *square);
    loaded.squares_[cell] = square;
  }
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
