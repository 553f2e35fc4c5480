// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Input files as arrays: motions of a scenario, rasters, scans.
#include <fmt/format.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "soilvdb/io/point_cloud.h"
#include "soilvdb/io/raster.h"
#include "soilvdb/io/scenario.h"
#include "tools/python/arguments.h"
#include "tools/python/interpreter.h"
#include "tools/python/values.h"

namespace soilvdb::python {
namespace {

/// The rows of a machine's motion that a run follows.
struct Rows {
  std::vector<double> times_s, values, turns, bases;
  bool by_joints = false;
};

/// @param until_s time at which all machines stop
Rows rows_of(const io::MotionFile& file, double until_s) {
  Rows rows;
  for (std::size_t part = 0; part < file.parts(); ++part) {
    const std::shared_ptr<const Motion> motion = file.part(part);
    const std::size_t joints = motion->chain().movable_count();
    rows.by_joints = motion->poses().empty();
    for (std::size_t i = part == 0 ? 0 : 1; i < motion->times_s().size(); ++i) {  // parts join
      if (motion->times_s()[i] > until_s) return rows;
      rows.times_s.push_back(motion->times_s()[i]);
      if (rows.by_joints) {
        const std::span<const double> row = motion->configuration(i);
        const auto base = row.begin() + static_cast<std::ptrdiff_t>(joints);
        rows.values.insert(rows.values.end(), row.begin(), base);
        rows.bases.insert(rows.bases.end(), base, row.end());
      } else {
        const Pose& pose = motion->poses()[i];
        rows.values.insert(rows.values.end(), pose.position.begin(), pose.position.end());
        const Eigen::Vector4d turn = pose.rotation.coeffs();
        rows.turns.insert(rows.turns.end(), turn.begin(), turn.end());
      }
    }
  }
  return rows;
}

/// @param count of rows, one or more
Array array(const std::vector<double>& values, std::size_t count) {
  return Array({static_cast<py::ssize_t>(count), static_cast<py::ssize_t>(values.size() / count)},
               values.data());
}

/// (positions, rotations) of poses as in row_of().
py::tuple base_arrays(const std::vector<double>& rows) {
  std::vector<double> positions, turns;
  for (std::size_t i = 0; i < rows.size(); i += kPoseNumbers) {
    positions.insert(positions.end(), &rows[i], &rows[i] + 3);
    turns.insert(turns.end(), &rows[i] + 3, &rows[i] + kPoseNumbers);
  }
  const std::size_t count = rows.size() / kPoseNumbers;
  return py::make_tuple(array(positions, count), array(turns, count));
}

py::dict motions(const std::filesystem::path& scenario) {
  std::vector<std::pair<std::string, Rows>> all;
  {
    const Released released;
    const Inside inside;
    const io::Scenario read = io::read_scenario(scenario, {}, io::Motions::kOptional);
    double until_s = std::numeric_limits<double>::infinity();
    for (const io::MachineInput& machine : read.machines)
      if (machine.motion.stops()) until_s = std::min(until_s, *machine.motion.bad_rows().good_s);
    for (const io::MachineInput& machine : read.machines)
      if (machine.has_motion()) all.emplace_back(machine.name, rows_of(machine.motion, until_s));
  }
  py::dict by_name;
  for (const auto& [name, rows] : all) {
    py::dict one;
    one["times"] = Array(static_cast<py::ssize_t>(rows.times_s.size()), rows.times_s.data());
    const std::size_t count = rows.times_s.size();
    one[rows.by_joints ? "joints" : "positions"] = array(rows.values, count);
    if (!rows.by_joints) one["rotations"] = array(rows.turns, count);
    if (!rows.bases.empty()) one["base"] = base_arrays(rows.bases);
    by_name[py::str(name)] = one;
  }
  return by_name;
}

/// Messages about motions that end at bad rows.
std::vector<std::string> bad_rows(const std::filesystem::path& scenario) {
  const Released released;
  const Inside inside;
  const io::Scenario read = io::read_scenario(scenario, {}, io::Motions::kOptional);
  std::vector<std::string> why;
  for (const io::MachineInput& machine : read.machines)
    if (machine.motion.stops()) why.push_back(machine.motion.bad_rows().first);
  return why;
}

/// The range of posts along an axis within [low, high], with one more on either side.
std::pair<int, int> posts(double first, double spacing, int count, double low, double high) {
  const double most = count - 1;
  const double from = std::clamp(std::floor((low - first) / spacing), 0.0, most);
  const double to = std::clamp(std::ceil((high - first) / spacing), 0.0, most);
  return {static_cast<int>(from), static_cast<int>(to)};
}

py::tuple read_raster(const std::filesystem::path& file, const py::object& box) {
  double sides[4] = {
      -std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity(),
      std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
  if (!box.is_none()) {
    numbers(box, "box", sides);
    if (!(sides[0] <= sides[2] && sides[1] <= sides[3]))
      throw py::value_error("box must be (xmin, ymin, xmax, ymax)");
  }
  io::RasterInput raster;
  std::vector<float> heights;
  int nx = 0, ny = 0;
  Vec2 first;
  {
    const Released released;
    const Inside inside;
    raster = io::open_raster(file);
    const HeightGrid& grid = raster.grid;
    const auto [x0, x1] = posts(grid.first.x(), grid.spacing.x(), grid.nx, sides[0], sides[2]);
    const auto [y0, y1] = posts(grid.first.y(), grid.spacing.y(), grid.ny, sides[1], sides[3]);
    nx = x1 - x0 + 1;
    ny = y1 - y0 + 1;
    if (static_cast<double>(nx) * ny > io::kMostRasterCells)
      throw std::runtime_error(
          fmt::format("{}: has {} x {} heights there; a box with at most {:.0e} would do",
                      file.string(), nx, ny, io::kMostRasterCells));
    heights.resize(static_cast<std::size_t>(nx) * static_cast<std::size_t>(ny));
    raster.source->read(x0, y0, nx, ny, heights.data());
    first = grid.first + grid.spacing.cwiseProduct(Vec2(x0, y0));
  }
  warn(raster.warnings);
  return py::make_tuple(
      py::array_t<float>({static_cast<py::ssize_t>(ny), static_cast<py::ssize_t>(nx)},
                         heights.data()),
      py::make_tuple(first.x(), first.y()),
      py::make_tuple(raster.grid.spacing.x(), raster.grid.spacing.y()), raster.crs_wkt);
}

void write_raster(const std::filesystem::path& file, const py::object& heights,
                  const py::object& first, const py::object& spacing, const std::string& crs,
                  const std::string& band) {
  const Array given = array_of(heights, "heights");
  if (given.ndim() != 2 || given.shape(0) < 2 || given.shape(1) < 2 ||
      static_cast<double>(given.size()) > io::kMostRasterCells)
    throw py::value_error("heights must have the shape (ny, nx), each 2 or more, 1e8 in all");
  HeightGrid grid{static_cast<int>(given.shape(1)), static_cast<int>(given.shape(0))};
  numbers(first, "first", {grid.first.data(), 2});
  numbers(spacing, "spacing", {grid.spacing.data(), 2});
  if (!grid.first.allFinite() || !(grid.spacing.minCoeff() > 0) || !grid.spacing.allFinite())
    throw py::value_error("first must be finite, and spacing more than 0");
  std::vector<io::RasterBand> bands{{band, {given.data(), given.data() + given.size()}}};
  const Released released;
  const Inside inside;
  io::write_geotiff(file, grid, bands, crs);
}

Array points(const std::filesystem::path& file) {
  io::PointCloud cloud;
  {
    const Released released;
    const Inside inside;
    cloud = io::read_points(file);
  }
  Array array({static_cast<py::ssize_t>(cloud.points_m.size()), py::ssize_t{3}});
  for (std::size_t i = 0; i < cloud.points_m.size(); ++i)
    std::copy(cloud.points_m[i].begin(), cloud.points_m[i].end(), array.mutable_data(i, 0));
  return array;
}

}  // namespace

void bind_files(py::module_& m) {
  m.def("_bad_rows", &bad_rows, py::arg("scenario"));
  m.def("motions", &motions, py::arg("scenario"),
        "Returns the rows that `soilvdb run` follows, by the name of each machine with a motion. "
        "Each is a dict of times (N,), s, and either joints (N, k), rad or m, or positions (N, 3), "
        "m, and rotations (N, 4) x, y, z, w; with joints also base, positions and rotations in a "
        "tuple, if the machine drives. Site.update_path() takes them: site.update_path(name, "
        "**motions[name]). Raises ValueError with the program's message.");
  m.def("points", &points, py::arg("file"),
        "Reads the points of a scan: (N, 3) float64, m, in the file's frame and order. file: PLY "
        "or PCD, text or binary; LAS 1.0 to 1.4; or text with columns named x, y, z, or else these "
        "three first. The content gives the format. Points without a return are left out: those "
        "with a coordinate that is not finite, and except in LAS those at (0, 0, 0). Raises "
        "ValueError with the line or byte for a file that is wrong or truncated; for LAZ and E57 "
        "with the way to convert them.");
  m.def("read_raster", &read_raster, py::arg("file"), py::arg("box") = py::none(),
        "Reads a file that soilvdb.raster() takes: (heights, first, spacing, crs). heights: (ny, "
        "nx) float32, m, NaN where there is no height; row 0 has the lowest y. first: (x, y) of "
        "heights[0, 0]. spacing: (dx, dy), m. crs: WKT, empty if it is not known. box: the part to "
        "read, (xmin, ymin, xmax, ymax). Raises ValueError for a file that is not a raster of "
        "heights.");
  m.def("write_raster", &write_raster, py::arg("file"), py::arg("heights"), py::arg("first"),
        py::arg("spacing"), py::arg("crs") = "", py::arg("band") = "surface",
        "Writes a GeoTIFF of 32-bit floats, completely or not at all. read_raster() returns these "
        "arguments, except band: the band's name. Raises RuntimeError if it cannot write the "
        "file.");
}

}  // namespace soilvdb::python
