// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The interpreter's lock, and a site's, around calls of the engine.
#pragma once

#include <pybind11/pybind11.h>
#include <unistd.h>

#include <atomic>
#include <mutex>
#include <stdexcept>
#include <thread>

namespace soilvdb::python {

/// Calls f(), which comes back with the interpreter's lock. A thread that finds that the
/// interpreter has ended is unwound by it, through all that it holds of Python's: it waits here for
/// the process's end instead.
template <typename F>
auto coming_back(const F& f) noexcept {
  try {
    return f();
  } catch (...) {
    for (;;) pause();
  }
}

/// Other Python threads run as long as there is one.
class Released {
 public:
  Released() : state_(PyEval_SaveThread()) {}
  ~Released() {
    coming_back([&] { PyEval_RestoreThread(state_); });
  }
  Released(const Released&) = delete;
  Released& operator=(const Released&) = delete;

 private:
  PyThreadState* state_;
};

/// Lets Python handle signals, within Released. @throw py::error_already_set, of KeyboardInterrupt
/// for one
inline void handle_signals() {
  const PyGILState_STATE state = coming_back([] { return PyGILState_Ensure(); });
  const bool raised = PyErr_CheckSignals() != 0;
  if (!raised) return PyGILState_Release(state);
  pybind11::error_already_set error;
  PyGILState_Release(state);
  throw error;
}

/// A mutex that refuses the thread that has it, which comes by a handler of signals.
class Turn {
 public:
  void lock() {
    if (holder_ == std::this_thread::get_id())
      throw std::runtime_error("the site is in the middle of a call of this thread");
    mutex_.lock();
    holder_ = std::this_thread::get_id();
  }
  void unlock() {
    holder_ = std::thread::id();
    mutex_.unlock();
  }

 private:
  std::mutex mutex_;
  std::atomic<std::thread::id> holder_;
};

}  // namespace soilvdb::python
