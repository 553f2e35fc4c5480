// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a sensor is expected to see: the ground about it as an image, made once for all its rays.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "soilvdb/change_follower.h"
#include "soilvdb/height_map.h"

namespace soilvdb::inline v0 {

/// Rays from one place, by coordinate. Directions of unit length.
struct ScanRays {
  std::vector<float> x, y, z, length_m;

  std::size_t count() const { return x.size(); }
  void resize(std::size_t count) {
    for (std::vector<float>* values : {&x, &y, &z, &length_m}) values->resize(count);
  }
  Vec3 way(std::size_t i) const { return {x[i], y[i], z[i]}; }
  void set_way(std::size_t i, const Vec3& way) {
    x[i] = static_cast<float>(way.x());
    y[i] = static_cast<float>(way.y());
    z[i] = static_cast<float>(way.z());
  }
  void copy(std::size_t from, std::size_t to) {
    for (std::vector<float>* values : {&x, &y, &z, &length_m}) (*values)[to] = (*values)[from];
  }
};

/// Finds where rays from a place meet the quads between the middles of columns. That is the surface
/// of HeightMap::at() where the ground was changed; elsewhere it differs by the terrain's bend
/// within a voxel.
///
/// The quads about a place are drawn onto five faces of a cube around it, all but the upper. A
/// pixel has the nearest quad at its middle. Where the four pixels about a ray see one surface, the
/// ray goes on from there to neighbours until it meets a quad within its borders. Others, as beside
/// edges, are cast by HeightMap. So a ray's range depends on its direction, the place and the
/// ground alone, whatever else was drawn.
///
/// Heights are kept until the ground changes, faces until the place does as well.
class GroundView {
 public:
  /// @param map of the ground; must outlive it
  GroundView(Ground& ground, HeightMap& map);

  /// Ranges to the ground, m: 0 if the place is below it, infinity if a ray meets none.
  void ranges(const Vec3& from_m, const ScanRays& rays, std::span<float> ranges_m);

 private:
  /// Pixels of a face along each side: they see angles of 2.6 mrad and less.
  static constexpr int kPixels = 768, kFaces = 5;
  /// Columns about a place that are drawn, and steps in which they move with it.
  static constexpr int kReach = 256, kStep = 64, kSide = 2 * kReach + kStep;
  static constexpr int kTiles = kSide / kChunkSide;
  /// Quads of a block that is left out of a face as a whole.
  static constexpr int kBlock = 16, kBlocks = kSide / kBlock;
  /// Faces are drawn by rectangles of whole cells of so many pixels.
  static constexpr int kPixelCell = 32;
  /// Neighbours to which a ray goes on.
  static constexpr int kNeighbours = 4;

  struct Pixel {
    float nearness;     ///< 1 / distance along the face's axis, 1 / cells; 0: nothing
    std::int32_t quad;  ///< negative: rays are cast
  };
  struct Face {
    Coord2 low = {0, 0}, end = {0, 0};  // pixels that were drawn
    std::vector<Pixel> pixels;

    bool holds(const Coord2& first, const Coord2& last) const {
      return (first - low).minCoeff() >= 0 && (end - last).minCoeff() > 0;
    }
  };
  struct Block {
    bool known = false;
    float low = 0, high = 0;
  };

  bool begin(const Vec3& from_m);
  void find_pixels(const ScanRays& rays);
  void draw(int face, const Coord2& first, const Coord2& last);
  void draw_block(int number, Face& face, int bx, int by);
  const Block& block(int bx, int by);
  void read_tile(const Coord2& tile);
  void follow(const ScanRays& rays, std::span<float> ranges_m);
  float follow(std::int32_t quad, float t, const std::array<float, 3>& way);
  float height(int x, int y) const { return heights_[static_cast<std::size_t>(x * kSide + y)]; }

  Ground& ground_;
  HeightMap& map_;
  ChangeFollower changes_;
  Vec3 from_ = {0, 0, 0};     // index space
  Coord3 first_ = {0, 0, 0};  // the lowest column, and the height from which heights are counted
  std::array<float, 3> at_ = {};    // the place from there, cells
  std::vector<float> heights_;      // cells; of kSide * kSide columns; empty: no place yet
  std::vector<std::uint8_t> read_;  // by tile
  std::vector<Block> blocks_;
  std::array<Face, kFaces> faces_;
  std::vector<std::int32_t> pixels_;  // of rays, the first of four; negative: upwards
};

}  // namespace soilvdb::inline v0
