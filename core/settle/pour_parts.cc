// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/pour_parts.h"

#include <algorithm>
#include <cmath>

#include "core/constants.h"

namespace soilvdb::inline v0 {

PourParts::PourParts(const Pour& pour, double voxel_size_m)
    : begin_s_(pour.begin_s), end_s_(pour.end_s) {
  if (end_s_ <= begin_s_) return;
  const double cells = pour.volume_m3 / (voxel_size_m * voxel_size_m * voxel_size_m);
  const double most = static_cast<double>(kMaxPourParts);
  count_ = std::max(kMinPourParts,
                    static_cast<std::int64_t>(std::min(std::ceil(cells / kPourPartCells), most)));
}

double PourParts::falls_s(std::int64_t part) const {
  if (part >= count_) return end_s_;
  return begin_s_ + (end_s_ - begin_s_) * static_cast<double>(part) / static_cast<double>(count_);
}

}  // namespace soilvdb::inline v0
