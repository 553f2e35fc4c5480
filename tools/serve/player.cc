// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/player.h"

#include <algorithm>
#include <limits>
#include <stdexcept>

namespace soilvdb::tools {
namespace {

constexpr double kForever = std::numeric_limits<double>::infinity();

}  // namespace

Player::Player(LiveSite& site, const io::Scenario& scenario, double speed)
    : site_(site), speed_(speed), begin_s_(kForever) {
  for (std::size_t i = 0; i < scenario.machines.size(); ++i) {
    const io::MotionFile& motion = scenario.machines[i].motion;
    Track& track = tracks_.emplace_back(Track{.motion = &motion, .done = motion.rows() == 0});
    if (track.done) continue;
    track.rows = motion.part(0);
    const auto last = site.session().last(i);
    if (last) track.fed_s = last->time_s;
    while (!track.done && track.fed_s && track.rows->times_s()[track.row] <= *track.fed_s)
      next_row(track);
    begin_s_ = std::min(begin_s_, motion.begin_s());
  }
  if (site.time_s()) begin_s_ = std::max(begin_s_, *site.time_s());
}

bool Player::done() const {
  return std::all_of(tracks_.begin(), tracks_.end(), [](const Track& t) { return t.done; });
}

void Player::next_row(Track& track) {
  if (++track.row < track.rows->times_s().size()) return;
  if (++track.part == track.motion->parts()) {
    track.done = true;
    return;
  }
  track.rows = track.motion->part(track.part);
  track.row = 1;
}

void Player::feed(std::size_t machine, double time_s) {
  Track& track = tracks_[machine];
  MachineState state{.machine = machine, .time_s = time_s};
  const Motion& motion = *track.rows;
  std::vector<double> values;
  if (motion.poses().empty()) {
    const std::span<const double> row = motion.configuration(track.row);
    values.assign(row.begin(), row.end());
    if (time_s != motion.times_s()[track.row]) values = motion.joint_values(time_s);
    const std::size_t joints = motion.chain().movable_count();
    state.joints = std::span<const double>(values).first(joints);
    if (values.size() > joints) state.base = pose_of(&values[joints]);
  } else {
    state.pose = motion.pose(time_s);
  }
  const StepResult step = site_.feed(state);
  if (!step.ok()) throw std::runtime_error(step.why);
  track.fed_s = time_s;
}

void Player::go_on() {
  const Clock::time_point now = Clock::now();
  if (!begun_) begun_ = now;
  const double now_s = begin_s_ + speed_ * std::chrono::duration<double>(now - *begun_).count();
  // First rows in the order of time, then states between two rows.
  for (;;) {
    std::size_t next = tracks_.size();
    double next_s = now_s;
    for (std::size_t i = 0; i < tracks_.size(); ++i) {
      if (tracks_[i].done) continue;
      const double row_s = tracks_[i].rows->times_s()[tracks_[i].row];
      if (row_s > next_s || (next < tracks_.size() && row_s == next_s)) continue;
      next = i;
      next_s = row_s;
    }
    if (next == tracks_.size()) break;
    feed(next, next_s);
    next_row(tracks_[next]);
  }
  for (std::size_t i = 0; i < tracks_.size(); ++i)
    if (!tracks_[i].done && tracks_[i].fed_s && now_s > *tracks_[i].fed_s) feed(i, now_s);
}

}  // namespace soilvdb::tools
