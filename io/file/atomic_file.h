// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// How every output file is written: whole or not at all.
#pragma once

#include <filesystem>
#include <string_view>

namespace soilvdb::inline v0::io {

/// @throw std::runtime_error always: `file` can't be written, for an `error` as errno has it.
[[noreturn]] void fail_to_write(const std::filesystem::path& file, int error);

/// Puts `bytes` into `file`: a temporary file in the same folder, every write checked, fsync,
/// read back and compared, rename over `file`, fsync of the folder. Whatever happens on the way,
/// `file` holds either what it held before or all of `bytes`; a temporary that couldn't be finished
/// is removed. Safe to call from several threads.
/// @throw std::runtime_error naming the file and the cause; also if `file` is there and isn't a
///        regular file (a folder, /dev/null).
void write_atomically(const std::filesystem::path& file, std::string_view bytes);

/// Syncs the folder of a file that was renamed, so that it is there under its name for good.
/// @throw std::runtime_error naming the file and the cause.
void sync_folder(const std::filesystem::path& file);

}  // namespace soilvdb::inline v0::io
