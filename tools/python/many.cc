// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// One call for many sites.
#include <fmt/format.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <limits>
#include <set>

#include "tools/python/site.h"

namespace soilvdb::python {
namespace {

/// One update of each of many sites.
struct Stepped {
  std::vector<StepResult> results;
  std::vector<std::string> machines;                          ///< names
  std::vector<double> bucket_m3;                              ///< after it, or as it was
  std::vector<std::pair<std::size_t, std::string>> warnings;  ///< sites and lines

  py::object error(std::size_t i) const {
    return error_of(results[i], machines[i], fmt::format("site {}: ", i));
  }
};

/// The number of the first site that isn't closed, to read states for; 0 without any.
std::size_t first_open(const std::vector<Site*>& sites) {
  const auto found =
      std::find_if(sites.begin(), sites.end(), [](Site* site) { return !site->is_closed(); });
  return found == sites.end() ? 0 : static_cast<std::size_t>(found - sites.begin());
}

Stepped step_each(const std::vector<Site*>& sites, const MachineName& machine,
                  const py::object& positions, const py::object& rotations, const py::object& poses,
                  const py::object& joints, const py::object& base, const py::object& times,
                  const std::optional<int>& threads) {
  std::vector<std::string> names;  // of joints
  Site* const like = sites.empty() ? nullptr : sites[first_open(sites)];
  if (like != nullptr) names = joint_names(*like, machine);
  const auto read = [&] {
    States states(positions, rotations, poses, joints, base, times, names);
    if (like != nullptr && states.joints() > 0 && states.joints() != names.size())
      throw py::value_error(
          names.empty() ? "joints: the machine has none; give it a pose"
                        : fmt::format("joints has the shape ({0}, {1}); it must be ({0}, {2})",
                                      states.count(), states.joints(), names.size()));
    return states;
  };
  const States given = like == nullptr ? read() : reading_states(*like, machine, read);
  if (given.count() != sites.size())
    throw py::value_error(
        fmt::format("there are {} states for {} sites", given.count(), sites.size()));
  Stepped all;
  all.results.resize(sites.size());
  all.machines.resize(sites.size());
  all.bucket_m3.resize(sites.size(), std::numeric_limits<double>::quiet_NaN());
  const auto step_open = [&](const std::vector<Session*>& sessions) {
    std::vector<std::size_t> numbers;
    std::vector<Session*> open;
    std::vector<MachineState> states;
    std::vector<StepResult> wrong(sites.size());
    for (std::size_t i = 0; i < sites.size(); ++i) {
      if (sessions[i] == nullptr) {
        all.results[i] = {Status::kFailed, "the site is closed", {}};
        continue;
      }
      numbers.push_back(i);
      open.push_back(sessions[i]);
      MachineState& state = states.emplace_back();
      const std::size_t number = of_site(i, [&] { return machine_of(*sessions[i], machine); });
      all.machines[i] = sessions[i]->machines()[number].name;
      try {
        state = given.at(i);
      } catch (const py::value_error& e) {  // no pose
        wrong[i] = no_state(all.machines[i], e.what());
        state.pose.position.setConstant(std::numeric_limits<double>::quiet_NaN());
      }
      state.machine = number;
    }
    constexpr std::size_t kGroup = 32;  // updates take up to some milliseconds
    in_groups(open.size(), kGroup, threads, [&](std::size_t first, std::size_t last) {
      std::vector<StepResult> made =
          soilvdb::update_many(std::span(open).subspan(first, last - first),
                               std::span(states).subspan(first, last - first));
      std::vector<std::size_t>::const_iterator i = numbers.begin() + std::ptrdiff_t(first);
      for (StepResult& one : made) all.results[*i++] = std::move(one);
    });
    for (std::size_t k = 0; k < open.size(); ++k) {
      const std::size_t i = numbers[k];
      if (!wrong[i].ok()) all.results[i] = wrong[i];
      all.bucket_m3[i] = open[k]->ledger(states[k].machine).bucket_m3();
      for (std::string& line : open[k]->take_warnings())
        all.warnings.emplace_back(i, std::move(line));
    }
  };
  with_all(sites, step_open, /*also_closed=*/true);
  return all;
}

/// Warns of each line once. @param told those that were told before, and now these
void tell_once(const Stepped& all, py::set told, int level) {
  for (const auto& [site, line] : all.warnings) {
    if (told.contains(line)) continue;
    told.add(line);
    tell({fmt::format("site {}: {}", site, line)}, level);
  }
}

/// The results of one update each: arrays by name, and the errors of refused states by site.
py::tuple step_sites(const py::tuple& kept, const MachineName& machine, const py::object& positions,
                     const py::object& rotations, const py::object& poses, const py::object& joints,
                     const py::object& base, const py::object& times,
                     const std::optional<int>& threads, const py::set& told) {
  const std::vector<Site*> sites = sites_of(kept);
  const Stepped all =
      step_each(sites, machine, positions, rotations, poses, joints, base, times, threads);
  constexpr int kCaller = 2;  // of VectorSite.step()
  tell_once(all, told, kCaller);
  const auto count = static_cast<py::ssize_t>(sites.size());
  const char* const names[] = {"cut_m3", "bucket_m3", "spilled_m3", "slid_m3"};
  py::dict columns, errors;
  std::vector<double*> out;
  for (const char* name : names) {
    Array column(count);
    out.push_back(column.mutable_data());
    columns[name] = column;
  }
  py::array_t<std::int8_t> status(count);
  for (std::size_t i = 0; i < sites.size(); ++i) {
    const Update& u = all.results[i].update;
    const double values[] = {u.cut_m3, all.bucket_m3[i], u.spilled_m3, u.slid_m3};
    for (std::size_t n = 0; n < std::size(names); ++n) out[n][i] = values[n];
    status.mutable_data()[i] = static_cast<std::int8_t>(all.results[i].status);
    if (!all.results[i].ok()) errors[py::int_(i)] = all.error(i);
  }
  columns["status"] = status;
  return py::make_tuple(columns, errors);
}

std::vector<Update> update_sites(const py::object& given, const MachineName& machine,
                                 const py::object& positions, const py::object& rotations,
                                 const py::object& poses, const py::object& joints,
                                 const py::object& base, const py::object& times,
                                 std::optional<double> time) {
  const py::tuple kept = several(given, "sites", "soilvdb.Site");  // keeps the sites alive
  const std::vector<Site*> sites = sites_of(kept);
  if (time && !times.is_none()) throw py::type_error("give either time or times");
  const std::size_t like = first_open(sites);
  for (std::size_t i = like + 1; i < sites.size() && py::hasattr(joints, "keys"); ++i)
    if (!sites[i]->is_closed() &&
        joint_names(*sites[i], machine) != joint_names(*sites[like], machine))
      throw py::value_error(
          fmt::format("site {} has other joints than site {}; give joints as an array", i, like));
  py::object each = times;
  if (time) {
    Array one(static_cast<py::ssize_t>(sites.size()));
    std::fill_n(one.mutable_data(), sites.size(), *time);
    each = one;
  }
  const Stepped all =
      step_each(sites, machine, positions, rotations, poses, joints, base, each, {});
  tell_once(all, py::set(), 1);
  std::vector<Update> updates;
  for (std::size_t i = 0; i < sites.size(); ++i) {
    if (!all.results[i].ok()) throw_error(all.error(i));
    updates.push_back(all.results[i].update);
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
  m.def("_array", [](const py::object& given, const char* name) { return array_of(given, name); });
  m.def("_step_sites", &step_sites, py::arg("sites"), py::arg("machine"), py::arg("positions"),
        py::arg("rotations"), py::arg("poses"), py::arg("joints"), py::arg("base"),
        py::arg("times"), py::arg("threads"), py::arg("told"));
  m.def(
      "update_many", &update_sites, py::arg("sites"), py::arg("machine"), py::kw_only(),
      py::arg("positions") = none, py::arg("rotations") = none, py::arg("poses") = none,
      py::arg("joints") = none, py::arg("base") = none, py::arg("times") = none,
      py::arg("time") = none,
      "One update of a machine (number or name) in each of N sites, on all cores. One of: "
      "positions "
      "(N, 3) with or without rotations (N, 4); poses (N, 4, 4); joints (N, joints), or by name, "
      "with or without base, ((N, 3), (N, 4)) or (N, 4, 4). times: (N,), or time: one for all, s. "
      "Returns N Updates. Raises the error of the first bad site, StateError or NoGroundError, "
      "when "
      "the others have moved; VectorSite.step() returns results and errors of all. Raises "
      "ValueError, and moves none, for another number of states than of sites, or of joints.");
}

}  // namespace soilvdb::python
