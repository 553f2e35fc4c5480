// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A surface of a file that may hold several: "site.xml#Base course".
#pragma once

#include <filesystem>
#include <string>

namespace soilvdb::inline v0::io {

struct FilePart {
  std::filesystem::path file;
  std::string part;  ///< empty: not named
};

/// Splits a path at the '#' after a suffix of files with surfaces, unless there is such a file.
FilePart file_part(const std::filesystem::path& path);

/// Does the path name a file with surfaces of triangles, by its suffix?
bool is_tin(const std::filesystem::path& path);

}  // namespace soilvdb::inline v0::io
