// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A survey of the ground, such as a drone's, as heights of columns of voxels.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "soilvdb/ground.h"

namespace soilvdb::inline v0 {

/// Mean heights of a rectangle of columns, in whole samples: 1/64 voxel, index space.
struct SurveyHeights {
  static constexpr std::int32_t kNone = std::numeric_limits<std::int32_t>::min();

  Coord2 first = {0, 0}, size = {0, 0};  ///< columns
  /// Of column (x, y) from the first: entry x * size.y() + y. kNone: not known, or no ground.
  std::vector<std::int32_t> heights = {};
  /// Columns along each side that only tell the slope of those beside them, so that a survey's
  /// parts make the same ground as the whole.
  int border = 0;

  Coord2 begin() const { return first + Coord2::Constant(border); }
  Coord2 end() const { return first + size - Coord2::Constant(border); }
  std::size_t number(int x, int y) const {
    return static_cast<std::size_t>(x) * static_cast<std::size_t>(size.y()) +
           static_cast<std::size_t>(y);
  }
  /// @throw std::invalid_argument unless they may be heights of a ground
  void validate() const;
  /// Adds them as bytes, and takes them from there. @throw std::invalid_argument for other bytes
  void save(std::string& out) const;
  static SurveyHeights load(std::string_view& in);
};

/// Heights of a ground's columns, counted. Those of a survey are those of an untouched ground of
/// that surface, voxel size and origin: where a survey has the terrain's heights nothing differs.
SurveyHeights column_heights(const Ground& ground, const Coord2& first, const Coord2& size);

/// The last height that surveys gave each column. Ground that still has it is as a survey says, and
/// no machine's work.
class SurveyedHeights {
 public:
  void add(const SurveyHeights& survey);
  /// Did a survey give a column this height? @param top index space
  bool are_of(const Coord2& column, double top) const;
  static constexpr int kSide = 64;  ///< columns
  /// The lowest columns of squares of kSide x kSide in which surveys gave heights.
  std::vector<Coord2> squares() const;
  /// Adds them as bytes, and takes them from there. @throw std::invalid_argument for other bytes
  void save(std::string& out) const;
  static SurveyedHeights load(std::string_view& in);

 private:
  using Square = std::array<std::int32_t, std::size_t{kSide} * kSide>;
  static std::size_t number(const Coord2& column);

  std::map<std::pair<int, int>, std::shared_ptr<const Square>> squares_;  // copies share them
};

/// What a survey changed.
struct SurveyVolumes {
  double removed_m3 = 0, added_m3 = 0;
  std::int64_t changed = 0;  ///< columns that have another height than before
};

}  // namespace soilvdb::inline v0
