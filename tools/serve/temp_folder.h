// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A folder for files that are not kept.
#pragma once

#include <stdlib.h>

#include <filesystem>
#include <stdexcept>
#include <string>

namespace soilvdb::tools {

/// Removed by its destructor.
class TempFolder {
 public:
  /// @param use for the message @param name how the folder's begins
  explicit TempFolder(const std::string& use, const std::string& name = "soilvdb-") {
    const std::filesystem::path in = std::filesystem::temp_directory_path();
    std::string path = (in / (name + "XXXXXX")).string();
    if (mkdtemp(path.data()) == nullptr)
      throw std::runtime_error("no temporary folder for " + use + " can be made in " + in.string());
    path_ = path;
  }
  ~TempFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TempFolder(const TempFolder&) = delete;
  TempFolder& operator=(const TempFolder&) = delete;

  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace soilvdb::tools
