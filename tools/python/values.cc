// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The parts of a site as Python values with repr, comparison and pickle.
#include "tools/python/values.h"

#include <fmt/format.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <array>
#include <cmath>
#include <limits>
#include <memory>

#include "soilvdb/capacity.h"
#include "soilvdb/io/bucket_mesh.h"
#include "soilvdb/io/mesh_file.h"
#include "soilvdb/io/urdf.h"
#include "soilvdb/resistance.h"
#include "soilvdb/tool_shape.h"
#include "tools/python/arguments.h"

namespace soilvdb::python {
namespace {

std::vector<Vec2> outline(const py::object& given) {
  return given.is_none() ? std::vector<Vec2>() : places(given, "profile");
}

py::list outline(const std::vector<Vec2>& points) {
  py::list list;
  for (const Vec2& p : points) list.append(py::make_tuple(p.x(), p.y()));
  return list;
}

io::MeshBucket mesh_bucket(const std::filesystem::path& file, const py::object& lip,
                           const py::object& upper, double unit) {
  const Array ends = rows(lip, "lip", 3);
  if (ends.shape(0) != 2)
    throw py::value_error(fmt::format(
        "lip has {} points; it must be the 2 ends (x, y, z) of the cutting edge", ends.shape(0)));
  io::MouthEdges edges;
  for (int k = 0; k < 2; ++k) edges.lip[k] = Vec3(ends.at(k, 0), ends.at(k, 1), ends.at(k, 2));
  if (!upper.is_none()) edges.upper = vector3(upper, "upper");
  const py::gil_scoped_release others_run;
  return io::read_bucket_mesh(file, edges, unit);
}

std::pair<double, double> span_of(const py::object& time, const char* name) {
  double both[2];
  numbers(time, name, both);
  return {both[0], both[1]};
}

Pose pose_if(const py::object& matrix) {
  return matrix.is_none() ? Pose{} : pose(py::none(), py::none(), matrix);
}

Pose pose_of_row(const py::handle& row) {
  return soilvdb::pose_of(row.cast<std::array<double, kPoseNumbers>>().data());
}

}  // namespace

void bind_values(py::module_& m) {
  py::class_<Bucket>(m, "Bucket",
                     "A digging tool in its own frame, in metres: origin at the middle of the lip, "
                     "y along the lip, z from the lip to the upper edge of the mouth, x out of the "
                     "mouth.")
      .def(py::init([](double width, double height, const py::object& profile,
                       std::optional<double> dump_angle, double edge, double plate) {
             Bucket bucket{width, height, outline(profile), dump_angle, {}, edge, plate};
             bucket.validate();
             return bucket;
           }),
           py::arg("width"), py::arg("height"), py::arg("profile") = py::none(),
           py::arg("dump_angle") = py::none(), py::kw_only(), py::arg("edge") = 0.0,
           py::arg("plate") = 0.0,
           "profile: (N, 2) points (x, z) of the body's side from the lip (0, 0) to the upper edge "
           "(0, height), x <= 0; default: the mouth alone digs. dump_angle: angle below the "
           "horizontal at which the whole load leaves at once, rad. edge, plate: thickness of the "
           "lip's and of each side plate's blunt edge, m, for Site.resistance(); 0: sharp.")
      .def_static(
          "from_mesh",
          [](const std::filesystem::path& file, const py::object& lip, const py::object& upper,
             double unit, std::optional<double> dump_angle) {
            Bucket bucket = mesh_bucket(file, lip, upper, unit).bucket;
            bucket.dump_angle_rad = dump_angle;
            bucket.validate();
            return bucket;
          },
          py::arg("file"), py::kw_only(), py::arg("lip"), py::arg("upper") = py::none(),
          py::arg("unit") = 1.0, py::arg("dump_angle") = py::none(),
          "A bucket with the inside of a real bucket's mesh: profile, width between the side "
          "plates, height of the mouth. The mesh may have thickness, teeth and lugs, and small "
          "gaps. file: .stl, .obj or .dae. lip: (2, 3), both ends of the cutting edge, in "
          "coordinates of the file, in any order. upper: (3,), a point of the mouth's upper edge; "
          "default: it is found. unit: metres per unit of the file. A .dae says its own: it takes "
          "no unit, and lip and upper in metres, in the file's axes. Raises ValueError if the lip "
          "is not on the mesh, or if the mesh is open elsewhere than at its mouth.")
      .def_static(
          "pose_in_mesh",
          [](const std::filesystem::path& file, const py::object& lip, const py::object& upper,
             double unit) {
            const Pose pose = mesh_bucket(file, lip, upper, unit).mesh_from_bucket;
            py::array_t<double> matrix({4, 4});
            Eigen::Map<Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> out(matrix.mutable_data());
            out.setIdentity();
            out.topLeftCorner<3, 3>() = pose.rotation.toRotationMatrix();
            out.topRightCorner<3, 1>() = pose.position;
            return matrix;
          },
          py::arg("file"), py::kw_only(), py::arg("lip"), py::arg("upper") = py::none(),
          py::arg("unit") = 1.0,
          "Where the bucket of from_mesh() is in its file: a 4x4 array, mesh from bucket, m. Its "
          "columns are x out of the mouth, y along the lip, z from the lip to the upper edge, and "
          "the middle of the lip.")
      .def_readonly("width", &Bucket::width_m)
      .def_readonly("height", &Bucket::height_m)
      .def_property_readonly("profile", [](const Bucket& b) { return outline(b.profile); })
      .def_readonly("dump_angle", &Bucket::dump_angle_rad)
      .def_readonly("edge", &Bucket::edge_m)
      .def_readonly("plate", &Bucket::plate_m)
      .def_property_readonly(
          "capacity",
          [](const Bucket& b) -> py::object {
            const std::optional<Capacity> capacity = Capacity::of(b);
            if (!capacity) return py::none();
            return py::make_tuple(capacity->struck_m3(), capacity->heaped_m3());
          },
          "(struck, heaped), m3, with the mouth level: up to the mouth, and heaped at 1:1 above "
          "it. Rigid soil has no limit. The limit of moving soil depends on the bucket's attitude "
          "and repose_angle, and may be more or less. None without a profile: the bucket holds any "
          "amount.")
      .def("__repr__",
           [](const Bucket& b) {
             return fmt::format("soilvdb.Bucket(width={}, height={}{})", b.width_m, b.height_m,
                                b.profile.empty() ? "" : ", profile=...");
           })
      .def(py::pickle(
          [](const Bucket& b) {
            return py::make_tuple(b.width_m, b.height_m, outline(b.profile), b.dump_angle_rad,
                                  b.shape ? py::object(py::bytes(b.shape->save())) : py::none(),
                                  b.edge_m, b.plate_m);
          },
          [](const py::tuple& t) {
            const py::object profile = t[2];
            if (!t[4].is_none()) return tool_of(ToolShape::load(t[4].cast<std::string>()));
            return Bucket{t[0].cast<double>(),
                          t[1].cast<double>(),
                          py::len(profile) > 0 ? outline(profile) : std::vector<Vec2>{},
                          t[3].cast<std::optional<double>>(),
                          {},
                          t[5].cast<double>(),
                          t[6].cast<double>()};
          }));

  m.def(
      "tool",
      [](const std::filesystem::path& mesh, double voxel) {
        const Mesh of = io::read_mesh(mesh);
        const ToolShape shape(of, voxel);
        if (const std::string lost = lost_by(shape, of);
            !lost.empty() &&
            PyErr_WarnEx(PyExc_UserWarning, (mesh.string() + ": " + lost).c_str(), 1) != 0)
          throw py::error_already_set();
        Bucket bucket = tool_of(shape);
        bucket.validate();
        return bucket;
      },
      py::arg("mesh"), py::arg("voxel"),
      "A tool of any closed shape in place of a bucket: blade, auger, ripper. It holds no soil and "
      "pushes aside the soil that it passes. mesh: an .stl, .obj or .dae file in the tool's frame, "
      "m. "
      "voxel: voxel size of the tool's distance field, m. Flat faces are exact at any size. Parts "
      "thinner than two voxels are lost; a UserWarning names a loss above 1 % of the volume. "
      "Raises ValueError if the mesh is not closed.");

  py::class_<MachineValue>(m, "Machine", "A bucket with a name and, if it has a URDF, joints.")
      .def(
          py::init([](const Bucket& bucket, std::string name,
                      const std::optional<std::filesystem::path>& urdf, const std::string& link,
                      const py::object& base, const py::object& lip) {
            return MachineValue(bucket, std::move(name), urdf, link, pose_if(base), pose_if(lip));
          }),
          py::arg("bucket"), py::arg("name") = "machine", py::kw_only(),
          py::arg("urdf") = py::none(), py::arg("link") = "bucket", py::arg("base") = py::none(),
          py::arg("lip") = py::none(),
          "urdf: a file with a chain of joints that ends at `link`; default: the link named "
          "bucket. base: 4x4 array, the URDF's root in the world. lip: 4x4 array, the bucket frame "
          "in the frame of link, m; default: they are the same, which they seldom are. Raises "
          "ValueError if the file has no such link.")
      .def_property_readonly("name", [](const MachineValue& v) { return v.machine.name; })
      .def_property_readonly("bucket", [](const MachineValue& v) { return v.machine.bucket; })
      .def_property_readonly("joints",
                             [](const MachineValue& v) {
                               return v.machine.chain ? v.machine.chain->movable()
                                                      : std::vector<std::string>{};
                             })
      .def("__repr__",
           [](const MachineValue& v) {
             return fmt::format("soilvdb.Machine('{}')", v.machine.name);
           })
      .def(py::pickle(
          [](const MachineValue& v) {
            return py::make_tuple(v.machine.bucket, v.machine.name, v.urdf, v.link, row_of(v.base),
                                  row_of(v.lip));
          },
          [](const py::tuple& t) {
            return MachineValue(t[0].cast<Bucket>(), t[1].cast<std::string>(),
                                t[2].cast<std::optional<std::filesystem::path>>(),
                                t[3].cast<std::string>(), pose_of_row(t[4]), pose_of_row(t[5]));
          }));

  py::class_<TerrainValue>(m, "Terrain",
                           "The ground before the first update: soilvdb.plane(), raster() or "
                           "snapshot().")
      .def("__repr__", [](const TerrainValue& t) { return t.text; })
      .def(py::pickle(
          [](const TerrainValue& t) {
            if (const auto* plane = std::get_if<io::PlaneTerrain>(&t.terrain))
              return py::make_tuple(0, plane->height_m, plane->slope.x(), plane->slope.y());
            if (const auto* raster = std::get_if<io::RasterTerrain>(&t.terrain)) {
              if (!raster->heights) return py::make_tuple(1, raster->file.string());
              const auto& [grid, values] = *raster->heights;
              return py::make_tuple(3, py::array_t<float>({grid.ny, grid.nx}, values.data()),
                                    py::make_tuple(grid.first.x(), grid.first.y()),
                                    grid.spacing.x());
            }
            return py::make_tuple(2, std::get<io::LevelSetTerrain>(t.terrain).file.string());
          },
          [](const py::tuple& t) {
            const int kind = t[0].cast<int>();
            if (kind == 0)
              return plane(t[1].cast<double>(), {t[2].cast<double>(), t[3].cast<double>()});
            if (kind == 3) return raster(t[1], t[2], t[3]);
            return kind == 1 ? raster(t[1].cast<std::string>())
                             : snapshot(t[1].cast<std::string>());
          }));
  m.def(
      "plane",
      [](double z, const py::object& slope) {
        Vec2 rise(0, 0);
        if (!slope.is_none()) numbers(slope, "slope", {rise.data(), 2});
        return plane(z, rise);
      },
      py::arg("z") = 0.0, py::arg("slope") = py::none(),
      "A plane with height z (m) at x = y = 0 and slope (dz/dx, dz/dy).");
  m.def(
      "raster", py::overload_cast<const py::object&, const py::object&, const py::object&>(&raster),
      py::arg("source"), py::kw_only(), py::arg("origin") = py::none(),
      py::arg("cell") = py::none(),
      "Heights from a file that GDAL reads, such as GeoTIFF or .asc, of triangles in LandXML or "
      "DXF, or from an array (ny, nx), m, kept as float32: linear between posts, NaN where there "
      "is "
      "no ground. With an array, origin: "
      "(x, y) of the post [0, 0], world, m; row 0 has the lowest y. cell: distance of posts, m. "
      "Site.write() writes an array's heights beside the snapshot; such a site can't be recorded. "
      "Raises ValueError for an array that is no terrain.");
  m.def("snapshot", &snapshot, py::arg("file"),
        "The ground of a snapshot (.vdb), or a closed level set.");

  py::class_<SoilProperties>(m, "Soil", "Properties of soil that moves, or that resists a bucket.")
      .def(py::init([](std::optional<double> repose_angle, double swell, double density,
                       std::optional<double> cohesion, std::optional<double> friction_angle,
                       std::optional<double> tool_friction, double adhesion) {
             const SoilProperties soil{repose_angle.value_or(0), swell,         density, cohesion,
                                       friction_angle,           tool_friction, adhesion};
             if (repose_angle)
               Earthmoving{soil, {}, {}}.validate();
             else
               SoilStrength::of(soil);
             return soil;
           }),
           py::arg("repose_angle") = py::none(), py::arg("swell") = 0.0,
           py::arg("density") = 1800.0, py::arg("cohesion") = py::none(),
           py::arg("friction_angle") = py::none(), py::kw_only(),
           py::arg("tool_friction") = py::none(), py::arg("adhesion") = 0.0,
           "repose_angle: steepest slope of loose soil, rad; usually 0.44 to 0.79; without it the "
           "soil is for Site.resistance() only. swell: loose volume / bank volume - 1; usually 0.1 "
           "to 0.7, at most 3. density: kg/m3 of bank soil, more than 0; usually 1200 to 2700. "
           "cohesion: Pa of bank soil; default: cuts stand as made. friction_angle: rad, of bank "
           "soil; default: repose_angle. For resistance only: tool_friction: rad, of soil on "
           "steel; default: two thirds of friction_angle. adhesion: Pa, of soil on steel.")
      .def_property_readonly("repose_angle",
                             [](const SoilProperties& s) {
                               return s.repose_rad > 0 ? std::optional(s.repose_rad) : std::nullopt;
                             })
      .def_readonly("swell", &SoilProperties::swell)
      .def_readonly("density", &SoilProperties::density_kg_m3)
      .def_readonly("cohesion", &SoilProperties::cohesion_pa)
      .def_readonly("friction_angle", &SoilProperties::friction_rad)
      .def_readonly("tool_friction", &SoilProperties::tool_friction_rad)
      .def_readonly("adhesion", &SoilProperties::adhesion_pa)
      .def(py::pickle(
          [](const SoilProperties& s) {
            return py::make_tuple(s.repose_rad, s.swell, s.density_kg_m3, s.cohesion_pa,
                                  s.friction_rad, s.tool_friction_rad, s.adhesion_pa);
          },
          [](const py::tuple& t) {
            using Maybe = std::optional<double>;
            return SoilProperties{t[0].cast<double>(), t[1].cast<double>(), t[2].cast<double>(),
                                  t[3].cast<Maybe>(),  t[4].cast<Maybe>(),  t[5].cast<Maybe>(),
                                  t[6].cast<double>()};
          }));

  py::class_<Pour>(m, "Pour",
                   "A source of soil from outside the site: a truck that tips, a "
                   "conveyor.")
      .def(py::init(
               [](const py::object& at, double volume, const py::object& time, std::string name) {
                 const auto [begin, end] = span_of(time, "time");
                 return Pour{std::move(name), vector3(at, "at"), begin, end, volume};
               }),
           py::arg("at"), py::arg("volume"), py::arg("time"), py::arg("name") = "pour",
           "at: (x, y, z), m, the point from which the soil falls. volume: m3, loose, even over "
           "time (begin, end), s.")
      .def(py::pickle(
          [](const Pour& p) {
            return py::make_tuple(p.name, p.at_m.x(), p.at_m.y(), p.at_m.z(), p.begin_s, p.end_s,
                                  p.volume_m3);
          },
          [](const py::tuple& t) {
            return Pour{t[0].cast<std::string>(),
                        {t[1].cast<double>(), t[2].cast<double>(), t[3].cast<double>()},
                        t[4].cast<double>(),
                        t[5].cast<double>(),
                        t[6].cast<double>()};
          }));

  py::class_<Hopper>(m, "Hopper",
                     "A truck's bed or a crusher: soil that falls into it leaves the "
                     "site.")
      .def(
          py::init([](const py::object& box, double top, const py::object& time, std::string name) {
            double sides[4];
            numbers(box, "box", sides);
            Hopper hopper{
                std::move(name), {Vec2(sides[0], sides[1]), Vec2(sides[2], sides[3])}, top};
            if (!time.is_none()) std::tie(hopper.begin_s, hopper.end_s) = span_of(time, "time");
            return hopper;
          }),
          py::arg("box"), py::arg("top"), py::arg("time") = py::none(), py::arg("name") = "hopper",
          "box: (xmin, ymin, xmax, ymax), m. top: height of the rim, m. time: (begin, end) of its "
          "presence, s; default: always.")
      .def(py::pickle(
          [](const Hopper& h) {
            return py::make_tuple(h.name, h.box_m.min().x(), h.box_m.min().y(), h.box_m.max().x(),
                                  h.box_m.max().y(), h.top_m, h.begin_s, h.end_s);
          },
          [](const py::tuple& t) {
            return Hopper{t[0].cast<std::string>(),
                          {Vec2(t[1].cast<double>(), t[2].cast<double>()),
                           Vec2(t[3].cast<double>(), t[4].cast<double>())},
                          t[5].cast<double>(),
                          t[6].cast<double>(),
                          t[7].cast<double>()};
          }));
}

MachineValue::MachineValue(const Bucket& bucket, std::string name,
                           std::optional<std::filesystem::path> file, std::string link_name,
                           const Pose& world_from_root, const Pose& link_from_bucket)
    : machine{std::move(name), bucket, {}},
      urdf(std::move(file)),
      link(std::move(link_name)),
      base(world_from_root),
      lip(link_from_bucket) {
  if (!urdf) return;
  machine.chain = io::read_chain(*urdf, link);
  machine.chain->world_from_root = base;
  machine.chain->link_from_bucket = lip;
}

const InitialTerrain& TerrainValue::surface() const {
  std::call_once(opened->once, [&] { opened->surface = io::open_base(terrain).surface; });
  return *opened->surface;
}

TerrainValue plane(double z, const Vec2& slope) {
  return {io::PlaneTerrain{z, slope}, fmt::format("soilvdb.plane({})", z)};
}
TerrainValue raster(const std::filesystem::path& file) {
  return {io::RasterTerrain{file}, fmt::format("soilvdb.raster('{}')", file.string())};
}
TerrainValue raster(const py::object& source, const py::object& origin, const py::object& cell) {
  if (py::isinstance<py::str>(source) || py::hasattr(source, "__fspath__")) {
    if (!origin.is_none() || !cell.is_none())
      throw py::type_error("a file says its origin and cell itself; leave them out");
    return raster(source.cast<std::filesystem::path>());
  }
  if (origin.is_none() || cell.is_none())
    throw py::type_error("with an array of heights, origin (x, y) and cell must be given");
  py::object filled = source;  // of a masked array, nan under its mask
  if (py::isinstance<py::array>(source) && py::hasattr(source, "mask"))
    filled = source.attr("astype")("float32").attr("filled")(std::nan(""));
  const Array given = array_of(filled, "source");
  if (given.ndim() != 2) throw py::value_error("source must have the shape (ny, nx)");
  auto heights = std::make_shared<io::RasterHeights>();
  heights->grid = {static_cast<int>(given.shape(1)), static_cast<int>(given.shape(0))};
  numbers(origin, "origin", {heights->grid.first.data(), 2});
  double side = 0;
  numbers(py::make_tuple(cell), "cell", {&side, 1});
  heights->grid.spacing = {side, side};
  for (py::ssize_t i = 0; i < given.size(); ++i) {
    const auto z = static_cast<float>(given.data()[i]);
    // Equal heights have equal bits, so that sites of equal arrays are the same.
    heights->values.push_back(std::isnan(z) ? std::numeric_limits<float>::quiet_NaN() : z + 0.0F);
  }
  const io::RasterTerrain terrain{"", std::move(heights)};
  io::open_base(terrain);  // throws now, not when a site is made
  return {terrain, fmt::format("soilvdb.raster(array of {} x {})", given.shape(0), given.shape(1))};
}
TerrainValue snapshot(const std::filesystem::path& file) {
  return {io::LevelSetTerrain{file, ""}, fmt::format("soilvdb.snapshot('{}')", file.string())};
}

}  // namespace soilvdb::python
