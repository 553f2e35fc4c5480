// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Real data that lies beside the repository, where it is there.
#pragma once

#include <cstdlib>
#include <filesystem>
#include <string>

namespace soilvdb::io {

inline std::filesystem::path shared(const std::string& name) {
  const char* folder = std::getenv("SOILVDB_SHARED");
  return (folder != nullptr ? std::filesystem::path(folder)
                            : std::filesystem::path(SOILVDB_SOURCE_DIR) / ".." / "shared") /
         "data" / name;
}

}  // namespace soilvdb::io
