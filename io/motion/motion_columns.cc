// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/motion/motion_columns.h"

#include <fmt/format.h>

#include <algorithm>

#include "io/file/text.h"

namespace soilvdb::inline v0::io {
namespace {

const std::vector<std::string> kPosition = {"x", "y", "z"};
const std::vector<std::string> kAngles = {"roll", "pitch", "yaw"};
const std::vector<std::string> kQuaternion = {"qx", "qy", "qz", "qw"};
constexpr const char* kBase = "base_";

std::vector<std::string> prefixed(const std::string& prefix, std::vector<std::string> names) {
  for (std::string& name : names) name.insert(0, prefix);
  return names;
}

class Header {
 public:
  Header(const RowPlace& lines, const std::vector<std::string_view>& fields)
      : lines_(lines), names_(fields.begin(), fields.end()) {
    if (parse_number(names_[0])) {
      lines_.fail(
          "begins with numbers; the first line must name the columns: time,x,y,z and so on");
    }
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
    for (std::size_t i = 0; i < names_.size(); ++i) {
      if (std::find(c.fields.begin(), c.fields.end(), i) == c.fields.end()) {
        c.unused.push_back(names_[i]);
      }
    }
    return c;
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
    std::string of_base, of_joint;
    for (const auto& names : {kPosition, kAngles, kQuaternion})
      for (const std::string& name : prefixed(kBase, names))
        if (has(name))
          (used(name.c_str()) ? of_joint : of_base) = name;
        else
          c.absent.push_back(name);
    if (of_base.empty()) return c;
    c.absent.clear();
    if (!of_joint.empty())
      lines_.fail(
          fmt::format("'{}' is of the base's pose, and '{}' is a joint of the urdf; rename "
                      "that joint, or leave the base's columns out",
                      of_base, of_joint));
    if (movable.empty())
      lines_.fail(
          fmt::format("'{}' is of the base's pose, and no joint of the urdf moves the lip; "
                      "leave the urdf out, and give the lip's pose, x,y,z and its rotation",
                      of_base));
    c.base = 1 + movable.size();
    add_pose(c, kBase, "the pose of the machine's base needs base_x,base_y,base_z");
    return c;
  }

  /// @param prefix of the columns' names @param needs what to say without its position
  void add_pose(Columns& c, const std::string& prefix, const std::string& needs) const {
    const std::vector<std::string> position = prefixed(prefix, kPosition),
                                   angles = prefixed(prefix, kAngles),
                                   quaternion = prefixed(prefix, kQuaternion);
    if (const auto lacking = missing(position); !lacking.empty()) fail_missing(lacking, needs);
    const auto lacking = missing(quaternion);
    c.quaternion = lacking.size() < quaternion.size();
    if (c.quaternion && missing(angles).size() < angles.size()) {
      lines_.fail(fmt::format("has both angles ({}) and a quaternion ({}); keep one",
                              fmt::join(angles, ", "), fmt::join(quaternion, ", ")));
    }
    if (c.quaternion && !lacking.empty())
      fail_missing(lacking, fmt::format("a quaternion needs {}", fmt::join(quaternion, ",")));
    const auto& rotation = c.quaternion ? quaternion : angles;
    c.names.insert(c.names.end(), position.begin(), position.end());
    c.names.insert(c.names.end(), rotation.begin(), rotation.end());
  }

  Columns poses() const {
    Columns c;
    c.names = {"time"};
    add_pose(c, "",
             "a motion by poses needs time,x,y,z (a motion by joints needs the "
             "machine's urdf)");
    return c;
  }

  [[noreturn]] void fail_missing(const std::vector<std::string>& lacking,
                                 const std::string& what_is_right) const {
    std::string hint;
    if (names_.size() == 1 && names_[0].find_first_of(";\t") != std::string::npos) {
      hint = "; columns must be separated by commas";
    }
    hint += other_case(lacking, names_);
    lines_.fail(fmt::format("column{} {} {} missing; {}{}", lacking.size() == 1 ? "" : "s",
                            quoted_list(lacking), lacking.size() == 1 ? "is" : "are", what_is_right,
                            hint));
  }

  const RowPlace& lines_;
  std::vector<std::string> names_;
};

}  // namespace

std::string other_case(const std::vector<std::string>& wanted,
                       const std::vector<std::string>& there) {
  std::string hint;
  for (const std::string& name : wanted) {
    const auto it = std::find_if(there.begin(), there.end(),
                                 [&](const auto& n) { return lower_case(n) == lower_case(name); });
    if (it == there.end()) continue;
    hint += fmt::format("{} '{}' by '{}'", hint.empty() ? "; did you mean" : ",", printable(name),
                        printable(*it));
  }
  return hint.empty() ? hint : hint + "?";
}

Columns read_columns(const RowPlace& lines, const std::vector<std::string_view>& header,
                     const std::optional<Chain>& chain) {
  return Header(lines, header).columns(chain);
}

}  // namespace soilvdb::inline v0::io
