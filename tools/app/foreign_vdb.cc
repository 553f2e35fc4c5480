// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/app/foreign_vdb.h"

#include <fmt/format.h>
#include <openvdb/openvdb.h>

#include <cmath>

#include "io/file/text.h"
#include "soilvdb/io/error.h"

namespace soilvdb::tools {
namespace {

std::string info_line(const char* label, const std::string& text) {
  return fmt::format("  {:<12}{}\n", label, text);
}

std::string text_of(const openvdb::Vec3d& v) {
  constexpr double kNothing = 1e-9;  // negligible against a voxel's size
  const auto number = [](double x) {
    return fmt::format("{:.9g}", std::abs(x) < kNothing ? 0 : x);
  };
  return fmt::format("{} {} {}", number(v.x()), number(v.y()), number(v.z()));
}

std::string transform_text(const openvdb::math::Transform& transform) {
  if (!transform.isLinear()) return "frustum";
  const openvdb::Vec3d size = transform.voxelSize();
  const std::string voxels = transform.hasUniformScale()
                                 ? fmt::format("voxels of {:.6g}", size.x())
                                 : fmt::format("voxels of {}", text_of(size));
  return fmt::format("{}, index 0 at {}", voxels,
                     text_of(transform.indexToWorld(openvdb::Vec3d())));
}

std::string background_text(const openvdb::GridBase& grid) {
  if (const auto* floats = dynamic_cast<const openvdb::FloatGrid*>(&grid))
    return fmt::format("{:.6g}", floats->background());
  if (const auto* doubles = dynamic_cast<const openvdb::DoubleGrid*>(&grid))
    return fmt::format("{}", doubles->background());
  return "";
}

std::string grid_text(const openvdb::GridBase& grid) {
  std::string text = fmt::format("grid '{}'\n", io::printable(grid.getName()));
  const auto kind = grid.getGridClass();
  text += info_line("class", kind == openvdb::GRID_UNKNOWN
                                 ? "none named"
                                 : openvdb::GridBase::gridClassToString(kind));
  text += info_line("values", grid.valueType());
  text += info_line("transform", transform_text(grid.transform()));
  const openvdb::CoordBBox box = grid.evalActiveVoxelBoundingBox();
  if (box.empty()) {
    text += info_line("active", "nothing");
  } else {
    const openvdb::BBoxd world = grid.transform().indexToWorld(box);
    text += info_line("active", fmt::format("{} voxels, from {} to {}", grid.activeVoxelCount(),
                                            text_of(world.min()), text_of(world.max())));
  }
  if (const std::string background = background_text(grid); !background.empty())
    text += info_line("background", background);
  return text;
}

}  // namespace

std::string foreign_vdb_text(const std::filesystem::path& file) {
  try {
    openvdb::initialize();
    openvdb::io::File vdb(file.string());
    vdb.open(/*delayLoad=*/false);
    const openvdb::GridPtrVecPtr grids = vdb.getGrids();
    // OpenVDB accepts a truncated header as a file without grids.
    if (grids->empty()) throw io::InputError(file, "has no grids, or was cut off; write it anew");
    std::string text = fmt::format("{}: OpenVDB file, not a snapshot of soilvdb, {} grid{}\n",
                                   file.string(), grids->size(), grids->size() == 1 ? "" : "s");
    for (const openvdb::GridBase::Ptr& grid : *grids) text += grid_text(*grid);
    return text;
  } catch (const openvdb::Exception& e) {
    throw io::InputError(
        file, fmt::format("is not a .vdb file or is damaged ({})", io::printable(e.what())));
  }
}

}  // namespace soilvdb::tools
