// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Snapshots: the resident ground and what it takes to go on from it, as a plain .vdb.
//
// Grid `surface` (FloatGrid, level set) is the soil's phi, grid `samples` (Int64Grid) its samples,
// a leaf per resident chunk in each; coordinates are relative to the site's origin. Metadata of the
// file and of `surface`, all named soilvdb_*, hold the rest. After the last byte that OpenVDB reads
// come the tracker's state, a CRC-64 of all before and their number, which other programs don't
// see.
//
// The same ground makes the same bytes. Damage is found before OpenVDB parses anything.
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
  std::string tracker_state = {};  ///< Tracker::state(), for a run that goes on; may be empty
};

/// The bytes of a snapshot. Reads the site, whose phi must be up to date (Tracker::flush()).
std::string snapshot_bytes(const std::filesystem::path& file, const Site& site,
                           const SnapshotInfo& info);

/// Writes a snapshot, atomically.
/// @param file where it goes: it refers to its base surface relative to its own folder
/// @throw std::runtime_error naming the file and the cause.
void write_snapshot(const std::filesystem::path& file, const Site& site, const SnapshotInfo& info);

/// Is this .vdb one of ours, damaged or not? Reads its first and last bytes. False if there is
/// none.
bool is_snapshot(const std::filesystem::path& file);

/// Opens a snapshot, its base surface included. The soil has the same bits as the one written.
/// @throw InputError if it is damaged, or its base surface is missing or has changed.
Site read_snapshot(const std::filesystem::path& file, SnapshotInfo* info = nullptr);

}  // namespace soilvdb::io
