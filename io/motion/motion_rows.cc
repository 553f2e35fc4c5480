// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/io/motion_rows.h"

#include <algorithm>
#include <stdexcept>

namespace soilvdb::inline v0::io {

MotionRows rows_between(const Motion& motion, double begin_s, double end_s) {
  const std::vector<double>& times = motion.times_s();
  // The pose at a row's own time also depends on the row after it, if there is one.
  const auto after_begin = std::upper_bound(times.begin(), times.end(), begin_s);
  const auto after_end = std::upper_bound(after_begin, times.end(), end_s);
  const auto first = static_cast<std::size_t>(std::max<std::ptrdiff_t>(
      0, std::min<std::ptrdiff_t>(after_begin - times.begin() - 1,
                                  static_cast<std::ptrdiff_t>(times.size()) - 2)));
  const std::size_t last =
      std::min(static_cast<std::size_t>(after_end - times.begin()), times.size() - 1);
  MotionRows rows;
  rows.times_s.assign(times.begin() + static_cast<std::ptrdiff_t>(first),
                      times.begin() + static_cast<std::ptrdiff_t>(last) + 1);
  rows.joints = motion.poses().empty();
  if (rows.joints) {
    rows.columns = motion.joint_values().size() / times.size();
    const auto values =
        motion.joint_values().subspan(first * rows.columns, (last + 1 - first) * rows.columns);
    rows.values.assign(values.begin(), values.end());
    return rows;
  }
  rows.columns = kPoseNumbers;
  for (const Pose& pose : motion.poses().subspan(first, last + 1 - first)) {
    const auto row = row_of(pose);
    rows.values.insert(rows.values.end(), row.begin(), row.end());
  }
  return rows;
}

Motion motion_of(const MotionRows& rows, const Chain& chain) {
  if (rows.joints) return {rows.times_s, rows.values, chain};
  if (rows.columns != kPoseNumbers || rows.values.size() != kPoseNumbers * rows.times_s.size())
    throw std::invalid_argument("a pose has seven numbers");
  std::vector<Pose> poses;
  for (const double* v = rows.values.data(); v < rows.values.data() + rows.values.size();
       v += kPoseNumbers)
    poses.push_back(pose_of(v));
  return {rows.times_s, std::move(poses)};
}

}  // namespace soilvdb::inline v0::io
