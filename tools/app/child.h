// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Reads .vdb files of other programs in a child process, because damaged files crash OpenVDB.
#pragma once

#include <filesystem>
#include <string>

namespace soilvdb::tools {

/// Purposes of reading a file: foreign_vdb_text(), or a check that it is a level set. The name of a
/// grid may follow kLevelSet.
inline const std::string kText = "text", kLevelSet = "level-set:";

/// Starts this program again to read `file`, with limits of memory and time by the file's size.
/// @throw io::InputError of the reader; or one about a damaged file, if the child crashed, exceeded
///        its memory or time, or threw anything else.
std::string read_in_child(const std::string& what, const std::filesystem::path& file);

/// Option of the child: `soilvdb --in-child WHAT FILE`.
inline constexpr const char* kInChild = "--in-child";
[[noreturn]] void child_main(const std::string& what, const std::filesystem::path& file);

}  // namespace soilvdb::tools
