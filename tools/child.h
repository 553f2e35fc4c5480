// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Reads files that a library may crash on in a child process, where a crash does no harm.
#pragma once

#include <filesystem>
#include <functional>
#include <string>

namespace soilvdb::tools {

/// What `read` returns, called in a child process with limits on memory and time that the size of
/// `file` sets. Call it before any thread is started.
/// @throw io::InputError as thrown by `read`, or saying that `file` is damaged if it crashed, ran
///        out of memory or time, or threw anything else.
std::string in_child(const std::filesystem::path& file, const std::function<std::string()>& read);

}  // namespace soilvdb::tools
