// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soilvdb.Site for the files that bind it. Each call of the engine releases the interpreter's lock
// and locks the site, so several threads may use one site.
#pragma once

#include <fmt/format.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "soilvdb/session.h"
#include "tools/python/arguments.h"
#include "tools/python/interpreter.h"

namespace soilvdb::python {

/// @throw std::runtime_error in a process that was forked from one that used the module
void require_own_process();

/// A session, and its construction arguments for pickle.
class Site {
 public:
  Site(Session session, py::tuple made_from)
      : session_(std::make_unique<Session>(std::move(session))), made_from_(std::move(made_from)) {}
  ~Site() {
    if (is_forked()) session_.release();  // this process lacks its threads
  }

  /// Calls f(session) exclusively, without the interpreter's lock.
  template <typename F>
  auto with(const F& f) {
    require_own_process();
    const Released released;
    const std::lock_guard lock(turn_);
    const Inside inside;
    return f(open());
  }
  Session& open() {
    if (!session_) throw std::runtime_error("the site is closed");
    return *session_;
  }
  Session* session() { return session_.get(); }  ///< null: it is closed
  bool is_closed() {
    require_own_process();
    const Released released;
    const std::lock_guard lock(turn_);
    return !session_;
  }
  void close() {
    require_own_process();
    const Released released;
    const std::lock_guard lock(turn_);
    const Inside inside;
    const std::unique_ptr<Session> session = std::move(session_);
    if (session) session->stop_recording();
  }
  Turn& turn() { return turn_; }
  const py::tuple& made_from() const { return made_from_; }

 private:
  Turn turn_;
  std::unique_ptr<Session> session_;
  py::tuple made_from_;
};

/// The number or name of a machine.
using MachineName = std::variant<std::ptrdiff_t, std::string>;
/// @throw py::value_error, std::invalid_argument that there is no such machine
std::size_t machine_of(Session& session, const MachineName& given);

/// The error of a refused state: StateError, NoGroundError or RuntimeError.
/// @param before the message's beginning, such as "state 3: "
py::object error_of(const StepResult& step, const std::string& machine,
                    const std::string& before = "");
[[noreturn]] void throw_error(const py::object& error);
/// @throw that error unless the step is good
void require_good(const StepResult& step, const std::string& machine = "",
                  const std::string& before = "");

/// The result of a state that is none. @param why without the machine
StepResult no_state(const std::string& machine, const std::string& why);
/// @throw StateError that a machine's state is none; the error of an unknown machine
[[noreturn]] void refuse_state(Site& site, const MachineName& machine, const std::string& why);
/// Calls f(), which reads states of a machine. @throw StateError in place of py::value_error
template <typename F>
auto reading_states(Site& site, const MachineName& machine, const F& f) {
  try {
    return f();
  } catch (const py::value_error& e) {
    refuse_state(site, machine, e.what());
  }
}

/// Warns of what was noticed during an update that is made: it may not raise, where warnings are
/// errors, because the update's results would be lost.
/// @param level of the Python frame that it points to; 1: that which called the module
void tell(const std::vector<std::string>& lines, int level = 1);

/// States of machines as arrays, one per row.
class States {
 public:
  /// Exactly one of positions (N, 3) with or without rotations (N, 4), poses (N, 4, 4) and joints
  /// (N, joints), or joints by name.
  /// @param base of joints, as Poses, or None
  /// @param times (N,), or None
  /// @param names of the machine's joints
  States(const py::object& positions, const py::object& rotations, const py::object& poses,
         const py::object& joints, const py::object& base, const py::object& times,
         const std::vector<std::string>& names);
  std::size_t count() const { return count_; }
  std::size_t joints() const { return kind_ == Kind::kJoints ? width_ : 0; }  ///< of each state
  /// Needs no lock of the interpreter. @throw py::value_error for a pose that is none
  MachineState at(std::size_t row) const;

 private:
  enum class Kind { kPositions, kPoses, kJoints } kind_ = Kind::kPositions;
  std::size_t count_ = 0, width_ = 0;
  // Copies, because another thread may write to the arrays meanwhile.
  std::vector<double> rows_, turns_, times_s_;
  Poses bases_;
};

/// Joints as one array (..., joints). @param given an array, or values by name
/// @throw py::value_error for a name that is unknown or missing
py::object joints_of(const py::object& given, const std::vector<std::string>& names);
std::vector<std::string> joint_names(Site& site, const MachineName& machine);

/// Calls f() on so many threads; empty: on all cores. @throw py::value_error for less than one
template <typename F>
void on_threads(const std::optional<int>& threads, const F& f) {
  if (!threads) return f();
  constexpr int kMostThreads = 1024;
  if (*threads < 1 || *threads > kMostThreads)
    throw py::value_error("threads is " + std::to_string(*threads) + "; it must be 1 to " +
                          std::to_string(kMostThreads));
  tbb::task_arena(*threads).execute(f);
}

/// Calls f(first, last) for groups of `count` sites, on so many threads, and handles signals
/// between groups. @param each number of sites of a group for each thread
template <typename F>
void in_groups(std::size_t count, std::size_t each, const std::optional<int>& threads, const F& f) {
  std::size_t first = 0;
  do {
    if (first > 0) handle_signals();
    on_threads(threads, [&] {
      const auto on = static_cast<std::size_t>(tbb::this_task_arena::max_concurrency());
      const std::size_t last = std::min(count, first + on * each);
      f(first, last);
      first = last;
    });
  } while (first < count);
}

/// Calls f(); its error says of which site it is.
template <typename F>
auto of_site(std::size_t number, const F& f) {
  const auto named = [&](const std::exception& e) {
    return fmt::format("site {}: {}", number, e.what());
  };
  try {
    return f();
  } catch (const py::value_error& e) {
    throw py::value_error(named(e));
  } catch (const std::invalid_argument& e) {
    throw std::invalid_argument(named(e));
  }
}

/// Different sites. @param kept keeps them alive
std::vector<Site*> sites_of(const py::tuple& kept);

/// Calls f(their sessions) exclusively, without the interpreter's lock.
/// @param also_closed those of closed sites are null; else one is an error
template <typename F>
void with_all(const std::vector<Site*>& sites, const F& f, bool also_closed = false) {
  require_own_process();
  const Released released;
  // A fixed order of locks avoids deadlocks between calls that share sites.
  std::set<Site*> ordered(sites.begin(), sites.end());
  std::vector<std::unique_lock<Turn>> locks;
  for (Site* site : ordered) locks.emplace_back(site->turn());
  const Inside inside;
  std::vector<Session*> sessions;
  for (std::size_t i = 0; i < sites.size(); ++i) {
    sessions.push_back(sites[i]->session());
    if (sessions[i] == nullptr && !also_closed)
      throw std::runtime_error(fmt::format("site {}: the site is closed", i));
  }
  f(sessions);
}

/// Binds what looks at the ground, and what many sites do in one call.
void bind_looks(py::class_<Site>& site, py::module_& m);
void bind_many(py::module_& m);
/// Binds scans.
void bind_scans(py::class_<Site>& site, py::module_& m);
/// Binds the force of the soil.
void bind_force(py::class_<Site>& site, py::module_& m);

}  // namespace soilvdb::python
