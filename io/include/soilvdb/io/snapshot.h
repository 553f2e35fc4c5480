// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Snapshots: the resident ground and all that a run needs to continue from it, as a plain .vdb.
//
// Grid `surface` (FloatGrid, level set) is the soil's surface for other programs. It has a leaf per
// resident chunk, and leaves where a cut's narrow band reaches beyond. Coordinates are relative to
// the site's origin. Metadata named soilvdb_* of the file and of `surface` describe the snapshot.
// After the last byte that OpenVDB reads come the samples (io/snapshot/snapshot_samples.h), the
// site's progress, a CRC-64 of all bytes before it, and the number of these bytes. Other programs
// ignore this part.
//
// An incremental snapshot holds only the chunks that changed since another snapshot in the same
// folder, which may be incremental, too. It names that snapshot with its checksum, and lists the
// chunks that are no longer resident. Its metadata are those of any snapshot, except that
// soilvdb_state_hash covers only its own chunks. read_snapshot() returns the whole ground.
//
// The same ground makes the same bytes. Damage is found before OpenVDB parses anything.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "soilvdb/io/checksum.h"
#include "soilvdb/io/site.h"

namespace soilvdb::inline v0::io {

/// Most incremental snapshots in a chain: readers refuse more. A larger limit lets one damaged file
/// cost more intervals of digging; a smaller one makes whole snapshots more frequent.
inline constexpr std::size_t kMaxChainLength = 64;

/// The snapshot that an incremental one continues.
struct SnapshotParent {
  std::string name;                  ///< a file in the same folder
  FileDigest digest;                 ///< of that file
  std::vector<Coord3> dropped = {};  ///< its chunks that are not resident any more
  /// As read: incremental snapshots from the whole one to this one, and the chunks that they hold
  /// or drop.
  std::size_t depth = 0, chunks = 0;
};

/// Data of a snapshot besides the ground.
struct SnapshotInfo {
  std::string scenario;
  double time_s = 0;
  double cut_m3 = 0, captured_m3 = 0, displaced_m3 = 0, dumped_m3 = 0;
  std::string tracker_state = {};  ///< Site::progress(), for a run that continues; may be empty
  std::optional<SnapshotParent> parent = {};  ///< empty: the snapshot is whole
};

/// The bytes of a snapshot.
/// @param site for an incremental snapshot: the site with only the chunks to store
/// @param ground for an incremental snapshot: the ground to make the surface of, which holds these
///        chunks and all that are resident within two chunks of them
std::string snapshot_bytes(const std::filesystem::path& file, const Site& site,
                           const SnapshotInfo& info, const Ground* ground = nullptr);

/// Writes a snapshot, atomically.
/// @param file its path; the base surface's path is relative to its folder
/// @throw std::runtime_error naming the file and the cause.
void write_snapshot(const std::filesystem::path& file, const Site& site, const SnapshotInfo& info);

/// Is this .vdb a soilvdb snapshot, damaged or not? Reads its first and last bytes. False if there
/// is no file.
bool is_snapshot(const std::filesystem::path& file);

/// The snapshot that this one continues, as stored in it; empty if this one is whole.
/// @throw InputError if it is damaged.
std::optional<SnapshotParent> read_snapshot_parent(const std::filesystem::path& file);

/// Opens a snapshot with its base surface and the snapshots that it continues. The soil has the
/// same bits as when it was written.
/// @throw InputError if it or a snapshot that it needs is damaged, missing or replaced, or if its
///        base surface is missing or has changed.
Site read_snapshot(const std::filesystem::path& file, SnapshotInfo* info = nullptr);

}  // namespace soilvdb::inline v0::io
