// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Progress of named areas to the design: what is left over time, its rate, and its end.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "soilvdb/initial_terrain.h"
#include "tools/serve/ground_query.h"
#include "tools/serve/history.h"
#include "tools/serve/live_site.h"
#include "tools/serve/measures.h"

namespace soilvdb::tools {

/// Soil above the design in an area, and room below it.
struct Remaining {
  double cut_m3 = 0, fill_m3 = 0;
  double all_m3() const { return cut_m3 + fill_m3; }
};

/// Of an area. Without `why_nothing` there are values, from before digging to now.
struct Progress {
  std::uint64_t measure = 0;
  std::string name = {};
  std::string why_nothing = {};      ///< there is nothing to compare with the design
  std::vector<double> times_s = {};  ///< empty: no state had a time yet
  std::vector<Remaining> at = {};    ///< by time
  Remaining start = {}, now = {};
  std::optional<double> done = {};    ///< share of what was to cut and fill at the start
  std::optional<double> per_h = {};   ///< m3 of it per hour of work on the site
  double over_h = 0;                  ///< the last hours of work, from which `per_h` is
  std::optional<double> left_h = {};  ///< hours of work at that rate
  std::optional<double> end_s = {};   ///< when they will have passed
  std::string note = {};              ///< what `end_s` assumes, or why there is none
};

/// Remaining volumes at earlier times. They stay as they are until the past changes.
struct ProgressSamples {
  std::map<std::pair<double, std::uint64_t>, Remaining> at;  ///< by time and shape
  std::uint64_t changes = 0;                                 ///< LiveSite::changes_of_past()
};

/// Finds the progress of areas, one ground after another, so that others' queries come in between.
class ProgressQuery {
 public:
  /// Copies what it needs of a site. @throw std::invalid_argument without a design
  ProgressQuery(const LiveSite& site, std::vector<Measure> areas,
                std::shared_ptr<const InitialTerrain> design);

  /// Looks at one earlier ground at most. @param changes of the past, now
  /// @return are there more?
  bool step(History& history, ProgressSamples& samples, std::uint64_t changes);
  /// The machines' work as of now.
  void take_work(const LiveSite& site);
  /// After the last step. @param live the ground as of take_work()
  void finish(GroundQuery& live);
  const std::vector<Progress>& result() const { return result_; }

 private:
  std::optional<Remaining> remaining(GroundQuery& ground, const Measure& area) const;
  /// Hours in which a machine worked.
  double worked_h(double from_s, double to_s) const;
  void sum(Progress& progress, double area_m2) const;

  std::vector<Measure> areas_;
  std::shared_ptr<const InitialTerrain> design_;
  bool planned_ = false;
  std::vector<double> earlier_s_;
  std::optional<double> from_s_, to_s_;
  double known_s_ = 0;  ///< up to which the past is on disk
  std::uint64_t changes_;
  std::map<std::pair<double, std::uint64_t>, Remaining> found_;
  std::optional<WorkLog> log_;
  std::vector<Progress> result_;
};

nlohmann::ordered_json progress_json(const std::vector<Progress>& all);

}  // namespace soilvdb::tools
