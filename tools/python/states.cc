// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// States of machines from Python's arguments, and the errors of those that are refused.
#include <fmt/format.h>

#include <algorithm>

#include "io/file/text.h"
#include "tools/python/site.h"

namespace soilvdb::python {
namespace {

void require_count(const char* what, py::ssize_t given, std::size_t states) {
  if (static_cast<std::size_t>(given) == states) return;
  throw py::value_error(fmt::format("there are {} {} for {} states", given, what, states));
}

bool is_mapping(const py::object& given) {
  return py::isinstance<py::dict>(given) ||
         (py::hasattr(given, "keys") && py::hasattr(given, "__getitem__"));
}

}  // namespace

void require_own_process() {
  if (!is_forked()) return;
  throw std::runtime_error(
      "soilvdb can't be used in a process that was forked from one that used it; start that with "
      "multiprocessing's method 'spawn'");
}

std::size_t machine_of(Session& session, const MachineName& given) {
  if (const auto* name = std::get_if<std::string>(&given)) return session.machine(*name);
  const std::ptrdiff_t number = std::get<std::ptrdiff_t>(given);
  if (number < 0 || static_cast<std::size_t>(number) >= session.machines().size())
    throw py::value_error(fmt::format("there is no machine {}; there are {}, numbered from 0",
                                      number, session.machines().size()));
  return static_cast<std::size_t>(number);
}

py::object error_of(const StepResult& step, const std::string& machine, const std::string& before) {
  if (step.status == Status::kFailed)
    return py::reinterpret_borrow<py::object>(PyExc_RuntimeError)(before + step.why);
  std::string reason = step.why;
  for (const char* after : {": ", " "})
    if (const std::string named = fmt::format("machine '{}'{}", machine, after);
        reason == step.why && reason.starts_with(named))
      reason.erase(0, named.size());
  return py::module_::import("soilvdb._errors")
      .attr(step.status == Status::kNoGround ? "NoGroundError" : "StateError")(
          before + step.why, machine.empty() ? py::object(py::none()) : py::str(machine), reason);
}

void throw_error(const py::object& error) {
  PyErr_SetObject(py::type::of(error).ptr(), error.ptr());
  throw py::error_already_set();
}

void require_good(const StepResult& step, const std::string& machine, const std::string& before) {
  if (!step.ok()) throw_error(error_of(step, machine, before));
}

StepResult no_state(const std::string& machine, const std::string& why) {
  return {Status::kBadState, fmt::format("machine '{}': {}", machine, why), {}};
}

void refuse_state(Site& site, const MachineName& machine, const std::string& why) {
  const std::string name = site.with(
      [&](Session& session) { return session.machines()[machine_of(session, machine)].name; });
  throw_error(error_of(no_state(name, why), name));
}

void tell(const std::vector<std::string>& lines, int level) {
  for (const std::string& line : lines)
    if (PyErr_WarnEx(PyExc_UserWarning, line.c_str(), level) != 0) PyErr_WriteUnraisable(nullptr);
}

std::vector<std::string> joint_names(Site& site, const MachineName& machine) {
  return site.with([&](Session& session) {
    const auto& chain = session.machines()[machine_of(session, machine)].chain;
    return chain ? chain->movable() : std::vector<std::string>();
  });
}

py::object joints_of(const py::object& given, const std::vector<std::string>& names) {
  if (!is_mapping(given)) return given;
  const py::dict by_name(given);
  if (names.empty()) throw py::value_error("joints: the machine has none; give it a pose");
  for (const auto& [key, value] : by_name) {
    const std::string name = py::str(key);
    if (std::find(names.begin(), names.end(), name) != names.end()) continue;
    throw py::value_error(fmt::format("joints: unknown joint '{}'; did you mean '{}'?",
                                      io::printable(name), io::nearest(name, names)));
  }
  py::list columns;
  for (const std::string& name : names) {
    if (!by_name.contains(name))
      throw py::value_error(fmt::format("joints: joint '{}' is missing", name));
    columns.append(array_of(by_name[name.c_str()], name.c_str()));
  }
  for (const py::handle& column : columns)
    if (!column.attr("shape").equal(columns[0].attr("shape")))
      throw py::value_error("joints: there must be as many values of each joint");
  return py::module_::import("numpy").attr("stack")(columns, py::arg("axis") = -1);
}

States::States(const py::object& positions, const py::object& rotations, const py::object& poses,
               const py::object& joints, const py::object& base, const py::object& times,
               const std::vector<std::string>& names)
    : bases_(base) {
  if (!poses.is_none() + !joints.is_none() + !positions.is_none() != 1 ||
      (!rotations.is_none() && positions.is_none()))
    throw py::type_error("give one of positions (with rotations), poses or joints");
  if (!base.is_none() && joints.is_none()) throw py::type_error("base goes with joints");
  Array given;
  if (!poses.is_none()) {
    kind_ = Kind::kPoses;
    given = array_of(poses, "poses");
    if (given.ndim() != 3 || given.shape(1) != 4 || given.shape(2) != 4)
      throw py::value_error("poses must have the shape (N, 4, 4)");
  } else if (!joints.is_none()) {
    kind_ = Kind::kJoints;
    given = array_of(joints_of(joints, names), "joints");
    if (given.ndim() != 2 || given.shape(1) == 0)
      throw py::value_error("joints must have the shape (N, joints)");
  } else {
    given = rows(positions, "positions", 3);
  }
  count_ = static_cast<std::size_t>(given.shape(0));
  rows_.assign(given.data(), given.data() + given.size());
  width_ = count_ > 0 ? rows_.size() / count_ : 0;
  bases_.require(count_);
  if (!rotations.is_none()) {
    const Array turns = rows(rotations, "rotations", 4);
    require_count("rotations", turns.shape(0), count_);
    turns_.assign(turns.data(), turns.data() + turns.size());
  }
  if (times.is_none()) return;
  times_s_ = numbers(times, "times");
  require_count("times", static_cast<py::ssize_t>(times_s_.size()), count_);
}

MachineState States::at(std::size_t row) const {
  MachineState state;
  const std::span<const double> values = std::span(rows_).subspan(row * width_, width_);
  if (kind_ == Kind::kPoses) {
    state.pose = pose_of(values);
  } else if (kind_ == Kind::kJoints) {
    state.joints = values;
    state.base = bases_.at(row);
  } else {
    state.pose.position = Vec3(values.data());
    if (!turns_.empty()) state.pose.rotation = quaternion(std::span(turns_).subspan(4 * row, 4));
  }
  if (!times_s_.empty()) state.time_s = times_s_[row];
  return state;
}

}  // namespace soilvdb::python
