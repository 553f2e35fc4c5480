// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Opens a site: the terrain a scenario names, as soil that is ready to be dug.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "soilvdb/ground.h"
#include "soilvdb/io/scenario.h"

namespace soilvdb::inline v0::io {

/// How to find a base surface again.
struct BaseReference {
  Terrain terrain;       ///< a level set may be a snapshot; paths absolute, links not followed
  std::string checksum;  ///< of the file's size and a sample of its bytes; empty for a plane
};

/// A base surface, and the coordinate system it came with.
struct Base {
  std::shared_ptr<const InitialTerrain> surface;
  BaseReference reference;
  std::string crs_wkt;         ///< empty: not known
  Eigen::AlignedBox2d bounds;  ///< where it is known, world; infinite for a plane
  /// Where it is a snapshot's ground, what that was before anyone dug.
  std::optional<BaseReference> beneath = {};
  std::vector<std::string> warnings = {};  ///< of heights that may be none, each a line
};

/// Opens a terrain; a snapshot as the surface of its ground.
/// @throw InputError if the terrain can't be used: missing, not a height raster, closed level set
/// or
///        snapshot, in degrees or feet.
Base open_base(const Terrain& terrain);

/// The ground of a site, and what goes with it into a snapshot.
struct Site {
  std::shared_ptr<Ground> ground;
  BaseReference reference;
  std::string crs_wkt;
  Eigen::AlignedBox2d bounds;
  std::optional<BaseReference> beneath = {};
  std::vector<std::string> warnings = {};  ///< of the terrain, where it was opened

  /// The ground before anyone dug, beneath all snapshots that one was dug from.
  const BaseReference& undug() const { return beneath ? *beneath : reference; }
};

/// The same site as if nobody had dug there. @param site outlives it: the base surface is its
Site undug_site(const Site& site);

/// Opens a terrain as a site nobody works on yet. @param near_m where work begins, which says the
/// origin; without, it is near the terrain's middle
/// @throw InputError as open_base()
Site open_site(const Terrain& terrain, double voxel_size_m, const std::optional<Vec3>& near_m);

/// Opens a scenario's terrain at its voxel size: a new site, its origin that of the lattice near
/// the first lip position, or pour (soilvdb/lattice.h), or the one a snapshot with such voxels
/// holds.
/// @throw InputError also where no machine's motion comes over the terrain, or a mouth goes below
///        the ground's height around it where the terrain has none, or a pour begins there or in
///        the ground.
Site open_site(const Scenario& scenario);

}  // namespace soilvdb::inline v0::io
