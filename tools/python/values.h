// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The parts of a site as Python values.
#pragma once

#include <pybind11/pybind11.h>

#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "soilvdb/session.h"

namespace soilvdb::python {

struct TerrainValue {
  io::Terrain terrain;
  std::string text;  ///< its repr

  /// Its heights, opened once for all copies. Needs no lock of the interpreter. @throw as
  /// io::open_base()
  const InitialTerrain& surface() const;

  struct Opened {
    std::once_flag once;
    std::shared_ptr<const InitialTerrain> surface;
  };
  std::shared_ptr<Opened> opened = std::make_shared<Opened>();
};
TerrainValue plane(double z, const Vec2& slope);
TerrainValue raster(const std::filesystem::path& file);
/// @param source a file, or an array with its origin and cell
TerrainValue raster(const pybind11::object& source, const pybind11::object& origin,
                    const pybind11::object& cell);
TerrainValue snapshot(const std::filesystem::path& file);

/// A machine, and the source of its chain.
struct MachineValue {
  MachineValue(const Bucket& bucket, std::string name, std::optional<std::filesystem::path> file,
               std::string link_name, const Pose& world_from_root, const Pose& link_from_bucket);
  SiteMachine machine;
  std::optional<std::filesystem::path> urdf;
  std::string link;
  Pose base, lip;
};

void bind_values(pybind11::module_& m);
void bind_site(pybind11::module_& m);
void bind_files(pybind11::module_& m);
/// Replaces pybind11's long messages about wrong arguments by one line, in all functions of the
/// module. @pre everything is bound
void explain_wrong_calls(pybind11::module_& m);

}  // namespace soilvdb::python
