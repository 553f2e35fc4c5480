// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Which files a recording has.
#pragma once

#include <filesystem>
#include <vector>

namespace soilvdb::inline v0::io {

/// A file by itself; of a folder its .mcap files, by their names.
/// @throw InputError if it isn't there, has none, or is a recording in sqlite3
std::vector<std::filesystem::path> mcap_files(const std::filesystem::path& path);

/// @throw InputError if it is a file or folder of a recording in sqlite3, saying how to convert it
void refuse_sqlite(const std::filesystem::path& path);

}  // namespace soilvdb::inline v0::io
