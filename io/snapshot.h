// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Snapshots: the resident ground and what it takes to go on from it, as a plain .vdb.
#pragma once

#include <filesystem>
#include <string>

#include "io/site.h"

namespace soilvdb::io {

/// What a snapshot says beside the ground itself.
struct SnapshotInfo {
  std::string scenario;
  double time_s = 0;
  double cut_m3 = 0, captured_m3 = 0, displaced_m3 = 0, dumped_m3 = 0;
};

/// Writes grid `surface` (FloatGrid, level set) and grid `samples` (Int64Grid), with the site's
/// origin, CRS, base surface, time and volumes as metadata. Atomic: a temporary file in the same
/// folder, checked stream, fsync, rename, fsync of the folder.
/// @throw std::runtime_error naming the file and the cause.
void write_snapshot(const std::filesystem::path& file, const Site& site, const SnapshotInfo& info);

/// Is this .vdb one of ours (has what read_snapshot needs)?
bool is_snapshot(const std::filesystem::path& file);

/// Opens a snapshot, its base surface included. The soil has the same bits as the one written.
/// @throw InputError if it is damaged, or its base surface is missing or has changed.
Site read_snapshot(const std::filesystem::path& file, SnapshotInfo* info = nullptr);

}  // namespace soilvdb::io
