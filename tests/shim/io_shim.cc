// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A library to preload into the program, by which the Nth operation on files of one folder goes
// wrong. Environment:
//   SHIM_FOLDER  the folder, absolute
//   SHIM_LOG     a file that gets the name of each operation, one per line
//   SHIM_FAULT   fail N ERRNO    the Nth fails
//                short N ERRNO   the same, but a write is done by half first, and all after it fail
//                kill N          the process dies there, a write half done
//                cut N           the same, and what was not synced is gone: a power cut
#include <dlfcn.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>
#include <mutex>
#include <sstream>
#include <string>
#include <vector>

namespace {

template <typename F>
F real(const char* name) {
  return reinterpret_cast<F>(dlsym(RTLD_NEXT, name));
}

#define REAL(name) (real<decltype(&::name)>(#name))

struct Rename {
  std::string from, to, before;  // before: a link to what `to` was, or nothing
};

class Shim {
 public:
  Shim() {
    if (const char* folder = std::getenv("SHIM_FOLDER")) folder_ = folder;
    if (const char* fault = std::getenv("SHIM_FAULT"))
      std::istringstream(fault) >> fault_ >> at_ >> error_;
    if (const char* log = std::getenv("SHIM_LOG"))
      log_ = REAL(open)(log, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
  }

  bool watches(const std::string& path) const {
    return !folder_.empty() && (path == folder_ || path.starts_with(folder_ + "/"));
  }
  std::string path_of(int descriptor) const {
    char path[4096];
    const std::string link = "/proc/self/fd/" + std::to_string(descriptor);
    const ssize_t n = readlink(link.c_str(), path, sizeof path);
    return n > 0 ? std::string(path, static_cast<std::size_t>(n)) : "";
  }

  /// Counts an operation. @return is it, or everything from now on, to fail?
  bool fails(const std::string& what, const std::string& path) {
    const std::lock_guard lock(mutex_);
    if (log_ >= 0) {
      const std::string line = what + " " + path.substr(folder_.size()) + "\n";
      if (REAL(write)(log_, line.data(), line.size()) < 0) std::abort();
    }
    ++count_;
    const bool full = fault_ == "short" && count_ > at_ && what.ends_with("write");
    if (count_ != at_ && !full) return false;
    if (fault_ == "kill" || fault_ == "cut") die();
    errno = error_;
    return fault_ == "fail" || fault_ == "short";
  }
  /// Is the next operation, a write, to be done by half?
  bool tears() {
    const std::lock_guard lock(mutex_);
    return count_ + 1 == at_ && fault_ != "fail";
  }

  void synced(int descriptor) {
    const std::lock_guard lock(mutex_);
    const std::string path = path_of(descriptor);
    struct stat status {};
    if (fstat(descriptor, &status) != 0) return;
    if (!S_ISDIR(status.st_mode)) {
      unsynced_[path] = status.st_size;
      return;
    }
    for (const Rename& r : renames_)
      if (!r.before.empty()) REAL(unlink)(r.before.c_str());
    renames_.clear();
  }
  void written(int descriptor) {
    const std::lock_guard lock(mutex_);
    unsynced_.emplace(path_of(descriptor), 0);
  }
  void renames(const std::string& from, const std::string& to) {
    const std::lock_guard lock(mutex_);
    if (fault_ != "cut") return;
    Rename r{from, to, to + ".before-the-cut"};
    if (link(to.c_str(), r.before.c_str()) != 0) r.before.clear();
    renames_.push_back(r);
    unsynced_[to] = unsynced_[from];
    unsynced_.erase(from);
  }

 private:
  [[noreturn]] void die() {
    if (fault_ == "cut") {
      for (const auto& [path, size] : unsynced_)
        if (truncate(path.c_str(), size) != 0) continue;  // it is gone
      for (auto r = renames_.rbegin(); r != renames_.rend(); ++r) {
        REAL(rename)(r->to.c_str(), r->from.c_str());
        if (!r->before.empty()) REAL(rename)(r->before.c_str(), r->to.c_str());
      }
    }
    kill(getpid(), SIGKILL);
    for (;;) pause();
  }

  std::string folder_, fault_;
  long at_ = -1, count_ = 0;
  int error_ = EIO, log_ = -1;
  std::mutex mutex_;
  std::map<std::string, off_t> unsynced_;  // how much of each file is on disk
  std::vector<Rename> renames_;            // not yet on disk
};

Shim& shim() {
  static Shim* const one = new Shim;  // outlives whatever runs at exit
  return *one;
}

int open_any(const char* name, const char* path, int flags, mode_t mode) {
  const int descriptor = real<int (*)(const char*, int, ...)>(name)(path, flags, mode);
  if (descriptor < 0) return descriptor;
  const std::string full = shim().path_of(descriptor);
  const bool changes = (flags & (O_WRONLY | O_RDWR | O_DIRECTORY)) != 0;
  if (!changes || !shim().watches(full)) return descriptor;
  if (!shim().fails("open", full)) return descriptor;
  const int error = errno;
  if ((flags & O_CREAT) && (flags & O_EXCL)) REAL(unlink)(path);
  REAL(close)(descriptor);
  errno = error;
  return -1;
}

template <typename Sync>
int sync_any(const char* name, int descriptor, Sync sync) {
  const std::string path = shim().path_of(descriptor);
  if (!shim().watches(path)) return sync(descriptor);
  if (shim().fails(name, path)) return -1;
  const int result = sync(descriptor);
  if (result == 0) shim().synced(descriptor);
  return result;
}

}  // namespace

extern "C" {

int open(const char* path, int flags, ...) {
  va_list more;
  va_start(more, flags);
  const mode_t mode = (flags & O_CREAT) ? va_arg(more, mode_t) : 0;
  va_end(more);
  return open_any("open", path, flags, mode);
}

int open64(const char* path, int flags, ...) {
  va_list more;
  va_start(more, flags);
  const mode_t mode = (flags & O_CREAT) ? va_arg(more, mode_t) : 0;
  va_end(more);
  return open_any("open64", path, flags, mode);
}

ssize_t write(int descriptor, const void* bytes, size_t size) {
  const std::string path = shim().path_of(descriptor);
  if (!shim().watches(path)) return REAL(write)(descriptor, bytes, size);
  const bool tears = shim().tears() && size > 1;
  if (tears) {
    if (REAL(write)(descriptor, bytes, size / 2) < 0) std::abort();
    shim().written(descriptor);
  }
  if (shim().fails("write", path)) return tears ? static_cast<ssize_t>(size / 2) : -1;
  const ssize_t result = REAL(write)(descriptor, bytes, size);
  shim().written(descriptor);
  return result;
}

int fsync(int descriptor) { return sync_any("fsync", descriptor, REAL(fsync)); }
int fdatasync(int descriptor) { return sync_any("fdatasync", descriptor, REAL(fdatasync)); }

int ftruncate64(int descriptor, off64_t size) {
  const std::string path = shim().path_of(descriptor);
  if (shim().watches(path) && shim().fails("ftruncate", path)) return -1;
  return REAL(ftruncate64)(descriptor, size);
}
int ftruncate(int descriptor, off_t size) {
  const std::string path = shim().path_of(descriptor);
  if (shim().watches(path) && shim().fails("ftruncate", path)) return -1;
  return REAL(ftruncate)(descriptor, size);
}

int close(int descriptor) {
  const std::string path = shim().path_of(descriptor);
  if (!shim().watches(path)) return REAL(close)(descriptor);
  const bool fails = shim().fails("close", path);
  const int error = errno, result = REAL(close)(descriptor);
  if (fails) errno = error;
  return fails ? -1 : result;
}

int rename(const char* from, const char* to) {
  if (shim().watches(to)) {
    if (shim().fails("rename", to)) return -1;
    shim().renames(from, to);
  }
  return REAL(rename)(from, to);
}

size_t fwrite(const void* bytes, size_t size, size_t count, FILE* stream) {
  const std::string path = shim().path_of(fileno(stream));
  if (shim().watches(path) && shim().fails("fwrite", path)) return 0;
  return REAL(fwrite)(bytes, size, count, stream);
}

int fflush(FILE* stream) {
  const std::string path = stream ? shim().path_of(fileno(stream)) : "";
  if (!shim().watches(path)) return REAL(fflush)(stream);
  if (shim().fails("fflush", path)) return EOF;
  const int result = REAL(fflush)(stream);
  shim().written(fileno(stream));
  return result;
}

int fclose(FILE* stream) {
  const std::string path = shim().path_of(fileno(stream));
  const bool fails = shim().watches(path) && shim().fails("fclose", path);
  const int error = errno, result = REAL(fclose)(stream);
  if (fails) errno = error;
  return fails ? EOF : result;
}

FILE* fopen64(const char* path, const char* mode) {
  if (*mode != 'r' && shim().watches(path) && shim().fails("fopen", path)) return nullptr;
  return REAL(fopen64)(path, mode);
}
FILE* fopen(const char* path, const char* mode) {
  if (*mode != 'r' && shim().watches(path) && shim().fails("fopen", path)) return nullptr;
  return REAL(fopen)(path, mode);
}

}  // extern "C"
