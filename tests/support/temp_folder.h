// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A folder for one test, gone when it ends, and what a reader says about a file in it.
#pragma once

#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <system_error>

namespace soilvdb::test {

/// TMPDIR, else memory where there is room: programs that sync wait for disks most of their time.
inline std::filesystem::path scratch() {
  constexpr std::uintmax_t kRoom = std::uintmax_t{4} << 30;
  const std::filesystem::path memory = "/dev/shm";
  std::error_code missing;
  const std::filesystem::space_info space = std::filesystem::space(memory, missing);
  if (std::getenv("TMPDIR") == nullptr && !missing && space.available > kRoom &&
      access(memory.c_str(), W_OK) == 0)
    return memory;
  return std::filesystem::temp_directory_path();
}

class TempFolder {
 public:
  TempFolder() {
    std::string name = (scratch() / "soilvdb_XXXXXX").string();
    if (!mkdtemp(name.data())) throw std::runtime_error("can't make a folder like " + name);
    path_ = name;
  }
  ~TempFolder() { std::filesystem::remove_all(path_); }
  TempFolder(const TempFolder&) = delete;
  TempFolder& operator=(const TempFolder&) = delete;

  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }
  const std::filesystem::path& path() const { return path_; }

  std::filesystem::path write(const std::string& name, std::string_view content) const {
    std::ofstream(path_ / name, std::ios::binary) << content;
    return path_ / name;
  }

 private:
  std::filesystem::path path_;
};

/// The message `f` throws, without the folder's name; "nothing thrown" if it doesn't.
template <typename F>
std::string message_of(const TempFolder& folder, F&& f) {
  try {
    f();
  } catch (const std::exception& e) {
    std::string message = e.what();
    const std::string prefix = folder.path().string() + "/";
    for (auto at = message.find(prefix); at != message.npos; at = message.find(prefix)) {
      message.erase(at, prefix.size());
    }
    return message;
  }
  return "nothing thrown";
}

}  // namespace soilvdb::test
