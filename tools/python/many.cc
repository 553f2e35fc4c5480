// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// One call for many sites.
#include <fmt/format.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <set>

#include "tools/python/site.h"

namespace soilvdb::python {
namespace {

/// The results of one update each: arrays by name, and the errors of refused states by site.
py::tuple step_sites(const py::tuple& kept, const MachineName& machine, const py::object& positions,
                     const py::object& rotations, const py::object& poses, const py::object& joints,
                     const py::object& base, const py::object& times,
                     const std::optional<int>& threads) {
  const std::vector<Site*> sites = sites_of(kept);
  if (sites.empty()) throw py::value_error("there are no sites");
  const States given(positions, rotations, poses, joints, base, times,
                     joint_names(*sites[0], machine));
  if (given.count() != sites.size())
    throw py::value_error(
        fmt::format("there are {} states for {} sites", given.count(), sites.size()));
  const auto count = static_cast<py::ssize_t>(sites.size());
  const char* const names[] = {"cut_m3", "bucket_m3", "spilled_m3", "slid_m3"};
  std::vector<Array> columns;
  std::vector<double*> out;
  for (std::size_t i = 0; i < std::size(names); ++i) {
    columns.emplace_back(count);
    out.push_back(columns.back().mutable_data());
  }
  py::array_t<std::int8_t> status(count);
  std::int8_t* const codes = status.mutable_data();
  std::vector<StepResult> results;
  std::vector<std::string> machines(sites.size()), warnings;
  with_all(sites, [&](const std::vector<Session*>& sessions) {
    std::vector<MachineState> states(sites.size());
    std::vector<StepResult> wrong(sites.size());
    for (std::size_t i = 0; i < sites.size(); ++i) {
      try {
        states[i] = given.at(i);
      } catch (const py::value_error& e) {  // no pose
        wrong[i] = {Status::kBadState, e.what(), {}};
        states[i].pose.position.setConstant(std::numeric_limits<double>::quiet_NaN());
      }
      states[i].machine = machine_of(*sessions[i], machine);
    }
    on_threads(threads, [&] { results = soilvdb::update_many(sessions, states); });
    for (std::size_t i = 0; i < sites.size(); ++i) {
      const Update& u = results[i].update;
      codes[i] = static_cast<std::int8_t>(results[i].status);
      const double bucket_m3 = sessions[i]->ledger(states[i].machine).bucket_m3();
      const double values[] = {u.cut_m3, bucket_m3, u.spilled_m3, u.slid_m3};
      for (std::size_t n = 0; n < std::size(names); ++n) out[n][i] = values[n];
      if (!wrong[i].ok()) results[i].why = wrong[i].why;
      if (!results[i].ok()) machines[i] = sessions[i]->machines()[states[i].machine].name;
      for (std::string& line : sessions[i]->take_warnings()) warnings.push_back(std::move(line));
    }
  });
  py::dict all, errors;
  for (std::size_t i = 0; i < std::size(names); ++i) all[names[i]] = columns[i];
  all["status"] = status;
  for (std::size_t i = 0; i < results.size(); ++i)
    if (!results[i].ok())
      errors[py::int_(i)] = error_of(results[i], machines[i], fmt::format("site {}: ", i));
  tell(warnings);
  return py::make_tuple(all, errors);
}

/// @param states of the sites, (N, 3) or (N, 4)
std::vector<Update> update_sites(const py::object& given, const MachineName& machine,
                                 const py::object& positions, const py::object& rotations,
                                 std::optional<double> time) {
  const py::tuple kept = several(given, "sites", "soilvdb.Site");  // keeps the sites alive
  const std::vector<Site*> sites = sites_of(kept);
  const Array places = rows(positions, "positions", 3);
  const Array turns = rotations.is_none() ? Array() : rows(rotations, "rotations", 4);
  if (static_cast<std::size_t>(places.shape(0)) != sites.size() ||
      (!rotations.is_none() && turns.shape(0) != places.shape(0)))
    throw py::value_error(
        fmt::format("there are {} sites; there must be as many positions and "
                    "rotations",
                    sites.size()));
  std::vector<MachineState> states(sites.size());
  for (std::size_t i = 0; i < sites.size(); ++i) {
    states[i].time_s = time;
    states[i].pose.position = Vec3(places.data() + 3 * i);
    if (!rotations.is_none()) states[i].pose.rotation = quaternion({turns.data() + 4 * i, 4});
  }
  std::vector<StepResult> results;
  std::vector<std::string> machines, warnings;
  with_all(sites, [&](const std::vector<Session*>& sessions) {
    for (std::size_t i = 0; i < sites.size(); ++i)
      states[i].machine = machine_of(*sessions[i], machine);
    results = soilvdb::update_many(sessions, states);
    for (std::size_t i = 0; i < sites.size(); ++i) {
      machines.push_back(sessions[i]->machines()[states[i].machine].name);
      for (std::string& line : sessions[i]->take_warnings()) warnings.push_back(std::move(line));
    }
  });
  tell(warnings);
  std::vector<Update> updates;
  for (std::size_t i = 0; i < results.size(); ++i) {
    require_good(results[i], machines[i], fmt::format("site {}: ", i));
    updates.push_back(results[i].update);
  }
  return updates;
}

}  // namespace

/// Different sites. @param kept keeps them alive
std::vector<Site*> sites_of(const py::tuple& kept) {
  std::vector<Site*> sites;
  for (const py::handle& one : kept) {
    if (!py::isinstance<Site>(one)) not_of_kind(one, "sites", "soilvdb.Site");
    sites.push_back(&one.cast<Site&>());
  }
  if (std::set<Site*>(sites.begin(), sites.end()).size() != sites.size())
    throw py::value_error("a site is there twice");
  return sites;
}

void bind_many(py::module_& m) {
  const auto none = py::none();
  m.def("_step_sites", &step_sites, py::arg("sites"), py::arg("machine"), py::arg("positions"),
        py::arg("rotations"), py::arg("poses"), py::arg("joints"), py::arg("base"),
        py::arg("times"), py::arg("threads"));
  m.def(
      "update_many", &update_sites, py::arg("sites"), py::arg("machine"), py::kw_only(),
      py::arg("positions"), py::arg("rotations") = none, py::arg("time") = none,
      "One update for each of many sites, on all cores: positions (N, 3), rotations (N, 4). Raises "
      "the error of the first bad site; the others have moved.");
}

}  // namespace soilvdb::python
