// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Measures that have names: boundaries, sections, heights and distances that people keep on a site.
#pragma once

#include <cstdint>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "soilvdb/types.h"

namespace soilvdb::tools {

class GroundQuery;

inline constexpr const char* kMeasuresName = "measures.json";
/// Of a boundary.

struct Measure {
  enum class Kind { kBoundary, kSection, kHeight, kDistance };
  std::uint64_t id = 0;  ///< never used again on this site
  Kind kind = Kind::kBoundary;
  std::string name = {};
  std::vector<Vec2> points = {};  ///< world, m
  std::uint64_t shape = 0;        ///< another number whenever points are others
};

/// The measures of a site, in a file. A crash leaves it as it was before a change, or after it.
class Measures {
 public:
  /// @param file empty: measures are lost at the end
  /// @throw io::InputError if the file exists and holds no measures
  explicit Measures(std::filesystem::path file);

  const std::vector<Measure>& all() const { return all_; }
  /// Those with a boundary.
  std::vector<Measure> areas() const;
  /// @throw std::invalid_argument with one line
  const Measure& find(std::uint64_t id) const;

  /// `{"add": {"kind": "boundary", "name": "Pit", "points": [[x, y], ..]}}`, `{"change": {"id": 1,
  /// "name": .., "points": ..}}` with one or both, or `{"remove": 1}`.
  /// @return the measure as it is now. @throw std::exception with one line: nothing has changed
  nlohmann::ordered_json change(std::string_view text);

  /// `{"measures": [{"id", "kind", "name", "points"}, ..]}`
  nlohmann::ordered_json json() const;
  /// For maps and other programs. @param crs_wkt of the site; empty: unknown
  nlohmann::ordered_json geojson(const std::string& crs_wkt) const;

 private:
  void keep(std::vector<Measure> all, std::uint64_t next);

  std::filesystem::path file_;
  std::vector<Measure> all_ = {};
  std::uint64_t next_ = 1, shapes_ = 0;
};

/// The header of measures.csv, and a row with a measure's values.
std::string measures_csv_head();
std::string measures_csv_row(const Measure& measure, GroundQuery& ground);

}  // namespace soilvdb::tools
