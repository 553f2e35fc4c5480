// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Writes output files: completely or not at all.
#pragma once

#include <filesystem>
#include <string_view>

namespace soilvdb::inline v0::io {

/// @throw std::runtime_error always: `file` can't be written, because of the errno `error`;
///        DiskFull if that says so.
[[noreturn]] void fail_to_write(const std::filesystem::path& file, int error);

/// Writes `bytes` to `file`: a temporary file in the same folder, each write checked, fsync, read
/// back and compared, rename over `file`, fsync of the folder. After any failure `file` holds its
/// old content or all of `bytes`, and the temporary is removed. Thread-safe.
/// @throw std::runtime_error naming the file and the cause; also if `file` exists and is not a
///        regular file (a folder, /dev/null).
void write_atomically(const std::filesystem::path& file, std::string_view bytes);

/// Syncs the folder of a renamed file, so that the new name survives a crash.
/// @throw std::runtime_error naming the file and the cause.
void sync_folder(const std::filesystem::path& file);

}  // namespace soilvdb::inline v0::io
