// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/app/child.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstdint>
#include <stdexcept>
#include <system_error>

#include "soilvdb/io/error.h"
#include "soilvdb/io/level_set_file.h"
#include "tools/app/foreign_vdb.h"

namespace soilvdb::tools {
namespace {

constexpr int kBroken = 1, kRefused = 3;
constexpr char kStarted = '>';  // the child's first output

// OpenVDB reads some 10 MB/s, and needs at most a hundred times a file's size, because each node's
// masks are stored uncompressed. A damaged file may demand more.
constexpr std::uintmax_t kMemory_bytes = 512 << 20, kMemoryPerThread_bytes = 16 << 20,
                         kMemoryPerByte = 256;
constexpr std::uintmax_t kTime_s = 2, kBytesPerSecond = 1 << 20;
// Limit of elapsed time, in CPU time limits: disks are slow, and a damaged heap may deadlock.
constexpr std::uintmax_t kPatience = 10;

void limit(int resource, rlim_t value) {
  const rlimit both{value, value};
  setrlimit(resource, &both);
}

void limit_memory_and_time(const std::filesystem::path& file) {
  std::error_code none;
  const std::uintmax_t size =
      std::min<std::uintmax_t>(std::filesystem::file_size(file, none), 1ull << 50);
  const std::uintmax_t time_s = kTime_s + size / kBytesPerSecond;
  limit(RLIMIT_CPU, time_s);
  alarm(static_cast<unsigned>(std::min<std::uintmax_t>(kPatience * time_s, 1 << 30)));
#ifndef __SANITIZE_ADDRESS__  // it reserves terabytes
  const auto of_system = [](int name) { return static_cast<std::uintmax_t>(sysconf(name)); };
  limit(RLIMIT_DATA,
        std::min(kMemory_bytes + kMemoryPerThread_bytes * of_system(_SC_NPROCESSORS_ONLN) +
                     kMemoryPerByte * size,
                 of_system(_SC_PHYS_PAGES) * of_system(_SC_PAGESIZE)));
#endif
}

void write_all(int descriptor, const std::string& text) {
  for (std::size_t done = 0; done < text.size();) {
    const ssize_t n = write(descriptor, text.data() + done, text.size() - done);
    if (n < 0 && errno != EINTR) _exit(kBroken);
    if (n > 0) done += static_cast<std::size_t>(n);
  }
}

}  // namespace

void child_main(const std::string& what, const std::filesystem::path& file) {
  // Hides output of OpenVDB and the C library about a damaged file or heap.
  const int answer = dup(STDOUT_FILENO), null = open("/dev/null", O_WRONLY);
  dup2(null, STDOUT_FILENO);
  dup2(null, STDERR_FILENO);
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  limit(RLIMIT_CORE, 0);
  limit_memory_and_time(file);
  write_all(answer, std::string(1, kStarted));
  try {
    if (what.starts_with(kLevelSet)) {
      io::read_level_set(file, what.substr(kLevelSet.size()));
    } else {
      write_all(answer, foreign_vdb_text(file));
    }
  } catch (const io::InputError& e) {
    write_all(answer, e.what());
    _exit(kRefused);
  } catch (...) {
    _exit(kBroken);
  }
  _exit(0);  // destructors could crash on a damaged heap
}

std::string read_in_child(const std::string& what, const std::filesystem::path& file) {
  std::array<int, 2> ends;
  if (pipe2(ends.data(), O_CLOEXEC) != 0)
    throw std::system_error(errno, std::generic_category(), "pipe");
  const pid_t pid = fork();
  if (pid < 0) throw std::system_error(errno, std::generic_category(), "fork");
  if (pid == 0) {  // exec, because a fork has only one of the libraries' threads
    dup2(ends[1], STDOUT_FILENO);
    execl("/proc/self/exe", "soilvdb", kInChild, what.c_str(), file.c_str(), nullptr);
    _exit(kBroken);
  }
  close(ends[1]);
  std::string text;
  std::array<char, 4096> some;
  for (;;) {
    const ssize_t n = ::read(ends[0], some.data(), some.size());
    if (n > 0) text.append(some.data(), static_cast<std::size_t>(n));
    if (n == 0 || (n < 0 && errno != EINTR)) break;
  }
  close(ends[0]);
  int status = 0;
  while (waitpid(pid, &status, 0) < 0) {
    if (errno != EINTR) throw std::system_error(errno, std::generic_category(), "waitpid");
  }
  if (!text.starts_with(kStarted) && WIFEXITED(status))
    throw std::runtime_error(fmt::format(
        "{}: can't be read: /proc/self/exe, which would read it, can't be started", file.string()));
  text.erase(0, 1);
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return text;
  if (WIFEXITED(status) && WEXITSTATUS(status) == kRefused) throw io::InputError(text);
  if (WIFSIGNALED(status) &&
      (WTERMSIG(status) == SIGINT || WTERMSIG(status) == SIGTERM || WTERMSIG(status) == SIGHUP))
    throw std::runtime_error("stopped by a signal; nothing was written");
  throw io::InputError(file,
                       "is damaged, or takes more memory or time than its size can need; write it "
                       "anew");
}

}  // namespace soilvdb::tools
