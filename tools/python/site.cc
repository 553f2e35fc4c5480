// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soilvdb.Site: a session for Python.
#include "tools/python/site.h"

#include <fmt/format.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <tuple>

#include "tools/python/values.h"

namespace soilvdb::python {
namespace {

using Clock = std::chrono::steady_clock;

/// A member of the session as one of the site.
template <auto member>
auto of_session(Site& site) {
  return site.with([](Session& session) { return (session.*member)(); });
}

constexpr auto kSignalsEvery = std::chrono::milliseconds(50);

template <typename Value>
std::vector<Value> values(const py::tuple& given, const char* name, const char* kind) {
  std::vector<Value> all;
  for (const py::handle& one : given) {
    if (!py::isinstance<Value>(one)) not_of_kind(one, name, kind);
    all.push_back(one.cast<Value>());
  }
  return all;
}

constexpr const char* kMachines = "soilvdb.Bucket or soilvdb.Machine";
constexpr const char* kPours = "soilvdb.Pour";
constexpr const char* kHoppers = "soilvdb.Hopper";

Session make_session(double voxel_size, const TerrainValue& terrain, const py::tuple& machines,
                     const std::optional<SoilProperties>& soil, const py::tuple& pours,
                     const py::tuple& hoppers, const py::object& near, bool limits,
                     std::optional<io::Site> opened = {}) {
  SessionSite site{.voxel_size_m = voxel_size,
                   .terrain = terrain.terrain,
                   .limits = limits,
                   .opened = std::move(opened)};
  for (const py::handle& one : machines) {
    if (py::isinstance<Bucket>(one)) {
      site.machines.push_back(
          {fmt::format("machine {}", site.machines.size()), one.cast<Bucket>(), {}});
    } else {
      if (!py::isinstance<MachineValue>(one)) not_of_kind(one, "machines", kMachines);
      site.machines.push_back(one.cast<MachineValue>().machine);
    }
  }
  site.earthmoving = {soil, values<Pour>(pours, "pours", kPours),
                      values<Hopper>(hoppers, "hoppers", kHoppers)};
  if (!soil && !(site.earthmoving.pours.empty() && site.earthmoving.hoppers.empty()))
    throw py::value_error(
        "pours and hoppers are for soil that moves; give soil=Soil(repose_angle=..) as well");
  if (!near.is_none()) site.near_m = vector3(near, "near");
  require_own_process();
  const Released released;
  const Inside inside;
  return Session(std::move(site));
}

std::unique_ptr<Site> made(Session session, const py::tuple& from) {
  warn(session.site().warnings);
  warn(session.take_warnings());
  return std::make_unique<Site>(std::move(session), from);
}

/// The site before its first state, in another soil. It shares heights that are open.
/// @pre it was made by Site()
std::unique_ptr<Site> anew(Site& site, const std::optional<SoilProperties>& soil) {
  const py::tuple& old = site.made_from();
  const py::tuple from = py::make_tuple(old[0], old[1], old[2], soil, old[4], old[5], old[6]);
  const auto& terrain = from[1].cast<const TerrainValue&>();
  std::optional<io::Site> opened;
  bool limits = true;
  site.with([&](Session& session) {
    limits = session.limits();
    if (std::holds_alternative<io::RasterTerrain>(terrain.terrain))
      opened = io::undug_site(session.site());
  });
  return made(make_session(from[0].cast<double>(), terrain, from[2], soil, from[4], from[5],
                           from[6], limits, std::move(opened)),
              from);
}

/// @param step_of Session::update or Session::place
template <StepResult (Session::*step_of)(const MachineState&) noexcept>
Update update(Site& site, const MachineName& machine, const py::object& position,
              const py::object& rotation, const py::object& matrix, const py::object& joints,
              const py::object& base, std::optional<double> time) {
  MachineState state;
  std::vector<double> values;
  state.time_s = time;
  reading_states(site, machine, [&] {
    if (joints.is_none()) {
      if (!base.is_none()) throw py::type_error("base goes with joints");
      state.pose = pose(position, rotation, matrix);
      return;
    }
    if (!position.is_none() || !rotation.is_none() || !matrix.is_none())
      throw py::type_error("give either joints or a pose");
    const bool is_row = PyTuple_Check(joints.ptr()) || PyList_Check(joints.ptr()) ||
                        py::isinstance<py::array>(joints);
    values = numbers(is_row ? joints : joints_of(joints, joint_names(site, machine)), "joints");
    if (values.empty()) throw py::value_error("joints has no numbers");
    state.joints = values;
    state.base = base_of(base);
  });
  std::string name;
  std::vector<std::string> warnings;
  const StepResult step = site.with([&](Session& session) {
    state.machine = machine_of(session, machine);
    StepResult made = (session.*step_of)(state);
    if (!made.ok()) name = session.machines()[state.machine].name;
    warnings = session.take_warnings();
    return made;
  });
  tell(warnings);
  require_good(step, name);
  return step.update;
}

/// Moves one machine through many states. @return arrays of the updates' results
py::dict update_path(Site& site, const MachineName& machine, const py::object& positions,
                     const py::object& rotations, const py::object& poses, const py::object& joints,
                     const py::object& base, const py::object& times) {
  const std::vector<std::string> known = joint_names(site, machine);
  const States states = reading_states(site, machine, [&] {
    return States(positions, rotations, poses, joints, base, times, known);
  });
  const char* const names[] = {"cut_m3", "bucket_m3", "spilled_m3", "slid_m3", "us"};
  std::vector<Array> columns;
  std::vector<double*> out;
  for (std::size_t i = 0; i < std::size(names); ++i) {
    columns.emplace_back(static_cast<py::ssize_t>(states.count()));
    out.push_back(columns.back().mutable_data());
  }
  std::size_t done = 0;
  StepResult step;
  std::string name;
  std::vector<std::string> warnings;
  site.with([&](Session& session) {
    const std::size_t number = machine_of(session, machine);
    name = session.machines()[number].name;
    for (Clock::time_point looked = Clock::now(); done < states.count(); ++done) {
      if (Clock::now() - looked > kSignalsEvery) {
        handle_signals();
        looked = Clock::now();
      }
      try {
        MachineState state = states.at(done);
        state.machine = number;
        step = session.update(state);
      } catch (const py::value_error& e) {
        step = no_state(name, e.what());
      }
      if (!step.ok()) break;
      const Update& u = step.update;
      const double given[] = {u.cut_m3, u.bucket_m3, u.spilled_m3, u.slid_m3, u.us};
      for (std::size_t i = 0; i < std::size(given); ++i) out[i][done] = given[i];
    }
    warnings = session.take_warnings();
  });
  tell(warnings);
  require_good(step, name, fmt::format("state {}: ", done));
  py::dict all;
  for (std::size_t i = 0; i < std::size(names); ++i) all[names[i]] = columns[i];
  return all;
}

/// (position, rotation)
py::tuple arrays_of(const Pose& pose) {
  const std::array<double, kPoseNumbers> row = row_of(pose);
  return py::make_tuple(Array(py::ssize_t{3}, row.data()), Array(py::ssize_t{4}, &row[3]));
}

/// The bucket's pose as it is, or for one row of joints or many.
py::tuple pose_of_machine(Site& site, const MachineName& machine, const py::object& joints,
                          const py::object& base) {
  if (joints.is_none()) {
    if (!base.is_none()) throw py::type_error("base goes with joints");
    const Pose now = site.with([&](Session& session) {
      const std::size_t number = machine_of(session, machine);
      const std::optional<MachineState> last = session.last(number);
      if (!last)
        throw std::invalid_argument(fmt::format("machine '{}' has no pose before its first state",
                                                session.machines()[number].name));
      return last->pose;
    });
    return arrays_of(now);
  }
  const Array given = array_of(joints_of(joints, joint_names(site, machine)), "joints");
  if (given.ndim() < 1 || given.ndim() > 2 || given.shape(given.ndim() - 1) == 0)
    throw py::value_error("joints must have the shape (joints,) or (N, joints)");
  const py::ssize_t count = given.ndim() == 2 ? given.shape(0) : 1;
  const auto width = static_cast<std::size_t>(given.shape(given.ndim() - 1));
  const std::vector<double> values(given.data(), given.data() + given.size());
  const Poses bases(given.ndim() == 2 ? base : py::none());
  bases.require(static_cast<std::size_t>(count));
  const std::optional<Pose> one = given.ndim() == 2 ? std::nullopt : base_of(base);
  Array positions({count, py::ssize_t{3}}), turns({count, py::ssize_t{4}});
  double *position = positions.mutable_data(), *turn = turns.mutable_data();
  site.with([&](Session& session) {
    const std::size_t number = machine_of(session, machine);
    for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
      const auto row = row_of(session.pose(number, std::span(values).subspan(i * width, width),
                                           one ? one : bases.at(i)));
      position = std::copy_n(row.begin(), 3, position);
      turn = std::copy_n(&row[3], 4, turn);
    }
  });
  if (given.ndim() == 2) return py::make_tuple(positions, turns);
  return py::make_tuple(positions.reshape({3}), turns.reshape({4}));
}

/// Points in the world and triangles, in memory of Python.
py::tuple arrays_of(const Mesh& mesh, const Vec3& origin) {
  py::array_t<double> points({static_cast<py::ssize_t>(mesh.points.size()), py::ssize_t{3}});
  py::array_t<std::uint32_t> triangles(
      {static_cast<py::ssize_t>(mesh.triangles.size()), py::ssize_t{3}});
  double* p = points.mutable_data();
  for (const Eigen::Vector3f& point : mesh.points)
    for (int axis = 0; axis < 3; ++axis) *p++ = origin[axis] + static_cast<double>(point[axis]);
  std::uint32_t* t = triangles.mutable_data();
  for (const auto& triangle : mesh.triangles) t = std::copy(triangle.begin(), triangle.end(), t);
  return py::make_tuple(points, triangles);
}

struct Patch {
  py::tuple block;
  py::object points, triangles;
};

std::vector<Patch> changed_patches(Site& site) {
  Vec3 origin;
  const std::vector<SurfacePatch> patches = site.with([&](Session& session) {
    origin = session.origin();
    return session.changed_patches();
  });
  std::vector<Patch> all;
  for (const SurfacePatch& patch : patches) {
    const py::tuple arrays = arrays_of(patch.mesh, origin);
    all.push_back(
        {py::make_tuple(patch.block.x(), patch.block.y(), patch.block.z()), arrays[0], arrays[1]});
  }
  return all;
}

py::dict ledger_of(Site& site, const std::optional<MachineName>& machine) {
  double kg = 0, sample_m3 = 0;
  MassBalance balance;
  Surveyed surveyed;
  const Ledger ledger = site.with([&](Session& session) {
    balance = session.mass_balance_without_ground();
    sample_m3 = session.site().ground->sample_m3();
    surveyed = session.surveyed().value_or(Surveyed());
    if (!machine) return session.total();
    const std::size_t number = machine_of(session, *machine);
    kg = session.bucket_kg(number);
    return session.ledger(number);
  });
  py::dict all;
  all["cut_m3"] = ledger.cut_m3();
  all["captured_m3"] = ledger.captured_m3();
  all["displaced_m3"] = ledger.displaced_m3();
  all["bucket_m3"] = ledger.bucket_m3();
  all["spilled_m3"] = ledger.spilled_m3();
  all["dumped_m3"] = ledger.dumped_m3();
  if (machine) {
    all["bucket_kg"] = kg;
    return all;
  }
  const auto loose_m3 = [&](std::int64_t mass) {
    return balance.units.loose_samples(mass) * sample_m3;
  };
  all["poured_m3"] = loose_m3(balance.poured);
  all["hauled_m3"] = loose_m3(balance.hauled);
  all["slid_m3"] = loose_m3(balance.slid);
  all["fill_m3"] = static_cast<double>(balance.fill_samples) * sample_m3;
  all["surveyed_removed_m3"] = static_cast<double>(surveyed.removed) * sample_m3;
  all["surveyed_added_m3"] = static_cast<double>(surveyed.added) * sample_m3;
  return all;
}

py::tuple pair(const io::JournalExtent& extent) {
  return py::make_tuple(extent.updates, extent.time_s);
}

py::tuple record(Site& site, const std::filesystem::path& folder, std::optional<double> sync,
                 std::optional<double> snapshot_every, std::optional<bool> incremental,
                 std::optional<std::size_t> keep) {
  return pair(site.with([&](Session& session) {
    Recording recording = session.recording();
    recording.folder = folder;
    if (sync) recording.sync_s = *sync;
    if (snapshot_every) recording.snapshot_every_s = snapshot_every;
    if (incremental) recording.incremental = *incremental;
    if (keep) recording.keep = keep;
    return session.record(recording, [](const io::JournalExtent&) { handle_signals(); });
  }));
}

}  // namespace

void bind_site(py::module_& m) {
  end_forked_processes_at_once();
  py::module_::import("atexit").attr("register")(py::cpp_function([] {
    const py::gil_scoped_release released;
    if (!is_forked()) Gate::get().close();
  }));

  py::class_<Update>(m, "Update", "The result of one update.")
      .def_readonly("cut_m3", &Update::cut_m3, "volume cut from the ground, in place")
      .def_readonly("bucket_m3", &Update::bucket_m3, "load of the bucket after the update, loose")
      .def_readonly("spilled_m3", &Update::spilled_m3, "volume that left the bucket, loose")
      .def_readonly("slid_m3", &Update::slid_m3, "volume of the slopes that failed, loose")
      .def_readonly("us", &Update::us, "duration, microseconds")
      .def("__repr__",
           [](const Update& u) {
             return fmt::format("soilvdb.Update(cut_m3={:.6g}, bucket_m3={:.6g})", u.cut_m3,
                                u.bucket_m3);
           })
      .def(py::pickle(
          [](const Update& u) {
            return std::tuple(u.cut_m3, u.bucket_m3, u.spilled_m3, u.slid_m3, u.us);
          },
          [](const std::tuple<double, double, double, double, double>& t) {
            const auto& [cut, bucket, spilled, slid, us] = t;
            return Update{cut, bucket, spilled, slid, us};
          }));

  py::class_<Patch>(m, "Patch",
                    "A block's part of the surface. Without points the block has no surface.")
      .def_readonly("block", &Patch::block, "(i, j, k), index of the block's first voxel")
      .def_readonly("points", &Patch::points, "(n, 3) float64, m, world")
      .def_readonly("triangles", &Patch::triangles, "(m, 3) uint32, counter-clockwise from the air")
      .def(py::pickle([](const Patch& p) { return std::tuple(p.block, p.points, p.triangles); },
                      [](const std::tuple<py::tuple, py::object, py::object>& t) {
                        const auto& [block, points, triangles] = t;
                        return Patch{block, points.cast<py::array_t<double>>(),
                                     triangles.cast<py::array_t<std::uint32_t>>()};
                      }));

  const auto none = py::none();
  py::class_<Site> bound(m, "Site",
                         "The ground and the machines that dig it. World frame, m, rad, s.");
  bound
      .def(py::init([](double voxel_size, const TerrainValue& terrain, const py::object& machines,
                       const std::optional<SoilProperties>& soil, const py::object& pours,
                       const py::object& hoppers, const py::object& near, bool limits) {
             py::object place = near;  // a copy, because the caller may change the original
             if (!near.is_none()) {
               const Vec3 at = vector3(near, "near");
               place = py::make_tuple(at.x(), at.y(), at.z());
             }
             const py::tuple from = py::make_tuple(
                 voxel_size, terrain, several(machines, "machines", kMachines), soil,
                 several(pours, "pours", kPours), several(hoppers, "hoppers", kHoppers), place);
             return made(
                 make_session(voxel_size, terrain, from[2], soil, from[4], from[5], place, limits),
                 from);
           }),
           py::arg("voxel_size"), py::arg("terrain"), py::arg("machines"), py::kw_only(),
           py::arg("soil") = none, py::arg("pours") = py::tuple(), py::arg("hoppers") = py::tuple(),
           py::arg("near") = none, py::arg("limits").noconvert() = true,
           "voxel_size: m. machines: each a Bucket or a Machine. soil: properties of moving soil; "
           "default: soil is rigid. near: (x, y, z) where work begins, for terrains wider than "
           "2**16 voxels; on a plane, default: where the first state is. limits: refuse states "
           "that no machine has, as `soilvdb run` does: joints beyond their limits, a jump of more "
           "than 100 m and, if times are known, more than 50 m/s or 10 rad/s. Raises ValueError "
           "for an invalid site.")
      .def_static(
          "open",
          [](const std::filesystem::path& scenario, bool limits) {
            require_own_process();
            const auto open = [&] {
              const Released released;
              const Inside inside;
              Session session = Session::open(scenario);
              session.set_limits(limits);
              return session;
            };
            return made(open(), py::make_tuple(scenario));
          },
          py::arg("scenario"), py::kw_only(), py::arg("limits").noconvert() = true,
          "Opens a scenario: its site, machines and soil, before any machine moves. limits: as for "
          "Site().")
      .def_property(
          "limits", &of_session<&Session::limits>,
          [](Site& s, const py::object& given) {
            if (!PyBool_Check(given.ptr())) throw py::type_error("limits must be True or False");
            const bool on = given.is(py::bool_(true));
            s.with([&](Session& one) { one.set_limits(on); });
          },
          "True: states that no machine has are refused. May be set.")
      .def("update", &update<&Session::update>, py::arg("machine"), py::kw_only(),
           py::arg("position") = none, py::arg("rotation") = none, py::arg("pose") = none,
           py::arg("joints") = none, py::arg("base") = none, py::arg("time") = none,
           "Moves a machine (number or name) to a state; the first state places it. position: (x, "
           "y, z) of the middle of the lip, m. rotation: quaternion (x, y, z, w), default: no "
           "rotation. pose: 4x4 array in place of these, world from bucket. joints: values in the "
           "chain's order, or by name, in place of a pose, rad or m. base: world pose of the root "
           "of "
           "the joints of a machine that drives, (position, rotation) or a 4x4 array; default: "
           "where "
           "the machine stands. time: s, must not go back. If states have times, joints and base "
           "move evenly between states, pours fall, and hoppers come and go. Raises StateError for "
           "an invalid state, or one that no machine has, NoGroundError "
           "where the terrain has no height, TypeError for what is not numbers; nothing has moved "
           "then. Warns once of a bucket that "
           "moves backwards through soil for 2 m and catches none.")
      .def(
          "place", &update<&Session::place>, py::arg("machine"), py::kw_only(),
          py::arg("position") = none, py::arg("rotation") = none, py::arg("pose") = none,
          py::arg("joints") = none, py::arg("base") = none, py::arg("time") = none,
          "Takes a machine to a state without digging, however far it is, as if it were lifted "
          "off: "
          "soil that it pushed or held up comes to rest, its load stays as far as the bucket holds "
          "it there. Arguments as for update(). The bucket must be in the air there, a voxel or "
          "more above ground. Raises the errors of update(); nothing has changed then.")
      .def("update_path", &update_path, py::arg("machine"), py::kw_only(),
           py::arg("positions") = none, py::arg("rotations") = none, py::arg("poses") = none,
           py::arg("joints") = none, py::arg("base") = none, py::arg("times") = none,
           "update() for many states in one call: positions (N, 3) with rotations (N, 4), poses "
           "(N, 4, 4), or joints (N, joints) or by name, with base ((N, 3), (N, 4)) or (N, 4, 4). "
           "Returns arrays (N,) by name: cut_m3, "
           "bucket_m3, "
           "spilled_m3, slid_m3, us. Stops at the first bad state with the error of update() and "
           "the state's number; the machine has moved through the states before.")
      .def(
          "joints", [](Site& s, const MachineName& machine) { return joint_names(s, machine); },
          py::arg("machine"), "Names of a machine's joints, in order; empty if it has no joints.")
      .def(
          "base",
          [](Site& s, const MachineName& machine) {
            return arrays_of(s.with(
                [&](Session& session) { return session.base(machine_of(session, machine)); }));
          },
          py::arg("machine"),
          "World pose of the root of a machine's joints after its last state: (position, "
          "rotation), (3,) and x, y, z, w, (4,). Raises ValueError for a machine without joints.")
      .def(
          "pose", &pose_of_machine, py::arg("machine"), py::arg("joints") = none,
          py::arg("base") = none,
          "World pose of a machine's bucket after its last state, or at given joints; the bucket "
          "does not move. joints: (joints,), rad or m, (N, joints), or values by name. base: as in "
          "update() or update_path(); default: where the machine stands. Returns "
          "(position, rotation), (3,) and x, y, z, w, (4,), or (N, 3) and (N, 4). Raises "
          "ValueError before the first state; with joints, for a machine without any, or for "
          "another number of joints.")
      .def(
          "pour",
          [](Site& s, double until) {
            require_good(s.with([&](Session& session) { return session.pour(until); }));
          },
          py::arg("until"), "Lets pours fall up to a time, s. update() with a time does so too.")
      .def(
          "reset_clock",
          [](Site& s, const std::variant<std::ptrdiff_t, std::string>& machine) {
            require_good(s.with([&](Session& session) {
              return session.reset_clock(machine_of(session, machine));
            }));
          },
          py::arg("machine"),
          "Call it after a machine's wrong clock was set right: the machine's next time may be "
          "earlier than its last time.")
      .def(
          "come_to_rest", [](Site& s) { require_good(of_session<&Session::come_to_rest>(s)); },
          "Lets soil that is too steep or overhangs come to rest, as at the end of a run.")
      .def(
          "mesh",
          [](Site& s) {
            Vec3 origin;
            const Mesh mesh = s.with([&](Session& session) {
              origin = session.origin();
              return session.mesh();
            });
            return arrays_of(mesh, origin);
          },
          "Returns the surface of all touched ground: points (n, 3) float64, m, world, and "
          "triangles (m, 3) uint32.")
      .def("changed_patches", &changed_patches,
           "Returns the patches of the surface that changed since the last call; the first call "
           "returns all.")
      .def("ledger", &ledger_of, py::arg("machine") = none,
           "Volumes of a machine, or of all machines, m3. In place: cut, captured and displaced. "
           "Loose: the bucket's load, spilled and dumped. One machine also has bucket_kg. All "
           "machines also have fill_m3, which moving soil added to the ground. They also have "
           "loose volumes of pours, hoppers and failed slopes: poured_m3, hauled_m3, slid_m3, and "
           "what scans and surveys took from the ground and added to it, in place: "
           "surveyed_removed_m3, surveyed_added_m3.")
      .def("change_m3", &of_session<&Session::change_m3>,
           "Volume of the ground minus that of the terrain, counted anew, m3.")
      .def("ground_hash", &of_session<&Session::ground_hash>,
           "Hash of the ground: `state_hash` of a run's summary.json, as a number.")
      .def_property_readonly("voxel_size", &of_session<&Session::voxel_size_m>)
      .def_property_readonly(
          "machines",
          [](Site& s) {
            std::vector<std::string> names;
            s.with([&](Session& session) {
              for (const SiteMachine& machine : session.machines()) names.push_back(machine.name);
            });
            return names;
          },
          "Names of the machines.")
      .def_property_readonly(
          "soil",
          [](Site& s) {
            return s.with([](Session& session) { return session.earthmoving().soil; });
          },
          "Properties of the soil that moves, a Soil; None where soil is rigid.")
      .def(
          "write",
          [](Site& s, const std::filesystem::path& file) {
            s.with([&](Session& session) { session.write(file); });
          },
          py::arg("file"),
          "Writes a snapshot for soilvdb and other programs; its name must end with .vdb. `soilvdb "
          "export` makes rasters and meshes from it. Terrain of an array is written beside it, as "
          "terrain_....tif, which it needs.")
      .def(
          "save", [](Site& s) { return py::bytes(of_session<&Session::save>(s)); },
          "Returns the complete state that the next update depends on, as bytes for restore().")
      .def(
          "restore",
          [](Site& s, const py::bytes& state) {
            char* data = nullptr;
            py::ssize_t size = 0;
            if (PyBytes_AsStringAndSize(state.ptr(), &data, &size) != 0)
              throw py::error_already_set();
            const std::string_view bytes(data, static_cast<std::size_t>(size));
            s.with([&](Session& session) { session.restore(bytes); });
          },
          py::arg("state"),
          "Restores a state of the same site. Raises ValueError for any other bytes, and for a "
          "site that is recorded: clone() it, or stop_recording() first. An error changes nothing.")
      .def(
          "clone",
          [](Site& s) {
            return std::make_unique<Site>(of_session<&Session::clone>(s), s.made_from());
          },
          "Returns another site in the same state: the same updates give the same results in both.")
      .def(
          "record", &record, py::arg("folder"), py::kw_only(), py::arg("sync") = none,
          py::arg("snapshot_every") = none, py::arg("incremental") = none, py::arg("keep") = none,
          "Records all states in a folder; call it before the first state. If the folder holds a "
          "recording of the same site, the site continues from its end. sync: longest time until a "
          "state is on disk, s; 0: before update() returns. snapshot_every: s between snapshots, "
          "which make it quick to continue. They are written beside updates; a snapshot waits "
          "until the last one is on disk. incremental: snapshots of the changes only. keep: number "
          "of snapshots that stay. Defaults: those of the scenario, else sync 1 and no snapshots. "
          "Returns (updates, time) that the folder held. Raises ValueError for a folder of another "
          "site.")
      .def_property_readonly(
          "acknowledged", [](Site& s) { return pair(of_session<&Session::acknowledged>(s)); },
          "(updates, time) of the part of the recording that is on disk for certain.")
      .def("flush", &of_session<&Session::flush>, "Waits until the whole recording is on disk.")
      .def("stop_recording", &of_session<&Session::stop_recording>,
           "Calls flush() and releases the folder.")
      .def(
          "limit_memory",
          [](Site& s, double megabytes, const std::filesystem::path& folder) {
            if (!(megabytes > 0 && megabytes < 1e12))
              throw py::value_error(
                  fmt::format("the memory is {} MB; it must be more than 0", megabytes));
            s.with([&](Session& session) {
              session.set_memory_limit(static_cast<std::uint64_t>(megabytes * 1e6), folder);
            });
          },
          py::arg("megabytes"), py::arg("folder"),
          "Limits the memory of the ground: ground that was unused for longest goes to a file "
          "without a name in the folder. Updates give the same bits. A limited site cannot be "
          "cloned.")
      .def("close", &Site::close,
           "Flushes the recording, if any, and frees the site's memory. All later calls raise "
           "RuntimeError.")
      .def_property_readonly("_made_from", &Site::made_from)
      .def("_anew", &anew, py::arg("soil"))
      .def(
          "_has_machines_of",
          [](Site& s, Site& other) {
            bool same = false;
            with_all({&s, &other},
                     [&](const auto& both) { same = both[0]->has_machines_of(*both[1]); });
            return same;
          },
          py::arg("other"))
      .def("__enter__", [](py::object self) { return self; })
      .def("__exit__", [](Site& s, const py::args&) { s.close(); })
      .def("__reduce__", [](const py::object& self) {
        auto& site = self.cast<Site&>();
        const py::bytes state(of_session<&Session::save>(site));
        return py::make_tuple(
            py::module_::import("soilvdb").attr("_unpickle"),
            py::make_tuple(site.made_from(), state, of_session<&Session::limits>(site)));
      });

  bind_looks(bound, m);
  bind_many(m);
  bind_force(bound, m);
  bind_scans(bound, m);
}

}  // namespace soilvdb::python
