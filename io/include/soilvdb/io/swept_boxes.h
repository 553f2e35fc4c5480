// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Boxes around a bucket's way, recorded while its motion is read.
#pragma once

#include <cstddef>
#include <vector>

#include "soilvdb/bucket.h"
#include "soilvdb/motion.h"

namespace soilvdb::inline v0::io {

using Box3 = Eigen::AlignedBox3d;

/// Corners of a bucket's digging parts, in the bucket frame, one per column.
using Corners = Eigen::Matrix3Xd;
Corners bucket_corners(const Bucket& bucket);

/// A box, world, around all that a bucket sweeps in a step.
struct StepBox {
  std::size_t row = 0;  ///< from this row of a motion to the next, or at the only row
  Box3 box;
};

/// Boxes of the steps that begin in rows [first, last) of a motion.
std::vector<StepBox> step_boxes(const Motion& motion, const Bucket& bucket, std::size_t first,
                                std::size_t last);

/// Boxes of all that a bucket sweeps on its way, one for kStepsPerBox steps between rows.
class SweptBoxes {
 public:
  static constexpr std::size_t kStepsPerBox = 64;

  /// Adds the next part of the bucket's motion. The length of all parts but the last must be a
  /// multiple of kStepsPerBox.
  void add(const Motion& part, const Bucket& bucket);

  const std::vector<Box3>& blocks() const { return blocks_; }
  Box3 whole() const;

 private:
  std::vector<Box3> blocks_;
};

}  // namespace soilvdb::inline v0::io
