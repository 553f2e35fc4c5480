// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A .vdb that is not one of our snapshots.
#pragma once

#include <filesystem>
#include <string>

namespace soilvdb::tools {

/// Its grids in words. Call it through read_in_child(). @throw io::InputError if it can't be read.
std::string foreign_vdb_text(const std::filesystem::path& file);

}  // namespace soilvdb::tools
