// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// From single runs to curves of error over time, and what one engine costs at another's error.
#pragma once

#include <optional>
#include <set>
#include <string>
#include <vector>

namespace soilvdb::bench {

/// The volume error that the paper reports for its own method.
inline constexpr double kPaperError = 0.0076;

struct Sample {
  std::string engine, family;
  int placement = 0;
  double voxel_m = 0;
  int updates = 0;
  double error = 0;
  double us_per_update = 0;
  int failures = 0;  ///< steps that the engine could not do
  bool complete = false;
};

/// One voxel size of an engine at one number of updates: root mean square error and geometric mean
/// time over the digs.
struct Point {
  double voxel_m = 0, error = 0, us_per_update = 0;
  std::size_t digs = 0;
  int failures = 0;  ///< steps
};

/// The digs (family and placement) that an engine completed at every voxel size it was tried at.
std::set<std::string> digs_done(const std::vector<Sample>& samples, const std::string& engine,
                                int updates);

/// From coarse to fine, over the digs named.
std::vector<Point> curve(const std::vector<Sample>& samples, const std::string& engine, int updates,
                         const std::set<std::string>& digs);

/// Time per update at which the curve comes down to `error`, linear between its points on log-log
/// scales; the coarsest point's time if it is below already; nothing if it never is.
std::optional<double> us_at_error(const std::vector<Point>& coarse_to_fine, double error);

}  // namespace soilvdb::bench
