// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soil.mcap: ground and loads as they change, for Lichtblick and whatever else reads MCAP files.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "io/mcap/mcap_writer.h"
#include "soilvdb/ground_service.h"
#include "soilvdb/soil.h"
#include "tools/run/elevation_map.h"

namespace soilvdb::tools {

/// Topics, all of them in the frame `site`, metres:
/// - `/ground`, foxglove_msgs/msg/SceneUpdate: an entity of triangles for each block of 32^3
/// voxels;
///   the same id replaces it;
/// - `/elevation`, grid_map_msgs/msg/GridMap with the layer `elevation`;
/// - `/load/MACHINE`, JSON: what a bucket holds, at most ten times a second;
/// - `/tf_static`, tf2_msgs/msg/TFMessage, once: where `site` is in `world`, so that numbers stay
///   small where the world's are large.
///
/// Times are those of the motions, from 0 to 2^31 s. What was flushed, or came to a chunk, can be
/// read whatever becomes of the process. All throw std::runtime_error naming the file and the
/// cause. For one thread.
class SoilMcap {
 public:
  struct Site {
    Vec3 origin = Vec3::Zero();  ///< Soil::origin()
    double voxel_size_m = 0;
    std::string crs_wkt = {};
    std::vector<std::string> machines = {};
  };
  struct Load {
    double bucket_m3 = 0, cut_m3 = 0;  ///< held, loose; cut so far, in place
    std::optional<double> bucket_kg = {};
  };

  /// Begins the file anew. @param time_s of its beginning
  SoilMcap(const std::filesystem::path& file, const Site& site, double time_s);

  /// Patches of blocks in place of those before; an empty one goes.
  void blocks(double time_s, std::span<const GroundService::Patch> patches);
  void elevation(double time_s, const ElevationMap& map);
  /// Of those in one tenth of a second the first is written.
  void load(double time_s, std::size_t machine, const Load& load);

  void flush() { writer_.flush(); }
  /// Writes the last loads and ends the file.
  void close();

 private:
  struct Channel {
    std::uint16_t id = 0;
    std::string name;                    // of the machine, as JSON
    double written_s = 0, newest_s = 0;  // times of loads
    std::optional<Load> newest;          // that isn't written
    bool any = false;                    // one was written
  };
  void put(double time_s, Channel& channel, const Load& load);

  io::McapWriter writer_;
  std::uint16_t ground_ = 0, elevation_ = 0;
  std::vector<Channel> loads_;
  std::set<Coord3, Before> shown_;  // blocks that have an entity
};

}  // namespace soilvdb::tools
