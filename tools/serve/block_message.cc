// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/block_message.h"

#include <zlib.h>

#include <algorithm>
#include <bitset>
#include <cmath>
#include <limits>
#include <map>
#include <stdexcept>
#include <utility>
#include <vector>

#include "core/lattice/bytes.h"
#include "core/lattice/chunk_math.h"
#include "io/draw/loose_soil.h"
#include "soilvdb/chunk_range.h"

namespace soilvdb::tools {
namespace {

/// Coordinate units per voxel, and the offset of a block's coordinates in voxels. Equal points of
/// neighbouring blocks differ by whole blocks exactly.
constexpr double kPerVoxel = 1024;
constexpr double kMargin = 8;
/// Rounding of coordinates in these units: 0.2 mm for 5 cm voxels. A smaller step makes messages of
/// rough ground larger; with a larger step gentle slopes look like stairs.
constexpr double kStep = 4;
constexpr std::uint16_t kNoHeight = 0x8000;

/// Appends numbers as bytes, all low bytes first.
template <typename T>
void put_numbers(std::string& out, const std::vector<T>& values, std::size_t bytes = sizeof(T)) {
  const std::size_t at = out.size(), n = values.size();
  out.resize(at + n * bytes);
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t byte = 0; byte < bytes; ++byte)
      out[at + byte * n + i] = static_cast<char>(values[i] >> (8 * byte) & 0xff);
}

/// Appends the differences between consecutive elements.
void put_array(std::string& out, std::vector<std::uint16_t> values) {
  std::uint16_t last = 0;
  for (std::uint16_t& value : values) {
    const auto difference = static_cast<std::uint16_t>(value - last);
    last = std::exchange(value, difference);
  }
  put_numbers(out, values);
}

/// A mesh's vertices in the order of their first use by triangles. Each corner is 0 for the next
/// vertex, else its distance back from the next vertex, which is mostly small.
struct OrderedMesh {
  std::vector<Eigen::Vector3f> points;
  std::vector<std::uint32_t> corners;

  explicit OrderedMesh(const Mesh& mesh) {
    constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
    std::vector<std::uint32_t> place(mesh.points.size(), kNone);
    const auto next = [&] { return static_cast<std::uint32_t>(points.size()); };
    for (const auto& triangle : mesh.triangles) {
      for (const std::uint32_t corner : triangle) {
        const bool seen = place[corner] != kNone;
        corners.push_back(seen ? next() - place[corner] : 0);
        if (seen) continue;
        place[corner] = next();
        points.push_back(mesh.points[corner]);
      }
    }
  }
};

/// A height difference in millimetres, clamped to 16 bits.
std::uint16_t millimetres(double above_m) {
  if (std::isnan(above_m)) return kNoHeight;
  const double mm = std::clamp(std::round(1000 * above_m), -32767.0, 32767.0);
  return static_cast<std::uint16_t>(static_cast<std::int16_t>(mm));
}

std::vector<std::uint16_t> above(const std::vector<Vec3>& points, const Heights& heights) {
  std::vector<Vec2> xy;
  xy.reserve(points.size());
  for (const Vec3& p : points) xy.emplace_back(p.head<2>());
  std::vector<double> z(points.size());
  heights(xy, z);
  std::vector<std::uint16_t> mm;
  mm.reserve(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) mm.push_back(millimetres(points[i].z() - z[i]));
  return mm;
}

/// Finds the parts of a ground that equal another ground, to the last sample.
class Unchanged {
 public:
  Unchanged(const Ground& now, const Ground& before) : now_(now), before_(before) {}

  /// Is the surface at a vertex the same? @param index of the place, in voxels
  bool at(const Vec3& index) {
    const Coord3 low(index.array().floor().cast<int>());
    // The surface there depends on the eight voxels around it, and each of these on its neighbours.
    for (int x = low.x() - 1; x <= low.x() + 2; ++x)
      for (int y = low.y() - 1; y <= low.y() + 2; ++y)
        for (int z = low.z() - 1; z <= low.z() + 2; ++z)
          if (changed({x, y, z})) return false;
    return true;
  }

 private:
  using Cells = std::bitset<kChunkVoxels>;

  bool changed(const Coord3& cell) {
    const Coord3 chunk = floor_to(cell, kChunkSide);
    const auto [found, first] = chunks_.try_emplace(chunk);
    if (first) found->second = changes_of(chunk);
    return found->second[static_cast<std::size_t>(cell_number(cell))];
  }

  Cells changes_of(const Coord3& chunk) const {
    Cells cells;
    if (now_.find(chunk) == nullptr && before_.find(chunk) == nullptr) return cells;
    SampleWords here, there;
    now_.read_samples(chunk, here);
    before_.read_samples(chunk, there);
    for (std::size_t n = 0; n < here.size(); ++n) cells[n] = here[n] != there[n];
    return cells;
  }

  const Ground& now_;
  const Ground& before_;
  std::map<Coord3, Cells, Before> chunks_;
};

std::uint64_t resident_chunks_of(const Ground& ground, const Coord3& block) {
  constexpr int kChunks = kBlockSide / kChunkSide;
  std::uint64_t mask = 0;
  for (int n = 0; n < kChunks * kChunks * kChunks; ++n) {
    const Coord3 chunk(n / (kChunks * kChunks), n / kChunks % kChunks, n % kChunks);
    if (ground.find(block + kChunkSide * chunk) != nullptr) mask |= std::uint64_t{1} << n;
  }
  return mask;
}

}  // namespace

std::string deflated(std::string_view bytes) {
  uLongf size = compressBound(bytes.size());
  std::string out(size, '\0');
  if (compress2(reinterpret_cast<Bytef*>(out.data()), &size,
                reinterpret_cast<const Bytef*>(bytes.data()), bytes.size(),
                Z_DEFAULT_COMPRESSION) != Z_OK)
    throw std::runtime_error("zlib can't compress");
  out.resize(size);
  return out;
}

std::string block_message(const Ground& ground, const Coord3& block, const Mesh& mesh,
                          std::uint32_t view, const Heights& before, const Heights& design,
                          bool soil_moves, const Ground* ground_before) {
  const OrderedMesh ordered(mesh);
  const std::size_t n = ordered.points.size();
  std::string out;
  for (const int first : {block.x(), block.y(), block.z()})
    put(out, static_cast<std::int32_t>(first));
  put(out, view);
  put(out, resident_chunks_of(ground, block));
  put(out, static_cast<std::uint32_t>(n));
  put(out, static_cast<std::uint32_t>(mesh.triangles.size()));
  put(out, std::uint32_t{design ? 1U : 0U});
  if (n == 0) return deflated(out);

  std::vector<Vec3> points;
  points.reserve(n);
  std::vector<std::uint16_t> values(n);
  for (int axis = 0; axis < 3; ++axis) {
    const double first = kPerVoxel * (block[axis] - kMargin);
    for (std::size_t i = 0; i < n; ++i) {  // rounds first, so that neighbours round alike
      const double voxels = double{ordered.points[i][axis]} / ground.voxel_size_m();
      const double q = kStep * std::round(kPerVoxel / kStep * voxels);
      values[i] = static_cast<std::uint16_t>(std::clamp(q - first, 0.0, 65535.0));
    }
    put_array(out, values);
  }
  for (const Eigen::Vector3f& p : ordered.points)
    points.emplace_back(ground.origin() + p.cast<double>());
  std::vector<std::uint16_t> changes = above(points, before);
  if (ground_before != nullptr) {
    // A vertex of a steep wall is not at its column's top, even without a change.
    Unchanged unchanged(ground, *ground_before);
    for (std::size_t i = 0; i < n; ++i)
      if (changes[i] != kNoHeight &&
          unchanged.at(ordered.points[i].cast<double>() / ground.voxel_size_m()))
        changes[i] = 0;
  }
  put_array(out, changes);
  if (design) put_array(out, above(points, design));
  for (std::size_t i = 0; i < n; ++i)
    values[i] =
        soil_moves
            ? static_cast<std::uint16_t>(257 * std::lround(255 * io::looseness(ground, points[i])))
            : std::uint16_t{0};
  put_array(out, values);
  put_numbers(out, ordered.corners, n > std::numeric_limits<std::uint16_t>::max() ? 4 : 2);
  return deflated(out);
}

}  // namespace soilvdb::tools
