// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/motion_unchanged.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "soilvdb/io/journal.h"
#include "tools/run/schedule.h"
#include "tools/run/text.h"

namespace soilvdb::tools {
namespace {

/// Omitted rows are within 1e-3 of a voxel; the same again allows for rounding.
constexpr double kSame = 2e-3;

/// The rows of one motion, compared with its moves.
class DugRows {
 public:
  /// @param all no row was omitted
  DugRows(const io::MachineInput& machine, bool all, double same_m)
      : machine_(machine), points_(extremes(machine.bucket)), all_(all), same_m_(same_m) {
    load(0, 0);
  }

  void check(const io::JournalUpdate& move) {
    const std::vector<double>& times = move.rows.times_s;
    std::optional<Motion> dug;
    for (std::size_t i = 0; i < times.size() && times[i] <= move.end_s; ++i) {
      if (times[i] <= dug_s_) continue;
      while (!at_end() && now_s() < times[i]) check_left_out(move, dug);
      if (at_end() || now_s() > times[i]) refuse_missing(move.rows, i);
      check_same(move.rows, i);
      advance();
    }
    while (!at_end() && now_s() <= move.end_s) check_left_out(move, dug);
    dug_s_ = move.end_s;
    if (all_ || last_s_ == dug_s_) return;
    if (at_end()) refuse_missing(move.rows, times.size() - 1);
    if (off_m(motion_->pose(dug_s_), dug_pose(move, dug, dug_s_)) > same_m_)
      refuse_after_last(now_s(), fmt::format("the way to this row was dug, and has changed at or "
                                             "before {} s; restore the rows up to here",
                                             time_text(dug_s_)));
  }

  void check_end() const {
    if (!at_end()) refuse(now_s(), "was not there when the run was finished; take it out");
  }

 private:
  bool at_end() const { return row_ == motion_->times_s().size(); }
  double now_s() const { return motion_->times_s()[row_]; }
  void load(std::size_t part, std::size_t row) {
    part_ = part;
    row_ = row;
    motion_ = machine_.motion.part(part);
  }
  void advance() {
    last_s_ = now_s();
    if (++row_ == motion_->times_s().size() && part_ + 1 < machine_.motion.parts())
      load(part_ + 1, 1);  // each part begins with the last row of the part before
  }

  Pose dug_pose(const io::JournalUpdate& move, std::optional<Motion>& dug, double time_s) const {
    if (!dug) dug = io::motion_of(move.rows, motion_->chain());
    return dug->pose(time_s);
  }
  double off_m(const Pose& a, const Pose& b) const {
    double most = 0;
    for (const Vec3& p : points_) most = std::max(most, (a * p - b * p).norm());
    return most;
  }

  /// The current row is not in the journal: checks it, and moves to the next.
  void check_left_out(const io::JournalUpdate& move, std::optional<Motion>& dug) {
    if (all_) refuse(now_s(), "was not there when the rows around it were dug; take it out");
    const double off = off_m(motion_->row(row_), dug_pose(move, dug, now_s()));
    if (off > same_m_)
      refuse(now_s(),
             fmt::format("is {} m from the bucket's place at {} s in the dug run; restore the row",
                         number(off), time_text(now_s())));
    advance();
  }

  void check_same(const io::MotionRows& rows, std::size_t i) const {
    const io::MotionRows now = io::rows_between(*motion_, now_s(), now_s());
    const auto at = static_cast<std::size_t>(
        std::find(now.times_s.begin(), now.times_s.end(), now_s()) - now.times_s.begin());
    for (std::size_t k = 0; k < std::min(rows.columns, now.columns); ++k) {
      const double was = rows.values[i * rows.columns + k], is = now.values[at * now.columns + k];
      if (io::same_bits(was, is)) continue;
      const std::string name = column(rows, k);
      if (name.empty()) refuse(now_s(), "has another rotation than the dug row; restore it");
      refuse(now_s(), fmt::format("{} is {}, but was dug as {}; restore it", name, is, was));
    }
    if (rows.columns != now.columns)
      refuse(now_s(), "has other columns than the dug rows; restore them");
  }

  /// The name of a value; empty for rotations, which have several notations.
  std::string column(const io::MotionRows& rows, std::size_t k) const {
    const std::string prefix = rows.joints ? "base_" : "";
    if (rows.joints) {
      const std::vector<std::string> names = motion_->chain().movable();
      if (k < names.size()) return names[k];
      k -= names.size();
    }
    return k < 3 ? prefix + "xyz"[k] : "";
  }

  [[noreturn]] void refuse_missing(const io::MotionRows& rows, std::size_t i) const {
    const double time_s = rows.times_s[i];
    std::string what = fmt::format("the row at {} s (", time_s);
    for (std::size_t k = 0; k < rows.columns && !column(rows, k).empty(); ++k)
      what +=
          fmt::format("{}{} {}", k ? ", " : "", column(rows, k), rows.values[i * rows.columns + k]);
    refuse_after_last(time_s, what + ") was dug; put it back");
  }

  /// A missing row after the last good one may be present as a bad row.
  [[noreturn]] void refuse_after_last(double time_s, const std::string& what) const {
    const io::BadRows& bad = machine_.motion.bad_rows();
    if (bad.good_s && *bad.good_s == last_s_)
      throw io::InputError(fmt::format("{}; {}", bad.first, what));
    refuse(time_s, what);
  }

  /// @param time_s of a row; if it is missing, the line of the next row is named, or the last line
  [[noreturn]] void refuse(double time_s, const std::string& what) const {
    io::MotionReader reader = machine_.motion.reader();
    while (true) {
      const long line = reader.mark().line();
      const Motion two = reader.next(1);
      if (two.begin_s() >= time_s || two.times_s().size() == 1)
        throw io::InputError(machine_.motion.file(), line, what);
    }
  }

  const io::MachineInput& machine_;
  const std::vector<Vec3> points_;  // the bucket's points that move farthest
  const bool all_;
  const double same_m_;
  std::size_t part_ = 0, row_ = 0;  // the current row
  std::shared_ptr<const Motion> motion_;
  double last_s_ = -std::numeric_limits<double>::infinity();  // of the row before
  double dug_s_ = last_s_;
};

}  // namespace

void check_motion_unchanged(const std::filesystem::path& journal, const io::Scenario& scenario,
                            const RunConfig& config) {
  const double same_m = kSame * scenario.voxel_size_m;
  const std::vector<io::MachineInput>& machines = scenario.machines;
  std::vector<DugRows> rows;
  for (const io::MachineInput& machine : machines)
    rows.emplace_back(machine, !config.options.updates, same_m);
  Schedule schedule(scenario, config.options.updates, config.ends_s, same_m);
  bool ended = false;
  io::JournalReader reader(journal);
  while (const std::optional<io::JournalRecord> record = reader.next()) {
    ended |= std::holds_alternative<io::JournalEnd>(*record);
    const auto* move = std::get_if<io::JournalUpdate>(&*record);
    if (!move) continue;
    if (move->machine < rows.size()) rows[move->machine].check(*move);
    // New rows before the end of the dug part are too late.
    const std::optional<Step> step = schedule.next();
    if (!step || !is_update(*step, *move)) {
      const std::size_t mover = step ? step->machine : move->machine;
      throw io::InputError(mover < machines.size() ? machines[mover].motion.file() : scenario.file,
                           fmt::format("its rows up to {} s are not those of the run; restore them",
                                       time_text(move->end_s)));
    }
  }
  if (!ended) return;
  for (const DugRows& motion : rows) motion.check_end();
}

}  // namespace soilvdb::tools
