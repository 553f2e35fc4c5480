// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/io/level_set_file.h"

#include <fmt/format.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "io/file/text.h"
#include "soilvdb/ground_grids.h"

namespace soilvdb::inline v0::io {
namespace {

using openvdb::Coord;
using openvdb::FloatGrid;
using Leaf = openvdb::FloatTree::LeafNodeType;

constexpr const char* kMakeLevelSet =
    "a closed level set of the ground would do (Houdini: VDB from Polygons, or Convert VDB with "
    "Fog "
    "to SDF; Blender: Mesh to SDF Grid)";

std::string described(const openvdb::GridBase& grid) {
  return fmt::format("'{}' ({}, {})", printable(grid.getName()),
                     openvdb::GridBase::gridClassToString(grid.getGridClass()), grid.valueType());
}

/// The only function that reads a foreign file.
/// @param several set if the file has other level sets
FloatGrid::Ptr read_grid(const std::filesystem::path& file, const std::string& name,
                         bool& several) {
  openvdb::initialize();
  openvdb::io::File vdb(file.string());
  vdb.open(/*delayLoad=*/false);
  const openvdb::GridPtrVecPtr grids = vdb.readAllGridMetadata();
  std::vector<std::string> names;  // of level sets
  std::string found;
  for (const openvdb::GridBase::Ptr& grid : *grids) {
    found += (found.empty() ? "" : ", ") + described(*grid);
    if (!grid->isType<FloatGrid>() || grid->getGridClass() != openvdb::GRID_LEVEL_SET) continue;
    names.push_back(grid->getName());
  }
  if (names.empty()) {
    throw InputError(file, fmt::format("has no float grid of class level set, only {}; {}",
                                       found.empty() ? "no grids at all" : found, kMakeLevelSet));
  }
  const auto count = [&](const std::string& n) {
    return std::count(names.begin(), names.end(), n);
  };
  if (!name.empty() && count(name) == 0) {
    throw InputError(file, fmt::format("has no level set '{}'; there {} {}", printable(name),
                                       names.size() == 1 ? "is" : "are", quoted_list(names)));
  }
  const std::string chosen = !name.empty()             ? name
                             : count(kSurfaceGrid) > 0 ? kSurfaceGrid
                                                       : names.front();
  if (count(chosen) > 1) {
    throw InputError(file, fmt::format("has {} level sets '{}'; give each a name of its own",
                                       count(chosen), printable(chosen)));
  }
  if (name.empty() && chosen != kSurfaceGrid && names.size() > 1) {
    throw InputError(file,
                     fmt::format("has several level sets, {}; choose one, as in "
                                 "{{level_set: {}, grid: {}}}",
                                 quoted_list(names), file.filename().string(), printable(chosen)));
  }
  several = names.size() > 1;
  const auto grid = openvdb::gridPtrCast<FloatGrid>(vdb.readGrid(chosen));
  if (!grid) throw std::runtime_error("its grid is not of the type its header names");
  return grid;
}

void check_transform(const std::filesystem::path& file, const FloatGrid& grid) {
  if (!grid.transform().isLinear()) {
    throw InputError(file, "has a frustum transform; a linear one with cubic voxels would do");
  }
  const openvdb::Mat4d m = grid.transform().baseMap()->getAffineMap()->getMat4();
  const double h = m[0][0];
  bool cubic = std::isfinite(h) && h > 0;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) cubic &= std::abs(m[i][j] - (i == j ? h : 0)) <= 1e-6 * h;
    cubic &= std::abs(m[3][i]) < 1e12;
  }
  if (cubic) return;
  const openvdb::Vec3d size = grid.voxelSize();
  throw InputError(
      file,
      fmt::format("grid {} is turned, mirrored or stretched (voxels of {:g} x {:g} x {:g} m); "
                  "resample it to cubic voxels along the axes",
                  described(grid), size.x(), size.y(), size.z()));
}

/// Does soil meet air here although not both have a distance? The surface is missing there.
bool torn(float a, bool a_known, float b, bool b_known) {
  return (a < 0) != (b < 0) && !(a_known && b_known);
}

/// The first voxel of a leaf with a missing surface to a neighbour; Leaf::SIZE if none.
openvdb::Index hole(const Leaf& leaf, const FloatGrid::ConstUnsafeAccessor& values) {
  constexpr openvdb::Index kStep[3] = {64, 8, 1};  // to the next voxel along x, y, z
  for (openvdb::Index n = 0; n < Leaf::SIZE; ++n) {
    const float value = leaf.getValue(n);
    const bool known = leaf.isValueOn(n);
    for (int axis = 0; axis < 3; ++axis) {
      const openvdb::Index at = n / kStep[axis] % Leaf::DIM;
      if (at + 1 < Leaf::DIM) {
        const openvdb::Index next = n + kStep[axis];
        if (torn(value, known, leaf.getValue(next), leaf.isValueOn(next))) return n;
      }
      for (const int side : {-1, 1}) {
        if (at != (side < 0 ? 0 : Leaf::DIM - 1)) continue;
        Coord beyond = leaf.offsetToGlobalCoord(n);
        beyond[axis] += side;
        float next;
        const bool next_known = values.probeValue(beyond, next);
        if (torn(value, known, next, next_known)) return n;
      }
    }
  }
  return Leaf::SIZE;
}

/// The first place with a missing surface, in the order of leaves.
std::optional<Coord> hole(const FloatGrid& grid) {
  std::vector<const Leaf*> leaves;
  grid.tree().getNodes(leaves);
  using Range = tbb::blocked_range<std::size_t>;
  const std::size_t none = leaves.size();
  const std::size_t first = tbb::parallel_reduce(
      Range(0, none, 64), none,
      [&](const Range& range, std::size_t found) {
        const auto values = grid.getConstUnsafeAccessor();
        for (std::size_t i = range.begin(); i < range.end() && found == none; ++i) {
          if (hole(*leaves[i], values) < Leaf::SIZE) found = i;
        }
        return found;
      },
      [](std::size_t a, std::size_t b) { return std::min(a, b); });
  if (first == none) return std::nullopt;
  return leaves[first]->offsetToGlobalCoord(hole(*leaves[first], grid.getConstUnsafeAccessor()));
}

void check_values(const std::filesystem::path& file, const FloatGrid& grid) {
  if (grid.activeVoxelCount() == 0) throw InputError(file, "is empty: it has no active voxels");
  const float background = grid.background();
  if (!(std::isfinite(background) && background > 0)) {
    throw InputError(file, fmt::format("grid {} has background {:g}; a level set's is its band's "
                                       "half width, above 0, and values are negative in soil",
                                       described(grid), background));
  }
  bool finite = true, soil = false;
  for (auto leaf = grid.tree().cbeginLeaf(); leaf; ++leaf) {
    for (openvdb::Index n = 0; n < Leaf::SIZE; ++n) {
      finite &= std::isfinite(leaf->getValue(n));
      soil |= leaf->getValue(n) < 0;
    }
  }
  if (!finite) throw InputError(file, "has values that are not numbers; write it anew");
  if (!soil) throw InputError(file, "has no soil: no value is negative, as in soil they must be");
  if (const auto c = hole(grid)) {
    const openvdb::Vec3d p = grid.indexToWorld(*c);
    throw InputError(file, fmt::format("is not closed: its surface is missing at x {:g}, y {:g}, z "
                                       "{:g} of its own coordinates; {}",
                                       p.x(), p.y(), p.z(), kMakeLevelSet));
  }
}

}  // namespace

LevelSetInput read_level_set(const std::filesystem::path& file, const std::string& name) {
  check_readable(file);
  FloatGrid::Ptr grid;
  bool several = false;
  try {
    grid = read_grid(file, name, several);
  } catch (const InputError&) {
    throw;
  } catch (const std::bad_alloc&) {
    throw InputError(file, "is damaged, or needs more memory than there is");
  } catch (const std::exception& error) {
    throw InputError(file,
                     fmt::format("is not a .vdb file or is damaged ({})", printable(error.what())));
  }
  check_transform(file, *grid);
  check_values(file, *grid);
  LevelSetInput input;
  if (several) input.grid = grid->getName();
  Vec3 origin = Vec3::Zero();
  if (const auto at = grid->getMetadata<openvdb::Vec3DMetadata>(kOriginKey)) {
    origin = {at->value().x(), at->value().y(), at->value().z()};
  }
  if (const auto crs = grid->getMetadata<openvdb::StringMetadata>(kCrsKey)) {
    input.crs_wkt = crs->value();
  }
  const openvdb::CoordBBox box = grid->evalActiveVoxelBoundingBox();
  const openvdb::Vec3d low = grid->indexToWorld(box.min()), high = grid->indexToWorld(box.max());
  input.bounds = {origin + Vec3(low.x(), low.y(), low.z()),
                  origin + Vec3(high.x(), high.y(), high.z())};
  input.surface = make_level_set_surface(std::move(grid), origin);
  return input;
}

}  // namespace soilvdb::inline v0::io
