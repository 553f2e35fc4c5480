// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A survey of the ground, such as a drone's, checked against the site whose ground it becomes.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "soilvdb/io/site.h"
#include "soilvdb/session.h"

namespace soilvdb::tools {

struct SurveyOptions {
  std::string name = "survey";          ///< in messages
  std::vector<Vec2> boundary = {};      ///< corners, world, m; empty: all of the survey
  bool trusts_heights = false;          ///< however far they are from the ground
  std::function<void()> go_on = [] {};  ///< called often; an exception from it ends the work
};

struct SurveyInput {
  /// Squares of columns, in which heights are that are to be taken.
  std::vector<SurveyHeights> parts;
  double area_m2 = 0;  ///< of the columns that are to be taken
  /// Parts of the survey's area: without a height; where the site has no ground.
  double voids = 0, outside = 0;
  std::vector<std::string> warnings = {};
};

/// @param site whose ground it becomes
/// @throw std::invalid_argument with one line if the survey is in another CRS, misses the site, or
///        is mostly far from the ground, as in another vertical datum or unit
SurveyInput read_survey(const Session& site, const io::Base& survey, const SurveyOptions& options);

}  // namespace soilvdb::tools
