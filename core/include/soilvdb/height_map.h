// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Heights of the ground straight from its samples, for who looks at it after every update.
#pragma once

#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "soilvdb/change_follower.h"
#include "soilvdb/ground.h"

namespace soilvdb::inline v0 {

class HeightReader;  // core/surface/height_reader.h

/// Square cells in plan. Cell (i, j) is row i, column j; a map has it at i * nx + j.
struct MapGrid {
  Vec2 first_m = {0, 0};  ///< middle of cell (0, 0), world
  double cell_m = 0;      ///< side of a cell
  int nx = 0, ny = 0;     ///< cells along x and along y
  Vec2 along = {1, 0};    ///< x axis of the map in the world, of unit length; y is to its left

  /// Around a place. @param turn a pose whose lip is the map's y axis; null: axes of the world
  static MapGrid around(const Vec2& middle_m, double cell_m, int nx, int ny,
                        const Pose* turn = nullptr);
  Vec2 middle_m(int i, int j) const;  ///< of a cell, world
};

/// What a map tells, m.
enum class MapLayer {
  kHeight,  ///< of the soil, world z
  kLoose,   ///< depth of the loose soil on the bank
  kDug,     ///< depth below the initial terrain; negative: higher
  kDesign   ///< height above a design: what is to be cut; negative: to be filled
};

/// Result of a look at the ground. Unless it is ok(), all that was asked for is NaN.
struct [[nodiscard]] LookResult {
  enum class Fault {
    kNone,
    kBadRequest,  ///< there is no answer: `why` says what would be right
    kFailed       ///< no memory, or a file of the terrain or of a memory limit can't be read
  };
  Fault fault = Fault::kNone;
  std::string why = {};  ///< one line, unless it is ok()
  bool ok() const { return fault == Fault::kNone; }
  /// For programs with exceptions. @throw std::invalid_argument for a bad request,
  /// std::runtime_error if it failed
  void check() const;
  /// That of a call, whose exception is the fault. @param out is NaN then
  template <typename F, typename T = double>
  static LookResult of(const F& look, std::span<T> out = {}) noexcept {
    try {
      look();
      return {};
    } catch (...) {
      for (T& value : out) value = std::numeric_limits<T>::quiet_NaN();
      return of_exception();
    }
  }

 private:
  static LookResult of_exception() noexcept;
};

/// Heights of a ground by counts of its samples. No surface is made.
///
/// A column of voxels has the mean height of its topmost soil: what lies above the topmost voxel
/// that is full of bank soil counts with its volume, and what is missing in the 32 voxels below
/// that as well. So sums over columns are volumes to the last sample. Not so under a roof, which is
/// bank soil over a voxel without any, or over voxels that together miss more than one: only what
/// is above its topmost full voxel counts. Pieces of soil in the air count.
///
/// Heights are kept by tiles of 8 x 8 columns until the ground changes there: looking costs some
/// nanoseconds a column, and some microseconds for each tile that changed since. The first look
/// costs each tile 10 to 30 us. Updates do not depend on it. Not for several threads; but those of
/// clones may be used at once.
///
/// Looks do not throw. They get memory where ground is looked at for the first time, and for the
/// first map of a size, or the first look at so many places. Later looks there get none, whatever
/// has changed: of 4096 places at most, in planes, rasters and level sets without a memory limit.
/// prepare() gets it for a whole area.
class HeightMap {
 public:
  /// @param ground must outlive it
  explicit HeightMap(Ground& ground);
  /// @param other of a ground with the same initial terrain, as of a clone. It shares what the
  /// other knows of that.
  HeightMap(Ground& ground, const HeightMap& other);
  HeightMap(HeightMap&&) noexcept;
  HeightMap& operator=(HeightMap&&) noexcept;
  ~HeightMap();

  /// Reads an area, so that looks there are not the first. It stays known until some 8192 tiles
  /// were looked at.
  /// @return a fault for an area of more than 8192 tiles, or farther than 2^23 voxels from the
  ///         site's origin
  LookResult prepare(const Eigen::AlignedBox2d& area_m) noexcept;

  /// The mean of a layer over each cell; NaN where no column has ground, else over those that have.
  /// Exact if the grid's axes are the world's or a quarter turn from them. In another grid it is
  /// that of points a voxel apart or closer, linear between the middles of columns.
  /// @param out grid.nx * grid.ny values
  /// @param ceiling_m only soil below is looked at, to the voxel; then nothing is kept, so that
  ///        each look costs as much as the first; unset: all
  /// @param design for MapLayer::kDesign; a column without a height of it does not count
  /// @return a fault for a bad grid, or without the design
  LookResult map(const MapGrid& grid, MapLayer layer, std::span<double> out,
                 std::optional<double> ceiling_m = {},
                 const InitialTerrain* design = nullptr) noexcept;
  LookResult map(const MapGrid& grid, MapLayer layer, std::span<float> out,
                 std::optional<double> ceiling_m = {},
                 const InitialTerrain* design = nullptr) noexcept;

  /// The surface at points: the initial terrain where all four columns around are as it was, else
  /// linear between their middles. Columns without ground do not count; NaN where the nearest has
  /// none. On even cuts it errs by some hundredths of a voxel, beside a wall by as much as that is
  /// high.
  /// @param ceiling_m as of map(): all soil above is air
  LookResult at(std::span<const Vec2> xy_m, std::span<double> heights_m,
                std::optional<double> ceiling_m = {}) noexcept;

  /// Heights along parallel lines, linear between the middles of columns; columns that are as the
  /// terrain was have its height at their middle. NaN without ground.
  /// @param first_m first point of the first line; from one to the next point by `along_m`, from
  ///        one to the next line by `across_m`
  /// @param heights_m count * lines values, line by line
  /// @throw std::invalid_argument for points farther than 2^23 voxels from the site's origin
  void lines(const Vec2& first_m, const Vec2& along_m, int count, const Vec2& across_m, int lines,
             std::span<double> heights_m);

  /// Distances along rays to the surface of at(), m: 0 if a ray begins below it, infinity if it
  /// meets none. A ray stops at the upright face of a step in that surface. It passes columns
  /// without ground, and holes of the terrain that are narrower than a voxel.
  ///
  /// Planes and rasters are found at any distance, also beyond 2^23 voxels from the site's origin,
  /// where nothing is dug. Other terrains are searched up to 2^24 voxels along a ray, which may
  /// miss what it is in for less than a quarter voxel; roofs stop it from above, and from below
  /// where it comes near soil. That takes a ray some 0.1 ms, else it takes tenths of a microsecond.
  ///
  /// Rays run on the threads of the caller's arena, with the same bits on any number of threads.
  /// Where they first come to changed ground they read 64 x 64 columns, in up to some milliseconds.
  /// These take 80 kB until the ground changes there: rays get memory also on prepared ground.
  /// @param origins_m one for each ray, or one for all
  /// @param directions of any length
  /// @param ranges_m one for each direction
  /// @return a fault for a ray whose origin or direction isn't finite or whose direction is zero,
  ///         with its number, and for sizes that don't fit
  LookResult cast(std::span<const Vec3> origins_m, std::span<const Vec3> directions,
                  std::span<double> ranges_m) noexcept;

  /// What it knows, for others of the engine that look at columns.
  HeightReader& reader() { return *reader_; }

 private:
  template <typename T>
  void fill(const MapGrid& grid, MapLayer layer, std::span<T> out, std::optional<double> ceiling_m,
            const InitialTerrain* design);
  void fill_at(std::span<const Vec2> xy_m, std::span<double> heights_m,
               std::optional<double> ceiling_m);
  void fill_ranges(std::span<const Vec3> origins_m, std::span<const Vec3> directions,
                   std::span<double> ranges_m);

  std::unique_ptr<HeightReader> reader_;
};

}  // namespace soilvdb::inline v0
