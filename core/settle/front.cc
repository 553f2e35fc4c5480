// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/settle/front.h"

#include <algorithm>
#include <cmath>

#include "core/constants.h"

namespace soilvdb::inline v0 {
namespace {

/// From a column to its neighbours along the axes; opposite sides add up to 3.
constexpr int kTowards[4][2] = {{-1, 0}, {0, -1}, {0, 1}, {1, 0}};

Vec2 middle(int x, int y) { return {x + 0.5, y + 0.5}; }

}  // namespace

void Front::clear() {
  level = -kInfinity;
  filled = keys = 0;
  lip = kInfinity;
  whole = true;
  fits = false;
  parts.clear();
  anchors.clear();
  lips.clear();
}

double Front::level_of(double volume) const {
  double count = static_cast<double>(parts.size());
  double at = (volume + keys) / count;
  // Parts that would have less than nothing leave; what they took away lowers the level.
  for (;;) {
    double sum = 0, below = 0;
    for (const Part& part : parts) {
      if (!(part.key < at)) continue;
      sum += part.key;
      ++below;
    }
    if (below == 0 || below >= count) return at;  // more: by rounding, where a key is the level
    count = below;
    at = (volume + sum) / count;
  }
}

void FrontFinder::look_at(const Columns& columns, double slope) {
  columns_ = &columns;
  slope_ = slope * columns.side_m;
  tau_ = kRunOnDrop * columns.side_m;
  labels_.resize(columns.height_m.size());
  steps_.resize(columns.height_m.size());
  if (++ground_ == 0) {
    for (Steps& s : steps_) s.ground = 0;
    ground_ = 1;
  }
}

int FrontFinder::add_anchor(const Vec2& at, double distance) {
  front_->anchors.push_back({at, distance, false, at});
  return static_cast<int>(front_->anchors.size()) - 1;
}

void FrontFinder::begin(const Source& source, Front& front) {
  front.clear();
  front_ = &front;
  queue_.clear();
  if (++epoch_ == 0) {
    for (Label& l : labels_) l.epoch = 0;
    epoch_ = 1;
  }
  front_->anchors[static_cast<std::size_t>(add_anchor(source.at, 0))].along = source.along;
  // Soil that falls on a column spreads from it even where its middle is higher than the soil.
  const auto spread = [&](int column) {
    if (labelled(column)) return;
    reach(column, anchor(0).distance_to(middle(column / columns_->ny, column % columns_->ny)), 0);
  };
  std::vector<int>& columns = under_source_;
  columns.assign(1, source.column);
  spread(source.column);
  const int steps = static_cast<int>(std::ceil(source.along.norm() / kSourceStep));
  for (int i = 0; i <= steps && steps > 0; ++i) {
    const Vec2 at = source.at + source.along * (static_cast<double>(i) / steps);
    const int x = static_cast<int>(std::floor(at.x())), y = static_cast<int>(std::floor(at.y()));
    if (!columns_->open(x, y)) continue;
    if (columns_->index(x, y) != columns.back()) columns.push_back(columns_->index(x, y));
    spread(columns.back());
  }
  for (const int column : columns) expand(column);
}

void FrontFinder::end() {
  for (const Front::Lip& lip : front_->lips)
    if (!labelled(lip.below) || label(lip.below).state != kReached)
      front_->lip = std::min(front_->lip, lip.level);
}

void FrontFinder::fill(const Source& source, double level, double most, Front& front) {
  growing_ = false;
  level_ = front.level = level;
  begin(source, front);
  front.level = level;
  while (!queue_.empty()) {
    const Queued next = pop();
    if (!take(next)) continue;
    front.filled += level - front.parts.back().key;
    if (front.filled > most) {
      front.whole = false;
      break;
    }
    expand(next.column);
  }
  end();
}

void FrontFinder::grow(const Source& source, double volume, double limit, Front& front) {
  growing_ = true;
  level_ = -kInfinity;
  limit_ = limit;
  begin(source, front);
  double count = 0;
  const auto holds = [&](double level) {
    return count > 0 && count * level - front.keys >= volume;
  };
  while (!front.fits && limit_ > level_ && !queue_.empty()) {
    const Queued next = pop();
    if (holds(std::min(next.order, limit_))) {
      front.fits = true;
    } else if (next.order > limit_) {
      break;
    } else if (take(next)) {
      level_ = std::max(level_, next.order);
      ++count;
      expand(next.column);
      front.fits = holds(level_);
    }
  }
  if (queue_.empty() && count > 0 && holds(limit_)) front.fits = true;
  front.level = front.fits ? front.level_of(volume) : limit_;
  front.filled = front.fits ? volume : count > 0 ? count * limit_ - front.keys : 0;
}

void FrontFinder::push(double order, double distance, int column, int anchor) {
  queue_.push_back({order, distance, column, anchor});
  std::push_heap(queue_.begin(), queue_.end());
}

FrontFinder::Queued FrontFinder::pop() {
  std::pop_heap(queue_.begin(), queue_.end());
  const Queued next = queue_.back();
  queue_.pop_back();
  return next;
}

bool FrontFinder::take(const Queued& next) {
  Label& l = label(next.column);
  if (l.state != kQueued || l.distance != next.distance) return false;
  l.state = kReached;
  const double key = columns_->at(next.column) + slope_ * next.distance;
  front_->keys += key;
  front_->parts.push_back({next.column, next.anchor, next.distance, key});
  return true;
}

void FrontFinder::expand(int column) {
  const Columns& c = *columns_;
  const int x = column / c.ny, y = column % c.ny;
  const Label here = label(column);
  const Anchor from = anchor(here.anchor);  // a copy: their list may grow
  if (!growing_) over_lips_of(column, here.anchor);
  for (int i = -1; i <= 1; ++i) {
    for (int j = -1; j <= 1; ++j) {
      if ((i == 0 && j == 0) || !c.open(x + i, y + j)) continue;
      const int to = column + i * c.ny + j;
      const bool known = labelled(to);
      if (known && (label(to).anchor == here.anchor || (!growing_ && label(to).state == kReached)))
        continue;
      const Vec2 goal = middle(x + i, y + j);
      const Vec2 way = from.nearest(goal) - goal;
      const double direct = from.distance + way.norm();
      const double longest = known ? label(to).distance : kInfinity;
      if (longest <= direct + kSamePlace) continue;
      const double key = c.at(to);
      const auto level = [&](double distance) {
        return growing_ ? std::max(level_, key + slope_ * distance) : level_;
      };
      if (sees(here.anchor, from.distance, way, to, level(direct))) {
        reach(to, direct, here.anchor);
        continue;
      }
      // Over a step it is over_lips_of() that goes on.
      if ((i == 0 || j == 0) && steps_to(column, to)) continue;
      // Round a corner: distances go on from the middle of this column.
      const Vec2 back(-i, -j);
      const double bent = here.distance + back.norm();
      if (longest <= bent + kSamePlace) continue;
      int& corner = label(column).corner;
      if (corner < 0) corner = add_anchor(middle(x, y), here.distance);
      if (sees(corner, here.distance, back, to, level(bent))) reach(to, bent, corner);
    }
  }
}

void FrontFinder::over_lip(int x, int y, int to_x, int to_y, double edge, const Anchor& from) {
  const int to = columns_->index(to_x, to_y);
  const Vec2 across(to_x - x, to_y - y), along(-across.y(), across.x());
  const Vec2 face = middle(x, y) + across / 2, near = from.nearest(face);
  const double ahead = (face - near).dot(across), beside = (near - face).dot(along);
  if (ahead < -kSamePlace) return;
  const double nearest = std::clamp(beside, -0.5, 0.5);
  const double opens = edge + slope_ * (from.distance + (face + nearest * along - near).norm());
  const double reach_there = (level_ - edge) / slope_ - from.distance;
  if (growing_) {
    const bool all = ahead * ahead + (std::abs(beside) + 0.5) * (std::abs(beside) + 0.5) <
                     reach_there * reach_there;
    if (!all || reach_there < 0) limit_ = std::min(limit_, std::max(opens, level_));
    return;
  }
  if (!(opens < level_)) return front_->lips.push_back({to, opens});
  // The soil stands above the edge where it is near enough to the anchor.
  const double half = std::sqrt(std::max(0.0, reach_there * reach_there - ahead * ahead));
  const double low = std::max(-0.5, beside - half), high = std::min(0.5, beside + half);
  const double straight = ahead > kSamePlace ? beside * 0.5 / (ahead + 0.5) : nearest;
  const int i = to_x - x, j = to_y - y;
  const Vec2 over = face + std::min(std::max(straight, low), high) * along;
  // What counted heights err by doesn't widen what soil runs over.
  const bool barely = level_ - opens < kMinEdgeCover * columns_->side_m;
  over_lip_to(to_x, to_y, over, barely ? Vec2(face + nearest * along) : over, from);
  const Vec2 left = face + low * along, right = face + high * along;
  over_lip_to(to_x + j, to_y - i, left, left, from);
  over_lip_to(to_x - j, to_y + i, right, right, from);
}

void FrontFinder::over_lip_to(int x, int y, const Vec2& lip, const Vec2& opens,
                              const Anchor& from) {
  if (!columns_->open(x, y)) return;
  const int to = columns_->index(x, y);
  const double to_lip = from.distance_to(lip);
  const double distance = to_lip + (middle(x, y) - lip).norm();
  if (labelled(to) && label(to).distance <= distance + kSamePlace) return;
  if (!(columns_->at(to) + slope_ * distance < level_)) return;
  front_->anchors.push_back({lip, to_lip, true, opens});
  const int at_lip = static_cast<int>(front_->anchors.size()) - 1;
  if (sees(at_lip, to_lip, lip - middle(x, y), to, level_)) reach(to, distance, at_lip);
}

void FrontFinder::reach(int column, double distance, int anchor) {
  const double key = columns_->at(column) + slope_ * distance;
  Label& l = label(column);
  if (growing_) {
    // Soil runs on, or a shorter way opened: distances are found anew at a level.
    if (level_ - key > tau_ || (labelled(column) && l.state == kReached)) {
      limit_ = std::min(limit_, level_);
      return;
    }
  } else if (labelled(column) && l.state == kReached) {
    return;
  }
  const bool low = growing_ || key < level_;
  const bool known = labelled(column);
  l = {distance, anchor, -1, epoch_, low ? kQueued : kTooHigh};
  if (low) push(growing_ ? std::max(key, level_) : distance, distance, column, anchor);
  if (!known && (growing_ || !low)) over_lips_of(column, anchor);
}

void FrontFinder::over_lips_of(int column, int from) {
  const unsigned down = steps(column);
  if (down == 0) return;
  const Anchor here = anchor(from);  // a copy: their list may grow
  const int x = column / columns_->ny, y = column % columns_->ny;
  for (int side = 0; side < 4; ++side) {
    if ((down >> side & 1) == 0) continue;
    const int to_x = x + kTowards[side][0], to_y = y + kTowards[side][1];
    over_lip(x, y, to_x, to_y, edge(column, side), here);
  }
}

/// To which sides the ground falls by a step, a bit each.
unsigned FrontFinder::steps(int column) {
  Steps& here = steps_[static_cast<std::size_t>(column)];
  if (here.ground == ground_) return here.to;
  const int x = column / columns_->ny, y = column % columns_->ny;
  unsigned to = 0;
  for (int side = 0; side < 4; ++side) {
    double edge;
    const int to_x = x + kTowards[side][0], to_y = y + kTowards[side][1];
    if (columns_->open(to_x, to_y) && step(x, y, to_x, to_y, edge)) to |= 1u << side;
  }
  here = {ground_, static_cast<std::uint8_t>(to)};
  return to;
}

/// Height of the upper edge of the step at a side.
double FrontFinder::edge(int column, int side) const {
  const int x = column / columns_->ny, y = column % columns_->ny;
  double edge = 0;
  steps_down(x, y, x + kTowards[side][0], y + kTowards[side][1], edge);
  return edge;
}

/// As step(), of columns that one of the two drops between.
bool FrontFinder::steps_down(int x, int y, int to_x, int to_y, double& edge) const {
  const Columns& c = *columns_;
  const int i = to_x - x, j = to_y - y, high = c.index(x, y), low = c.index(to_x, to_y);
  const double drop = c.at(high) - c.at(low), firm_drop = c.firm_at(high) - c.firm_at(low);
  // Ground goes on to the face from both sides as it came, unless it rises too steep for that.
  const int behind = c.open(x - i, y - j) ? c.index(x - i, y - j) : high;
  const int beyond = c.open(to_x + i, to_y + j) ? c.index(to_x + i, to_y + j) : low;
  const auto at_face = [&](double ground, double rise, double most) {
    return rise <= slope_ ? ground + std::max(rise, -most) / 2 : ground;
  };
  const auto foot_at_face = [&](double ground, double fall, double most) {
    return fall >= -slope_ ? ground + std::min(fall, most) / 2 : ground;
  };
  const double most = std::max(drop, slope_), firm_most = std::max(firm_drop, slope_);
  const double firm = at_face(c.firm_at(high), c.firm_at(high) - c.firm_at(behind), firm_most);
  const double loose =
      c.at(high) > c.firm_at(high) ? at_face(c.at(high), c.at(high) - c.at(behind), most) : firm;
  const double foot = foot_at_face(c.at(low), c.at(low) - c.at(beyond), most);
  const bool steps = drop > slope_ + tau_ && std::max(firm, loose) - foot > kMinStepShare * drop;
  edge = std::max(firm, loose);
  if (firm_drop > slope_ + tau_ && !(steps && loose > firm + kMinEdgeCover * c.side_m)) {
    // Whatever lies on firm ground and before it, nothing passes below its edge.
    const double firm_foot =
        foot_at_face(c.firm_at(low), c.firm_at(low) - c.firm_at(beyond), firm_most);
    edge = firm;
    return firm - firm_foot > kMinStepShare * firm_drop;
  }
  return steps;
}

/// @param n, to neighbours along an axis, on a way between places in the columns
inline bool FrontFinder::passes(int n, int to, double surface) {
  const Columns& c = *columns_;
  if (!c.open(to)) return false;
  const double most = slope_ + tau_, here = c.at(n), there = c.at(to);
  if (std::abs(here - there) > most || std::abs(c.firm_at(n) - c.firm_at(to)) > most) {
    const int side = side_of(to - n);
    if (steps_to(n, to)) return edge(n, side) < surface;
    if (steps_to(to, n)) return edge(to, 3 - side) < surface;
  }
  // Ground at the face's middle, from which it may rise by half of the slope to where the way is.
  return (here + there) / 2 < surface + slope_ / 2 + tau_;
}

/// Does soil whose top is at `level` above an anchor come from there straight to a column?
/// @param distance of the anchor @param way from the column's middle to it
bool FrontFinder::sees(int seen_from, double distance, const Vec2& way, int column, double level) {
  const double dx = std::abs(way.x()), dy = std::abs(way.y());
  const int by_x = way.x() > 0 ? columns_->ny : -columns_->ny, by_y = way.y() > 0 ? 1 : -1;
  // Between two neighbours that see the anchor nothing hides it but a lip.
  const int corner_x = column / columns_->ny + (by_x > 0 ? 1 : -1);
  const int corner_y = column % columns_->ny + by_y;
  if (std::max(dx, dy) > 1.5 && columns_->has(corner_x, corner_y)) {
    const int next = column + (dx > dy ? by_x : by_y), corner = columns_->index(corner_x, corner_y);
    const auto shows = [&](int n) {
      if (!columns_->open(n)) return false;
      if (!labelled(n) || label(n).anchor != seen_from || label(n).state == kTooHigh) return false;
      return columns_->at(n) + slope_ * label(n).distance <= level + tau_;
    };
    if (shows(next) && shows(corner) && !steps_to(next, column) && !steps_to(corner, next))
      return true;
  }
  const double length = way.norm();
  const double every_x = dx > 0 ? 1 / dx : kInfinity, every_y = dy > 0 ? 1 / dy : kInfinity;
  double next_x = every_x / 2, next_y = every_y / 2;
  for (int n = column;;) {
    const double t = std::min(next_x, next_y);
    if (t >= 1 - kSamePlace) return true;
    const double surface = level - slope_ * (distance + (1 - t) * length);
    if (std::abs(next_x - next_y) < kSamePlace) {
      const auto round = [&](int first) {
        return passes(n, n + first, surface) && passes(n + first, n + by_x + by_y, surface);
      };
      if (!round(by_x) && !round(by_y)) return false;
      n += by_x + by_y;
      next_x += every_x;
      next_y += every_y;
    } else if (next_x < next_y) {
      if (!passes(n, n + by_x, surface)) return false;
      n += by_x;
      next_x += every_x;
    } else {
      if (!passes(n, n + by_y, surface)) return false;
      n += by_y;
      next_y += every_y;
    }
  }
}

}  // namespace soilvdb::inline v0
