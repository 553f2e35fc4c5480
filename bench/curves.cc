// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "bench/curves.h"

#include <fmt/core.h>

#include <cmath>
#include <functional>
#include <map>

namespace soilvdb::bench {
namespace {

std::string dig_of(const Sample& s) { return fmt::format("{}/{}", s.family, s.placement); }

}  // namespace

std::set<std::string> digs_done(const std::vector<Sample>& samples, const std::string& engine,
                                int updates) {
  std::set<std::string> done;
  for (const Sample& s : samples) {
    if (s.engine != engine || s.updates != updates) continue;
    if (s.complete) done.insert(dig_of(s));
  }
  // A voxel size that no dig could be completed at does not count against the digs.
  std::map<double, bool> any;
  for (const Sample& s : samples) {
    if (s.engine == engine && s.updates == updates) any[s.voxel_m] |= s.complete;
  }
  for (const Sample& s : samples) {
    if (s.engine == engine && s.updates == updates && !s.complete && any[s.voxel_m]) {
      done.erase(dig_of(s));
    }
  }
  return done;
}

std::vector<Point> curve(const std::vector<Sample>& samples, const std::string& engine, int updates,
                         const std::set<std::string>& digs) {
  std::map<double, Point, std::greater<>> points;
  for (const Sample& s : samples) {
    if (s.engine != engine || s.updates != updates || !s.complete || !digs.contains(dig_of(s))) {
      continue;
    }
    Point& p = points[s.voxel_m];
    p.voxel_m = s.voxel_m;
    p.error += s.error * s.error;
    p.us_per_update += std::log(s.us_per_update);
    p.failures += s.failures;
    ++p.digs;
  }
  std::vector<Point> line;
  for (auto& [voxel, p] : points) {
    if (p.digs != digs.size()) continue;  // the same digs at every point
    const double n = static_cast<double>(p.digs);
    line.push_back(
        {p.voxel_m, std::sqrt(p.error / n), std::exp(p.us_per_update / n), p.digs, p.failures});
  }
  return line;
}

std::optional<double> us_at_error(const std::vector<Point>& line, double error) {
  for (std::size_t i = 0; i < line.size(); ++i) {
    if (line[i].error > error) continue;
    if (i == 0) return line[0].us_per_update;
    const Point &a = line[i - 1], &b = line[i];
    const double f = std::log(a.error / error) / std::log(a.error / b.error);
    return a.us_per_update * std::pow(b.us_per_update / a.us_per_update, f);
  }
  return std::nullopt;
}

}  // namespace soilvdb::bench
