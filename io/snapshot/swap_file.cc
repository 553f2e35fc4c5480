// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/snapshot/swap_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <limits>
#include <stdexcept>

#include "soilvdb/io/checksum.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::size_t kUnit = 64;  // bytes; a record's number is its first unit

/// Precedes a record's bytes in the file.
struct Head {
  std::uint64_t crc;  ///< of the other fields and the bytes
  std::uint32_t number, size;
};

std::size_t units(std::size_t size) { return (sizeof(Head) + size + kUnit - 1) / kUnit; }

std::uint64_t checksum(std::string_view record) { return crc64(record.substr(sizeof(Head::crc))); }

}  // namespace

SwapFile::SwapFile(const std::filesystem::path& folder) : folder_(folder) {
  descriptor_ = ::open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
  if (descriptor_ < 0) {  // O_TMPFILE is not supported by all file systems
    std::string name = (folder / "cold.XXXXXX").string();
    descriptor_ = ::mkostemp(name.data(), O_CLOEXEC);
    if (descriptor_ >= 0) ::unlink(name.c_str());
  }
  if (descriptor_ < 0)
    throw std::runtime_error(fmt::format("{}: no file can be made in it for cold ground ({})",
                                         folder.string(), std::strerror(errno)));
}

SwapFile::~SwapFile() { ::close(descriptor_); }

std::uint32_t SwapFile::put(std::string_view bytes) {
  const std::size_t length = units(bytes.size());
  std::uint32_t number = 0;
  {
    const std::lock_guard lock(mutex_);
    if (gaps_.size() <= length) gaps_.resize(length + 1);
    if (!gaps_[length].empty()) {
      number = gaps_[length].back();
      gaps_[length].pop_back();
    } else if (length < std::numeric_limits<std::uint32_t>::max() - end_) {
      number = end_;
      end_ += static_cast<std::uint32_t>(length);
    } else {
      throw std::runtime_error(folder_.string() + ": its file of cold ground is full");
    }
  }
  const Head head{0, number, static_cast<std::uint32_t>(bytes.size())};
  std::string record(reinterpret_cast<const char*>(&head), sizeof(head));
  record += bytes;
  const std::uint64_t crc = checksum(record);
  std::memcpy(record.data(), &crc, sizeof(crc));
  for (std::size_t done = 0; done < record.size();) {
    const ssize_t n = ::pwrite(descriptor_, record.data() + done, record.size() - done,
                               static_cast<off_t>(number * kUnit + done));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) {
      const int why = errno;
      drop(number, bytes.size());
      throw std::runtime_error(fmt::format("{}: cold ground can't be written to a file there ({})",
                                           folder_.string(), std::strerror(n < 0 ? why : ENOSPC)));
    }
    done += static_cast<std::size_t>(n);
  }
  return number;
}

void SwapFile::get(std::uint32_t number, std::string& bytes) const {
  constexpr std::size_t kUsual = 2048;  // most records fit into one read
  bytes.resize(kUsual);
  std::size_t have = 0;
  Head head{};
  const auto read_to = [&](std::size_t size) {
    while (have < size) {
      const ssize_t n = ::pread(descriptor_, bytes.data() + have, bytes.size() - have,
                                static_cast<off_t>(number * kUnit + have));
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0) return false;
      have += static_cast<std::size_t>(n);
    }
    return true;
  };
  bool good = read_to(sizeof(head));
  if (good) {
    std::memcpy(&head, bytes.data(), sizeof(head));
    constexpr std::size_t kMost = 1 << 20;
    good = head.number == number && head.size < kMost;
  }
  if (good) {
    const std::size_t size = sizeof(head) + head.size;
    if (size > bytes.size()) bytes.resize(size);
    good = read_to(size);
    bytes.resize(size);
  }
  if (!good || checksum(bytes) != head.crc)
    throw std::runtime_error(folder_.string() +
                             ": the file of cold ground there is damaged or can't be read");
  bytes.erase(0, sizeof(head));
}

void SwapFile::drop(std::uint32_t number, std::size_t size) {
  const std::lock_guard lock(mutex_);
  gaps_[units(size)].push_back(number);
}

std::uint64_t SwapFile::size_bytes() const {
  const std::lock_guard lock(mutex_);
  return end_ * kUnit;
}

}  // namespace soilvdb::inline v0::io
