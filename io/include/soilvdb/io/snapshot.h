// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Snapshots: the resident ground and what it takes to go on from it, as a plain .vdb.
//
// Grid `surface` (FloatGrid, level set) is the soil's surface for other programs, a leaf per
// resident chunk and where a cut's band reaches beyond; coordinates are relative to the site's
// origin. Metadata of the file and of `surface`, all named soilvdb_*, hold what is to be known of
// it. After the last byte that OpenVDB reads come the samples (io/snapshot/snapshot_samples.h), the
// tracker's state, a CRC-64 of all before and their number, which other programs don't see.
//
// An incremental snapshot holds only the chunks that changed since another one in the same folder,
// which it names with its checksum; that may be incremental, too. It lists the chunks that are no
// longer resident. Its metadata are those of any snapshot, but soilvdb_state_hash is of the chunks
// it holds. Whoever reads it here gets the whole ground.
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

/// Most incremental snapshots that follow on each other: a reader refuses more.
inline constexpr std::size_t kMaxChainLength = 64;

/// What an incremental snapshot goes on from.
struct SnapshotParent {
  std::string name;                  ///< of a file in the same folder
  FileDigest digest;                 ///< of that file
  std::vector<Coord3> dropped = {};  ///< chunks of it that are not resident any more
  /// As read: incremental ones from a whole one to this, and the chunks that they hold and drop.
  std::size_t depth = 0, chunks = 0;
};

/// What a snapshot says beside the ground itself.
struct SnapshotInfo {
  std::string scenario;
  double time_s = 0;
  double cut_m3 = 0, captured_m3 = 0, displaced_m3 = 0, dumped_m3 = 0;
  std::string tracker_state = {};  ///< Tracker::state(), for a run that goes on; may be empty
  std::optional<SnapshotParent> parent = {};  ///< else it is whole
};

/// The bytes of a snapshot. Reads the site.
/// @param site for an incremental snapshot: with only the chunks that it is to hold
/// @param ground of which the surface is made where that isn't all there is of it: these chunks and
///        what is resident within two chunks of them
std::string snapshot_bytes(const std::filesystem::path& file, const Site& site,
                           const SnapshotInfo& info, const Ground* ground = nullptr);

/// Writes a snapshot, atomically.
/// @param file where it goes: it refers to its base surface relative to its own folder
/// @throw std::runtime_error naming the file and the cause.
void write_snapshot(const std::filesystem::path& file, const Site& site, const SnapshotInfo& info);

/// Is this .vdb one of ours, damaged or not? Reads its first and last bytes. False if there is
/// none.
bool is_snapshot(const std::filesystem::path& file);

/// What a snapshot goes on from, as it says itself; nothing if it is whole.
/// @throw InputError if it is damaged.
std::optional<SnapshotParent> read_snapshot_parent(const std::filesystem::path& file);

/// Opens a snapshot, its base surface and what it goes on from included. The soil has the same bits
/// as the one written.
/// @throw InputError if it or a snapshot that it needs is damaged, missing or another one, or if
///        its base surface is missing or has changed.
Site read_snapshot(const std::filesystem::path& file, SnapshotInfo* info = nullptr);

}  // namespace soilvdb::inline v0::io
