// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Reads a motion line by line; only the columns in use are turned into numbers.
#include "soilvdb/io/motion_csv.h"

#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <limits>
#include <string_view>
#include <utility>

#include "io/file/text.h"
#include "io/motion/motion_angles.h"
#include "io/motion/motion_checks.h"
#include "io/motion/motion_columns.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::size_t kDigestFactor = 0x9E3779B97F4A7C15;

}  // namespace

struct MotionReader::State {
  State(const std::filesystem::path& f, const std::optional<Chain>& c, AngleUnit u)
      : file(f), chain(c), unit(u), lines(f), limits(c.value_or(Chain{})) {
    std::string_view line;
    if (!lines.next(line)) throw InputError(file, "is empty; it must be a motion as CSV");
    split_fields(line, fields);
    columns = read_columns(lines, fields, chain);
    angles = Angles(columns.names, chain, unit);
    row.resize(columns.names.size(), 0.0);
    fresh = row;
  }

  /// Goes on to the next good row. @return false at the end of the file
  bool advance() {
    while (true) {
      const CsvLines::Mark mark = lines.mark();
      try {
        std::string_view line;
        compared = false;
        if (!lines.next(line)) return false;
        if (is_blank(line)) {
          if (blanks++ == 0) blank = mark;
          continue;
        }
        if (blanks > 0) refuse_blanks();
        take(line);
        at = mark;
        at_odds = 0;
        ++good;
        return true;
      } catch (const LineError& e) {
        if (blanks > 0) refuse_blanks();
        refuse(e);
        if (compared && fresh[0] != row[0]) {  // a row that is there twice says nothing
          ++bad.at_odds;
          if (++at_odds > most_at_odds) {
            most_at_odds = at_odds;
            bad.at_odds_with = at.lines + 1;
          }
          if (at_odds > std::max(good, bad.outnumbering)) {
            bad.outnumbering = at_odds;
            bad.outnumbered = at.lines + 1;
          }
        }
      } catch (const InputError&) {  // of a joint that wraps, as degrees seem to
        angles.check(file);
        throw;
      }
    }
  }

  /// Makes a line the row it is at. @throw LineError; then it stays where it is
  void take(std::string_view line) {
    split_fields(line, fields);
    if (fields.size() != columns.count) {
      lines.fail(fmt::format("has {} field{}; the header has {} columns", fields.size(),
                             fields.size() == 1 ? "" : "s", columns.count));
    }
    for (std::size_t i = 0; i < fresh.size(); ++i) {
      if (columns.fields[i] == Columns::kNone) continue;
      fresh[i] = row_number(lines, columns.names[i], fields[columns.fields[i]]);
    }
    angles.row(fresh, lines.number());
    if (chain) check_limits(lines, *chain, fresh, unit);
    const auto time = fields[columns.fields[0]];
    compared = !first;
    if (!first && !(fresh[0] > row[0])) {
      lines.fail(
          fmt::format("time {} doesn't come after {} in the row before; times must strictly "
                      "increase",
                      printable(time), printable(time_text)));
    }
    if (chain) {
      if (!first) check_joints(lines, *chain, row, fresh, unit);
      limits.row(fresh, lines.number());
    } else {
      const Pose to = row_pose(lines, fresh, columns.quaternion);
      if (!first) check_poses(lines, pose, to, fresh[0] - row[0]);
      pose = to;
    }
    std::swap(row, fresh);
    time_text = time;
    hash = std::hash<std::string_view>()(line);
    first = false;
  }

  void refuse_blanks() {
    refuse(InputError(file, blank.lines + 1, "is a blank line between rows; leave it out"));
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
  CsvLines lines;
  Columns columns;
  JointLimits limits;
  Angles angles;
  std::vector<std::string_view> fields;
  std::vector<double> row, fresh;  // the row it is at, and scratch
  Pose pose;                       // of the row, where there is no chain
  std::string time_text;           // of the row
  CsvLines::Mark at;               // of the row
  std::size_t hash = 0;            // of the row
  std::size_t digest = 0;          // of the rows of the last part
  bool first = true;               // it is at no row yet
  CsvLines::Mark blank;            // the first of the blank lines since the row
  std::int64_t blanks = 0;         // so many
  bool compared = false;           // the line it looks at with the row
  std::int64_t at_odds = 0;        // rows since the row that can't come after it,
  std::int64_t most_at_odds = 0;   // and the most there were of them
  std::int64_t good = 0;           // rows so far
  BadRows bad;
};

MotionReader::MotionReader(const std::filesystem::path& file, const std::optional<Chain>& chain,
                           AngleUnit angles)
    : state_(std::make_unique<State>(file, chain, angles)) {
  if (state_->advance()) return;
  check_angles();
  if (state_->bad.count > 0) throw InputError(state_->bad.first);
  throw InputError(file, state_->lines.number(), "has a header but no rows; it needs at least one");
}
MotionReader::~MotionReader() = default;

CsvLines::Mark MotionReader::mark() const { return state_->at; }

std::int64_t MotionReader::bytes_read() const { return state_->lines.mark().bytes; }

void MotionReader::go_to(const CsvLines::Mark& mark) {
  state_->lines.go_to(mark);
  state_->first = true;
  state_->blanks = 0;
  if (!state_->advance()) throw InputError(state_->file, mark.lines + 1, "is not there any more");
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

const BadRows& MotionReader::bad_rows() const { return state_->bad; }

void MotionReader::check_angles() const { state_->angles.check(state_->file); }

std::size_t MotionReader::digest() const { return state_->digest; }

std::vector<std::string> MotionReader::warnings() const {
  std::vector<std::string> warnings;
  const Columns& columns = state_->columns;
  std::vector<std::string> zero;
  for (std::size_t i = 0; i < columns.names.size(); ++i) {
    if (columns.fields[i] == Columns::kNone) zero.push_back(columns.names[i]);
  }
  if (const auto& unused = columns.unused; !unused.empty()) {
    std::string warning = fmt::format("{}: ignored column{} {}", state_->file.string(),
                                      unused.size() == 1 ? "" : "s", quoted_list(unused));
    if (!zero.empty()) {
      warning += fmt::format("; {} {} there, taken as 0", quoted_list(zero),
                             zero.size() == 1 ? "isn't" : "aren't") +
                 other_case(zero, unused);
    }
    warnings.push_back(std::move(warning));
  }
  state_->limits.warn(state_->file, warnings);
  state_->angles.warn(state_->file, warnings);
  return warnings;
}

MotionInput read_motion(const std::filesystem::path& file, const std::optional<Chain>& chain,
                        AngleUnit angles) {
  MotionReader reader(file, chain, angles);
  Motion motion = reader.next(std::numeric_limits<std::int64_t>::max());
  reader.check_angles();
  if (reader.bad_rows().count > 0) throw InputError(reader.bad_rows().first);
  return {std::move(motion), reader.warnings()};
}

}  // namespace soilvdb::inline v0::io
