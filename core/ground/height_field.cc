// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>

#include "core/constants.h"
#include "core/ground/bilinear_patch.h"
#include "core/ground/height_tiles.h"
#include "core/ground/ray_terrain.h"
#include "core/lattice/affine.h"
#include "core/lattice/chunk_math.h"
#include "core/lattice/lanes.h"
#include "core/lattice/ray_walk.h"
#include "soilvdb/initial_terrain.h"

namespace soilvdb::inline v0 {
namespace {

constexpr double kCliff = 1e9;  // a slope that bounds nothing
constexpr double kNoHeight = std::numeric_limits<double>::quiet_NaN();

class HeightField final : public InitialTerrain, public RayTerrain {
 public:
  HeightField(const HeightGrid& grid, std::shared_ptr<const HeightSource> source)
      : tiles_(grid, std::move(source)), grid_(tiles_.grid()) {}

  Content classify(const Eigen::AlignedBox3d& box) const override {
    const HeightTiles::Bounds b = tiles_.bounds(box.min().head<2>(), box.max().head<2>(), 0);
    if (box.min().z() >= b.high) return Content::kAir;
    if (b.complete && box.max().z() < b.low) return Content::kSoil;
    return Content::kMixed;
  }

  bool has_data(const Eigen::AlignedBox3d& box) const override {
    HeightTiles::Bounds b = tiles_.bounds(box.min().head<2>(), box.max().head<2>(), 0);
    if (b.complete) return true;
    for (int margin = kNearPosts; margin <= kFarPosts && b.low > b.high; margin *= 2) {
      b = tiles_.bounds(box.min().head<2>(), box.max().head<2>(), margin);
    }
    return b.low <= b.high && box.min().z() >= b.high;
  }

  void distance(const Vec3& first, double h, double band, float* phi) const override {
    const Vec3 last = first + Vec3::Constant(h * (kChunkSide - 1));
    const Vec2 margin = Vec2::Constant(band);
    const HeightTiles::Window& w = tiles_.window(first.head<2>() - margin, last.head<2>() + margin);
    if (first.z() - band >= w.high || (w.complete && last.z() + band <= w.low)) {
      std::fill_n(phi, kChunkVoxels, static_cast<float>(first.z() - band >= w.high ? band : -band));
      return;
    }
    // Around a hole in the terrain the slope is unknown.
    const double slope = w.complete ? std::hypot(steepest_x(w), steepest_y(w)) : kCliff;
    // The ratio of vertical gap to true distance is at most this.
    const float steepest = static_cast<float>(std::hypot(1.0, slope));
    const float step = static_cast<float>(h), far = static_cast<float>(band);
    for (int x = 0; x < kChunkSide; ++x) {
      for (int y = 0; y < kChunkSide; ++y, phi += kChunkSide) {
        const double px = first.x() + h * x, py = first.y() + h * y;
        const double ground = at(w, px, py);
        std::array<float, kChunkSide> best;
        best.fill(far);
        const float gap = static_cast<float>(first.z() - ground);
        bool near = std::isnan(ground);
        for (int z = 0; z < kChunkSide; ++z) {
          const float g = std::abs(gap + static_cast<float>(z) * step);
          near |= g < far * steepest;
          best[static_cast<std::size_t>(z)] = g < far ? g : far;
        }
        if (near) nearest(w, {px, py, first.z(), h, ground, slope}, best);
        for (int z = 0; z < kChunkSide; ++z) {
          const float d = best[static_cast<std::size_t>(z)];
          phi[z] = gap + static_cast<float>(z) * step < 0 ? -d : d;
        }
      }
    }
  }

  void samples(const Coord3& chunk, const Vec3& first, double h,
               SampleWords& words) const override {
    const Vec2 half = Vec2::Constant(h / 2);
    const Vec2 last = first.head<2>() + Vec2::Constant(h * (kChunkSide - 1));
    const HeightTiles::Window& w = tiles_.window(first.head<2>() - half, last + half);
    // Within a cell the ground differs from its height in the middle by at most this.
    const double half_range = h / 2 * (1 + steepest_x(w) + steepest_y(w));
    std::array<CellPlace, kChunkSide> xs, ys;
    for (int k = 0; k < kChunkSide; ++k) {
      xs[static_cast<std::size_t>(k)] = place_of_cell(0, first.x() + h * k, h, w.x0, w.nx);
      ys[static_cast<std::size_t>(k)] = place_of_cell(1, first.y() + h * k, h, w.y0, w.ny);
    }
    for (int column = 0; column < kChunkVoxels; column += kChunkSide) {
      const Coord3 voxel = numbered_voxel(column);
      const CellPlace& x = xs[static_cast<std::size_t>(voxel.x())];
      const CellPlace& y = ys[static_cast<std::size_t>(voxel.y())];
      const double ground = between(w, x.middle, y.middle);
      const HeightTiles::Bounds bounds = bounds_of(w, x, y);
      for (int z = 0; z < kChunkSide; ++z) {
        const double middle = first.z() + h * z, gap = middle - ground;
        std::uint64_t& word = words[static_cast<std::size_t>(column + z)];
        if (bounds.complete && std::abs(gap) > half_range) {
          word = gap < 0 ? kAllSoil : 0;
          continue;
        }
        if (middle - h / 2 >= bounds.high) {  // also without any height
          word = 0;
          continue;
        }
        if (bounds.complete && middle + h / 2 <= bounds.low) {
          word = kAllSoil;
          continue;
        }
        const CellPoints& points = sample_points(chunk + numbered_voxel(column + z));
        word = occupancy(w, x, y, first.z() + (h * z - h / 2), h, bounds, points);
      }
    }
  }

  std::uint64_t memory_bytes() const override { return tiles_.memory_bytes(); }
  void forget() const override { tiles_.forget(); }

  std::optional<double> height(double x, double y) const override {
    const double z = at(tiles_.window({x, y}, {x, y}), x, y);
    if (std::isnan(z)) return std::nullopt;
    return z;
  }

  double meet(const Vec3& origin, const Vec3& direction, double from_m) const override {
    const Vec2 at = tiles_.post(origin.x(), origin.y());
    RayWalk walk({at.x(), at.y(), origin.z()}, {direction.x() / grid_.spacing.x(),
                                                direction.y() / grid_.spacing.y(), direction.z()});
    double to = RayWalk::kNever;
    if (!walk.clip({0, 0}, Vec2(grid_.nx - 1, grid_.ny - 1), from_m, to)) return RayWalk::kNever;
    walk.start(from_m, {0, 0}, {grid_.nx - 2, grid_.ny - 2});
    Coord2 block = Coord2::Constant(-1);
    const float* highest = nullptr;
    for (int level = kRayLevels;;) {
      const Coord2 here(walk.x() / kRaySide, walk.y() / kRaySide);
      if (here != block) highest = tiles_.highest(here.x(), here.y());
      block = here;
      const double end = std::min(walk.end(level), to);
      if (level > 0 && walk.lowest(end) <= HeightTiles::highest_of(highest, level, walk)) {
        --level;
        continue;
      }
      if (level == 0) {
        const int i = walk.x(), j = walk.y();
        const double met = walk.meet(tiles_.at(i, j), tiles_.at(i + 1, j), tiles_.at(i, j + 1),
                                     tiles_.at(i + 1, j + 1), end);
        if (met != RayWalk::kNever) return met;
      }
      if (end >= to) return RayWalk::kNever;
      const int x = walk.x(), y = walk.y();
      walk.leave(level, end);
      if (walk.x() < 0 || walk.y() < 0 || walk.x() > grid_.nx - 2 || walk.y() > grid_.ny - 2)
        return RayWalk::kNever;
      // In another square of the next level, that is worth a look.
      if (level < kRayLevels && ((x ^ walk.x()) | (y ^ walk.y())) >> (level + 1) != 0) ++level;
    }
  }

 private:
  /// A place along an axis, between posts.
  struct Place {
    int post;   // before it
    double in;  // from there, in posts
    bool is_known;
  };
  Place place(int axis, double at_m) const {
    const double u = (at_m - grid_.first[axis]) / grid_.spacing[axis];
    const int last = (axis == 0 ? grid_.nx : grid_.ny) - 1;
    if (!(u >= 0 && u <= last)) return {0, 0, false};
    const int post = std::min(static_cast<int>(u), last - 1);
    return {post, u - post, true};
  }
  /// A cell along an axis: the same for all the cells of a chunk that stand beside and above it.
  struct CellPlace {
    double low_m;
    Place middle;
    int first, last;  // posts about it, of a window
    bool is_inside;   // of the grid
    bool is_in_patch;
    double in;  // its low side from the first post, in posts
  };
  CellPlace place_of_cell(int axis, double middle_m, double h, int begin, int count) const {
    const double low_m = middle_m - h / 2;
    const double low = (low_m - grid_.first[axis]) / grid_.spacing[axis];
    const double high = (low_m + h - grid_.first[axis]) / grid_.spacing[axis];
    const int last = (axis == 0 ? grid_.nx : grid_.ny) - 1;
    const double post = std::floor(low);
    return {.low_m = low_m,
            .middle = place(axis, middle_m),
            .first = static_cast<int>(std::max(post, double(begin))),
            .last = static_cast<int>(std::min(std::floor(high) + 1, double(begin + count - 1))),
            .is_inside = low >= 0 && high <= last,
            .is_in_patch = high <= post + 1 && post >= 0 && post + 1 <= last,
            .in = low - post};
  }

  /// Of the posts about a column of cells.
  static HeightTiles::Bounds bounds_of(const HeightTiles::Window& w, const CellPlace& x,
                                       const CellPlace& y) {
    float least = std::numeric_limits<float>::infinity(), most = -least;
    bool complete = x.is_inside && y.is_inside;
    for (int j = y.first; j <= y.last; ++j) {
      for (int i = x.first; i <= x.last; ++i) {
        const float z = w.at(i, j);
        complete = complete && !std::isnan(z);
        least = z < least ? z : least;
        most = z > most ? z : most;
      }
    }
    return {least, most, complete};
  }

  /// Bit i is set if point i of the cell with low side `low_m` and side `h` is soil.
  /// @param bounds of the posts about it
  std::uint64_t occupancy(const HeightTiles::Window& w, const CellPlace& x, const CellPlace& y,
                          double low_m, double h, const HeightTiles::Bounds& bounds,
                          const CellPoints& points) const {
    if (x.is_in_patch && y.is_in_patch) {
      // The cell lies in one patch: z = a + b x + c y + d x y in cell units.
      const int i = x.first, j = y.first;
      const double z00 = w.at(i, j), z10 = w.at(i + 1, j), z01 = w.at(i, j + 1),
                   z11 = w.at(i + 1, j + 1);
      const double twist = z00 - z10 - z01 + z11, u = x.in, v = y.in;
      const double du = h / grid_.spacing.x(), dv = h / grid_.spacing.y();
      const double a0 = z00 + u * (z10 - z00) + v * (z01 - z00) + u * v * twist;
      return points_below(points, static_cast<float>((a0 - low_m) / h),
                          static_cast<float>(((z10 - z00) + v * twist) * du / h),
                          static_cast<float>(((z01 - z00) + u * twist) * dv / h),
                          static_cast<float>(twist * du * dv / h));
    }
    if (x.is_inside && y.is_inside)
      return below_patches(w, {x.low_m, y.low_m, low_m}, h, bounds, points);
    std::uint64_t bits = 0;
    for (int k = 0; k < 64; ++k) {
      const double ground = at(w, x.low_m + h * points.x[k], y.low_m + h * points.y[k]);
      bits |= std::uint64_t{low_m + h * points.z[k] < ground} << k;  // false without a height
    }
    return bits;
  }

  /// occupancy() of a cell in several patches: heights as at() has them, to the bit.
  SOILVDB_FOR_CPUS std::uint64_t below_patches(const HeightTiles::Window& w, const Vec3& low,
                                               double h, const HeightTiles::Bounds& bounds,
                                               const CellPoints& points) const {
    // Most points are above or below all posts about the cell.
    const float under = bounds.complete
                            ? static_cast<float>((bounds.low - low.z()) / h) - kBoxRounding
                            : -std::numeric_limits<float>::infinity();
    const float over = static_cast<float>((bounds.high - low.z()) / h) + kBoxRounding;
    std::uint64_t below = 0, open = 0;
    for (std::size_t k = 0; k < 64; k += kChunkSide) {
      const Lanes z = lanes_at(&points.z[k]);
      below |= std::uint64_t{bits(z < under)} << k;
      open |= std::uint64_t{bits((z >= under) & (z < over))} << k;
    }
    std::array<std::uint8_t, 64> numbers;
    std::size_t count = 0;
    for (; open != 0; open &= open - 1)
      numbers[count++] = static_cast<std::uint8_t>(std::countr_zero(open));
    const double x0 = low.x(), y0 = low.y(), z0 = low.z();
    const double first_x = grid_.first.x(), first_y = grid_.first.y();
    const double spacing_x = grid_.spacing.x(), spacing_y = grid_.spacing.y();
    const int last_i = grid_.nx - 2, last_j = grid_.ny - 2, row = w.nx;
    const int begin = w.y0 * row + w.x0;
    std::array<double, 64> s, t;
    std::array<int, 64> places;
    for (std::size_t n = 0; n < count; ++n) {
      const double u = (x0 + h * points.x[numbers[n]] - first_x) / spacing_x;
      const double v = (y0 + h * points.y[numbers[n]] - first_y) / spacing_y;
      const int i = std::min(static_cast<int>(u), last_i),
                j = std::min(static_cast<int>(v), last_j);
      s[n] = u - i;
      t[n] = v - j;
      places[n] = j * row + i - begin;
    }
    std::array<unsigned char, 64> is_below;
    const float *near = w.posts.data(), *far = near + row;
    for (std::size_t n = 0; n < count; ++n) {
      const double a = near[places[n]], b = near[places[n] + 1];
      const double c = far[places[n]], d = far[places[n] + 1];
      const double ground =
          (1 - t[n]) * ((1 - s[n]) * a + s[n] * b) + t[n] * ((1 - s[n]) * c + s[n] * d);
      is_below[n] = z0 + h * points.z[numbers[n]] < ground;  // not without a height
    }
    for (std::size_t n = 0; n < count; ++n) below |= std::uint64_t{is_below[n]} << numbers[n];
    return below;
  }

  /// Height at (x, y); NaN without a height.
  double at(const HeightTiles::Window& w, double x, double y) const {
    return between(w, place(0, x), place(1, y));
  }
  static double between(const HeightTiles::Window& w, const Place& x, const Place& y) {
    if (!x.is_known || !y.is_known) return kNoHeight;
    const double s = x.in, t = y.in;
    const double a = w.at(x.post, y.post), b = w.at(x.post + 1, y.post),
                 c = w.at(x.post, y.post + 1), d = w.at(x.post + 1, y.post + 1);
    return (1 - t) * ((1 - s) * a + s * b) + t * ((1 - s) * c + s * d);
  }

  /// Largest |dz/dx| and |dz/dy| between the window's posts, except posts without a height.
  double steepest_x(const HeightTiles::Window& w) const {
    float most = 0;
    for (int y = 0; y < w.ny; ++y) {
      const float* z = &w.posts[std::size_t(y) * w.nx];
      for (int x = 0; x + 1 < w.nx; ++x) most = larger(most, z[x + 1] - z[x]);
    }
    return most / grid_.spacing.x();
  }
  double steepest_y(const HeightTiles::Window& w) const {
    float most = 0;
    for (int y = 0; y + 1 < w.ny; ++y) {
      const float* z = &w.posts[std::size_t(y) * w.nx];
      for (int x = 0; x < w.nx; ++x) most = larger(most, z[x + w.nx] - z[x]);
    }
    return most / grid_.spacing.y();
  }
  static float larger(float most, float step) {
    return std::abs(step) > most ? std::abs(step) : most;
  }

  /// Lowers `best` to the distances from the points of a row to the patches.
  void nearest(const HeightTiles::Window& w, const PointRow& row,
               std::array<float, kChunkSide>& best) const {
    const double farthest = *std::max_element(best.begin(), best.end());
    const Vec2 c = tiles_.post(row.x, row.y);
    const Vec2 r = Vec2::Constant(farthest).cwiseQuotient(grid_.spacing);
    const int i0 = std::max(static_cast<int>(std::floor(c.x() - r.x())), w.x0);
    const int i1 = std::min(static_cast<int>(std::floor(c.x() + r.x())), w.x0 + w.nx - 2);
    const int j0 = std::max(static_cast<int>(std::floor(c.y() - r.y())), w.y0);
    const int j1 = std::min(static_cast<int>(std::floor(c.y() + r.y())), w.y0 + w.ny - 2);
    const auto look = [&](int i, int j) {
      const BilinearPatch patch{grid_.spacing.x(), grid_.spacing.y(), w.at(i, j),
                                w.at(i + 1, j),    w.at(i, j + 1),    w.at(i + 1, j + 1)};
      const double low = std::min(std::min(patch.z00, patch.z10), std::min(patch.z01, patch.z11));
      const double high = std::max(std::max(patch.z00, patch.z10), std::max(patch.z01, patch.z11));
      if (std::isnan(patch.z00 + patch.z10 + patch.z01 + patch.z11)) return;
      if (row.z - high >= farthest || low - (row.z + row.step * (kChunkSide - 1)) >= farthest)
        return;
      nearest_on_patch(patch, grid_.first.x() + i * grid_.spacing.x(),
                       grid_.first.y() + j * grid_.spacing.y(), row, best);
    };
    // Start with the patch below: it leaves few others that may be nearer.
    const int own_i = static_cast<int>(std::floor(c.x())),
              own_j = static_cast<int>(std::floor(c.y()));
    if (own_i >= i0 && own_i <= i1 && own_j >= j0 && own_j <= j1) look(own_i, own_j);
    for (int j = j0; j <= j1; ++j) {
      for (int i = i0; i <= i1; ++i) {
        if (i != own_i || j != own_j) look(i, j);
      }
    }
  }

  HeightTiles tiles_;
  const HeightGrid& grid_;
};

}  // namespace

std::unique_ptr<InitialTerrain> make_height_field(const HeightGrid& grid,
                                                  std::shared_ptr<const HeightSource> source) {
  if (grid.nx < 2 || grid.ny < 2 || !(grid.spacing.x() > 0) || !(grid.spacing.y() > 0)) {
    throw std::invalid_argument("a height field needs 2 x 2 posts or more, spacing above zero");
  }
  return std::make_unique<HeightField>(grid, std::move(source));
}

}  // namespace soilvdb::inline v0
