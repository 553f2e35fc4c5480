// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/file/atomic_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <stdexcept>
#include <string>
#include <system_error>

#include "soilvdb/io/error.h"

namespace soilvdb::inline v0::io {
namespace {

/// Closes its descriptor and removes its temporary file in its destructor.
class Temporary {
 public:
  explicit Temporary(const std::filesystem::path& target) : target_(target) {
    static std::atomic<unsigned> counter{0};
    do {  // a crashed process with the same id may have left one
      path_ = target;
      path_.replace_filename("." + target.filename().string() + "." + std::to_string(::getpid()) +
                             "-" + std::to_string(counter++) + ".tmp");
      descriptor_ = ::open(path_.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    } while (descriptor_ < 0 && errno == EEXIST);
    if (descriptor_ < 0) fail_to_write(target, errno);
  }
  Temporary(const Temporary&) = delete;
  Temporary& operator=(const Temporary&) = delete;
  ~Temporary() {
    if (descriptor_ >= 0) ::close(descriptor_);
    if (!renamed_) ::unlink(path_.c_str());
  }

  void write(std::string_view bytes) {
    constexpr std::size_t kMost = std::size_t{1} << 30;  // write() takes less than 2 GiB at once
    while (!bytes.empty()) {
      const ssize_t n = ::write(descriptor_, bytes.data(), std::min(bytes.size(), kMost));
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) fail_to_write(target_, errno);
      bytes.remove_prefix(static_cast<std::size_t>(n));
    }
  }

  /// Compares the written bytes with the disk's, bypassing the cache where the system allows it.
  void verify(std::string_view bytes) {
    ::posix_fadvise(descriptor_, 0, 0, POSIX_FADV_DONTNEED);
    std::string block(std::min(bytes.size() + 1, std::size_t{1} << 20), '\0');
    for (off_t at = 0;;) {
      const ssize_t n = ::pread(descriptor_, block.data(), block.size(), at);
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) fail_to_write(target_, errno);
      const auto size = static_cast<std::size_t>(n);
      if (size > bytes.size() || bytes.substr(0, size) != std::string_view(block).substr(0, size) ||
          (size == 0 && !bytes.empty()))
        throw std::runtime_error(target_.string() +
                                 ": can't be written: what was read back is not what was written");
      if (size == 0) return;
      bytes.remove_prefix(size);
      at += n;
    }
  }

  void sync() {
    if (::fsync(descriptor_) != 0) fail_to_write(target_, errno);
  }

  void rename_to_target() {
    const int closed = ::close(descriptor_);
    descriptor_ = -1;
    if (closed != 0) fail_to_write(target_, errno);
    if (::rename(path_.c_str(), target_.c_str()) != 0) fail_to_write(target_, errno);
    renamed_ = true;
  }

 private:
  const std::filesystem::path& target_;
  std::filesystem::path path_;
  int descriptor_ = -1;
  bool renamed_ = false;
};

}  // namespace

void fail_to_write(const std::filesystem::path& file, int error) {
  const std::string why =
      file.string() + ": can't be written: " + std::generic_category().message(error);
  if (error == ENOSPC || error == EDQUOT) throw DiskFull(why);
  throw std::runtime_error(why);
}

void sync_folder(const std::filesystem::path& file) {
  const std::filesystem::path folder = file.has_parent_path() ? file.parent_path() : ".";
  const int descriptor = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor < 0) {
    if (errno == EACCES) return;  // a folder that is writable but not readable can't be synced
    fail_to_write(file, errno);
  }
  const int synced = ::fsync(descriptor), error = errno;
  ::close(descriptor);
  // Some network and FUSE file systems can't sync a folder; the file itself is safe.
  if (synced != 0 && error != EINVAL && error != ENOTSUP) fail_to_write(file, error);
}

void write_atomically(const std::filesystem::path& file, std::string_view bytes) {
  std::error_code none;
  // Follows a link, as a plain write does.
  std::filesystem::path target = file;
  if (std::filesystem::is_symlink(file, none)) {
    const std::filesystem::path named = std::filesystem::weakly_canonical(file, none);
    if (!none) target = named;
  }
  const auto status = std::filesystem::status(target, none);
  if (std::filesystem::is_directory(status)) fail_to_write(file, EISDIR);
  if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status)) {
    throw std::runtime_error(file.string() + ": can't be written: is not a regular file");
  }
  Temporary temporary(target);
  temporary.write(bytes);
  temporary.sync();
  temporary.verify(bytes);
  temporary.rename_to_target();
  sync_folder(target);
}

}  // namespace soilvdb::inline v0::io
