// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Where a bucket goes: boxes about its way, taken down while its motion is read.
#pragma once

#include <cstddef>
#include <vector>

#include "soilvdb/bucket.h"
#include "soilvdb/motion.h"

namespace soilvdb::inline v0::io {

using Box3 = Eigen::AlignedBox3d;

/// Corners of everything of a bucket that digs, in the bucket frame, one per column.
using Corners = Eigen::Matrix3Xd;
Corners bucket_corners(const Bucket& bucket);

/// A box, world, about all that a bucket sweeps.
struct StepBox {
  std::size_t row = 0;  ///< from this row of a motion to the next, or at the only row
  Box3 box;
};

/// Boxes of the steps of a motion that begin in rows [first, last).
std::vector<StepBox> step_boxes(const Motion& motion, const Bucket& bucket, std::size_t first,
                                std::size_t last);

/// Boxes of all that a bucket sweeps on its way, one for so many steps between rows.
class SweptBoxes {
 public:
  static constexpr std::size_t kStepsPerBox = 64;

  /// Goes on by a part of the bucket's motion that joins the last one. All parts but the last are a
  /// multiple of kStepsPerBox long.
  void add(const Motion& part, const Bucket& bucket);

  const std::vector<Box3>& blocks() const { return blocks_; }
  Box3 whole() const;

 private:
  std::vector<Box3> blocks_;
};

}  // namespace soilvdb::inline v0::io
