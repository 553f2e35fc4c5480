// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/schedule.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace soilvdb::tools {
Schedule::Schedule(const io::Scenario& scenario, std::optional<std::int64_t> updates,
                   const std::vector<double>& ends_s, double tolerance_m)
    : scans_(scenario.scans),
      begin_s_(std::numeric_limits<double>::infinity()),
      end_s_(-begin_s_),
      stop_s_(begin_s_) {
  for (std::size_t i = 0; i < scenario.machines.size(); ++i) {
    const io::MachineInput& machine = scenario.machines[i];
    // With moving soil all rows stay, because soil settles at places counted from row to row.
    const auto thinned_m = scenario.soil ? std::nullopt : std::optional(tolerance_m);
    total_ += cursors_.emplace_back(machine, updates, ends_s.at(i), thinned_m).count();
    begin_s_ = std::min(begin_s_, machine.motion.begin_s());
    end_s_ = std::max(end_s_, machine.motion.end_s());
    const io::BadRows& bad = machine.motion.bad_rows();
    if (!machine.motion.stops() || *bad.good_s >= stop_s_) continue;
    stop_s_ = *bad.good_s;
    stops_at_ = bad.first;
  }
  for (const Pour& pour : scenario.pours) {
    total_ += pours_.emplace_back(PourParts(pour, scenario.voxel_size_m)).count();
    begin_s_ = std::min(begin_s_, pour.begin_s);
    end_s_ = std::max(end_s_, pour.end_s);
  }
  for (const io::ScanInput& scan : scenario.scans) {
    begin_s_ = std::min(begin_s_, scan.time_s);
    end_s_ = std::max(end_s_, scan.time_s);
    ++total_;
  }
}

std::optional<Step> Schedule::next() {
  Cursor* first = nullptr;
  for (Cursor& cursor : cursors_) {
    if (!cursor.at_end() && (!first || cursor.until_s() < first->until_s())) first = &cursor;
  }
  PourCursor* first_pour = nullptr;
  for (PourCursor& pour : pours_) {
    if (!pour.at_end() && (!first_pour || pour.until_s() < first_pour->until_s()))
      first_pour = &pour;
  }
  if (scanned_ < scans_.size()) {
    // A scan sees what was done at its time.
    const io::ScanInput& scan = scans_[scanned_];
    const double time_s = scan.time_s;
    const bool is_next =
        (!first || time_s < first->until_s()) && (!first_pour || time_s < first_pour->until_s());
    if (is_next && (time_s > stop_s_ || stop_s_ <= begin_s_)) return std::nullopt;
    if (is_next)
      return Step{cursors_.size() + pours_.size() + scanned_++, time_s, time_s,
                  scan.machine ? cursors_[*scan.machine].motion_at(time_s) : nullptr, true};
  }
  if (first_pour && (!first || first_pour->until_s() < first->until_s())) {
    if (first_pour->until_s() > stop_s_ || stop_s_ <= begin_s_) return std::nullopt;
    Step step = first_pour->step();
    step.machine = cursors_.size() + static_cast<std::size_t>(first_pour - pours_.data());
    return step;
  }
  // A run that stops before the first movement does nothing.
  if (!first || first->until_s() > stop_s_ || stop_s_ <= begin_s_) return std::nullopt;
  Step step = first->step();
  step.machine = static_cast<std::size_t>(first - cursors_.data());
  return step;
}

Schedule::Cursor::Cursor(const io::MachineInput& machine, std::optional<std::int64_t> updates,
                         double end_s, std::optional<double> thinned_m)
    : machine_(&machine),
      by_rows_(!updates || end_s == machine.motion.begin_s()),
      intervals_(updates.value_or(1)),
      planned_s_(end_s),
      count_(machine.motion.rows()),
      at_s_(machine.motion.begin_s()) {
  if (!machine.has_motion()) return;
  if (!by_rows_ && machine.motion.rows() > 2 * *updates) thinned_m_ = thinned_m;
  if (!by_rows_) {
    constexpr double kMost = 1e15;
    const double spans = (machine.motion.end_s() - at_s_) / (planned_s_ - at_s_);
    const double about = std::floor(spans * static_cast<double>(intervals_)) - 1;
    count_ = static_cast<std::int64_t>(std::clamp(about, 1.0, kMost));
    while (boundary_s(count_) < machine.motion.end_s()) ++count_;
  }
  load(0);
  aim();
}

void Schedule::Cursor::load(std::size_t part) {
  part_ = part;
  row_ = part == 0 ? 0 : 1;  // each part begins with the last row of the part before
  motion_ = machine_->motion.part(part);
  if (thinned_m_)
    motion_ = std::make_shared<Motion>(motion_->simplified(machine_->bucket, *thinned_m_));
}

/// Sets until_s_, the end of the next update.
void Schedule::Cursor::aim() {
  if (at_end()) return;
  const io::MotionFile& whole = machine_->motion;
  if (done_ > 0 && at_s_ >= motion_->end_s() && part_ + 1 < whole.parts()) load(part_ + 1);
  if (by_rows_) {
    until_s_ = motion_->times_s()[row_++];
  } else if (done_ + 1 == count_) {
    until_s_ = whole.end_s();
  } else {
    until_s_ = std::min(boundary_s(done_ + 1), whole.end_s());
  }
}

/// The end of an update other than the last.
double Schedule::Cursor::boundary_s(std::int64_t update) const {
  if (update == intervals_) return planned_s_;
  const double begin_s = machine_->motion.begin_s();
  const double share = static_cast<double>(update) / static_cast<double>(intervals_);
  return begin_s + (planned_s_ - begin_s) * share;
}

Step Schedule::Cursor::step() {
  Step step{0, at_s_, std::min(until_s_, motion_->end_s()), motion_, until_s_ <= motion_->end_s()};
  at_s_ = step.end_s;
  if (step.ends_update) {
    ++done_;
    aim();
  } else {
    load(part_ + 1);
  }
  return step;
}

std::shared_ptr<const Motion> Schedule::Cursor::motion_at(double time_s) const {
  std::shared_ptr<const Motion> motion = motion_;
  for (std::size_t part = part_ + 1; motion && time_s > motion->end_s(); ++part) {
    if (part >= machine_->motion.parts()) break;
    motion = machine_->motion.part(part);
  }
  return motion;
}

Step Schedule::PourCursor::step() {
  const double begin_s = parts_.falls_s(done_), end_s = until_s();
  ++done_;
  return {0, begin_s, end_s, nullptr, true};
}

std::vector<double> ends_of(const std::vector<io::MachineInput>& machines) {
  std::vector<double> ends_s;
  for (const io::MachineInput& machine : machines) ends_s.push_back(machine.motion.end_s());
  return ends_s;
}

}  // namespace soilvdb::tools
