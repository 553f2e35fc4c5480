// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/settle/fall_line.h"

#include <algorithm>
#include <cmath>

#include "core/constants.h"

namespace soilvdb::inline v0 {
namespace {

constexpr int kSides[8][2] = {{1, 0}, {1, 1}, {0, 1}, {-1, 1}, {-1, 0}, {-1, -1}, {0, -1}, {1, -1}};

/// The steepest way down from a column's middle, over the eight triangles around it.
struct Descent {
  double fall = 0;  // metres per column
  Vec2 way = Vec2::Zero();
  int x = 0, y = 0;  // neighbour nearest to the way
};

Descent descent(const FrontFinder& finder, const Columns& c, int x, int y) {
  Descent best;
  const double here = c.at(c.index(x, y));
  const auto height = [&](const int side[2]) { return c.at(c.index(x + side[0], y + side[1])); };
  const auto runs = [&](const int side[2]) {
    double edge;
    return c.open(x + side[0], y + side[1]) && !finder.step(x, y, x + side[0], y + side[1], edge);
  };
  const auto better = [&](double fall, const Vec2& way, const int side[2]) {
    if (fall > best.fall) best = {fall, way, x + side[0], y + side[1]};
  };
  for (int n = 0; n < 8; n += 2) {
    if (!runs(kSides[n])) continue;
    const Vec2 axis(kSides[n][0], kSides[n][1]);
    const double along = here - height(kSides[n]);
    better(along, axis, kSides[n]);
    for (const int m : {(n + 1) % 8, (n + 7) % 8}) {
      const int* corner = kSides[m];
      if (!runs(corner)) continue;
      const Vec2 diagonal(corner[0], corner[1]);
      const double beside = height(kSides[n]) - height(corner);
      if (beside >= 0 && beside <= along)
        better(std::sqrt(along * along + beside * beside),
               (along * axis + beside * (diagonal - axis)).normalized(),
               2 * beside > along ? corner : kSides[n]);
      else if (beside > along)
        better((along + beside) / std::sqrt(2.0), diagonal.normalized(), corner);
    }
  }
  return best;
}

}  // namespace

void FallLine::find(const FrontFinder& finder, const Columns& columns, double slope,
                    const Source& from, double level) {
  nodes_.clear();
  // Too steep to the next column; and too steep on the whole, if it goes on so.
  const double repose = slope * columns.side_m, noise = kRunOnDrop * columns.side_m;
  double beyond = 0;
  bool surely = true;
  std::size_t sure = 1;
  int x = from.column / columns.ny, y = from.column % columns.ny;
  Vec2 at = from.at;
  nodes_.push_back({at, level, from.column});
  along_ = from.along;
  if (from.is_line()) {
    nodes_.push_back({at, std::min(level, columns.at(from.column)), from.column});
    return;
  }
  for (bool first = true;; first = false) {
    const int column = columns.index(x, y);
    const Descent down = descent(finder, columns, x, y);
    const Vec2 middle(x + 0.5, y + 0.5);
    double ground = columns.at(column) - down.fall * down.way.dot(at - middle);
    ground = std::min(ground, nodes_.back().level);
    if (!first || ground < level) nodes_.push_back({at, ground, column});
    if (surely) sure = nodes_.size();
    if (!(down.fall > kRunSlope * repose)) break;
    // To the column's side, and on into the column there; or to the lowest, where that isn't lower.
    double length = 2;
    int side_x = x, side_y = y;
    for (int axis = 0; axis < 2; ++axis) {
      if (down.way[axis] == 0) continue;
      const double to =
          (middle[axis] + (down.way[axis] > 0 ? 0.5 : -0.5) - at[axis]) / down.way[axis];
      if (to >= length) continue;
      length = std::max(0.0, to);
      side_x = x + (axis == 0 ? (down.way[axis] > 0 ? 1 : -1) : 0);
      side_y = y + (axis == 1 ? (down.way[axis] > 0 ? 1 : -1) : 0);
    }
    if (columns.open(side_x, side_y) &&
        columns.at(columns.index(side_x, side_y)) < columns.at(column)) {
      at += length * down.way;
      x = side_x;
      y = side_y;
    } else {
      x = down.x;
      y = down.y;
      at = (middle + Vec2(x + 0.5, y + 0.5)) / 2;
    }
    beyond += down.fall - repose;
    surely = down.fall > repose + noise || beyond > noise;
  }
  nodes_.erase(nodes_.begin() + static_cast<std::ptrdiff_t>(sure), nodes_.end());
}

double FallLine::upright() const {
  const std::size_t n = nodes_.size();
  if (n > 1 && nodes_[n - 1].at != nodes_[n - 2].at) return lowest();
  return n > 2 ? nodes_[n - 2].level : std::numeric_limits<double>::infinity();
}

Source FallLine::at(double level) const {
  const auto below =
      std::find_if(nodes_.begin(), nodes_.end(), [&](const Node& n) { return n.level < level; });
  if (below == nodes_.begin()) return {nodes_.front().at, nodes_.front().column, along_};
  if (below == nodes_.end()) return {nodes_.back().at, nodes_.back().column, along_};
  const Node& above = *(below - 1);
  const double s = (level - below->level) / (above.level - below->level);
  return {below->at + s * (above.at - below->at), above.column, along_};
}

}  // namespace soilvdb::inline v0
