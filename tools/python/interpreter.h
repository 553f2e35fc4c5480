// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Locks of the interpreter and of a site for calls of the engine.
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

/// Calls f(), which returns with the interpreter's lock. After the interpreter's end, Python would
/// unwind the thread through frames that hold Python objects. The thread waits here for the
/// process's end instead.
template <typename F>
auto coming_back(const F& f) noexcept {
  try {
    return f();
  } catch (...) {
    for (;;) pause();
  }
}

/// Was this process forked from one that used the module? It lacks the engine's threads.
inline bool is_forked() {
  static const pid_t process = getpid();
  return getpid() != process;
}

/// OpenVDB's logger has a thread since the module's import. A process forked after the import does
/// not have this thread, and would wait for it forever at its end.
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

/// Counts threads in the engine, because the end of the program destroys the engine's data. After
/// close() only its caller may enter; other threads wait for the process's end.
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
  /// Call it between steps of a long call.
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
  /// Returns when no thread is inside.
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

/// A scope within the engine; enter it before taking the engine's locks.
class Inside {
 public:
  Inside() { Gate::get().enter(); }
  ~Inside() { Gate::get().leave(); }
  Inside(const Inside&) = delete;
  Inside& operator=(const Inside&) = delete;
};

/// A scope in which other Python threads can run.
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

/// Lets Python handle signals, within Released and Inside. @throw py::error_already_set, such as
/// KeyboardInterrupt
inline void handle_signals() {
  Gate::get().pause_if_closed();
  const PyGILState_STATE state = coming_back([] { return PyGILState_Ensure(); });
  const bool raised = PyErr_CheckSignals() != 0;
  if (!raised) return PyGILState_Release(state);
  pybind11::error_already_set error;
  PyGILState_Release(state);
  throw error;
}

/// A mutex that throws if its own thread locks it again, as a signal handler could.
class Turn {
 public:
  void lock() {
    if (holder_ == std::this_thread::get_id())
      throw std::runtime_error("this thread is already in a call of the site");
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
