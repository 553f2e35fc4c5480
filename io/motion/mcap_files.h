// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The files of a recording.
#pragma once

#include <filesystem>
#include <vector>

namespace soilvdb::inline v0::io {

/// The file itself, or the .mcap files of a folder, by name.
/// @throw InputError if it does not exist, has no such file, or is a recording in sqlite3
std::vector<std::filesystem::path> mcap_files(const std::filesystem::path& path);

/// @throw InputError with the conversion's command, if it is a file or folder of a recording in
///        sqlite3
void refuse_sqlite(const std::filesystem::path& path);

}  // namespace soilvdb::inline v0::io
