// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// How far loose soil reaches whose top stands at a level: the least stable surface over a point.
// Lengths in plan are in columns here, heights in metres, volumes in metres of one column.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <vector>

#include "core/settle/columns.h"

namespace soilvdb::inline v0 {

inline constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Where soil arrives: a point, or a line to `at + along`, and the column that `at` lies on
/// (columns share their sides).
struct Source {
  Vec2 at;
  int column;
  Vec2 along{0, 0};

  bool is_line() const { return along != Vec2::Zero(); }
};

/// What distances go on from in straight lines, a point mostly, and the way to it from the source.
struct Anchor {
  Vec2 from;
  double distance;
  bool lip;          ///< on the edge of a step down
  Vec2 opens;        ///< where soil runs over that edge, if it only just does: there it came first
  Vec2 along{0, 0};  ///< a line from `from`: its nearest point counts

  Vec2 nearest(const Vec2& to) const {
    if (along == Vec2::Zero()) return from;
    return from + std::clamp(along.dot(to - from) / along.squaredNorm(), 0.0, 1.0) * along;
  }
  /// Distance of a place that sees it.
  double distance_to(const Vec2& place) const { return distance + (place - nearest(place)).norm(); }
};

/// The surface max(ground, level - slope * distance) over what is reached: distances are those of
/// ways that stay below that surface's ground, round corners, over lips that the soil is above of.
struct Front {
  /// A column reached. `key` is the level from which on it is: ground + slope * distance.
  struct Part {
    int column, anchor;
    double distance, key;
  };
  /// A step down where soil would run over from a level on, and the column below it.
  struct Lip {
    int below;
    double level;
  };

  double level = -std::numeric_limits<double>::infinity();
  double filled = 0, keys = 0;  ///< heights raised at this level; sum of the parts' keys
  double lip = std::numeric_limits<double>::infinity();  ///< least at which a new depth opens
  bool whole = true;        ///< not broken off because it held too much
  bool fits = false;        ///< only grow(): holds what was asked for
  std::vector<Part> parts;  ///< by distance, or as they were reached
  std::vector<Anchor> anchors;
  std::vector<Lip> lips;

  void clear();
  /// The level at which the parts hold so much, those of least key first.
  double level_of(double volume) const;
};

/// Finds fronts. Keeps its memory from one to the next: what a front costs goes with its parts.
class FrontFinder {
 public:
  /// To be called again when the ground has changed.
  void look_at(const Columns& columns, double slope);

  /// The front of soil whose top is at `level`; broken off once it holds more than `most`.
  void fill(const Source& source, double level, double most, Front& front);
  /// Lets the level rise until the front holds `volume`; ends before where soil would run over a
  /// lip, or distances change, or at `limit`. One pass.
  void grow(const Source& source, double volume, double limit, Front& front);

  /// Ground falls by a step from column (x, y) to its neighbour along an axis; then `edge` is the
  /// height of the step's upper edge.
  bool step(int x, int y, int to_x, int to_y, double& edge) const {
    const Columns& c = *columns_;
    const int high = c.index(x, y), low = c.index(to_x, to_y);
    const double most = slope_ + tau_;
    return (c.at(high) - c.at(low) > most || c.firm_at(high) - c.firm_at(low) > most) &&
           steps_down(x, y, to_x, to_y, edge);
  }

 private:
  enum State : std::uint8_t { kReached, kQueued, kTooHigh };
  struct Label {
    double distance;
    int anchor, corner;  // corner: the anchor at its middle
    std::uint32_t epoch = 0;
    State state;
  };
  struct Steps {
    std::uint32_t ground = 0;
    std::uint8_t to;
  };
  struct Queued {
    double order, distance;
    int column, anchor;
    /// So that the first of a heap is the next to come.
    bool operator<(const Queued& o) const {
      if (order != o.order) return order > o.order;
      return distance != o.distance ? distance > o.distance : column > o.column;
    }
  };

  const Columns* columns_ = nullptr;
  double slope_ = 0, tau_ = 0;  // metres per column; metres
  std::uint32_t epoch_ = 0, ground_ = 0;
  std::vector<Label> labels_;
  std::vector<Steps> steps_;  // of this ground where they were asked for
  std::vector<Queued> queue_;
  std::vector<int> under_source_;
  Front* front_ = nullptr;
  bool growing_ = false;
  double level_ = 0, limit_ = 0;

  void begin(const Source& source, Front& front);
  void end();
  void push(double order, double distance, int column, int anchor);
  Queued pop();
  bool take(const Queued& next);
  void expand(int column);
  void over_lip(int x, int y, int to_x, int to_y, double edge, const Anchor& from);
  void over_lip_to(int x, int y, const Vec2& lip, const Vec2& opens, const Anchor& from);
  void reach(int column, double distance, int anchor);
  void over_lips_of(int column, int anchor);
  bool steps_down(int x, int y, int to_x, int to_y, double& edge) const;
  unsigned steps(int column);
  int side_of(int way) const { return way == 1 ? 2 : way == -1 ? 1 : way > 0 ? 3 : 0; }
  bool steps_to(int column, int to) { return (steps(column) >> side_of(to - column) & 1) != 0; }
  double edge(int column, int side) const;
  bool sees(int anchor, double distance, const Vec2& way, int column, double level);
  bool passes(int n, int to, double surface);
  bool labelled(int column) const {
    return labels_[static_cast<std::size_t>(column)].epoch == epoch_;
  }
  Label& label(int column) { return labels_[static_cast<std::size_t>(column)]; }
  const Label& label(int column) const { return labels_[static_cast<std::size_t>(column)]; }
  const Anchor& anchor(int i) const { return front_->anchors[static_cast<std::size_t>(i)]; }
  int add_anchor(const Vec2& at, double distance);
};

}  // namespace soilvdb::inline v0
