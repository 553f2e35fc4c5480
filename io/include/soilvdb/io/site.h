// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Opens a site: a scenario's terrain as soil that is ready for digging.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "soilvdb/ground.h"
#include "soilvdb/io/scenario.h"

namespace soilvdb::inline v0::io {

/// A reference to a base surface, to find it again.
struct BaseReference {
  Terrain terrain;       ///< a level set may be a snapshot; absolute paths, links not resolved
  std::string checksum;  ///< of the file's size and a sample of its bytes; empty for a plane
};

/// A base surface and its coordinate system.
struct Base {
  std::shared_ptr<const InitialTerrain> surface;
  BaseReference reference;
  std::string crs_wkt;         ///< empty: unknown
  Eigen::AlignedBox2d bounds;  ///< area with heights, world; infinite for a plane
  /// If the surface is a snapshot's ground: the ground before digging.
  std::optional<BaseReference> beneath = {};
  std::vector<std::string> warnings = {};  ///< about heights that may be voids, a line each
};

/// Opens a terrain; a snapshot becomes the surface of its ground.
/// @throw InputError if the terrain is missing, is not a height raster, closed level set or
///        snapshot, or is in degrees or feet.
Base open_base(const Terrain& terrain);

/// The ground of a site, and the data that a snapshot stores with it.
struct Site {
  std::shared_ptr<Ground> ground;
  BaseReference reference;
  std::string crs_wkt;
  Eigen::AlignedBox2d bounds;
  std::optional<BaseReference> beneath = {};
  std::vector<std::string> warnings = {};  ///< of the terrain, if it was opened

  /// The ground before digging, beneath all snapshots that this ground was dug from.
  const BaseReference& undug() const { return beneath ? *beneath : reference; }
};

/// The same site before digging. @param site outlives the result, which shares its base surface
Site undug_site(const Site& site);

/// Opens a terrain as a new site.
/// @param near_m place where work begins, for the choice of the origin; default: the terrain's
///        middle
/// @throw InputError as open_base()
Site open_site(const Terrain& terrain, double voxel_size_m, const std::optional<Vec3>& near_m);

/// Opens a scenario's terrain at its voxel size, as a new site. Its origin is that of the lattice
/// near the first lip position or pour (soilvdb/lattice.h). A snapshot with such voxels keeps its
/// own origin.
/// @throw InputError also if no motion comes over the terrain, or if a mouth or a pour is
///        underground or lies where the terrain has no height.
///        the ground.
Site open_site(const Scenario& scenario);

}  // namespace soilvdb::inline v0::io
