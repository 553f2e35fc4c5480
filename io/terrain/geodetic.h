// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Latitudes, longitudes and heights of satellite receivers in a site's coordinates, by PROJ.
#pragma once

#include <memory>
#include <string>

#include "soilvdb/gnss.h"

namespace soilvdb::inline v0::io {

/// Largest distance of a geoid from its ellipsoid, m; on Earth it is half of that.
inline constexpr double kMostUndulation_m = 200;

/// A place by a receiver.
struct GeodeticPlace {
  double latitude = 0, longitude = 0;  ///< degrees
  double height_m = 0;                 ///< above the ellipsoid
};

/// The way from a receiver's CRS to a site's. Each antenna is projected by itself, so directions
/// between them are those of the site's grid. One thread at a time may use it.
class Geodetic {
 public:
  /// @param site_wkt CRS of the terrain; empty: none
  /// @param bounds area of the site, world; empty or infinite: unknown
  /// @throw std::invalid_argument with one line if PROJ doesn't know the best way for this area
  ///        with all that it needs: a grid that is not installed is named, and no guess is made
  Geodetic(const Gnss& gnss, const std::string& site_wkt, const Eigen::AlignedBox2d& bounds);
  ~Geodetic();
  Geodetic(Geodetic&&) noexcept;
  Geodetic& operator=(Geodetic&&) noexcept;

  /// World. @throw std::invalid_argument with one line, beyond ranges and grids
  Vec3 in_site(const GeodeticPlace& place) const;
  /// A warning if the way is known less well than receivers measure; else empty.
  const std::string& doubt() const;

 private:
  struct Way;
  std::unique_ptr<Way> way_;
};

}  // namespace soilvdb::inline v0::io
