// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "core/survey/ground_view.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/constants.h"
#include "core/ground/ray_terrain.h"
#include "core/lattice/affine.h"
#include "core/lattice/chunk_math.h"
#include "core/surface/height_reader.h"

namespace soilvdb::inline v0 {
namespace {

constexpr float kNotMet = std::numeric_limits<float>::quiet_NaN();
/// Part of a quad by which rays may miss it at its border: rounding leaves no gaps.
constexpr float kBorder = 1e-3f;
/// Quads that are seen by neighbouring pixels are of one surface if they are no farther apart.
constexpr int kNextTo = 2;
/// In place of a quad with a corner that has no ground. Rays that may meet it are cast.
constexpr std::int32_t kRagged = -1;
/// In place of the next quad: the ray met the last one.
constexpr std::int32_t kArrived = -2;
/// A quad is the number of its first column along x, then along y.
constexpr int kQuadBits = 10, kQuadMask = (1 << kQuadBits) - 1;
/// Ground nearer than this is not drawn, cells; and room to the ground about a place that needs
/// none of it.
constexpr float kNearest = 0.25f, kMostNear = 1 / kNearest;
constexpr int kRoom = 3;

/// A face of the cube: two coordinates along it, and the distance. Factors of x, y and z.
struct Axes {
  std::array<float, 3> u, v, w;
};
constexpr std::array<Axes, 5> kAxes = {{
    {{1, 0, 0}, {0, 1, 0}, {0, 0, -1}},
    {{0, 1, 0}, {0, 0, 1}, {1, 0, 0}},
    {{0, 1, 0}, {0, 0, 1}, {-1, 0, 0}},
    {{1, 0, 0}, {0, 0, 1}, {0, 1, 0}},
    {{1, 0, 0}, {0, 0, 1}, {0, -1, 0}},
}};

/// Number of a pixel: face, then along u, then along v.
constexpr int kPixelBits = 10, kPixelMask = (1 << kPixelBits) - 1;

/// Numbers of the first of four pixels about each ray.
SOILVDB_FOR_CPUS void find(const float* xs, const float* ys, const float* zs, std::size_t count,
                           float half, std::int32_t* out) {
  for (std::size_t i = 0; i < count; ++i) {
    const float x = xs[i], y = ys[i], z = zs[i], ax = std::abs(x), ay = std::abs(y);
    const bool is_x = ax >= ay;
    const float side = is_x ? ax : ay;
    const bool down = -z >= side;
    const float w = down ? -z : side;
    const float u = (is_x && !down) ? y : x, v = down ? y : z;
    const int on_side = is_x ? (x > 0 ? 1 : 2) : (y > 0 ? 3 : 4);
    const int face = down ? 0 : on_side;
    const float last = 2 * half - 2;
    const int a = static_cast<int>(std::clamp((u / w + 1) * half - 0.5f, 0.0f, last));
    const int b = static_cast<int>(std::clamp((v / w + 1) * half - 0.5f, 0.0f, last));
    const int number = face << (2 * kPixelBits) | a << kPixelBits | b;
    out[i] = z >= side ? -1 : number;
  }
}

/// Rays that are followed at a time.
constexpr std::size_t kRaysTogether = 256;

/// Faces and pixels of some numbers, the first and the last of each.
struct PixelRange {
  std::int32_t first_face = kPixelMask, last_face = -1;
  std::int32_t u0 = kPixelMask, u1 = -1, v0 = kPixelMask, v1 = -1;
};
SOILVDB_FOR_CPUS PixelRange range_of(const std::int32_t* numbers, std::size_t count) {
  PixelRange all;
  for (std::size_t i = 0; i < count; ++i) {
    const std::int32_t face = numbers[i] >> (2 * kPixelBits);
    const std::int32_t u = numbers[i] >> kPixelBits & kPixelMask, v = numbers[i] & kPixelMask;
    all.first_face = std::min(all.first_face, face);
    all.last_face = std::max(all.last_face, face);
    all.u0 = std::min(all.u0, u);
    all.u1 = std::max(all.u1, u);
    all.v0 = std::min(all.v0, v);
    all.v1 = std::max(all.v1, v);
  }
  return all;
}

/// What rays at a time see, and where they are on their way.
struct Sights {
  template <typename T>
  using Values = std::array<T, kRaysTogether>;

  std::array<Values<float>, 4> nearness;  // of the four pixels about each
  std::array<Values<std::int32_t>, 4> quads;
  Values<std::int32_t> quad;             // the one that it sees; kRagged: it is cast
  std::array<Values<float>, 4> heights;  // of that one's corners
  Values<float> t;                       // along the ray, cells
  Values<std::int32_t> next;             // where it goes on; kArrived: it meets that quad
};

/// Finds what the four pixels about each ray see.
SOILVDB_FOR_CPUS void find_quads(const float* xs, const float* ys, const float* zs,
                                 std::size_t count, Sights& sights) {
  for (std::size_t i = 0; i < count; ++i) {
    // From the nearest, so that nothing before the others is passed by.
    float nearness = sights.nearness[0][i];
    std::int32_t quad = sights.quads[0][i];
    for (std::size_t n = 1; n < 4; ++n) {
      const bool is_nearer = sights.nearness[n][i] > nearness;
      quad = is_nearer ? sights.quads[n][i] : quad;
      nearness = is_nearer ? sights.nearness[n][i] : nearness;
    }
    const int qx = quad >> kQuadBits, qy = quad & kQuadMask;
    // Where the four see one surface, bumps of less than a pixel alone are hidden between them.
    bool is_one = true;
    for (std::size_t n = 0; n < 4; ++n) {
      const std::int32_t other = sights.quads[n][i];
      const int x = (other >> kQuadBits) - qx, y = (other & kQuadMask) - qy;
      is_one &= (other >= 0) & (x <= kNextTo) & (-x <= kNextTo) & (y <= kNextTo) & (-y <= kNextTo);
    }
    const float wide = std::max(std::abs(xs[i]), std::abs(ys[i]));
    sights.t[i] = 1 / (nearness * std::max(wide, -zs[i]));
    sights.quad[i] = is_one ? quad : kRagged;
  }
}

/// Takes rays to the quads that they see. @param from the place, cells
/// @param last of columns that have quads
SOILVDB_FOR_CPUS void meet_quads(const std::array<float, 3>& from, int last, const float* xs,
                                 const float* ys, const float* zs, std::size_t count,
                                 Sights& sights) {
  const float from_x = from[0], from_y = from[1], from_z = from[2];
  for (std::size_t i = 0; i < count; ++i) {
    const std::int32_t quad = sights.quad[i];
    const int qx = quad >> kQuadBits, qy = quad & kQuadMask;
    const float z = sights.heights[0][i], far_z = sights.heights[2][i];
    const float dx = xs[i], dy = ys[i], dz = zs[i], t = sights.t[i];
    const float x = from_x + t * dx - static_cast<float>(qx);
    const float y = from_y + t * dy - static_cast<float>(qy);
    const float a = far_z - z, b = sights.heights[1][i] - z;
    const float twist = sights.heights[3][i] - far_z - b;
    const float gap = from_z + t * dz - (z + a * x + (b + twist * x) * y);
    const float rate = dz - (a * dx + b * dy + twist * (x * dy + y * dx));
    const float square = rate * rate + 4 * twist * dx * dy * gap;
    const float step = 2 * gap / (std::sqrt(square) - rate);
    const float in_x = x + step * dx, in_y = y + step * dy;
    const int next_x = (in_x > 1 + kBorder ? 1 : 0) - (in_x < -kBorder ? 1 : 0);
    const int next_y = (in_y > 1 + kBorder ? 1 : 0) - (in_y < -kBorder ? 1 : 0);
    const int to_x = qx + next_x, to_y = qy + next_y;
    const bool is_in = (to_x >= 0) & (to_y >= 0) & (to_x <= last) & (to_y <= last);
    const std::int32_t beside = is_in ? to_x << kQuadBits | to_y : kRagged;
    const std::int32_t met = t + step > 0 ? kArrived : kRagged;
    const std::int32_t next = (next_x | next_y) == 0 ? met : beside;
    sights.t[i] = t + step;
    const bool may_meet = (quad >= 0) & (rate < 0) & (square >= 0);
    sights.next[i] = may_meet ? next : kRagged;
  }
}

}  // namespace

GroundView::GroundView(Ground& ground, HeightMap& map)
    : ground_(ground), map_(map), changes_(ground) {
  static_assert(kSide <= 1 << kQuadBits);
}

/// Takes a place. @return is ground about it drawn?
bool GroundView::begin(const Vec3& from_m) {
  const Vec3 from = ground_.index_from_world(from_m);
  if (dynamic_cast<const RayTerrain*>(&ground_.terrain()) == nullptr ||
      !(from.cwiseAbs().maxCoeff() < kMaxIndex - kSide))
    return false;
  const Coord3 cell(cell_of(from.x()), cell_of(from.y()), cell_of(from.z()));
  const Coord3 first = floor_to(cell, kStep) - Coord3(kReach, kReach, 0);
  const std::vector<Coord3> changed = changes_.take();
  map_.reader().refresh();
  map_.reader().find_changed();
  if (heights_.empty() || first != first_) {
    first_ = first;
    heights_.resize(std::size_t{kSide} * kSide);
    read_.assign(std::size_t{kTiles} * kTiles, 0);
    blocks_.assign(std::size_t{kBlocks} * kBlocks, {});
    from_.setConstant(std::numeric_limits<double>::quiet_NaN());
  }
  bool is_same = from == from_;
  for (const Coord3& origin : changed) {
    // Surfaces are between the middles of columns: the blocks before it have its first, too.
    const Coord2 tile = (origin - first).head<2>() / kChunkSide;
    if (((origin - first).head<2>().array() < 0).any() || tile.maxCoeff() >= kTiles) continue;
    read_[static_cast<std::size_t>(tile.x() * kTiles + tile.y())] = 0;
    for (int bx = (tile.x() * kChunkSide - 1) / kBlock; bx <= tile.x() * kChunkSide / kBlock; ++bx)
      for (int by = (tile.y() * kChunkSide - 1) / kBlock; by <= tile.y() * kChunkSide / kBlock;
           ++by)
        blocks_[static_cast<std::size_t>(bx * kBlocks + by)].known = false;
    is_same = false;
  }
  if (!is_same)
    for (Face& face : faces_) face.end = face.low;
  from_ = from;
  for (int a = 0; a < 3; ++a)
    at_[static_cast<std::size_t>(a)] = static_cast<float>(from[a] - first[a]);
  // Faces do not show what they pass through.
  const Coord2 low = (cell - first_).head<2>() - Coord2::Constant(kRoom);
  for (int x = low.x(); x <= low.x() + 2 * kRoom; ++x) {
    for (int y = low.y(); y <= low.y() + 2 * kRoom; ++y) {
      block(x / kBlock, y / kBlock);
      if (height(x, y) > at_[2] - kRoom) return false;
    }
  }
  return true;
}

void GroundView::read_tile(const Coord2& tile) {
  std::uint8_t& is_read = read_[static_cast<std::size_t>(tile.x() * kTiles + tile.y())];
  if (is_read != 0) return;
  HeightReader& reader = map_.reader();
  const Coord2 low = kChunkSide * tile;
  reader.read_surface(first_.head<2>() + low, reader.columns);
  for (int x = 0; x < kChunkSide; ++x)
    for (int y = 0; y < kChunkSide; ++y)
      heights_[static_cast<std::size_t>((low.x() + x) * kSide + low.y() + y)] =
          static_cast<float>(reader.columns.at(x, y) - first_.z());
  is_read = 1;
}

const GroundView::Block& GroundView::block(int bx, int by) {
  Block& block = blocks_[static_cast<std::size_t>(bx * kBlocks + by)];
  if (block.known) return block;
  const int x0 = bx * kBlock, y0 = by * kBlock;
  const int x1 = std::min(x0 + kBlock, kSide - 1), y1 = std::min(y0 + kBlock, kSide - 1);
  for (int x = x0 / kChunkSide; x <= x1 / kChunkSide; ++x)
    for (int y = y0 / kChunkSide; y <= y1 / kChunkSide; ++y) read_tile({x, y});
  block.low = std::numeric_limits<float>::infinity();
  block.high = -block.low;
  for (int x = x0; x <= x1; ++x) {
    for (int y = y0; y <= y1; ++y) {
      const float z = height(x, y);
      if (std::isnan(z)) continue;
      block.low = std::min(block.low, z);
      block.high = std::max(block.high, z);
    }
  }
  block.known = true;
  return block;
}

void GroundView::draw(int number, const Coord2& first, const Coord2& last) {
  Face& face = faces_[static_cast<std::size_t>(number)];
  if (face.holds(first, last)) return;
  face.low = floor_to(first, kPixelCell);
  face.end = floor_to(last, kPixelCell) + Coord2::Constant(kPixelCell);
  const Coord2 size = face.end - face.low;
  face.pixels.assign(static_cast<std::size_t>(size.prod()), {0, -1});
  const Axes& axes = kAxes[static_cast<std::size_t>(number)];
  constexpr float kHalf = kPixels / 2;
  // Sides of the rectangle as planes through the place: what is drawn has u - s w of one sign.
  const auto may_see = [&](const std::array<float, 3>& low, const std::array<float, 3>& high) {
    const auto most = [&](const std::array<float, 3>& along, float sign, float slope) {
      float sum = 0;
      for (std::size_t a = 0; a < 3; ++a) {
        const float factor = sign * along[a] + slope * axes.w[a];
        if (factor != 0) sum += std::max(factor * low[a], factor * high[a]);
      }
      return sum;
    };
    if (!(most({}, 0, 1) > 0)) return false;
    for (int a = 0; a < 2; ++a) {
      const auto& along = a == 0 ? axes.u : axes.v;
      const float from = static_cast<float>(face.low[a]) / kHalf - 1;
      const float to = static_cast<float>(face.end[a]) / kHalf - 1;
      if (!(most(along, 1, -from) >= 0) || !(most(along, -1, to) >= 0)) return false;
    }
    return true;
  };
  constexpr float kAny = 1e9f;
  for (int bx = 0; bx < kBlocks; ++bx) {
    for (int by = 0; by < kBlocks; ++by) {
      std::array<float, 3> low = {static_cast<float>(bx * kBlock) - at_[0],
                                  static_cast<float>(by * kBlock) - at_[1], -kAny};
      std::array<float, 3> high = {low[0] + kBlock, low[1] + kBlock, kAny};
      if (!may_see(low, high)) continue;
      const Block& heights = block(bx, by);
      low[2] = heights.low - at_[2];
      high[2] = heights.high - at_[2];
      if (heights.low <= heights.high && may_see(low, high)) draw_block(number, face, bx, by);
    }
  }
}

void GroundView::draw_block(int number, Face& face, int bx, int by) {
  struct Corner {
    float u, v, nearness;  // pixels; of what is not before the face, as if it were just before it
    bool has_ground, is_before;
    float wide_u, wide_v;  // where it would be just before the face
  };
  const Axes& axes = kAxes[static_cast<std::size_t>(number)];
  constexpr float kHalf = kPixels / 2;
  constexpr int kCorners = kBlock + 1;
  std::array<Corner, kCorners * kCorners> corners;
  const float highest = blocks_[static_cast<std::size_t>(bx * kBlocks + by)].high;
  const int x0 = bx * kBlock, y0 = by * kBlock;
  const int nx = std::min(kCorners, kSide - x0), ny = std::min(kCorners, kSide - y0);
  for (int i = 0; i < nx; ++i) {
    for (int j = 0; j < ny; ++j) {
      const float x = static_cast<float>(x0 + i) - at_[0], y = static_cast<float>(y0 + j) - at_[1];
      const float ground = height(x0 + i, y0 + j);
      const bool has_ground = !std::isnan(ground);
      const float z = (has_ground ? ground : highest) - at_[2];
      const auto along = [&](const std::array<float, 3>& axis) {
        return axis[0] * x + axis[1] * y + axis[2] * z;
      };
      const float u = along(axes.u), v = along(axes.v), w = along(axes.w);
      const auto pixel = [&](float to, float near) { return (to * near + 1) * kHalf - 0.5f; };
      const float nearness = 1 / std::max(w, kNearest);
      corners[static_cast<std::size_t>(i * kCorners + j)] = {
          pixel(u, nearness), pixel(v, nearness),  nearness,           has_ground,
          w > kNearest,       pixel(u, kMostNear), pixel(v, kMostNear)};
    }
  }
  const int low_u = face.low.x(), low_v = face.low.y(), end_u = face.end.x(), end_v = face.end.y();
  const int row = end_v - low_v;
  const auto draw = [&](const Corner& a, const Corner& b, const Corner& c, std::int32_t quad) {
    const int u0 = std::max(low_u, static_cast<int>(std::ceil(std::min({a.u, b.u, c.u}))));
    const int u1 = std::min(end_u - 1, static_cast<int>(std::floor(std::max({a.u, b.u, c.u}))));
    const int v0 = std::max(low_v, static_cast<int>(std::ceil(std::min({a.v, b.v, c.v}))));
    const int v1 = std::min(end_v - 1, static_cast<int>(std::floor(std::max({a.v, b.v, c.v}))));
    if (u0 > u1 || v0 > v1) return;
    const float bu = b.u - a.u, bv = b.v - a.v, cu = c.u - a.u, cv = c.v - a.v;
    const float area = bu * cv - cu * bv;
    if (area == 0) return;
    const float share = 1 / area, bn = b.nearness - a.nearness, cn = c.nearness - a.nearness;
    for (int u = u0; u <= u1; ++u) {
      const float du = static_cast<float>(u) - a.u;
      Pixel* const pixels = face.pixels.data() + (u - low_u) * row - low_v;
      for (int v = v0; v <= v1; ++v) {
        const float dv = static_cast<float>(v) - a.v;
        const float s = (du * cv - cu * dv) * share, t = (bu * dv - du * bv) * share;
        if (!(s >= -kBorder && t >= -kBorder && s + t <= 1 + kBorder)) continue;
        const float nearness = a.nearness + s * bn + t * cn;
        if (nearness > pixels[v].nearness) pixels[v] = {nearness, quad};
      }
    }
  };
  // What rises past the place is seen somewhere on the way from where it begins to where it ends.
  const auto cover = [&](const std::array<const Corner*, 4>& all) {
    Eigen::AlignedBox2f box;
    for (const Corner* c : all) {
      box.extend(Eigen::Vector2f(c->u, c->v));
      box.extend(Eigen::Vector2f(c->wide_u, c->wide_v));
    }
    const auto within = [](float at, int low, int end) {
      return static_cast<int>(std::clamp(at, static_cast<float>(low), static_cast<float>(end)));
    };
    const int u1 = within(std::ceil(box.max().x()) + 1, low_u, end_u);
    const int v1 = within(std::ceil(box.max().y()) + 1, low_v, end_v);
    for (int u = within(std::floor(box.min().x()), low_u, end_u); u < u1; ++u)
      for (int v = within(std::floor(box.min().y()), low_v, end_v); v < v1; ++v)
        face.pixels[static_cast<std::size_t>((u - low_u) * row + v - low_v)] = {kMostNear, kRagged};
  };
  for (int i = 0; i + 1 < nx; ++i) {
    for (int j = 0; j + 1 < ny; ++j) {
      const Corner* const c = &corners[static_cast<std::size_t>(i * kCorners + j)];
      const Corner &c00 = c[0], &c01 = c[1], &c10 = c[kCorners], &c11 = c[kCorners + 1];
      const int before = c00.is_before + c01.is_before + c10.is_before + c11.is_before;
      const int known = c00.has_ground + c01.has_ground + c10.has_ground + c11.has_ground;
      if (before == 0 || known == 0) continue;
      if (before < 4) {
        cover({&c00, &c01, &c10, &c11});
        continue;
      }
      const std::int32_t quad = known == 4 ? (x0 + i) << kQuadBits | (y0 + j) : kRagged;
      draw(c00, c10, c11, quad);
      draw(c00, c01, c11, quad);
    }
  }
}

void GroundView::find_pixels(const ScanRays& rays) {
  pixels_.resize(rays.count());
  find(rays.x.data(), rays.y.data(), rays.z.data(), rays.count(), kPixels / 2, pixels_.data());
  std::array<Coord2, kFaces> first, last;
  first.fill(Coord2::Constant(kPixels));
  last.fill(Coord2::Constant(-1));
  for (std::size_t begin = 0; begin < pixels_.size(); begin += kRaysTogether) {
    const std::size_t count = std::min(kRaysTogether, pixels_.size() - begin);
    const PixelRange range = range_of(&pixels_[begin], count);
    const auto add = [&](std::int32_t number, const Coord2& low, const Coord2& high) {
      const auto face = static_cast<std::size_t>(number);
      first[face] = first[face].cwiseMin(low);
      last[face] = last[face].cwiseMax(high + Coord2::Ones());
    };
    if (range.first_face == range.last_face) {
      if (range.first_face >= 0) add(range.first_face, {range.u0, range.v0}, {range.u1, range.v1});
      continue;
    }
    for (std::size_t i = begin; i < begin + count; ++i) {
      const std::int32_t number = pixels_[i];
      if (number < 0) continue;
      const Coord2 at(number >> kPixelBits & kPixelMask, number & kPixelMask);
      add(number >> (2 * kPixelBits), at, at);
    }
  }
  for (std::size_t f = 0; f < kFaces; ++f)
    if (last[f].x() >= 0) draw(static_cast<int>(f), first[f], last[f]);
}

/// Follows rays from the quads of their pixels; NaN where these do not meet them.
void GroundView::follow(const ScanRays& rays, std::span<float> ranges_m) {
  const auto h = static_cast<float>(ground_.voxel_size_m());
  const auto face_of = [&](std::size_t i) { return pixels_[i] >> (2 * kPixelBits); };
  Sights sights;
  for (std::size_t begin = 0, end = 0; begin < rays.count(); begin = end) {
    const std::int32_t number = face_of(begin);
    const std::size_t most = std::min(rays.count(), begin + kRaysTogether);
    for (end = begin + 1; end < most && face_of(end) == number;) ++end;
    if (number < 0) continue;
    const Face& face = faces_[static_cast<std::size_t>(number)];
    const int row = (face.end - face.low).y();
    const std::size_t count = end - begin;
    for (std::size_t i = 0; i < count; ++i) {
      const std::int32_t at = pixels_[begin + i];
      const int u = (at >> kPixelBits & kPixelMask) - face.low.x(),
                v = (at & kPixelMask) - face.low.y();
      const Pixel* const pixel = &face.pixels[static_cast<std::size_t>(u * row + v)];
      const Pixel* const about[] = {pixel, pixel + 1, pixel + row, pixel + row + 1};
      for (std::size_t n = 0; n < 4; ++n) {
        sights.nearness[n][i] = about[n]->nearness;
        sights.quads[n][i] = about[n]->quad;
      }
    }
    const float *const x = &rays.x[begin], *const y = &rays.y[begin], *const z = &rays.z[begin];
    find_quads(x, y, z, count, sights);
    for (std::size_t i = 0; i < count; ++i) {
      const std::int32_t quad = std::max(sights.quad[i], 0);
      const float* const low =
          &heights_[static_cast<std::size_t>((quad >> kQuadBits) * kSide + (quad & kQuadMask))];
      const float* const corners[] = {low, low + 1, low + kSide, low + kSide + 1};
      for (std::size_t n = 0; n < 4; ++n) sights.heights[n][i] = *corners[n];
    }
    meet_quads(at_, kSide - 2, x, y, z, count, sights);
    for (std::size_t i = 0; i < count; ++i) {
      const std::int32_t quad = sights.next[i];
      if (quad == kArrived)
        ranges_m[begin + i] = h * sights.t[i];
      else if (quad >= 0)
        ranges_m[begin + i] = h * follow(quad, sights.t[i], {x[i], y[i], z[i]});
    }
  }
}

/// Follows a ray that comes to a quad from the first of its neighbours. @return where it meets the
/// ground, cells; kNotMet
float GroundView::follow(std::int32_t quad, float t, const std::array<float, 3>& way) {
  int qx = quad >> kQuadBits, qy = quad & kQuadMask;
  const float dx = way[0], dy = way[1], dz = way[2];
  for (int n = 1; n <= kNeighbours; ++n) {
    block(qx / kBlock, qy / kBlock);
    const float* const z = &heights_[static_cast<std::size_t>(qx * kSide + qy)];
    const float x = at_[0] + t * dx - static_cast<float>(qx);
    const float y = at_[1] + t * dy - static_cast<float>(qy);
    const float a = z[kSide] - z[0], b = z[1] - z[0], twist = z[kSide + 1] - z[kSide] - b;
    const float gap = at_[2] + t * dz - (z[0] + a * x + (b + twist * x) * y);
    const float rate = dz - (a * dx + b * dy + twist * (x * dy + y * dx));
    const float square = rate * rate + 4 * twist * dx * dy * gap;
    if (!(rate < 0) || !(square >= 0)) break;
    const float step = 2 * gap / (std::sqrt(square) - rate);
    t += step;
    const float in_x = x + step * dx, in_y = y + step * dy;
    const int next_x = (in_x > 1 + kBorder) - (in_x < -kBorder);
    const int next_y = (in_y > 1 + kBorder) - (in_y < -kBorder);
    if (next_x == 0 && next_y == 0) return t > 0 ? t : kNotMet;
    qx += next_x;
    qy += next_y;
    if (qx < 0 || qy < 0 || qx + 1 >= kSide || qy + 1 >= kSide) break;
  }
  return kNotMet;
}

void GroundView::ranges(const Vec3& from_m, const ScanRays& rays, std::span<float> ranges_m) {
  std::fill(ranges_m.begin(), ranges_m.end(), kNotMet);
  try {
    if (begin(from_m)) {
      find_pixels(rays);
      follow(rays, ranges_m);
    }
  } catch (...) {
    heights_.clear();  // what was half read or drawn is not used again
    throw;
  }
  std::vector<std::size_t> others;
  std::vector<Vec3> ways;
  for (std::size_t i = 0; i < rays.count(); ++i) {
    if (!std::isnan(ranges_m[i])) continue;
    others.push_back(i);
    ways.push_back(rays.way(i));
  }
  std::vector<double> cast(ways.size());
  map_.cast(std::span(&from_m, 1), ways, cast).check();
  for (std::size_t k = 0; k < others.size(); ++k) ranges_m[others[k]] = static_cast<float>(cast[k]);
}

}  // namespace soilvdb::inline v0
