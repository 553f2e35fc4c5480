// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The force of the soil on a bucket, for Python.
#include <fmt/format.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <tbb/parallel_for.h>

#include <limits>
#include <memory>

#include "soilvdb/resistance.h"
#include "tools/python/site.h"

namespace soilvdb::python {
namespace {

/// What soilvdb.Resistance has.
struct ResistanceValue {
  Resistance of;
  Pose world_from_bucket;
};

Array array_of_vector(const Vec3& v) { return Array(py::ssize_t{3}, v.data()); }

py::object wrench_of(const Wrench& wrench) {
  return py::module_::import("soilvdb._force")
      .attr("Wrench")(array_of_vector(wrench.force), array_of_vector(wrench.moment));
}

/// @param soil null: the site's
SoilStrength strength_of(Session& session, const std::optional<SoilProperties>& soil) {
  if (soil) return SoilStrength::of(*soil);
  if (!session.earthmoving().soil)
    throw std::invalid_argument(
        "soil is rigid here; say soil=soilvdb.Soil(density=.., cohesion=.., friction_angle=..)");
  return SoilStrength::of(*session.earthmoving().soil);
}

ResistanceValue value_of(const CutGeometry& geometry, const SoilStrength& soil, bool crescents) {
  return {geometry.resistance(soil, crescents), geometry.world_from_bucket()};
}

ResistanceValue resistance(Site& site, const MachineName& machine,
                           const std::optional<SoilProperties>& soil, bool crescents) {
  return site.with([&](Session& session) {
    const SoilStrength strength = strength_of(session, soil);
    const std::size_t number = machine_of(session, machine);
    const Resistance made = session.resistance(number, &strength, crescents);
    return ResistanceValue{made, session.last(number)->pose};
  });
}

/// The soil of each site. @param given one for all, one for each, or None: their own
std::vector<std::optional<SoilProperties>> soils_of(const py::object& given, std::size_t sites) {
  using Soils = std::vector<std::optional<SoilProperties>>;
  if (given.is_none()) return Soils(sites);
  if (py::isinstance<SoilProperties>(given)) return Soils(sites, given.cast<SoilProperties>());
  Soils soils;
  for (const py::handle& soil : several(given, "soil", "soilvdb.Soil")) {
    if (!py::isinstance<SoilProperties>(soil)) not_of_kind(soil, "soil", "soilvdb.Soil");
    soils.emplace_back(soil.cast<SoilProperties>());
  }
  if (soils.size() != sites)
    throw py::value_error(fmt::format("there are {} soils for {} sites", soils.size(), sites));
  return soils;
}

/// Forces and moments of many sites; NaN where a machine had no state.
py::tuple resistances(const py::object& given, const MachineName& machine, const py::object& soil,
                      bool crescents, const std::optional<int>& threads) {
  const py::tuple kept = several(given, "sites", "soilvdb.Site");
  const std::vector<Site*> sites = sites_of(kept);
  const std::vector<std::optional<SoilProperties>> soils = soils_of(soil, sites.size());
  const auto count = static_cast<py::ssize_t>(sites.size());
  Array forces({count, py::ssize_t{3}}), moments({count, py::ssize_t{3}});
  double *const force = forces.mutable_data(), *const moment = moments.mutable_data();
  with_all(sites, [&](const std::vector<Session*>& sessions) {
    std::vector<SoilStrength> strengths;
    std::vector<std::size_t> numbers;
    for (std::size_t i = 0; i < sessions.size(); ++i) {
      of_site(i, [&] {
        strengths.push_back(strength_of(*sessions[i], soils[i]));
        numbers.push_back(machine_of(*sessions[i], machine));
      });
    }
    constexpr std::size_t kGroup = 32;  // each takes a millisecond or so
    in_groups(sessions.size(), kGroup, threads, [&](std::size_t first, std::size_t last) {
      tbb::parallel_for(first, last, [&](std::size_t i) {
        Wrench all;
        if (sessions[i]->last(numbers[i]))
          all = sessions[i]->resistance(numbers[i], &strengths[i], crescents).total();
        else
          all.force = all.moment = Vec3::Constant(std::numeric_limits<double>::quiet_NaN());
        std::copy_n(all.force.data(), 3, force + 3 * i);
        std::copy_n(all.moment.data(), 3, moment + 3 * i);
      });
    });
  });
  return py::make_tuple(forces, moments);
}

py::array_t<double> jacobian_of(const Resistance& r) {
  py::array_t<double> out({3, 5});
  Eigen::Map<Eigen::Matrix<double, 3, 5, Eigen::RowMajor>>(out.mutable_data()) = r.by_strength;
  return out;
}

}  // namespace

void bind_force(py::class_<Site>& site, py::module_& m) {
  py::class_<ResistanceValue>(
      m, "Resistance",
      "The force of the soil on a bucket. Forces, N, and their moments "
      "about the middle of the lip, "
      "N m, act on the bucket. What is not modelled: see Site.resistance().")
      .def_property_readonly(
          "force", [](const ResistanceValue& v) { return array_of_vector(v.of.total().force); },
          "(3,), N, in the bucket's frame")
      .def_property_readonly(
          "moment", [](const ResistanceValue& v) { return array_of_vector(v.of.total().moment); },
          "(3,), N m, in the bucket's frame, about the middle of the lip")
      .def_property_readonly(
          "world",
          [](const ResistanceValue& v) {
            return wrench_of(turned(v.of.total(), v.world_from_bucket.rotation));
          },
          "force and moment with the axes of the world, about the middle of the lip")
      .def_property_readonly(
          "parts",
          [](const ResistanceValue& v) {
            py::dict parts;
            parts["cut"] = wrench_of(v.of.cut);
            parts["edge"] = wrench_of(v.of.edge);
            parts["load"] = wrench_of(v.of.load);
            parts["heel"] = wrench_of(v.of.heel);
            return parts;
          },
          "force and moment by part, in the bucket's frame: 'cut', of the soil that fails ahead; "
          "'edge', on blunt edges of lip and side plates; 'load', the weight of what is held; "
          "'heel', on faces that press on the ground")
      .def_property_readonly(
          "jacobian", [](const ResistanceValue& v) { return jacobian_of(v.of); },
          "(3, 5): derivatives of force by density (per kg/m3), cohesion (per Pa), friction_angle, "
          "tool_friction (per rad), adhesion (per Pa); each with the others held. Exact to 1e-5; "
          "before a steep blade to 1e-3")
      .def_property_readonly(
          "angle", [](const ResistanceValue& v) { return v.of.angle_rad; },
          "of the failure planes with the way ahead, rad")
      .def_property_readonly(
          "depth_m", [](const ResistanceValue& v) { return v.of.depth_m; },
          "of the lip below the ground just ahead, mean over its width")
      .def_property_readonly(
          "limited", [](const ResistanceValue& v) { return v.of.limited(); },
          "why the force is a rough estimate: 'steep blade': soil rides before it; 'heel': a face "
          "presses; too high: 'lifts': the way rises more steeply than the failure planes; or too "
          "low: 'ground ends ahead'; 'no failure plane': the soil can't fail before some of the "
          "blade, which counts 0; 'blade below ground': what lies above its end is left out; "
          "'rolled over': only the load counts; empty if it is none")
      .def("__repr__", [](const ResistanceValue& v) {
        const Vec3 force = v.of.total().force;
        return fmt::format("soilvdb.Resistance(force=[{:.5g}, {:.5g}, {:.5g}] N)", force.x(),
                           force.y(), force.z());
      });

  using Geometry = std::shared_ptr<CutGeometry>;
  py::class_<CutGeometry, Geometry>(
      m, "CutGeometry",
      "Ground, blade and load at one place of a bucket: all that its resistance depends on besides "
      "the soil's strength. It stays as it is when the site goes on, and can be pickled.")
      .def(
          "resistance",
          [](const CutGeometry& g, const SoilProperties& soil, bool crescents) {
            return value_of(g, SoilStrength::of(soil), crescents);
          },
          py::arg("soil"), py::kw_only(), py::arg("crescents") = true,
          "As Site.resistance() at that place, for any soil.")
      .def(py::pickle([](const CutGeometry& g) { return py::bytes(g.save()); },
                      [](const py::bytes& bytes) {
                        return std::make_shared<CutGeometry>(
                            CutGeometry::load(bytes.cast<std::string>()));
                      }));

  const auto none = py::none();
  site.def("resistance", &resistance, py::arg("machine") = 0, py::kw_only(), py::arg("soil") = none,
           py::arg("crescents") = true,
           "The force of the soil on a machine's bucket where it is, as it last moved: passive "
           "earth pressure of the ground ahead (fundamental equation of earthmoving, Reece 1965, "
           "McKyes 1985) over strips of the blade, blunt edges, weight of the load, heels. The cut "
           "is zero where the bucket leaves the soil. soil: default: that of the site; rigid soil "
           "needs one. crescents: soil beside a blade without side plates moves with it. Not "
           "modelled: rate, water, rock, shape of teeth, lighter and weaker loose soil. Takes tens "
           "of microseconds, a steep blade some hundreds. Raises ValueError before the machine's "
           "first state.")
      .def(
          "cut_geometry",
          [](Site& s, const MachineName& machine) {
            return s.with([&](Session& session) {
              return std::make_shared<CutGeometry>(
                  session.cut_geometry(machine_of(session, machine)));
            });
          },
          py::arg("machine") = 0,
          "What the resistance depends on besides the soil, for identify() or many soils.")
      .def(
          "torques",
          [](Site& s, const MachineName& machine, const std::optional<SoilProperties>& soil,
             bool crescents) {
            const std::vector<double> torques = s.with([&](Session& session) {
              const std::size_t number = machine_of(session, machine);
              const CutGeometry geometry = session.cut_geometry(number);
              const Wrench all = geometry.resistance(strength_of(session, soil), crescents).total();
              return session.joint_loads(number,
                                         turned(all, geometry.world_from_bucket().rotation));
            });
            return Array(static_cast<py::ssize_t>(torques.size()), torques.data());
          },
          py::arg("machine") = 0, py::kw_only(), py::arg("soil") = none,
          py::arg("crescents") = true,
          "What that force does to a machine's joints, in their order, N m or N: positive the way "
          "that the joint's value grows. Weights of the links are not in it. Raises ValueError "
          "unless the last state was given by joints.");
  m.def(
      "resistances", &resistances, py::arg("sites"), py::arg("machine") = 0, py::kw_only(),
      py::arg("soil") = none, py::arg("crescents") = true, py::arg("threads") = none,
      "Site.resistance() of many sites: forces (sites, 3), N, and moments (sites, 3), N m, in "
      "the bucket's frame; NaN before the machine's first state. soil: one for all, or a list "
      "with one for each; default: each site's own. threads: default: all cores. Not modelled: as "
      "there.");
}

}  // namespace soilvdb::python
