// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Looking at the ground from Python: heights, maps, volumes.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <cmath>

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
             const py::object& matrix, const std::pair<py::ssize_t, py::ssize_t>& shape,
             double cell, bool turn, const std::string& name, std::optional<double> below,
             const std::optional<TerrainValue>& wanted, std::optional<std::size_t> sites = {})
      : machine(around), turned(turn), ceiling(below), design(wanted) {
    if (machine.has_value() + !origin.is_none() + !matrix.is_none() != 1)
      throw py::type_error("give one of machine, pose or origin");
    constexpr py::ssize_t kMost = 1 << 16;
    if (std::min(shape.first, shape.second) < 1 || std::max(shape.first, shape.second) > kMost)
      throw py::value_error(fmt::format("shape is ({}, {}); each must be from 1 to {}", shape.first,
                                        shape.second, kMost));
    constexpr const char* kNames[] = {"height", "loose", "dug", "design"};
    const auto* found = std::find(std::begin(kNames), std::end(kNames), name);
    if (found == std::end(kNames))
      throw py::value_error("layer is '" + name +
                            "'; it must be 'height', 'loose', 'dug' or 'design'");
    layer = static_cast<MapLayer>(found - std::begin(kNames));
    grid.ny = static_cast<int>(shape.first);
    grid.nx = static_cast<int>(shape.second);
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
  /// @param i number of the site
  MapPlace of(Session& session, std::size_t i = 0) const {
    if (machine)
      return MapAround{machine_of(session, *machine), grid.cell_m, grid.nx, grid.ny, turned};
    return of_sites.empty() ? grid : of_sites[i];
  }
};

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
  py::array out;
  if (py::isinstance<py::array>(view)) out = py::reinterpret_borrow<py::array>(view);
  constexpr int kWanted = int{py::array::c_style} | int{py::detail::npy_api::NPY_ARRAY_ALIGNED_};
  const bool fits = out && (out.flags() & kWanted) == kWanted && out.writeable() &&
                    std::equal(shape.begin(), shape.end(), out.shape(), out.shape() + out.ndim());
  const auto count = static_cast<std::size_t>(out ? out.size() : 0);
  if (fits && py::isinstance<py::array_t<float>>(out)) {
    f(std::span<float>(static_cast<float*>(out.mutable_data()), count));
  } else if (fits && py::isinstance<py::array_t<double>>(out)) {
    f(std::span<double>(static_cast<double*>(out.mutable_data()), count));
  } else {
    throw py::value_error(
        fmt::format("out must be a writable C-contiguous array of float32 or float64 with the "
                    "shape ({})",
                    fmt::join(shape, ", ")));
  }
  return given;
}

using MapShape = std::pair<py::ssize_t, py::ssize_t>;

py::object height_map(Site& site, const std::optional<MachineName>& machine,
                      const py::object& origin, const py::object& matrix, const MapShape& shape,
                      double cell, bool turned, const std::string& layer,
                      std::optional<double> ceiling, const std::optional<TerrainValue>& design,
                      const py::object& out) {
  const MapRequest map(machine, origin, matrix, shape, cell, turned, layer, ceiling, design);
  return fill_array(out, {shape.first, shape.second}, [&](auto values) {
    site.with([&](Session& session) {
      const MapPlace place = map.of(session);
      const auto* const around = std::get_if<MapAround>(&place);
      const MapGrid all = around ? session.map_around(*around) : std::get<MapGrid>(place);
      const double side = all.cell_m / session.voxel_size_m();
      constexpr double kPiece =
          1 << 22;  // columns of voxels: some tens of milliseconds, once known
      const int rows = static_cast<int>(
          std::clamp(kPiece / (all.nx * std::max(1.0, side * side)), 1.0, double(all.ny)));
      for (int from = 0; from < all.ny; from += rows) {
        if (from > 0) handle_signals();
        MapGrid piece = all;
        piece.first_m = all.middle_m(from, 0);
        piece.ny = std::min(rows, all.ny - from);
        const auto cells = static_cast<std::size_t>(all.nx);
        session
            .height_map(piece, map.layer,
                        values.subspan(static_cast<std::size_t>(from) * cells,
                                       static_cast<std::size_t>(piece.ny) * cells),
                        map.ceiling, map.wanted())
            .check();
      }
    });
  });
}

/// A map of each of many sites.
py::object maps_of_sites(const py::object& given, const std::optional<MachineName>& machine,
                         const py::object& origin, const py::object& matrix, const MapShape& shape,
                         double cell, bool turned, const std::string& layer,
                         std::optional<double> ceiling, const std::optional<TerrainValue>& design,
                         const py::object& out, const std::optional<int>& threads) {
  const py::tuple kept = several(given, "sites", "soilvdb.Site");
  const std::vector<Site*> sites = sites_of(kept);
  const MapRequest map(machine, origin, matrix, shape, cell, turned, layer, ceiling, design,
                       sites.size());
  const auto count = static_cast<py::ssize_t>(sites.size());
  return fill_array(out, {count, shape.first, shape.second}, [&](auto values) {
    with_all(sites, [&](const std::vector<Session*>& sessions) {
      std::vector<MapPlace> places;
      for (std::size_t i = 0; i < sessions.size(); ++i) {
        try {
          places.push_back(map.of(*sessions[i], i));
        } catch (const py::value_error& e) {
          throw std::invalid_argument(fmt::format("site {}: {}", i, e.what()));
        } catch (const std::invalid_argument& e) {
          throw std::invalid_argument(fmt::format("site {}: {}", i, e.what()));
        }
      }
      on_threads(threads, [&] {
        soilvdb::height_maps(std::span<Session* const>(sessions), places, map.layer, values,
                             map.ceiling, map.wanted())
            .check();
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
      session
          .cast(begins.size() == 1 ? begins : begins.subspan(at, piece), ways.subspan(at, piece),
                out.subspan(at, piece))
          .check();
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
          "scans, see scan().")
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
          "is not along the world's axes, whose cells have means of points, and not under "
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
      "no meaning then.");
}

}  // namespace soilvdb::python
