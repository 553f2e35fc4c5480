// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What is in a .vdb that is not one of our snapshots.
#pragma once

#include <filesystem>

namespace soilvdb::tools {

/// Prints its grids. @throw io::InputError if it can't be read.
void info_foreign_vdb(const std::filesystem::path& file);

}  // namespace soilvdb::tools
