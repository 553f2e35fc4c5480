// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soil.mcap: changes of ground and loads, for Lichtblick and other readers of MCAP.
#pragma once

#include <array>
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
#include "soilvdb/types.h"
#include "tools/run/elevation_map.h"
#include "tools/run/snapshot_schedule.h"

namespace soilvdb::tools {

/// Topics, in the frame `site` but for the last three, metres:
/// - `/ground`, foxglove_msgs/msg/SceneUpdate: an entity of triangles for each block of 32^3
///   voxels; the same id replaces it;
/// - `/elevation`, grid_map_msgs/msg/GridMap with the layer `elevation`;
/// - `/load/MACHINE`, JSON: load of a bucket, at most ten times a second;
/// - `/MACHINE/soil_wrench`, geometry_msgs/msg/WrenchStamped in the frame `MACHINE_bucket`: the
///   force of the soil on a bucket after each update, if that is recorded;
/// - `/tf`, tf2_msgs/msg/TFMessage, with each of them: `MACHINE_bucket` in `world`;
/// - `/tf_static`, tf2_msgs/msg/TFMessage, once: `site` in `world`, so that coordinates stay small.
///
/// Times are those of the motions, from 0 to 2^31 s. The output depends only on the calls, so a run
/// writes the same bytes for any number of threads, also when it is dug again. Flushed messages and
/// complete chunks survive a crash. All members throw std::runtime_error naming the file and the
/// cause. Not thread-safe.
class SoilMcap {
 public:
  struct Load {
    double bucket_m3 = 0, cut_m3 = 0;  ///< loose load; in-place cut so far
    std::optional<double> bucket_kg = {};
  };

  /// Begins a new file. At first all ground counts as changed.
  /// @param ground must outlive it
  /// @param machines names
  /// @param end_s end of a run, which is written to FILE.part; close() renames it to FILE, and
  ///        without close() FILE.part is removed and an older FILE stays. Empty: a live site
  /// @param forces are forces recorded?
  SoilMcap(std::filesystem::path file, const Ground& ground, const std::string& crs_wkt,
           const std::vector<std::string>& machines, double begin_s, std::optional<double> end_s,
           bool forces = false);
  ~SoilMcap();
  SoilMcap(const SoilMcap&) = delete;
  SoilMcap& operator=(const SoilMcap&) = delete;

  /// Is the ground due, twice a second? For a run: when all machines reached `time_s`. For a live
  /// site: by any clock, from the first call on.
  bool due(double time_s);
  bool would_be_due(double time_s) const { return schedule_.would_be_due(time_s); }

  void changed(std::span<const Coord3> chunks) { changed_.insert(chunks.begin(), chunks.end()); }
  /// Records changes, and once a second a map of the ground.
  /// @param most number of chunks per call @return whether chunks are left
  bool ground(double time_s, std::size_t most = std::numeric_limits<std::size_t>::max());
  /// Records the first load in each tenth of a second.
  void load(double time_s, std::size_t machine, const Load& load);
  /// @param force and moment in the bucket's frame at the middle of the lip, N and N m
  void wrench(double time_s, std::size_t machine, const Pose& world_from_bucket,
              const std::array<double, 6>& force);

  void flush() { writer_.flush(); }
  /// Records the rest, and ends the file.
  void close(double time_s);

 private:
  struct Channel {
    std::uint16_t id = 0, wrenches = 0;
    std::string name;                    // of the machine, as JSON
    std::string frame;                   // of its bucket
    double written_s = 0, newest_s = 0;  // times of loads
    std::optional<Load> newest;          // not written yet
    bool any = false;                    // a load was written
  };
  void put_blocks(double time_s, std::span<const Coord3> blocks);
  void put_map(double time_s);
  void put(double time_s, Channel& channel, const Load& load);

  std::filesystem::path file_, part_;  // equal after close(), and for a live site
  io::McapWriter writer_;
  SnapshotSchedule schedule_, map_schedule_;
  bool map_due_ = false, asked_ = false;
  CachedMesher mesher_;
  ElevationMap map_;
  std::uint16_t ground_ = 0, elevation_ = 0, places_ = 0;
  std::vector<Channel> loads_;
  std::set<Coord3, Before> changed_;      // chunks to record
  Coord3 last_changed_ = Coord3::Zero();  // last recorded chunk
  std::vector<Coord3> not_in_map_;        // chunks that changed since the last map
  std::set<Coord3, Before> shown_;        // blocks with an entity
};

}  // namespace soilvdb::tools
