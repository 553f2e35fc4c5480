// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The interpreter's lock, and a site's, around calls of the engine.
#pragma once

#include <pybind11/pybind11.h>
#include <unistd.h>

#include <atomic>
#include <condition_variable>
#include <cstdio>
#include <cstdlib>
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

/// Was this process forked from one that used the module? It has none of the engine's threads.
inline bool is_forked() {
  static const pid_t process = getpid();
  return getpid() != process;
}

/// What OpenVDB logs by has a thread from the module's import on, for which the end of a process
/// that was forked since then would wait forever.
inline void end_forked_processes_at_once() {
  static const pid_t importer = getpid();
  on_exit(
      [](int status, void*) {
        if (getpid() == importer) return;
        std::fflush(nullptr);
        _exit(status);
      },
      nullptr);
}

/// Who is in the engine when a program ends: what that is made of is destroyed then. From close()
/// on only the thread that called it gets in, and others wait for the process's end.
class Gate {
 public:
  static Gate& get() {
    static Gate* const gate = new Gate;  // outlives all threads
    return *gate;
  }
  void enter() {
    std::unique_lock lock(mutex_);
    if (closed_ && ender_ != std::this_thread::get_id()) stay(lock);
    ++inside_;
  }
  void leave() {
    const std::lock_guard lock(mutex_);
    --inside_;
    left_.notify_all();
  }
  /// Between two steps of a long call.
  void pause_if_closed() {
    std::unique_lock lock(mutex_);
    if (!closed_ || ender_ == std::this_thread::get_id()) return;
    --inside_;
    left_.notify_all();
    stay(lock);
  }
  /// Is this the thread that called close()?
  bool is_ender() {
    const std::lock_guard lock(mutex_);
    return closed_ && ender_ == std::this_thread::get_id();
  }
  /// Returns when nobody is inside any more.
  void close() {
    std::unique_lock lock(mutex_);
    closed_ = true;
    ender_ = std::this_thread::get_id();
    left_.wait(lock, [&] { return inside_ == 0; });
  }

 private:
  [[noreturn]] static void stay(std::unique_lock<std::mutex>& lock) {
    lock.unlock();
    for (;;) pause();
  }

  std::mutex mutex_;
  std::condition_variable left_;
  int inside_ = 0;
  bool closed_ = false;
  std::thread::id ender_;
};

/// Within the engine, with all locks that it takes.
class Inside {
 public:
  Inside() { Gate::get().enter(); }
  ~Inside() { Gate::get().leave(); }
  Inside(const Inside&) = delete;
  Inside& operator=(const Inside&) = delete;
};

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

/// Lets Python handle signals, within Released and Inside. @throw py::error_already_set, of
/// KeyboardInterrupt for one
inline void handle_signals() {
  Gate::get().pause_if_closed();
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
    if (!Gate::get().is_ender())
      mutex_.lock();
    else if (!mutex_.try_lock())
      throw std::runtime_error("the site is in a call of a thread that ended with the program");
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
