// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Reads a motion row by row, and keeps the good rows.
#include "soilvdb/io/motion_csv.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <utility>

#include "io/file/text.h"
#include "io/motion/motion_angles.h"
#include "io/motion/motion_checks.h"
#include "io/motion/row_source.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::size_t kDigestFactor = 0x9E3779B97F4A7C15;

}  // namespace

struct MotionReader::State {
  State(const MotionSource& source, const std::optional<Chain>& c, AngleUnit u)
      : file(source.file),
        chain(c),
        unit(u),
        rows(source.is_mcap ? mcap_rows(source, chain) : csv_rows(source.file, chain)),
        columns(rows->columns()),
        limits(c.value_or(Chain{})),
        angles(columns.names, chain, unit),
        gaps(rows->most_gap_s()) {
    row.resize(columns.names.size(), 0.0);
  }

  /// Moves to the next good row. @return false at the end of the file
  bool advance() {
    while (true) {
      try {
        compared = false;
        const RowSource::Got got = rows->next();
        if (got == RowSource::Got::kEnd) return false;
        if (got == RowSource::Got::kBlank) {
          if (blanks++ == 0) blank = rows->mark();
          continue;
        }
        if (blanks > 0) refuse_blanks();
        if (!take()) continue;
        at = rows->mark();
        at.turns = turns;
        at_file = rows->place().file();
        at_odds = 0;
        ++good;
        return true;
      } catch (const LineError& e) {
        if (blanks > 0) refuse_blanks();
        refuse(e);
        if (compared && fresh[0] != row[0]) {  // a repeated row is no evidence
          ++bad.at_odds;
          if (++at_odds > most_at_odds) {
            most_at_odds = at_odds;
            bad.at_odds_with = at.line();
            bad.at_odds_in = at_file;
          }
          if (at_odds > std::max(good, bad.outnumbering)) {
            bad.outnumbering = at_odds;
            bad.outnumbered = at.line();
            bad.outnumbered_in = at_file;
          }
        }
      }
    }
  }

  /// Makes the row that was read the current one. @return false if it repeats the current row
  /// @throw LineError, without a change, if the row is bad
  bool take() {
    const RowPlace& place = rows->place();
    fresh.assign(columns.names.size(), 0.0);
    rows->values(fresh);
    angles.row(fresh, place.number());
    if (columns.base) {
      const Pose base =
          row_pose(place, std::span(fresh).subspan(*columns.base), columns.quaternion, "base_");
      fresh.resize(*columns.base);
      Chain::add_base(fresh, base);
    }
    if (chain) {
      check_limits(place, *chain, fresh, unit);
      fresh_turns = turns;
      go_on_past_turns(*chain, first ? fresh : row, fresh, fresh_turns);
    }
    if (!first && fresh[0] == row[0] && same_values(fresh, row)) return false;
    compared = !first;
    if (!first && fresh[0] == row[0]) {
      place.fail(
          fmt::format("time {} doesn't come after {} in the row before, and other values differ; "
                      "two rows of one time must be the same",
                      printable(rows->time_text()), printable(time_text)));
    }
    if (!first && !(fresh[0] > row[0])) {
      place.fail(
          fmt::format("time {} doesn't come after {} in the row before; times must strictly "
                      "increase",
                      printable(rows->time_text()), printable(time_text)));
    }
    double moved = 0;
    if (chain) {
      if (!first) check_joints(place, *chain, row, fresh);
      for (std::size_t i = 1; i < row.size(); ++i)
        moved = std::max(moved, std::abs(fresh[i] - row[i]));
      limits.row(fresh, fresh_turns, place.number());
      std::swap(turns, fresh_turns);
    } else {
      const Pose to = row_pose(place, std::span(fresh).subspan(1), columns.quaternion);
      if (!first) check_poses(place, pose, to, fresh[0] - row[0]);
      moved = std::max((to.position - pose.position).norm(),
                       to.rotation.angularDistance(pose.rotation));
      pose = to;
    }
    if (!first) gaps.row(place, fresh[0] - row[0], moved);
    std::swap(row, fresh);
    time_text = rows->time_text();
    hash = rows->hash();
    first = false;
    return true;
  }

  void refuse_blanks() {
    refuse(InputError(file, blank.line(), "is a blank line between rows; leave it out"));
    bad.count += std::exchange(blanks, 0) - 1;
  }

  void refuse(const InputError& why) {
    if (bad.count++ > 0) return;
    bad.first = why.what();
    if (!first) bad.good_s = row[0];
  }

  std::filesystem::path file;
  std::optional<Chain> chain;
  AngleUnit unit;
  std::unique_ptr<RowSource> rows;
  const Columns& columns;
  JointLimits limits;
  Angles angles;
  Gaps gaps;
  std::vector<double> row, fresh;       // the current row; scratch
  Pose pose;                            // of the current row, without a chain
  std::string time_text;                // of the current row
  RowMark at;                           // of the current row
  std::filesystem::path at_file;        // among several files
  std::vector<int> turns, fresh_turns;  // of joints that wrap, up to the current row; scratch
  std::size_t hash = 0;                 // of the current row
  std::size_t digest = 0;               // of the rows of the last part
  bool first = true;                    // there is no current row yet
  RowMark blank;                        // the first blank line since the current row
  std::int64_t blanks = 0;              // number of blank lines
  bool compared = false;                // the new line was compared with the current row
  std::int64_t at_odds = 0;             // rows since the current one that contradict it
  std::int64_t most_at_odds = 0;        // longest run of these
  std::int64_t good = 0;                // number of good rows
  BadRows bad;
};

MotionReader::MotionReader(const MotionSource& source, const std::optional<Chain>& chain,
                           AngleUnit angles)
    : state_(std::make_unique<State>(source, chain, angles)) {
  if (state_->advance()) return;
  check_angles();
  if (state_->bad.count > 0) throw InputError(state_->bad.first);
  throw InputError(source.file, state_->rows->place().number(),
                   "has a header but no rows; it needs at least one");
}
MotionReader::~MotionReader() = default;

RowMark MotionReader::mark() const { return state_->at; }

std::int64_t MotionReader::bytes_read() const { return state_->rows->bytes_read(); }

void MotionReader::go_to(const RowMark& mark) {
  state_->rows->go_to(mark);
  state_->turns = mark.turns;
  state_->first = true;
  state_->blanks = 0;
  if (!state_->advance()) throw InputError(state_->file, mark.line(), "is not there any more");
}

Motion MotionReader::next(std::int64_t most_steps) {
  State& s = *state_;
  std::vector<double> times_s, joint_values;
  std::vector<Pose> poses;
  s.digest = 0;
  const auto add = [&] {
    times_s.push_back(s.row[0]);
    if (s.chain) {
      joint_values.insert(joint_values.end(), s.row.begin() + 1, s.row.end());
    } else {
      poses.push_back(s.pose);
    }
    s.digest = s.digest * kDigestFactor + s.hash;
  };
  add();
  for (std::int64_t i = 0; i < most_steps && s.advance(); ++i) add();
  if (s.chain) return {std::move(times_s), std::move(joint_values), *s.chain};
  return {std::move(times_s), std::move(poses)};
}

MotionSource MotionReader::source() const { return state_->rows->source(); }

const BadRows& MotionReader::bad_rows() const { return state_->bad; }

void MotionReader::check_angles() const { state_->angles.check(state_->file); }

std::size_t MotionReader::digest() const { return state_->digest; }

std::vector<std::string> MotionReader::warnings() const {
  std::vector<std::string> warnings;
  state_->rows->warn(warnings);
  state_->limits.warn(state_->rows->place(), warnings);
  state_->angles.warn(state_->rows->place(), warnings);
  state_->gaps.warn(warnings);
  return warnings;
}

MotionInput read_motion(const MotionSource& source, const std::optional<Chain>& chain,
                        AngleUnit angles) {
  MotionReader reader(source, chain, angles);
  Motion motion = reader.next(std::numeric_limits<std::int64_t>::max());
  reader.check_angles();
  if (reader.bad_rows().count > 0) throw InputError(reader.bad_rows().first);
  return {std::move(motion), reader.warnings()};
}

}  // namespace soilvdb::inline v0::io
