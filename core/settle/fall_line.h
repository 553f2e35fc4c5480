// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The way that soil runs down ground too steep for it.
#pragma once

#include <vector>

#include "core/settle/front.h"

namespace soilvdb::inline v0 {

/// From a point down the fall line to where soil comes to rest. What piles up there leans against
/// the way, so its top goes up it as it grows; above the way's begin it stands over that.
class FallLine {
 public:
  /// A line of soil rests where it falls.
  /// @param level of the soil where it starts, at least the ground's there: it falls down the rest
  void find(const FrontFinder& finder, const Columns& columns, double slope, const Source& from,
            double level);
  /// Where a pile's top is when it is at a level.
  Source at(double level) const;
  double lowest() const { return nodes_.back().level; }
  Source end() const { return {nodes_.back().at, nodes_.back().column, along_}; }
  /// The pile's top rises over one point up to this level.
  double upright() const;

 private:
  struct Node {
    Vec2 at;
    double level;
    int column;  ///< that the way goes on through
  };
  std::vector<Node> nodes_;
  Vec2 along_{0, 0};  ///< of a line, which has no way down
};

}  // namespace soilvdb::inline v0
