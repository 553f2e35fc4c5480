// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Looking at the ground from Python: heights, maps, volumes.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <limits>
#include <string_view>

#include "soilvdb/boundary_volume.h"
#include "tools/python/site.h"
#include "tools/python/values.h"

namespace soilvdb::python {
namespace {

/// @param heights_of fills heights of a session at places
template <typename F>
Array heights(Site& site, const py::object& xy, const F& heights_of) {
  const std::vector<Vec2> at = places(xy, "xy");
  const std::size_t count = at.size();
  Array out(static_cast<py::ssize_t>(count));
  const std::span<double> heights_m(out.mutable_data(), count);
  site.with([&](Session& session) {
    constexpr std::size_t kPiece = 1 << 18;  // some tens of milliseconds
    for (std::size_t from = 0; from < count; from += kPiece) {
      if (from > 0) handle_signals();
      const std::size_t piece = std::min(kPiece, count - from);
      heights_of(session, std::span(at).subspan(from, piece), heights_m.subspan(from, piece));
    }
  });
  return out;
}

/// Rows and columns of a map. @throw py::type_error, py::value_error for other than two whole
/// numbers
std::array<py::ssize_t, 2> shape_of(const py::object& given) {
  const auto message = [&] {
    std::string shown = py::repr(given);
    if (shown.size() > 60 || shown.find('\n') != std::string::npos)
      shown = py::cast<std::string>(py::type::of(given).attr("__name__"));
    return "shape must be (ny, nx), two whole numbers, not " + shown;
  };
  const auto numbers = py::reinterpret_steal<py::tuple>(PySequence_Tuple(given.ptr()));
  if (!numbers) {
    PyErr_Clear();
    throw py::type_error(message());
  }
  if (numbers.size() != 2) throw py::value_error(message());
  std::array<py::ssize_t, 2> shape;
  for (std::size_t i = 0; i < 2; ++i) {
    const py::object one = numbers[i];
    shape[i] = PyNumber_AsSsize_t(one.ptr(), nullptr);  // the nearest, if it has no room
    if (PyErr_Occurred() == nullptr && !PyBool_Check(one.ptr())) continue;
    PyErr_Clear();
    throw py::type_error(message());
  }
  constexpr py::ssize_t kMost = 1 << 16;
  if (std::min(shape[0], shape[1]) < 1 || std::max(shape[0], shape[1]) > kMost)
    throw py::value_error(
        fmt::format("shape is ({}, {}); each must be from 1 to {}", shape[0], shape[1], kMost));
  return shape;
}

/// What a height map is asked for.
struct MapRequest {
  MapGrid grid;                   ///< its place and axis unless `machine` says them
  std::vector<MapGrid> of_sites;  ///< where each site has its own
  std::optional<MachineName> machine;
  bool turned = true;
  MapLayer layer = MapLayer::kHeight;
  std::optional<double> ceiling;
  std::optional<TerrainValue> design;

  MapRequest(const std::optional<MachineName>& around, const py::object& origin,
             const py::object& matrix, const py::object& shape, double cell, bool turn,
             const std::string& name, std::optional<double> below,
             const std::optional<TerrainValue>& wanted, std::optional<std::size_t> sites = {})
      : machine(around), turned(turn), ceiling(below), design(wanted) {
    if (machine.has_value() + !origin.is_none() + !matrix.is_none() != 1)
      throw py::type_error("give one of machine, pose or origin");
    const auto [rows, columns] = shape_of(shape);
    constexpr const char* kNames[] = {"height", "loose", "dug", "design"};
    const auto* found = std::find(std::begin(kNames), std::end(kNames), name);
    if (found == std::end(kNames))
      throw py::value_error("layer is '" + name +
                            "'; it must be 'height', 'loose', 'dug' or 'design'");
    layer = static_cast<MapLayer>(found - std::begin(kNames));
    grid.ny = static_cast<int>(rows);
    grid.nx = static_cast<int>(columns);
    grid.cell_m = cell;
    if (!origin.is_none()) numbers(origin, "origin", {grid.first_m.data(), 2});
    if (matrix.is_none()) return;
    const auto around_pose = [&](const Pose& at) {
      return MapGrid::around(at.position.head<2>(), cell, grid.nx, grid.ny, turned ? &at : nullptr);
    };
    const Array given = array_of(matrix, "pose");
    if (!sites || given.ndim() != 3) {
      grid = around_pose(pose(py::none(), py::none(), given));
      return;
    }
    if (static_cast<std::size_t>(given.shape(0)) != *sites || given.shape(1) != 4 ||
        given.shape(2) != 4)
      throw py::value_error(fmt::format("pose has the shape {}; it must be (4, 4) or ({}, 4, 4)",
                                        py::cast<std::string>(py::str(given.attr("shape"))),
                                        *sites));
    for (std::size_t i = 0; i < *sites; ++i) {
      try {
        of_sites.push_back(around_pose(pose_of({given.data() + 16 * i, 16})));
      } catch (const py::value_error& e) {
        throw py::value_error(fmt::format("site {}: {}", i, e.what()));
      }
    }
  }

  const InitialTerrain* wanted() const { return design ? &design->surface() : nullptr; }
  bool has_place(Session& session) const {
    return !machine || session.last(machine_of(session, *machine));
  }
  /// @param i number of the site @throw std::invalid_argument without a place
  MapGrid of(Session& session, std::size_t i = 0) const {
    if (!machine) return of_sites.empty() ? grid : of_sites[i];
    return session.map_around(
        {machine_of(session, *machine), grid.cell_m, grid.nx, grid.ny, turned});
  }
};

/// Fills maps in pieces, between which signals are handled.
/// @param grids of each site; without one its map is NaN
/// @param check takes a site's number and result
template <typename T, typename F>
void fill_maps(const std::vector<Session*>& sessions, const MapRequest& map,
               const std::vector<std::optional<MapGrid>>& grids, std::span<T> values,
               const std::optional<int>& threads, const F& check) {
  constexpr double kPiece = 1 << 22;  // columns of voxels: some tens of milliseconds, once known
  const MapGrid& like = map.grid;
  double columns = 1;  // of a row
  for (Session* session : sessions) {
    const double side = like.cell_m / session->voxel_size_m();
    columns = std::max(columns, like.nx * std::max(1.0, side * side));
  }
  const int most = static_cast<int>(std::clamp(kPiece / columns, 1.0, double(like.ny)));
  const auto width = static_cast<std::size_t>(like.nx), height = static_cast<std::size_t>(like.ny);
  std::vector<LookResult> made(sessions.size());
  for (int row = 0; row < like.ny; row += most) {
    if (row > 0) handle_signals();
    const int rows = std::min(most, like.ny - row);
    const auto look = [&](std::size_t i) {
      const std::span<T> out = values.subspan((i * height + static_cast<std::size_t>(row)) * width,
                                              static_cast<std::size_t>(rows) * width);
      MapGrid piece =
          grids[i].value_or(MapGrid{sessions[i]->origin().template head<2>(), like.cell_m, 1, 1});
      if (grids[i]) {
        piece.first_m = piece.middle_m(row, 0);
        piece.ny = rows;
      }
      made[i] = sessions[i]->height_map(piece, map.layer, grids[i] ? out : out.first(1),
                                        map.ceiling, map.wanted());  // all but its place is right?
      if (!grids[i]) std::fill(out.begin(), out.end(), std::numeric_limits<T>::quiet_NaN());
    };
    const double each = std::max(1.0, kPiece / (columns * rows));
    in_groups(sessions.size(), static_cast<std::size_t>(each), threads,
              [&](std::size_t first, std::size_t last) {
                tbb::parallel_for(first, last, look);
                for (; first < last; ++first) check(first, made[first]);
              });
  }
}

/// An array for results: the caller's, or a new one of doubles. Calls f(its values).
template <typename F>
py::object fill_array(const py::object& given, const std::vector<py::ssize_t>& shape, const F& f) {
  if (given.is_none()) {
    Array made(shape);
    f(std::span<double>(made.mutable_data(), static_cast<std::size_t>(made.size())));
    return made;
  }
  py::object view = given;
  if (!py::isinstance<py::array>(given))
    view = py::module_::import("soilvdb._arrays").attr("view_of")(given);
  const bool is_array = py::isinstance<py::array>(view);
  py::array out;
  if (is_array) out = py::reinterpret_borrow<py::array>(view);
  const bool is_float = py::isinstance<py::array_t<float>>(view);
  std::string fault;
  if (!is_array)
    fault = "is a " + py::cast<std::string>(py::type::of(given).attr("__name__"));
  else if (py::hasattr(view, "mask"))
    fault = "is a masked array";
  else if (!is_float && !py::isinstance<py::array_t<double>>(out))
    fault = "has the type " + py::cast<std::string>(py::str(out.dtype()));
  else if (!std::equal(shape.begin(), shape.end(), out.shape(), out.shape() + out.ndim()))
    fault = "has the shape " + py::cast<std::string>(py::str(out.attr("shape")));
  else if (!out.writeable())
    fault = "is read-only";
  else if ((out.flags() & py::array::c_style) == 0)
    fault = "is not C-contiguous";
  else if ((out.flags() & py::detail::npy_api::NPY_ARRAY_ALIGNED_) == 0)
    fault = "is not aligned";
  if (!fault.empty())
    throw py::value_error(
        fmt::format("out must be a writable C-contiguous array of float32 or float64 with the "
                    "shape ({}); this one {}",
                    fmt::join(shape, ", "), fault));
  const auto count = static_cast<std::size_t>(out.size());
  if (is_float)
    f(std::span<float>(static_cast<float*>(out.mutable_data()), count));
  else
    f(std::span<double>(static_cast<double*>(out.mutable_data()), count));
  return given;
}

py::object height_map(Site& site, const std::optional<MachineName>& machine,
                      const py::object& origin, const py::object& matrix, const py::object& shape,
                      double cell, bool turned, const std::string& layer,
                      std::optional<double> ceiling, const std::optional<TerrainValue>& design,
                      const py::object& out) {
  const MapRequest map(machine, origin, matrix, shape, cell, turned, layer, ceiling, design);
  return fill_array(out, {map.grid.ny, map.grid.nx}, [&](auto values) {
    site.with([&](Session& session) {
      fill_maps({&session}, map, {map.of(session)}, values, {},
                [](std::size_t, LookResult& made) { made.check(); });
    });
  });
}

/// A map of each of many sites.
py::object maps_of_sites(const py::object& given, const std::optional<MachineName>& machine,
                         const py::object& origin, const py::object& matrix,
                         const py::object& shape, double cell, bool turned,
                         const std::string& layer, std::optional<double> ceiling,
                         const std::optional<TerrainValue>& design, const py::object& out,
                         const std::optional<int>& threads) {
  const py::tuple kept = several(given, "sites", "soilvdb.Site");
  const std::vector<Site*> sites = sites_of(kept);
  const MapRequest map(machine, origin, matrix, shape, cell, turned, layer, ceiling, design,
                       sites.size());
  const auto count = static_cast<py::ssize_t>(sites.size());
  return fill_array(out, {count, map.grid.ny, map.grid.nx}, [&](auto values) {
    with_all(sites, [&](const std::vector<Session*>& sessions) {
      std::vector<std::optional<MapGrid>> grids(sessions.size());
      for (std::size_t i = 0; i < sessions.size(); ++i)
        of_site(i, [&] {
          if (map.has_place(*sessions[i])) grids[i] = map.of(*sessions[i], i);
        });
      fill_maps(sessions, map, grids, values, threads, [](std::size_t i, LookResult& made) {
        if (!made.ok()) made.why = fmt::format("site {}: {}", i, made.why);
        made.check();
      });
    });
  });
}

/// @param directions (..., 3). @return (...)
Array cast(Site& site, const py::object& origins, const py::object& directions) {
  const auto points = [](const py::object& given, const char* name) {
    Array array = array_of(given, name);
    if (array.ndim() < 1 || array.shape(array.ndim() - 1) != 3)
      throw py::value_error(std::string(name) + " must have the shape (..., 3)");
    return array;
  };
  const Array from = points(origins, "origins"), to = points(directions, "directions");
  if (from.ndim() > 1 &&
      !std::equal(from.shape(), from.shape() + from.ndim(), to.shape(), to.shape() + to.ndim()))
    throw py::value_error("origins must have the shape (3,), or that of directions");
  Array ranges(std::vector<py::ssize_t>(to.shape(), to.shape() + to.ndim() - 1));
  const auto vectors = [](const Array& array) {
    static_assert(sizeof(Vec3) == 3 * sizeof(double));
    return std::span(reinterpret_cast<const Vec3*>(array.data()),
                     static_cast<std::size_t>(array.size() / 3));
  };
  const std::span<const Vec3> begins = vectors(from), ways = vectors(to);
  const std::span<double> out(ranges.mutable_data(), ways.size());
  site.with([&](Session& session) {
    constexpr std::size_t kPiece = 1 << 20;  // some tenths of a second
    for (std::size_t at = 0; at < ways.size(); at += kPiece) {
      if (at > 0) handle_signals();
      const std::size_t piece = std::min(kPiece, ways.size() - at);
      LookResult made = session.cast(begins.size() == 1 ? begins : begins.subspan(at, piece),
                                     ways.subspan(at, piece), out.subspan(at, piece));
      constexpr std::string_view kRay = "ray ";  // and its number in the piece
      if (made.why.starts_with(kRay)) {
        std::size_t end = 0;
        const std::size_t ray = std::stoull(made.why.substr(kRay.size()), &end);
        made.why = fmt::format("ray {}{}", at + ray, made.why.substr(kRay.size() + end));
      }
      made.check();
    }
  });
  return ranges;
}

/// What was dug and filled inside a boundary.
BoundaryVolume volume(Site& site, const py::object& boundary,
                      const std::optional<TerrainValue>& design, bool sigma) {
  const std::vector<Vec2> corners = places(boundary, "boundary");
  if (corners.size() < 3) throw py::value_error("boundary must have 3 corners or more");
  for (std::size_t i = 0; i < corners.size(); ++i)
    if (!corners[i].allFinite())
      throw py::value_error(fmt::format("boundary: corner {} is not finite", i));
  return site.with([&](Session& session) {
    return session.volume(corners, design ? &design->surface() : nullptr, sigma);
  });
}

py::object or_none(const std::optional<ToDesign>& left, double ToDesign::*volume) {
  return left && left->area_m2 > 0 ? py::object(py::float_((*left).*volume)) : py::none();
}

void bind_volume(py::class_<Site>& site, py::module_& m) {
  py::class_<BoundaryVolume>(m, "Volume", "Volumes inside a boundary, in place, m3.")
      .def_readonly("cut_m3", &BoundaryVolume::cut_m3, "removed from the terrain")
      .def_readonly("fill_m3", &BoundaryVolume::fill_m3, "added to the terrain")
      .def_readonly("net_m3", &BoundaryVolume::net_m3, "fill less cut")
      .def_readonly("error_m3", &BoundaryVolume::error_m3, "error bound of cut, and of fill")
      .def_readonly("area_m2", &BoundaryVolume::area_m2, "area of the boundary that has ground")
      .def_property_readonly(
          "design_area_m2",
          [](const BoundaryVolume& v) { return or_none(v.to_design, &ToDesign::area_m2); },
          "area where both ground and design are known, m2; None without any")
      .def_property_readonly(
          "to_cut_m3",
          [](const BoundaryVolume& v) { return or_none(v.to_design, &ToDesign::cut_m3); },
          "soil above the design where both are known; None without a design there")
      .def_property_readonly(
          "to_fill_m3",
          [](const BoundaryVolume& v) { return or_none(v.to_design, &ToDesign::fill_m3); },
          "room below the design where both are known; None without a design there")
      .def_readonly(
          "sigma_m3", &BoundaryVolume::sigma_m3,
          "standard deviation of net_m3 by what is known of the machines' lips and by scans; "
          "None unless it was asked for")
      .def(py::pickle(
          [](const BoundaryVolume& v) {
            const ToDesign left = v.to_design.value_or(ToDesign{});
            return std::tuple(v.cut_m3, v.fill_m3, v.net_m3, v.error_m3, v.area_m2, v.off_site_m2,
                              v.to_design.has_value(), left.area_m2, left.cut_m3, left.fill_m3,
                              v.sigma_m3);
          },
          [](const std::tuple<double, double, double, double, double, double, bool, double, double,
                              double, std::optional<double>>& t) {
            const auto& [cut, fill, net, error, area, off, has, to_area, to_cut, to_fill, sigma] =
                t;
            BoundaryVolume v{cut, fill, net, error, area, off, {}, sigma};
            if (has) v.to_design = {to_area, to_cut, to_fill};
            return v;
          }))
      .def("__repr__", [](const BoundaryVolume& v) {
        return fmt::format("soilvdb.Volume(cut_m3={:.6g}, fill_m3={:.6g}, area_m2={:.6g}{})",
                           v.cut_m3, v.fill_m3, v.area_m2,
                           v.sigma_m3 ? fmt::format(", sigma_m3={:.2g}", *v.sigma_m3) : "");
      });
  site.def(
      "volume", &volume, py::arg("boundary"), py::kw_only(), py::arg("design") = py::none(),
      py::arg("sigma") = false,
      "Cut and fill inside a boundary against the terrain, counted sample by sample. boundary: "
      "corners (N, 2), m, world; the last connects to the first. Parts of an area sum to the "
      "whole. design: a Terrain; then to_cut_m3 and to_fill_m3 say what is left to do, summed "
      "over at most 250 000 places, and where ground changed over a place in each voxel's column, "
      "at most a million. sigma: then sigma_m3 says how well net_m3 is known. Raises "
      "ValueError if sides of the boundary cross, or "
      "without any ground inside.");
}

}  // namespace

void bind_looks(py::class_<Site>& site, py::module_& m) {
  const auto none = py::none();
  site.def(
          "heights",
          [](Site& s, const py::object& xy, bool sigma,
             std::optional<double> ceiling) -> py::object {
            if (sigma && ceiling)
              throw py::value_error(
                  "sigma is that of the surface without a ceiling; give either sigma or ceiling");
            Array z = heights(s, xy, [&](Session& session, auto places, auto heights_m) {
              session.heights(places, heights_m, ceiling).check();
            });
            if (!sigma) return z;
            return py::make_tuple(z, heights(s, xy, [](Session& session, auto places, auto sigmas) {
                                    session.sigmas(places, sigmas);
                                  }));
          },
          py::arg("xy"), py::kw_only(), py::arg("sigma") = false, py::arg("ceiling") = none,
          "The surface at points xy (N, 2), m, world: (N,) float64, NaN where there is no ground. "
          "It "
          "comes straight from the soil's samples: the terrain's own height where nothing was "
          "moved, "
          "else linear between the middles of columns of voxels. On even cuts it errs by some "
          "hundredths of a voxel, beside a wall by as much as that is high. Under a roof the "
          "topmost "
          "soil counts. Take heights() for the ground at a point; for volumes, and for maps, take "
          "height_map(), whose cells have the mean height of their soil. ceiling: only soil below "
          "this height counts, to the voxel: the floor of a tunnel or the ground under a bucket; "
          "then nothing is kept for the next look. "
          "After an update one costs some microseconds, each of many some tens of ns. With sigma a "
          "pair: "
          "heights, and their standard deviations by what is known of the machines' lips and by "
          "scans, see scan(). sigma and ceiling do not go together.")
      .def(
          "mesh_heights",
          [](Site& s, const py::object& xy) {
            return heights(s, xy, [](Session& session, auto places, auto heights_m) {
              session.mesh_heights(places, heights_m);
            });
          },
          py::arg("xy"),
          "As heights(), on the surface of mesh(): for pictures. It meshes what changed since the "
          "last call, which takes milliseconds.")
      .def(
          "height_map", &height_map, py::kw_only(), py::arg("machine") = none,
          py::arg("origin") = none, py::arg("pose") = none, py::arg("shape"), py::arg("cell"),
          py::arg("turned") = true, py::arg("layer") = "height", py::arg("ceiling") = none,
          py::arg("design") = none, py::arg("out") = none,
          "Map of square cells, shape (ny, nx), side cell, m: (ny, nx) float64. Give one of: "
          "origin (x, y), the middle of cell [0, 0]; machine, around the middle of its lip; pose, "
          "a 4x4 array, as of a machine there. Around a machine or pose, y is the lip's direction "
          "in plan and x at right angles to it, out of the mouth, unless turned is False; else x "
          "and y are the world's. Columns go on along x, rows along y; half of the map is behind "
          "the lip. layer: 'height', mean height of the topmost soil in a cell, world z; 'loose', "
          "depth of the loose soil; 'dug', depth below the terrain; 'design', height above the "
          "Terrain design: what is to be cut, negative: to be filled; NaN where there is no "
          "ground. "
          "Cells times their area sum to the volume, to the last sample. They do not in a map that "
          "is not along the world's axes, whose cells have means of points; not where the terrain "
          "ends within a cell, which has the mean of the columns that have ground; and not under "
          "roofs, as of a tunnel or over a curled bucket: there only soil above the topmost full "
          "voxel counts. volume() and change_m3() are exact there too. heights() has the surface "
          "at points. ceiling: only soil below this height counts, to the voxel: to look into a "
          "tunnel or under a bucket; nothing is kept for the next look then. out: a float32 or "
          "float64 array to fill and return, C-contiguous. It takes about 10 ns for each column of "
          "voxels that a cell covers. Raises TypeError for none or several of origin, machine and "
          "pose, ValueError for a machine before its first state, a bad out, a layer without its "
          "design, and a place too far from where work began: see near of Site(). Before its first "
          "state a plane without near may be looked at anywhere.");
  site.def(
      "cast", &cast, py::arg("origins"), py::arg("directions"),
      "Distances along rays to the ground, m: as a depth camera or a lidar measures them. "
      "directions: (..., 3), of any length. origins: (3,) or one for each ray, world. Returns "
      "(...) float64: infinity where a ray meets no ground, 0 where it begins below. The surface "
      "is that of heights(); a ray stops at its upright steps. Runs on all cores, some tenths of "
      "a microsecond a ray. Raises ValueError for a direction that is zero or not finite.");
  bind_volume(site, m);
  m.def(
      "height_maps", &maps_of_sites, py::arg("sites"), py::kw_only(), py::arg("machine") = none,
      py::arg("origin") = none, py::arg("pose") = none, py::arg("shape"), py::arg("cell"),
      py::arg("turned") = true, py::arg("layer") = "height", py::arg("ceiling") = none,
      py::arg("design") = none, py::arg("out") = none, py::arg("threads") = none,
      "Site.height_map() of N sites at once: (N, ny, nx) float64, or out, filled. machine, origin "
      "(x, y) and pose (4, 4) are for all sites; pose may also be (N, 4, 4). The map of a site "
      "whose machine has no place yet is NaN. threads: default: all cores. Raises the errors of "
      "Site.height_map() for all sites if one of them can't be looked at, and says which; out has "
      "no meaning then, nor after KeyboardInterrupt.");
}

}  // namespace soilvdb::python
