// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Reads .vdb files of other programs in a process of its own: damaged ones crash OpenVDB, and there
// a crash does no harm.
#pragma once

#include <filesystem>
#include <string>

namespace soilvdb::tools {

/// What to read a file for: what foreign_vdb_text() says of it, or whether it is a level set;
/// the name of a grid may follow that.
inline const std::string kText = "text", kLevelSet = "level-set:";

/// Starts this program again to read `file`, with limits on memory and time that its size sets.
/// @throw io::InputError as thrown by what reads it, or saying that `file` is damaged if that
///        crashed, ran out of memory or time, or threw anything else.
std::string read_in_child(const std::string& what, const std::filesystem::path& file);

/// What that does: `soilvdb --in-child WHAT FILE`.
inline constexpr const char* kInChild = "--in-child";
[[noreturn]] void child_main(const std::string& what, const std::filesystem::path& file);

}  // namespace soilvdb::tools
