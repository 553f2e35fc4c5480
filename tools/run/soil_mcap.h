// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soil.mcap: ground and loads as they change, for Lichtblick and whatever else reads MCAP files.
#pragma once

#include <cstdint>
#include <filesystem>
#include <limits>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "io/mcap/mcap_writer.h"
#include "soilvdb/chunk_range.h"
#include "soilvdb/ground.h"
#include "soilvdb/mesher.h"
#include "tools/run/elevation_map.h"
#include "tools/run/snapshot_schedule.h"

namespace soilvdb::tools {

/// Topics, all of them in the frame `site`, metres:
/// - `/ground`, foxglove_msgs/msg/SceneUpdate: an entity of triangles for each block of 32^3
///   voxels; the same id replaces it;
/// - `/elevation`, grid_map_msgs/msg/GridMap with the layer `elevation`;
/// - `/load/MACHINE`, JSON: what a bucket holds, at most ten times a second;
/// - `/tf_static`, tf2_msgs/msg/TFMessage, once: where `site` is in `world`, so that numbers stay
///   small where the world's are large.
///
/// Times are those of the motions, from 0 to 2^31 s. What it writes hangs on what it is told only,
/// so a run has the same bytes for any number of threads, and dug again. What was flushed, or came
/// to a chunk, can be read whatever becomes of the process. All throw std::runtime_error naming the
/// file and the cause. For one thread.
class SoilMcap {
 public:
  struct Load {
    double bucket_m3 = 0, cut_m3 = 0;  ///< held, loose; cut so far, in place
    std::optional<double> bucket_kg = {};
  };

  /// Begins the file anew. All that there is of the ground counts as changed.
  /// @param ground outlives it
  /// @param machines their names
  /// @param end_s of a run: it is written to FILE.part, which close() renames to FILE; without
  ///        close() nothing is left, and a FILE that was there before stays. None: of a live site
  SoilMcap(std::filesystem::path file, const Ground& ground, const std::string& crs_wkt,
           const std::vector<std::string>& machines, double begin_s, std::optional<double> end_s);
  ~SoilMcap();
  SoilMcap(const SoilMcap&) = delete;
  SoilMcap& operator=(const SoilMcap&) = delete;

  /// Is the ground to be recorded, as it is twice a second? Of a run when all machines came to a
  /// time; of a live site by any clock, from when it is first asked.
  bool due(double time_s);
  bool would_be_due(double time_s) const { return schedule_.would_be_due(time_s); }

  void changed(std::span<const Coord3> chunks) { changed_.insert(chunks.begin(), chunks.end()); }
  /// Records what changed, and a map of the ground once a second.
  /// @param most chunks: others wait until it is their turn @return whether some do
  bool ground(double time_s, std::size_t most = std::numeric_limits<std::size_t>::max());
  /// Of those in one tenth of a second the first is written.
  void load(double time_s, std::size_t machine, const Load& load);

  void flush() { writer_.flush(); }
  /// Records all that isn't yet, and ends the file.
  void close(double time_s);

 private:
  struct Channel {
    std::uint16_t id = 0;
    std::string name;                    // of the machine, as JSON
    double written_s = 0, newest_s = 0;  // times of loads
    std::optional<Load> newest;          // that isn't written
    bool any = false;                    // one was written
  };
  void put_blocks(double time_s, std::span<const Coord3> blocks);
  void put_map(double time_s);
  void put(double time_s, Channel& channel, const Load& load);

  std::filesystem::path file_, part_;  // the same once it is closed, and of a live site
  io::McapWriter writer_;
  SnapshotSchedule schedule_, map_schedule_;
  bool map_due_ = false, asked_ = false;
  CachedMesher mesher_;
  ElevationMap map_;
  std::uint16_t ground_ = 0, elevation_ = 0;
  std::vector<Channel> loads_;
  std::set<Coord3, Before> changed_;      // chunks that aren't recorded
  Coord3 last_changed_ = Coord3::Zero();  // that was recorded
  std::vector<Coord3> not_in_map_;        // chunks that changed since the last one
  std::set<Coord3, Before> shown_;        // blocks that have an entity
};

}  // namespace soilvdb::tools
