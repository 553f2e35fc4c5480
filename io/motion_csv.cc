// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Reads a motion line by line; only the columns in use are turned into numbers.
#include "io/motion_csv.h"

#include <fmt/format.h>

#include <cmath>
#include <functional>
#include <limits>
#include <string_view>

#include "io/motion_columns.h"
#include "io/text.h"

namespace soilvdb::io {
namespace {

constexpr double kMaxTimeS = 1e11;             // seconds since 1970 are fine, milliseconds are not
constexpr double kQuaternionTolerance = 0.01;  // two decimals; more is no rotation
constexpr double kLimitTolerance = 1e-6;       // rounding of decimal input, rad or m
constexpr std::size_t kDigestFactor = 0x9E3779B97F4A7C15;

double number(const CsvLines& lines, const std::string& name, std::string_view field) {
  const auto value = parse_number(field);
  if (!value) {
    lines.fail(fmt::format("{} is '{}'; it must be a number", name, printable(field)));
  }
  const double limit = name == "time" ? kMaxTimeS : kMaxNumber;
  if (!(std::abs(*value) <= limit)) {
    lines.fail(fmt::format("{} is {}; it must be a number within {:g}{}", name, printable(field),
                           limit, name == "time" ? " (seconds)" : ""));
  }
  return *value;
}

Pose make_pose(const CsvLines& lines, const std::vector<double>& v, bool quaternion) {
  Pose pose;
  pose.position = {v[1], v[2], v[3]};
  if (!quaternion) {
    pose.rotation = from_rpy(v[4], v[5], v[6]);
    return pose;
  }
  pose.rotation = Eigen::Quaterniond(v[7], v[4], v[5], v[6]);
  const double norm = pose.rotation.norm();
  if (!(std::abs(norm - 1) <= kQuaternionTolerance)) {
    lines.fail(fmt::format("the quaternion qx,qy,qz,qw has the norm {:.6g}; it must be 1", norm));
  }
  pose.rotation.normalize();
  return pose;
}

/// Rows in which each movable joint is beyond its limits.
class LimitCheck {
 public:
  explicit LimitCheck(const Chain& chain) {
    for (const Joint& joint : chain.joints) {
      if (joint.type != Joint::Type::kFixed) joints_.push_back({joint, 0, 0});
    }
  }
  /// @param v the time, then the joints
  void row(const std::vector<double>& v, long line) {
    for (std::size_t i = 0; i < joints_.size(); ++i) {
      auto& [joint, rows, first] = joints_[i];
      if (joint.type == Joint::Type::kContinuous || joint.lower == joint.upper) continue;
      if (v[i + 1] >= joint.lower - kLimitTolerance && v[i + 1] <= joint.upper + kLimitTolerance) {
        continue;
      }
      if (rows++ == 0) first = line;
    }
  }
  void warn(const std::filesystem::path& file, std::vector<std::string>& warnings) const {
    for (const auto& [joint, rows, first] : joints_) {
      if (rows == 0) continue;
      warnings.push_back(fmt::format(
          "{}: joint {} exceeds its limits ({:.2f} to {:.2f} {}) in {} row{}, first at line {}",
          file.string(), joint.name, joint.lower, joint.upper,
          joint.type == Joint::Type::kPrismatic ? "m" : "rad", rows, rows == 1 ? "" : "s", first));
    }
  }

 private:
  struct Count {
    Joint joint;
    long rows, first;
  };
  std::vector<Count> joints_;
};

/// Refuses turns in one row that no machine makes and that would take forever to sweep.
void check_turns(const CsvLines& lines, const Chain& chain, const std::vector<std::string>& names,
                 const std::vector<double>& before, const std::vector<double>& row) {
  constexpr double kMostRad = 100;
  std::size_t i = 0;
  for (const Joint& joint : chain.joints) {
    if (joint.type == Joint::Type::kFixed) continue;
    ++i;
    const double turn = row[i] - before[i];
    if (joint.type == Joint::Type::kPrismatic || std::abs(turn) <= kMostRad) continue;
    lines.fail(
        fmt::format("joint {} turns {:g} rad since the row before; at most {} rad in one row",
                    names[i], turn, kMostRad));
  }
}

}  // namespace

struct MotionReader::State {
  State(const std::filesystem::path& f, const std::optional<Chain>& c)
      : file(f), chain(c), lines(f), limits(c.value_or(Chain{})) {
    std::string_view line;
    if (!lines.next(line)) throw InputError(file, "is empty; it must be a motion as CSV");
    split_fields(line, fields);
    columns = read_columns(lines, fields, chain);
    row.resize(columns.names.size(), 0.0);
    before = row;
  }

  /// Reads the next row. @return false at the end of the file
  bool advance() {
    std::string_view line;
    CsvLines::Mark mark;
    long blank_line = 0;
    do {
      mark = lines.mark();
      if (!lines.next(line)) return false;
      if (is_blank(line) && blank_line == 0) blank_line = lines.number();
    } while (is_blank(line));
    if (blank_line > 0) {
      throw InputError(file, blank_line, "is a blank line between rows; leave it out");
    }
    at = mark;
    hash = std::hash<std::string_view>()(line);
    split_fields(line, fields);
    if (fields.size() != columns.count) {
      lines.fail(fmt::format("has {} field{}; the header has {} columns", fields.size(),
                             fields.size() == 1 ? "" : "s", columns.count));
    }
    std::swap(before, row);
    for (std::size_t i = 0; i < row.size(); ++i) {
      if (columns.fields[i] == Columns::kNone) continue;
      row[i] = number(lines, columns.names[i], fields[columns.fields[i]]);
    }
    const auto time = fields[columns.fields[0]];
    if (!first && !(row[0] > before[0])) {
      lines.fail(
          fmt::format("time {} doesn't come after {} in the row before; times must strictly "
                      "increase",
                      printable(time), printable(time_text)));
    }
    time_text = time;
    if (chain) {
      limits.row(row, lines.number());
      if (!first) check_turns(lines, *chain, columns.names, before, row);
    }
    first = false;
    return true;
  }

  std::filesystem::path file;
  std::optional<Chain> chain;
  CsvLines lines;
  Columns columns;
  LimitCheck limits;
  std::vector<std::string_view> fields;
  std::vector<double> row, before;  // the row read last, and the one before it
  std::string time_text;            // of the row read last
  CsvLines::Mark at;                // of the row read last
  std::size_t hash = 0;             // of the row read last
  std::size_t digest = 0;           // of the rows of the last part
  bool first = true;                // no row was read before
};

MotionReader::MotionReader(const std::filesystem::path& file, const std::optional<Chain>& chain)
    : state_(std::make_unique<State>(file, chain)) {
  if (!state_->advance()) {
    throw InputError(file, state_->lines.number(),
                     "has a header but no rows; it needs at least one");
  }
}
MotionReader::~MotionReader() = default;

CsvLines::Mark MotionReader::mark() const { return state_->at; }

std::int64_t MotionReader::bytes_read() const { return state_->lines.mark().bytes; }

void MotionReader::go_to(const CsvLines::Mark& mark) {
  state_->lines.go_to(mark);
  state_->first = true;
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
      poses.push_back(make_pose(s.lines, s.row, s.columns.quaternion));
    }
    s.digest = s.digest * kDigestFactor + s.hash;
  };
  add();
  for (std::int64_t i = 0; i < most_steps && s.advance(); ++i) add();
  if (s.chain) return {std::move(times_s), std::move(joint_values), *s.chain};
  return {std::move(times_s), std::move(poses)};
}

std::size_t MotionReader::digest() const { return state_->digest; }

std::vector<std::string> MotionReader::warnings() const {
  std::vector<std::string> warnings;
  if (const auto& unused = state_->columns.unused; !unused.empty()) {
    warnings.push_back(fmt::format("{}: ignored column{} {}", state_->file.string(),
                                   unused.size() == 1 ? "" : "s", quoted_list(unused)));
  }
  state_->limits.warn(state_->file, warnings);
  return warnings;
}

MotionInput read_motion(const std::filesystem::path& file, const std::optional<Chain>& chain) {
  MotionReader reader(file, chain);
  Motion motion = reader.next(std::numeric_limits<std::int64_t>::max());
  return {std::move(motion), reader.warnings()};
}

}  // namespace soilvdb::io
