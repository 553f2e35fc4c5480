// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// .vdb files that are not snapshots of soilvdb.
#pragma once

#include <filesystem>
#include <string>

namespace soilvdb::tools {

/// A description of its grids. Call it through read_in_child(). @throw io::InputError if the file
/// can't be read.
std::string foreign_vdb_text(const std::filesystem::path& file);

}  // namespace soilvdb::tools
