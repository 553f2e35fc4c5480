// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/child.h"

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <system_error>

#include "io/error.h"

namespace soilvdb::tools {
namespace {

constexpr int kRefused = 3;

// No file of OpenVDB's takes more than a hundred times its size, since each node's masks are in it
// as they are, and all read at some 10 MB/s. A damaged one may try to.
constexpr std::uintmax_t kMemory_bytes = 512 << 20, kMemoryPerThread_bytes = 16 << 20,
                         kMemoryPerByte = 256;
constexpr std::uintmax_t kTime_s = 2, kBytesPerSecond = 1 << 20;
// So many times that by the clock: disks are slow, and a damaged heap may make it wait for itself.
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
#ifndef __SANITIZE_ADDRESS__  // which reserves terabytes
  const auto of_system = [](int name) { return static_cast<std::uintmax_t>(sysconf(name)); };
  limit(RLIMIT_DATA,
        std::min(kMemory_bytes + kMemoryPerThread_bytes * of_system(_SC_NPROCESSORS_ONLN) +
                     kMemoryPerByte * size,
                 of_system(_SC_PHYS_PAGES) * of_system(_SC_PAGESIZE)));
#endif
}

[[noreturn]] void child(const std::filesystem::path& file, int pipe_end,
                        const std::function<std::string()>& read) {
  // What the C library says of a damaged heap is not for the user.
  if (const int null = open("/dev/null", O_WRONLY); null >= 0) dup2(null, STDERR_FILENO);
  limit(RLIMIT_CORE, 0);
  limit_memory_and_time(file);
  int status = 0;
  std::string text;
  try {
    text = read();
  } catch (const io::InputError& e) {
    status = kRefused;
    text = e.what();
  } catch (...) {
    _exit(1);
  }
  for (std::size_t done = 0; done < text.size();) {
    const ssize_t n = write(pipe_end, text.data() + done, text.size() - done);
    if (n < 0 && errno != EINTR) _exit(1);
    if (n > 0) done += static_cast<std::size_t>(n);
  }
  _exit(status);
}

}  // namespace

std::string in_child(const std::filesystem::path& file, const std::function<std::string()>& read) {
  std::array<int, 2> ends;
  if (pipe(ends.data()) != 0) throw std::system_error(errno, std::generic_category(), "pipe");
  std::fflush(nullptr);
  const pid_t pid = fork();
  if (pid < 0) throw std::system_error(errno, std::generic_category(), "fork");
  if (pid == 0) {
    close(ends[0]);
    child(file, ends[1], read);
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
  while (waitpid(pid, &status, 0) < 0 && errno == EINTR) {
  }
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return text;
  if (WIFEXITED(status) && WEXITSTATUS(status) == kRefused) throw io::InputError(text);
  if (WIFSIGNALED(status) && (WTERMSIG(status) == SIGINT || WTERMSIG(status) == SIGTERM))
    throw std::runtime_error("stopped by a signal; nothing was written");
  throw io::InputError(file,
                       "is damaged, or takes more memory or time than its size can need; write it "
                       "anew");
}

}  // namespace soilvdb::tools
