// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Ground and loads as MCAP, of a run and of a live site alike.
#pragma once

#include <filesystem>
#include <span>
#include <vector>

#include "soilvdb/mesher.h"
#include "tools/run/elevation_map.h"
#include "tools/run/soil_mcap.h"

namespace soilvdb::tools {

/// Meshes and maps what changed into a SoilMcap. All throw std::runtime_error naming the file and
/// the cause. For one thread.
class GroundMcap {
 public:
  /// Begins the file anew.
  /// @param soil outlives it; what of it was touched by now is to be written by blocks()
  GroundMcap(const std::filesystem::path& file, const SoilMcap::Site& site, const Soil& soil,
             double time_s);

  /// @param changed chunks since the last call
  void blocks(double time_s, std::span<const Coord3> changed);
  /// A map of the ground, if it has changed since the last one.
  void elevation(double time_s);
  void load(double time_s, std::size_t machine, const SoilMcap::Load& load) {
    mcap_.load(time_s, machine, load);
  }
  void flush() { mcap_.flush(); }
  /// Ends the file. Nothing may follow.
  void close() { mcap_.close(); }

 private:
  SoilMcap mcap_;
  CachedMesher mesher_;
  ElevationMap elevation_;
  std::vector<Coord3> not_in_map_;  // chunks that changed since the last one
};

}  // namespace soilvdb::tools
