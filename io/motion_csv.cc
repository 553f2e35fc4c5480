// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Reads a motion line by line; only the columns in use are turned into numbers.
#include "io/motion_csv.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string_view>

#include "io/csv.h"
#include "io/text.h"

namespace soilvdb::io {
namespace {

constexpr double kMaxTimeS = 1e11;             // seconds since 1970 are fine, milliseconds are not
constexpr double kQuaternionTolerance = 0.01;  // two decimals; more is no rotation
constexpr double kLimitTolerance = 1e-6;       // rounding of decimal input, rad or m

const std::vector<std::string> kAngles = {"roll", "pitch", "yaw"};
const std::vector<std::string> kQuaternion = {"qx", "qy", "qz", "qw"};

/// Where the columns in use are. Values are kept in the order of `names`; names[0] is the time.
struct Columns {
  std::size_t count = 0;  ///< of the file
  std::vector<std::string> names;
  std::vector<std::size_t> fields;  ///< for each name, its field; kNone: 0 for all rows
  bool quaternion = false;
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);
};

class Header {
 public:
  Header(const CsvLines& lines, const std::vector<std::string_view>& fields)
      : lines_(lines), names_(fields.begin(), fields.end()) {
    for (std::size_t i = 0; i < names_.size(); ++i) {
      if (names_[i].empty()) continue;
      if (find(names_[i]) != i) {
        lines_.fail(fmt::format("column '{}' is there twice; leave one out", printable(names_[i])));
      }
    }
  }

  std::size_t find(const std::string& name) const {
    const auto it = std::find(names_.begin(), names_.end(), name);
    return it == names_.end() ? Columns::kNone : static_cast<std::size_t>(it - names_.begin());
  }
  bool has(const std::string& name) const { return find(name) != Columns::kNone; }
  std::vector<std::string> missing(const std::vector<std::string>& wanted) const {
    std::vector<std::string> names;
    for (const auto& name : wanted) {
      if (!has(name)) names.push_back(name);
    }
    return names;
  }

  Columns columns(const std::optional<Chain>& chain) const {
    if (!has("time")) fail_missing({"time"}, "the header must be time and the columns of a motion");
    Columns c = chain ? joints(chain->movable()) : poses();
    c.count = names_.size();
    for (const auto& name : c.names) c.fields.push_back(find(name));
    return c;
  }

  std::vector<std::string> unused(const Columns& c) const {
    std::vector<std::string> names;
    for (std::size_t i = 0; i < names_.size(); ++i) {
      if (std::find(c.fields.begin(), c.fields.end(), i) == c.fields.end()) {
        names.push_back(names_[i]);
      }
    }
    return names;
  }

 private:
  Columns joints(const std::vector<std::string>& movable) const {
    Columns c;
    c.names = {"time"};
    c.names.insert(c.names.end(), movable.begin(), movable.end());
    if (const auto lacking = missing(movable); !lacking.empty()) {
      fail_missing(lacking,
                   "the machine has a urdf, so its motion needs a column for each joint "
                   "from the root to the lip: " +
                       quoted_list(movable));
    }
    const auto used = [&](const char* n) {
      return std::find(c.names.begin(), c.names.end(), n) != c.names.end();
    };
    if (!used("x") && !used("y") && !used("z") && has("x") && has("y") && has("z")) {
      lines_.fail(
          "has both joints and a pose (x, y, z); remove the columns of the pose, or the "
          "machine's urdf");
    }
    return c;
  }

  Columns poses() const {
    const std::vector<std::string> xyz = {"x", "y", "z"};
    if (const auto lacking = missing(xyz); !lacking.empty()) {
      fail_missing(lacking,
                   "a motion by poses needs time,x,y,z (a motion by joints needs the "
                   "machine's urdf)");
    }
    Columns c;
    c.names = {"time", "x", "y", "z"};
    const auto lacking = missing(kQuaternion);
    c.quaternion = lacking.size() < kQuaternion.size();
    if (c.quaternion && missing(kAngles).size() < kAngles.size()) {
      lines_.fail("has both angles (roll, pitch, yaw) and a quaternion (qx, qy, qz, qw); keep one");
    }
    if (c.quaternion && !lacking.empty()) {
      fail_missing(lacking, "a quaternion needs qx,qy,qz,qw");
    }
    const auto& rotation = c.quaternion ? kQuaternion : kAngles;
    c.names.insert(c.names.end(), rotation.begin(), rotation.end());
    return c;
  }

  [[noreturn]] void fail_missing(const std::vector<std::string>& lacking,
                                 const std::string& what_is_right) const {
    std::string hint;
    if (names_.size() == 1 && names_[0].find_first_of(";\t") != std::string::npos) {
      hint = "; columns must be separated by commas";
    }
    lines_.fail(fmt::format("column{} {} {} missing; {}{}", lacking.size() == 1 ? "" : "s",
                            quoted_list(lacking), lacking.size() == 1 ? "is" : "are", what_is_right,
                            hint));
  }

  const CsvLines& lines_;
  std::vector<std::string> names_;
};

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
                 const std::vector<double>& row, const std::vector<double>& joint_values) {
  constexpr double kMostRad = 100;
  if (joint_values.empty()) return;
  const double* before = joint_values.data() + joint_values.size() - (row.size() - 1);
  std::size_t i = 0;
  for (const Joint& joint : chain.joints) {
    if (joint.type == Joint::Type::kFixed) continue;
    const double turn = row[i + 1] - before[i];
    ++i;
    if (joint.type == Joint::Type::kPrismatic || std::abs(turn) <= kMostRad) continue;
    lines.fail(
        fmt::format("joint {} turns {:g} rad since the row before; at most {} rad in one row",
                    names[i], turn, kMostRad));
  }
}

}  // namespace

MotionInput read_motion(const std::filesystem::path& file, const std::optional<Chain>& chain) {
  CsvLines lines(file);
  std::string_view line;
  std::vector<std::string_view> fields;
  if (!lines.next(line)) throw InputError(file, "is empty; it must be a motion as CSV");
  split_fields(line, fields);
  const Header header(lines, fields);
  const Columns columns = header.columns(chain);

  std::vector<std::string> warnings;
  if (const auto unused = header.unused(columns); !unused.empty()) {
    warnings.push_back(fmt::format("{}: ignored column{} {}", file.string(),
                                   unused.size() == 1 ? "" : "s", quoted_list(unused)));
  }

  LimitCheck limits(chain.value_or(Chain{}));
  std::vector<double> times_s, joint_values, row(columns.names.size(), 0.0);
  std::vector<Pose> poses;
  std::string time_before;
  long blank_line = 0;
  while (lines.next(line)) {
    if (is_blank(line)) {
      if (blank_line == 0) blank_line = lines.number();
      continue;
    }
    if (blank_line > 0) {
      throw InputError(file, blank_line, "is a blank line between rows; leave it out");
    }
    split_fields(line, fields);
    if (fields.size() != columns.count) {
      lines.fail(fmt::format("has {} field{}; the header has {} columns", fields.size(),
                             fields.size() == 1 ? "" : "s", columns.count));
    }
    for (std::size_t i = 0; i < row.size(); ++i) {
      if (columns.fields[i] == Columns::kNone) continue;
      row[i] = number(lines, columns.names[i], fields[columns.fields[i]]);
    }
    const auto time = fields[columns.fields[0]];
    if (!times_s.empty() && !(row[0] > times_s.back())) {
      lines.fail(
          fmt::format("time {} doesn't come after {} in the row before; times must strictly "
                      "increase",
                      printable(time), printable(time_before)));
    }
    time_before = time;
    times_s.push_back(row[0]);
    if (chain) {
      limits.row(row, lines.number());
      check_turns(lines, *chain, columns.names, row, joint_values);
      joint_values.insert(joint_values.end(), row.begin() + 1, row.end());
    } else {
      poses.push_back(make_pose(lines, row, columns.quaternion));
    }
  }
  if (times_s.empty()) {
    throw InputError(file, lines.number(), "has a header but no rows; it needs at least one");
  }
  limits.warn(file, warnings);
  if (chain) return {Motion(std::move(times_s), std::move(joint_values), *chain), warnings};
  return {Motion(std::move(times_s), std::move(poses)), warnings};
}

}  // namespace soilvdb::io
