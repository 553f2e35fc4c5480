// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Scans of depth cameras and lidars, for Python.
#include <fmt/format.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <array>
#include <cmath>
#include <optional>

#include "core/constants.h"
#include "core/survey/sensor_model.h"
#include "io/scan/scan_messages.h"
#include "soilvdb/survey.h"
#include "tools/python/site.h"
#include "tools/python/values.h"
#include "tools/run/survey_input.h"

namespace soilvdb::python {
namespace {

/// What soilvdb.Sensor is.
struct Sensor : soilvdb::Sensor {
  bool has_place = false;
};

Sensor sensor_of(const py::object& position, const py::object& rotation, const py::object& matrix,
                 const std::string& name, std::optional<double> range_sigma,
                 std::optional<double> range_squared_sigma, double height_sigma, double tilt_sigma,
                 double scale_sigma, const std::optional<std::string>& noise, double shift_sigma,
                 double turn_sigma, std::optional<double> max_range) {
  Sensor sensor;
  sensor.name = name;
  sensor.has_place = !position.is_none() || !matrix.is_none();
  if (sensor.has_place) sensor.pose = pose(position, rotation, matrix);
  if (position.is_none() && !rotation.is_none())
    throw py::type_error("give a position with the rotation");
  if (noise && (range_sigma || range_squared_sigma))
    throw py::type_error("give noise, or range_sigma and range_squared_sigma");
  const RangeNoise range = noise ? noise_of(*noise) : RangeNoise{sensor.range_sigma_m, 0};
  sensor.range_sigma_m = range_sigma.value_or(range.sigma_m);
  sensor.range_squared_sigma_per_m = range_squared_sigma.value_or(range.squared_per_m);
  sensor.mount_height_sigma_m = height_sigma;
  sensor.mount_tilt_sigma_rad = tilt_sigma;
  sensor.mount_scale_sigma = scale_sigma;
  sensor.pose_shift_sigma_m = shift_sigma;
  sensor.pose_turn_sigma_rad = turn_sigma;
  if (max_range) sensor.max_range_m = *max_range;
  sensor.validate();
  return sensor;
}

/// Where rays ended, in the sensor's frame, of a depth image.
std::vector<Vec3> points_of(const py::object& depth, const py::object& intrinsics) {
  const Array image = array_of(depth, "depth");
  if (image.ndim() != 2)
    throw py::value_error(fmt::format(
        "depth must be an image of rows and columns of pixels, an array (H, W); it has {} "
        "dimension{}",
        image.ndim(), image.ndim() == 1 ? "" : "s"));
  std::array<double, 4> k;
  if (intrinsics.is_none()) throw py::type_error("a depth image needs intrinsics=(fx, fy, cx, cy)");
  numbers(intrinsics, "intrinsics", k);
  if (!(k[0] > 0) || !(k[1] > 0) || !std::isfinite(k[0] + k[1] + k[2] + k[3]))
    throw py::value_error("intrinsics must be (fx, fy, cx, cy) in pixels, fx and fy more than 0");
  const io::CameraModel camera{0, 0, k[0], k[1], k[2], k[3]};
  std::vector<Vec3> points;
  points.reserve(static_cast<std::size_t>(image.size()));
  const double* pixel = image.data();
  for (py::ssize_t v = 0; v < image.shape(0); ++v) {
    for (py::ssize_t u = 0; u < image.shape(1); ++u) {
      const double z = *pixel++;
      if (z > kMostScanRangeM && std::isfinite(z))
        throw py::value_error(
            fmt::format("depth must be in metres, at most {}; pixel ({}, {}) has {}: is it in "
                        "millimetres?",
                        kMostScanRangeM, v, u, z));
      if (z > 0 && std::isfinite(z))
        points.push_back(camera.point(static_cast<std::size_t>(u), static_cast<std::size_t>(v), z));
    }
  }
  return points;
}

void scan(Site& site, const Sensor& sensor, const py::object& points, const py::object& depth,
          const py::object& intrinsics, bool world) {
  if (points.is_none() == depth.is_none())
    throw py::type_error("give points, or depth with intrinsics");
  if (!depth.is_none() && world) throw py::type_error("a depth image is in the sensor's frame");
  if (world && !sensor.has_place)
    throw py::value_error(fmt::format(
        "sensor '{}' has no position, where rays to points in the world begin; give it one",
        sensor.name));
  if (depth.is_none() && !intrinsics.is_none())
    throw py::type_error("intrinsics are for a depth image");
  std::vector<Vec3> ends;
  if (!depth.is_none()) {
    ends = points_of(depth, intrinsics);
  } else {
    const Array given = rows(points, "points", 3);
    for (py::ssize_t i = 0; i < given.shape(0); ++i) {
      const Vec3 p(given.data() + 3 * i);
      if (p.allFinite() && (world || !p.isZero(0))) ends.push_back(p);
    }
  }
  if (!world) place_points(sensor.pose, ends);
  std::vector<std::string> warnings;
  const StepResult made = site.with([&](Session& session) {
    StepResult taken = session.scan(sensor, ends);
    warnings = session.take_warnings();
    return taken;
  });
  tell(warnings);
  require_good(made);
}

/// What soilvdb.Survey has.
struct SurveyValue {
  Survey of;
  std::vector<std::string> machines;
};

SurveyValue apply_scans(Site& site) {
  SurveyValue value;
  std::vector<std::string> warnings;
  const StepResult made = site.with([&](Session& session) {
    for (const SiteMachine& machine : session.machines()) value.machines.push_back(machine.name);
    StepResult applied = session.apply_scans(value.of);
    warnings = session.take_warnings();
    return applied;
  });
  tell(warnings);
  require_good(made);
  return value;
}

/// Errors by the numbers of machines, and by their names.
py::object lip_errors_of(const SurveyValue& value) {
  py::list estimates;
  for (const Estimate& lip : value.of.lip_errors_m)
    estimates.append(py::make_tuple(lip.mean, lip.sigma));
  return py::module_::import("soilvdb._scan").attr("ByMachine")(value.machines, estimates);
}

py::dict rays_of(const SurveyValue& value) {
  const RayCounts& rays = value.of.rays;
  py::dict counts;
  counts["used"] = rays.used;
  counts["masked"] = rays.masked;
  counts["through"] = rays.through;
  counts["new"] = rays.added;
  counts["dropped"] = rays.dropped;
  counts["far"] = rays.far;
  return counts;
}

/// What soilvdb.SurveyedGround has.
struct SurveyedGround {
  double area_m2 = 0, removed_m3 = 0, added_m3 = 0, voids = 0, outside = 0;
};

SurveyedGround survey(Site& site, const TerrainValue& terrain, const py::object& boundary,
                      bool trust_heights) {
  tools::SurveyOptions options;
  options.name = "the survey";
  options.trusts_heights = trust_heights;
  if (!boundary.is_none()) {
    options.boundary = places(boundary, "boundary");
    if (options.boundary.size() < 3) throw py::value_error("boundary must have 3 corners or more");
  }
  SurveyedGround made;
  std::vector<std::string> warnings;
  const StepResult step = site.with([&](Session& session) {
    const io::Base base = io::open_base(terrain.terrain);
    const Vec3 before = session.origin();
    if (const Vec2 middle = base.bounds.center(); middle.allFinite())
      session.begin_near(
          {middle.x(), middle.y(), base.surface->height(middle.x(), middle.y()).value_or(0)});
    tools::SurveyInput input;
    try {
      input = tools::read_survey(session, base, options);
    } catch (...) {
      session.begin_near(before);  // one that is refused leaves a site without a place as it was
      throw;
    }
    made = {input.area_m2, 0, 0, input.voids, input.outside};
    warnings = input.warnings;
    for (const SurveyHeights& part : input.parts) {
      SurveyVolumes volumes;
      if (StepResult taken = session.survey(part, volumes); !taken.ok()) return taken;
      made.removed_m3 += volumes.removed_m3;
      made.added_m3 += volumes.added_m3;
    }
    return StepResult();
  });
  tell(warnings);
  require_good(step);
  return made;
}

py::tuple pair_of(const Estimate& estimate) {
  return py::make_tuple(estimate.mean, estimate.sigma);
}

Heap heap(Site& site, const py::object& boundary) {
  const std::vector<Vec2> corners = places(boundary, "boundary");
  return site.with([&](Session& session) { return session.heap(corners); });
}

void bind_heap(py::class_<Site>& site, py::module_& m) {
  const auto estimate = [](Estimate Heap::*of) {
    return [of](const Heap& heap) { return pair_of(heap.*of); };
  };
  py::class_<Heap>(m, "Heap",
                   "A heap of loose soil as scans saw it, from Site.heap(): each (mean, sigma).")
      .def_property_readonly("swell", estimate(&Heap::swell), "loose_m3 / bank_m3 - 1")
      .def_property_readonly("repose_angle", estimate(&Heap::repose_rad),
                             "slope of its flanks, rad")
      .def_property_readonly("loose_m3", estimate(&Heap::loose_m3),
                             "volume above the terrain, as scans saw it")
      .def_property_readonly("bank_m3", estimate(&Heap::bank_m3),
                             "put down there less what was taken, as bank soil, without what scans "
                             "changed")
      .def(py::pickle(
          [](const Heap& h) {
            std::vector<std::array<double, 2>> all;
            for (const Estimate& e : {h.loose_m3, h.bank_m3, h.swell, h.repose_rad})
              all.push_back({e.mean, e.sigma});
            return py::make_tuple(all);
          },
          [](const py::tuple& t) {
            const auto all = t[0].cast<std::array<std::array<double, 2>, 4>>();
            const auto of = [&](std::size_t i) { return Estimate{all[i][0], all[i][1]}; };
            return Heap{of(0), of(1), of(2), of(3)};
          }))
      .def("__repr__", [](const Heap& h) {
        return fmt::format(
            "soilvdb.Heap(swell={:.3g} +- {:.2g}, repose_angle={:.3g} +- {:.2g}, loose_m3={:.4g}, "
            "bank_m3={:.4g})",
            h.swell.mean, h.swell.sigma, h.repose_rad.mean, h.repose_rad.sigma, h.loose_m3.mean,
            h.bank_m3.mean);
      });
  site.def("heap", &heap, py::arg("boundary"),
           "Swell and angle of repose of a heap after apply_scans(): its volume above the terrain, "
           "over the bank soil that machines and pours put down there, and the slope of its "
           "flanks. boundary: corners (N, 2), m, world, around the whole heap and nothing else "
           "that was dug or filled. Raises ValueError with one line if the site has no soil, scans "
           "have not seen half of the heap as it is, it is lower than 8 voxels or has too little "
           "of flanks, no soil was put down, or ground inside was cut.");
  site.def(
      "cut_m3",
      [](Site& s, const MachineName& machine) {
        return pair_of(
            s.with([&](Session& session) { return session.cut_m3(machine_of(session, machine)); }));
      },
      py::arg("machine") = 0,
      "(mean, sigma), m3: what a machine cut, in place: the ledger's volume, corrected by what "
      "scans know of its lip, with the error of its lip over the ground that it dug, also where "
      "that "
      "was filled since. Raises ValueError for several machines that dug before the first scan.");
}

void bind_sensor(py::module_& m) {
  const auto none = py::none();
  py::class_<Sensor>(
      m, "Sensor",
      "A depth camera or a lidar, for Site.scan(). Its frame: points of a lidar are in it as "
      "given; "
      "a depth image's is the optical frame: z ahead, x right, y down. Scans of one name share the "
      "errors of one mount.")
      .def(
          py::init(&sensor_of), py::kw_only(), py::arg("position") = none,
          py::arg("rotation") = none, py::arg("pose") = none, py::arg("name") = "sensor",
          py::arg("range_sigma") = none, py::arg("range_squared_sigma") = none,
          py::arg("mount_height_sigma") = Sensor{}.mount_height_sigma_m,
          py::arg("mount_tilt_sigma") = Sensor{}.mount_tilt_sigma_rad,
          py::arg("mount_scale_sigma") = Sensor{}.mount_scale_sigma, py::arg("noise") = none,
          py::arg("pose_shift_sigma") = Sensor{}.pose_shift_sigma_m,
          py::arg("pose_turn_sigma") = Sensor{}.pose_turn_sigma_rad, py::arg("max_range") = none,
          "position (3,), m, and rotation (x, y, z, w): the sensor in the world; or pose, 4x4. "
          "Without them points are in the world's axes from (0, 0, 0). Scans with world=True need "
          "the "
          "position as well, because rays begin there, and are refused without. Standard "
          "deviations: "
          "of a ray of R metres range_sigma + range_squared_sigma * R**2, m, with range_sigma in m "
          "(0.02) and range_squared_sigma in 1/m (0); of the mount: mount_height_sigma, m (0.01), "
          "mount_tilt_sigma about each horizontal axis, rad (0.002), and mount_scale_sigma, a "
          "share "
          "of ranges (0.002). A stereo camera has range_squared_sigma = subpixel / (f * baseline). "
          "In place of both of a ray: noise, that of a known "
          "sensor: 'ouster_os1', 'realsense_d435', 'realsense_d455'. Of a sensor that moves also "
          "those of "
          "each scan's pose: pose_shift_sigma along each axis, m, and pose_turn_sigma about each, "
          "rad; 0 by default, for a fixed mount. The pose of each scan is then fitted to ground "
          "that nobody touched, if the scan sees 20 squares of 1 m of it. max_range, m, at most "
          "1000: "
          "farther points are left out, and counted as far; default: they are refused beyond 1000. "
          "Raises ValueError for negative sigmas, and without any noise of the range.")
      .def_readonly("name", &Sensor::name)
      .def_property_readonly(
          "position", [](const Sensor& s) { return Array(py::ssize_t{3}, s.pose.position.data()); })
      .def_property_readonly(
          "rotation",
          [](const Sensor& s) { return Array(py::ssize_t{4}, s.pose.rotation.coeffs().data()); },
          "(x, y, z, w): world from sensor")
      .def_readonly("range_sigma", &Sensor::range_sigma_m, "m")
      .def_readonly("range_squared_sigma", &Sensor::range_squared_sigma_per_m, "1/m")
      .def_readonly("mount_height_sigma", &Sensor::mount_height_sigma_m, "m")
      .def_readonly("mount_tilt_sigma", &Sensor::mount_tilt_sigma_rad, "rad")
      .def_readonly("mount_scale_sigma", &Sensor::mount_scale_sigma, "share of range")
      .def_readonly("pose_shift_sigma", &Sensor::pose_shift_sigma_m, "m")
      .def_readonly("pose_turn_sigma", &Sensor::pose_turn_sigma_rad, "rad")
      .def_readonly("max_range", &Sensor::max_range_m, "m; infinite without one")
      .def(py::pickle(
          [](const Sensor& s) {
            const Vec3& p = s.pose.position;
            const Eigen::Vector4d q = s.pose.rotation.coeffs();
            const auto if_placed = [&](py::object value) {
              return s.has_place ? std::move(value) : py::none();
            };
            return py::make_tuple(
                s.name, if_placed(py::make_tuple(p.x(), p.y(), p.z())),
                if_placed(py::make_tuple(q.x(), q.y(), q.z(), q.w())), s.range_sigma_m,
                s.range_squared_sigma_per_m, s.mount_height_sigma_m, s.mount_tilt_sigma_rad,
                s.mount_scale_sigma, s.pose_shift_sigma_m, s.pose_turn_sigma_rad, s.max_range_m);
          },
          [](const py::tuple& t) {
            return sensor_of(t[1], t[2], py::none(), t[0].cast<std::string>(), t[3].cast<double>(),
                             t[4].cast<double>(), t[5].cast<double>(), t[6].cast<double>(),
                             t[7].cast<double>(), std::nullopt, t[8].cast<double>(),
                             t[9].cast<double>(), t[10].cast<double>());
          }))
      .def("__repr__", [](const Sensor& s) {
        const Vec3& p = s.pose.position;
        return fmt::format("soilvdb.Sensor(name='{}', position=({:.6g}, {:.6g}, {:.6g}))", s.name,
                           p.x(), p.y(), p.z());
      });
}

}  // namespace

void bind_scans(py::class_<Site>& site, py::module_& m) {
  bind_sensor(m);
  bind_heap(site, m);
  py::class_<SurveyValue>(m, "Survey", "What scans changed, from Site.apply_scans().")
      .def_property_readonly(
          "removed_m3", [](const SurveyValue& v) { return v.of.removed_m3; }, "soil taken away")
      .def_property_readonly(
          "added_m3", [](const SurveyValue& v) { return v.of.added_m3; }, "soil put in")
      .def_property_readonly(
          "sigma_m3", [](const SurveyValue& v) { return v.of.sigma_m3; },
          "standard deviation, after the correction, of the volume of the columns that were seen "
          "and "
          "are not as the terrain")
      .def_property_readonly(
          "lip_error", &lip_errors_of,
          "by number or name of a machine: (mean, sigma), m, by how much its lip "
          "is told too high")
      .def_property_readonly(
          "rays", &rays_of,
          "numbers of rays: used, masked (met a machine), through (went through "
          "soil expected there), new (met new ground), dropped, far (beyond max_range)")
      .def(py::pickle(
          [](const SurveyValue& v) {
            std::vector<std::array<double, 2>> lips;
            for (const Estimate& lip : v.of.lip_errors_m) lips.push_back({lip.mean, lip.sigma});
            const RayCounts& rays = v.of.rays;
            return py::make_tuple(v.of.removed_m3, v.of.added_m3, v.of.sigma_m3, lips,
                                  std::array{rays.used, rays.masked, rays.through, rays.added,
                                             rays.dropped, rays.far},
                                  v.machines);
          },
          [](const py::tuple& t) {
            SurveyValue v{{t[0].cast<double>(), t[1].cast<double>(), t[2].cast<double>(), {}, {}},
                          t[5].cast<std::vector<std::string>>()};
            for (const auto& lip : t[3].cast<std::vector<std::array<double, 2>>>())
              v.of.lip_errors_m.push_back({lip[0], lip[1]});
            const auto rays = t[4].cast<std::array<std::int64_t, 6>>();
            v.of.rays = {rays[0], rays[1], rays[2], rays[3], rays[4], rays[5]};
            return v;
          }))
      .def("__repr__", [](const SurveyValue& v) {
        const RayCounts& rays = v.of.rays;
        return fmt::format(
            "soilvdb.Survey(removed_m3={:.4g}, added_m3={:.4g}, sigma_m3={:.2g}, rays: {} used, {} "
            "masked, {} through, {} new, {} dropped, {} far)",
            v.of.removed_m3, v.of.added_m3, v.of.sigma_m3, rays.used, rays.masked, rays.through,
            rays.added, rays.dropped, rays.far);
      });
  py::class_<SurveyedGround>(m, "SurveyedGround", "What a survey changed, from Site.survey().")
      .def_readonly("area_m2", &SurveyedGround::area_m2, "where the ground has its heights now")
      .def_readonly("removed_m3", &SurveyedGround::removed_m3, "soil taken away")
      .def_readonly("added_m3", &SurveyedGround::added_m3, "soil put in")
      .def_readonly("voids", &SurveyedGround::voids,
                    "part of the survey's area in which it has no height")
      .def_readonly("outside", &SurveyedGround::outside,
                    "part of the survey's area in which the site has no ground")
      .def(py::pickle(
          [](const SurveyedGround& s) {
            return std::tuple(s.area_m2, s.removed_m3, s.added_m3, s.voids, s.outside);
          },
          [](const std::tuple<double, double, double, double, double>& t) {
            const auto& [area, removed, added, voids, outside] = t;
            return SurveyedGround{area, removed, added, voids, outside};
          }))
      .def("__repr__", [](const SurveyedGround& s) {
        return fmt::format(
            "soilvdb.SurveyedGround(area_m2={:.6g}, removed_m3={:.4g}, added_m3={:.4g})", s.area_m2,
            s.removed_m3, s.added_m3);
      });
  const auto none = py::none();
  site.def(
      "survey", &survey, py::arg("terrain"), py::kw_only(), py::arg("boundary") = none,
      py::arg("trust_heights") = false,
      "Gives the ground the heights of a survey, such as a drone's, and returns a "
      "SurveyedGround. terrain: raster(), of a file or an array, or another Terrain. "
      "boundary: corners (N, 2), m, world, within which it is taken; default: everywhere. Each "
      "column of voxels gets the survey's mean height. Beside the survey and in its voids "
      "nothing changes. What is added or removed is booked as surveyed, loads and cuts stay "
      "as they are. Added soil is loose where soil moves, and stays however steep until "
      "something changes there. Raises ValueError for another CRS, for a survey that misses "
      "the site, and unless trust_heights if it is 5 m or more above or below the ground "
      "nearly everywhere, as above another zero or in feet.");
  site.def(
          "scan", &scan, py::arg("sensor"), py::arg("points") = none, py::kw_only(),
          py::arg("depth") = none, py::arg("intrinsics") = none, py::arg("world") = false,
          "Takes what a sensor saw. points: (N, 3), m, in the sensor's frame, or the world's with "
          "world; rows that aren't finite, or zero in the sensor's frame, are no return. Or depth: "
          "(H, W), m along the optical axis, with intrinsics (fx, fy, cx, cy), pixels; NaN and 0 "
          "are no return. Nothing changes before apply_scans(). Rays that meet the bucket of a "
          "machine are not used. Warns, once, of a sensor that moves without standard deviations "
          "of "
          "its poses. The result does not depend on the order of scans between two "
          "calls of "
          "apply_scans().")
      .def("apply_scans", &apply_scans,
           "Corrects the ground by all scans so far, and returns a Survey. The ground that nobody "
           "touched is the datum. What is added or removed is booked as surveyed: loads and cuts "
           "stay as they are. Warns, once, if most rays do not meet the ground where it is "
           "expected, "
           "as with a wrong place of the sensor.");
}

}  // namespace soilvdb::python
