// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soilvdb.Site: a session for Python. Each call of the engine releases the interpreter's lock and
// locks the site, so several threads may use one site.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>
#include <tbb/parallel_for.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <mutex>
#include <set>
#include <tuple>

#include "soilvdb/session.h"
#include "tools/python/arguments.h"
#include "tools/python/interpreter.h"
#include "tools/python/values.h"

namespace soilvdb::python {
namespace {

using Clock = std::chrono::steady_clock;

constexpr auto kSignalsEvery = std::chrono::milliseconds(50);

py::handle no_ground_error;

[[noreturn]] void refuse(Status status, const std::string& why) {
  if (status == Status::kBadState) throw py::value_error(why);
  PyErr_SetString(status == Status::kNoGround ? no_ground_error.ptr() : PyExc_RuntimeError,
                  why.c_str());
  throw py::error_already_set();
}

void require_own_process() {
  if (!is_forked()) return;
  throw std::runtime_error(
      "soilvdb can't be used in a process that was forked from one that used it; start that with "
      "multiprocessing's method 'spawn'");
}

/// A session, and its construction arguments for pickle.
class Site {
 public:
  Site(Session session, py::tuple made_from)
      : session_(std::make_unique<Session>(std::move(session))), made_from_(std::move(made_from)) {}
  ~Site() {
    if (is_forked()) session_.release();  // this process lacks its threads
  }

  /// Calls f(session) exclusively, without the interpreter's lock.
  template <typename F>
  auto with(const F& f) {
    require_own_process();
    const Released released;
    const std::lock_guard lock(turn_);
    const Inside inside;
    return f(open());
  }
  Session& open() {
    if (!session_) throw std::runtime_error("the site is closed");
    return *session_;
  }
  void close() {
    require_own_process();
    const Released released;
    const std::lock_guard lock(turn_);
    const Inside inside;
    const std::unique_ptr<Session> session = std::move(session_);
    if (session) session->stop_recording();
  }
  Turn& turn() { return turn_; }
  const py::tuple& made_from() const { return made_from_; }

 private:
  Turn turn_;
  std::unique_ptr<Session> session_;
  py::tuple made_from_;
};

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
                     const py::tuple& hoppers, const py::object& near) {
  SessionSite site{.voxel_size_m = voxel_size, .terrain = terrain.terrain};
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
  if (!near.is_none()) site.near_m = vector3(near, "near");
  require_own_process();
  const Released released;
  const Inside inside;
  return Session(std::move(site));
}

std::unique_ptr<Site> made(Session session, const py::tuple& from) {
  warn(session.site().warnings);
  return std::make_unique<Site>(std::move(session), from);
}

std::size_t machine_of(Session& session, const std::variant<std::ptrdiff_t, std::string>& given) {
  if (const auto* name = std::get_if<std::string>(&given)) return session.machine(*name);
  const std::ptrdiff_t number = std::get<std::ptrdiff_t>(given);
  if (number < 0 || static_cast<std::size_t>(number) >= session.machines().size())
    throw py::value_error(fmt::format("there is no machine {}; there are {}, numbered from 0",
                                      number, session.machines().size()));
  return static_cast<std::size_t>(number);
}

using MachineName = std::variant<std::ptrdiff_t, std::string>;

Update update(Site& site, const MachineName& machine, const py::object& position,
              const py::object& rotation, const py::object& matrix, const py::object& joints,
              std::optional<double> time) {
  MachineState state;
  std::vector<double> values;
  state.time_s = time;
  if (joints.is_none()) {
    state.pose = pose(position, rotation, matrix);
  } else {
    if (!position.is_none() || !rotation.is_none() || !matrix.is_none())
      throw py::type_error("give either joints or a pose");
    values = numbers(joints, "joints");
    if (values.empty()) throw py::value_error("joints has no numbers");
    state.joints = values;
  }
  const StepResult step = site.with([&](Session& session) {
    state.machine = machine_of(session, machine);
    return session.update(state);
  });
  if (!step.ok()) refuse(step.status, step.why);
  return step.update;
}

/// Moves one machine through many states. @return arrays of the updates' results
py::dict update_path(Site& site, const MachineName& machine, const py::object& positions,
                     const py::object& rotations, const py::object& poses, const py::object& joints,
                     const py::object& times) {
  const bool by_pose = !poses.is_none(), by_joints = !joints.is_none();
  if (by_pose + by_joints + !positions.is_none() != 1)
    throw py::type_error("give one of positions (with rotations), poses or joints");
  Array rows_of, turns, times_s;
  if (by_pose) {
    rows_of = array_of(poses, "poses");
    if (rows_of.ndim() != 3 || rows_of.shape(1) != 4 || rows_of.shape(2) != 4)
      throw py::value_error("poses must have the shape (N, 4, 4)");
  } else if (by_joints) {
    rows_of = array_of(joints, "joints");
    if (rows_of.ndim() != 2 || rows_of.shape(1) == 0)
      throw py::value_error("joints must have the shape (N, joints)");
  } else {
    rows_of = rows(positions, "positions", 3);
    if (!rotations.is_none()) turns = rows(rotations, "rotations", 4);
  }
  const py::ssize_t count = rows_of.shape(0);
  if (!rotations.is_none() && turns.shape(0) != count)
    throw py::value_error(
        fmt::format("there are {} rotations for {} positions", turns.shape(0), count));
  if (!times.is_none()) {
    const std::vector<double> given = numbers(times, "times");
    if (static_cast<py::ssize_t>(given.size()) != count)
      throw py::value_error(fmt::format("there are {} times for {} states", given.size(), count));
    if (std::any_of(given.begin(), given.end(), [](double t) { return std::isnan(t); }))
      throw py::value_error("times has a nan; leave times out if they are unknown");
    times_s = Array(count, given.data());
  }
  const char* const names[] = {"cut_m3", "bucket_m3", "spilled_m3", "slid_m3", "us"};
  std::vector<Array> columns;
  std::vector<double*> out;
  for (std::size_t i = 0; i < std::size(names); ++i) {
    columns.emplace_back(count);
    out.push_back(columns.back().mutable_data());
  }
  // Copies, because another thread may write to the arrays meanwhile.
  const std::vector<double> states(rows_of.data(), rows_of.data() + rows_of.size());
  const std::vector<double> rotation(turns.data(), turns.data() + turns.size());
  const std::vector<double> time(times_s.data(), times_s.data() + times_s.size());
  const auto width = static_cast<std::size_t>(count > 0 ? rows_of.size() / count : 0);
  std::size_t done = 0;
  StepResult step;
  site.with([&](Session& session) {
    MachineState state;
    state.machine = machine_of(session, machine);
    for (Clock::time_point looked = Clock::now(); done < static_cast<std::size_t>(count); ++done) {
      if (Clock::now() - looked > kSignalsEvery) {
        handle_signals();
        looked = Clock::now();
      }
      const std::span<const double> row = std::span(states).subspan(done * width, width);
      if (by_pose) {
        try {
          state.pose = pose_of(row);
        } catch (const py::value_error& e) {
          step = {Status::kBadState, e.what(), {}};
          return;
        }
      } else if (by_joints) {
        state.joints = row;
      } else {
        state.pose.position = Vec3(row.data());
        if (!rotation.empty())
          state.pose.rotation = quaternion(std::span(rotation).subspan(4 * done, 4));
      }
      if (!time.empty()) state.time_s = time[done];
      step = session.update(state);
      if (!step.ok()) return;
      const Update& u = step.update;
      const double given[] = {u.cut_m3, u.bucket_m3, u.spilled_m3, u.slid_m3, u.us};
      for (std::size_t i = 0; i < std::size(given); ++i) out[i][done] = given[i];
    }
  });
  if (!step.ok()) refuse(step.status, fmt::format("state {}: {}", done, step.why));
  py::dict all;
  for (std::size_t i = 0; i < std::size(names); ++i) all[names[i]] = columns[i];
  return all;
}

/// The bucket's pose for one row of joints or many.
py::tuple pose_by_joints(Site& site, const MachineName& machine, const py::object& joints) {
  const Array given = array_of(joints, "joints");
  if (given.ndim() < 1 || given.ndim() > 2 || given.shape(given.ndim() - 1) == 0)
    throw py::value_error("joints must have the shape (joints,) or (N, joints)");
  const py::ssize_t count = given.ndim() == 2 ? given.shape(0) : 1;
  const auto width = static_cast<std::size_t>(given.shape(given.ndim() - 1));
  const std::vector<double> values(given.data(), given.data() + given.size());
  Array positions({count, py::ssize_t{3}}), turns({count, py::ssize_t{4}});
  double *position = positions.mutable_data(), *turn = turns.mutable_data();
  site.with([&](Session& session) {
    const std::size_t number = machine_of(session, machine);
    for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
      const Pose pose = session.pose(number, std::span(values).subspan(i * width, width));
      position = std::copy(pose.position.begin(), pose.position.end(), position);
      const Eigen::Vector4d xyzw = pose.rotation.coeffs();
      turn = std::copy(xyzw.begin(), xyzw.end(), turn);
    }
  });
  if (given.ndim() == 2) return py::make_tuple(positions, turns);
  return py::make_tuple(positions.reshape({3}), turns.reshape({4}));
}

/// @param heights_of Session::heights or Session::mesh_heights
Array heights(Site& site, const py::object& xy,
              void (Session::*heights_of)(std::span<const Vec2>, std::span<double>)) {
  const Array given = rows(xy, "xy", 2);
  const auto count = static_cast<std::size_t>(given.shape(0));
  std::vector<Vec2> places(count);
  for (std::size_t i = 0; i < count; ++i) places[i] = Vec2(given.data() + 2 * i);
  Array out(static_cast<py::ssize_t>(count));
  const std::span<double> heights_m(out.mutable_data(), count);
  site.with([&](Session& session) {
    constexpr std::size_t kPiece = 1 << 18;  // some tens of milliseconds
    for (std::size_t from = 0; from < count; from += kPiece) {
      if (from > 0) handle_signals();
      const std::size_t piece = std::min(kPiece, count - from);
      (session.*heights_of)(std::span(places).subspan(from, piece), heights_m.subspan(from, piece));
    }
  });
  return out;
}

/// What a height map is asked for.
struct MapRequest {
  MapGrid grid;  ///< its place and axis unless `machine` says them
  std::optional<MachineName> machine;
  bool turned = true;
  MapLayer layer = MapLayer::kHeight;
  std::optional<double> ceiling;

  MapRequest(const std::optional<MachineName>& around, const py::object& origin,
             const py::object& matrix, const std::pair<py::ssize_t, py::ssize_t>& shape,
             double cell, bool turn, const std::string& name, std::optional<double> below)
      : machine(around), turned(turn), ceiling(below) {
    if (machine.has_value() + !origin.is_none() + !matrix.is_none() != 1)
      throw py::type_error("give one of machine, pose or origin");
    constexpr py::ssize_t kMost = 1 << 16;
    if (std::min(shape.first, shape.second) < 1 || std::max(shape.first, shape.second) > kMost)
      throw py::value_error(fmt::format("shape is ({}, {}); each must be from 1 to {}", shape.first,
                                        shape.second, kMost));
    constexpr const char* kNames[] = {"height", "loose", "dug"};
    const auto* found = std::find(std::begin(kNames), std::end(kNames), name);
    if (found == std::end(kNames))
      throw py::value_error("layer is '" + name + "'; it must be 'height', 'loose' or 'dug'");
    layer = static_cast<MapLayer>(found - std::begin(kNames));
    grid.ny = static_cast<int>(shape.first);
    grid.nx = static_cast<int>(shape.second);
    grid.cell_m = cell;
    if (!origin.is_none()) numbers(origin, "origin", {grid.first_m.data(), 2});
    if (matrix.is_none()) return;
    const Pose at = pose(py::none(), py::none(), matrix);
    grid = MapGrid::around(at.position.head<2>(), cell, grid.nx, grid.ny, turned ? &at : nullptr);
  }

  MapGrid of(Session& session) const {
    return machine ? session.map_around(machine_of(session, *machine), grid.cell_m, grid.nx,
                                        grid.ny, turned)
                   : grid;
  }
};

/// An array for results: the caller's, or a new one of doubles. Calls f(its values).
template <typename F>
py::array fill_array(const py::object& given, const std::vector<py::ssize_t>& shape, const F& f) {
  if (given.is_none()) {
    Array made(shape);
    f(std::span<double>(made.mutable_data(), static_cast<std::size_t>(made.size())));
    return made;
  }
  py::array out;
  if (py::isinstance<py::array>(given)) out = py::reinterpret_borrow<py::array>(given);
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
  return out;
}

using MapShape = std::pair<py::ssize_t, py::ssize_t>;

py::array height_map(Site& site, const std::optional<MachineName>& machine,
                     const py::object& origin, const py::object& matrix, const MapShape& shape,
                     double cell, bool turned, const std::string& layer,
                     std::optional<double> ceiling, const py::object& out) {
  const MapRequest map(machine, origin, matrix, shape, cell, turned, layer, ceiling);
  return fill_array(out, {shape.first, shape.second}, [&](auto values) {
    site.with([&](Session& session) {
      const MapGrid all = map.of(session);
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
        session.height_map(piece, map.layer,
                           values.subspan(static_cast<std::size_t>(from) * cells,
                                          static_cast<std::size_t>(piece.ny) * cells),
                           map.ceiling);
      }
    });
  });
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
  const Ledger ledger = site.with([&](Session& session) {
    balance = session.mass_balance_without_ground();
    sample_m3 = session.site().ground->sample_m3();
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
  return all;
}

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

/// Calls f(their sessions) exclusively, without the interpreter's lock.
template <typename F>
void with_all(const std::vector<Site*>& sites, const F& f) {
  require_own_process();
  const Released released;
  // A fixed order of locks avoids deadlocks between calls that share sites.
  std::set<Site*> ordered(sites.begin(), sites.end());
  std::vector<std::unique_lock<Turn>> locks;
  for (Site* site : ordered) locks.emplace_back(site->turn());
  const Inside inside;
  std::vector<Session*> sessions;
  for (Site* site : sites) sessions.push_back(&site->open());
  f(sessions);
}

/// A map of each of many sites.
py::array height_maps(const py::object& given, const std::optional<MachineName>& machine,
                      const py::object& origin, const MapShape& shape, double cell, bool turned,
                      const std::string& layer, std::optional<double> ceiling,
                      const py::object& out) {
  const py::tuple kept = several(given, "sites", "soilvdb.Site");
  const std::vector<Site*> sites = sites_of(kept);
  const MapRequest map(machine, origin, py::none(), shape, cell, turned, layer, ceiling);
  const auto count = static_cast<py::ssize_t>(sites.size());
  return fill_array(out, {count, shape.first, shape.second}, [&](auto values) {
    with_all(sites, [&](const std::vector<Session*>& sessions) {
      std::vector<MapGrid> grids;
      for (std::size_t i = 0; i < sessions.size(); ++i) {
        try {
          grids.push_back(map.of(*sessions[i]));
        } catch (const std::exception& e) {
          throw std::invalid_argument(fmt::format("site {}: {}", i, e.what()));
        }
      }
      const auto cells = static_cast<std::size_t>(shape.first * shape.second);
      tbb::parallel_for(std::size_t{0}, sessions.size(), [&](std::size_t i) {
        sessions[i]->height_map(grids[i], map.layer, values.subspan(i * cells, cells), map.ceiling);
      });
    });
  });
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
  with_all(sites, [&](const std::vector<Session*>& sessions) {
    for (std::size_t i = 0; i < sites.size(); ++i)
      states[i].machine = machine_of(*sessions[i], machine);
    results = soilvdb::update_many(sessions, states);
  });
  std::vector<Update> updates;
  for (std::size_t i = 0; i < results.size(); ++i) {
    if (!results[i].ok()) refuse(results[i].status, fmt::format("site {}: {}", i, results[i].why));
    updates.push_back(results[i].update);
  }
  return updates;
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

void require_good(const StepResult& step) {
  if (!step.ok()) refuse(step.status, step.why);
}

}  // namespace

void bind_site(py::module_& m) {
  end_forked_processes_at_once();
  py::module_::import("atexit").attr("register")(py::cpp_function([] {
    const py::gil_scoped_release released;
    if (!is_forked()) Gate::get().close();
  }));
  static py::exception<NoGroundError> no_ground(m, "NoGroundError", PyExc_RuntimeError);
  no_ground_error = no_ground;

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
  py::class_<Site>(m, "Site", "The ground and the machines that dig it. World frame, m, rad, s.")
      .def(py::init([](double voxel_size, const TerrainValue& terrain, const py::object& machines,
                       const std::optional<SoilProperties>& soil, const py::object& pours,
                       const py::object& hoppers, const py::object& near) {
             py::object place = near;  // a copy, because the caller may change the original
             if (!near.is_none()) {
               const Vec3 at = vector3(near, "near");
               place = py::make_tuple(at.x(), at.y(), at.z());
             }
             const py::tuple from = py::make_tuple(
                 voxel_size, terrain, several(machines, "machines", kMachines), soil,
                 several(pours, "pours", kPours), several(hoppers, "hoppers", kHoppers), place);
             return made(make_session(voxel_size, terrain, from[2], soil, from[4], from[5], place),
                         from);
           }),
           py::arg("voxel_size"), py::arg("terrain"), py::arg("machines"), py::kw_only(),
           py::arg("soil") = none, py::arg("pours") = py::tuple(), py::arg("hoppers") = py::tuple(),
           py::arg("near") = none,
           "voxel_size: m. machines: each a Bucket or a Machine. soil: properties of moving soil; "
           "default: soil is rigid. near: (x, y, z) where work begins, for terrains wider than "
           "2**16 voxels. Raises ValueError for an invalid site.")
      .def_static(
          "open",
          [](const std::filesystem::path& scenario) {
            require_own_process();
            const auto open = [&] {
              const Released released;
              const Inside inside;
              return Session::open(scenario);
            };
            return made(open(), py::make_tuple(scenario));
          },
          py::arg("scenario"),
          "Opens a scenario: its site, machines and soil, before any machine "
          "moves.")
      .def(
          "update", &update, py::arg("machine"), py::kw_only(), py::arg("position") = none,
          py::arg("rotation") = none, py::arg("pose") = none, py::arg("joints") = none,
          py::arg("time") = none,
          "Moves a machine (number or name) to a state; the first state places it. position: (x, "
          "y, z) of the middle of the lip, m. rotation: quaternion (x, y, z, w), default: no "
          "rotation. pose: 4x4 array in place of these, world from bucket. joints: values in the "
          "chain's order in place of a pose, rad or m. time: s, must not go back. If states have "
          "times, joints move evenly between states, pours fall, and hoppers come and go. Raises "
          "ValueError for an invalid state, NoGroundError where the terrain has no height; nothing "
          "has moved then.")
      .def("update_path", &update_path, py::arg("machine"), py::kw_only(),
           py::arg("positions") = none, py::arg("rotations") = none, py::arg("poses") = none,
           py::arg("joints") = none, py::arg("times") = none,
           "update() for many states in one call: positions (N, 3) with rotations (N, 4), poses "
           "(N, 4, 4) or joints (N, joints). Returns arrays (N,) by name: cut_m3, bucket_m3, "
           "spilled_m3, slid_m3, us. Stops at the first bad state with the error of update() and "
           "the state's number; the machine has moved through the states before.")
      .def(
          "joints",
          [](Site& s, const MachineName& machine) {
            return s.with([&](Session& session) {
              const auto& chain = session.machines()[machine_of(session, machine)].chain;
              return chain ? chain->movable() : std::vector<std::string>();
            });
          },
          py::arg("machine"), "Names of a machine's joints, in order; empty if it has no joints.")
      .def(
          "base",
          [](Site& s, const MachineName& machine) {
            const Pose base = s.with([&](Session& session) {
              const SiteMachine& one = session.machines()[machine_of(session, machine)];
              if (!one.chain)
                throw std::invalid_argument("machine '" + one.name + "' has no joints");
              return one.chain->world_from_root;
            });
            const Eigen::Vector4d xyzw = base.rotation.coeffs();
            return py::make_tuple(Array(py::ssize_t{3}, base.position.data()),
                                  Array(py::ssize_t{4}, xyzw.data()));
          },
          py::arg("machine"),
          "World pose of the root of a machine's joints: (position, rotation), (3,) and x, y, z, "
          "w, (4,). Raises ValueError for a machine without joints.")
      .def("pose", &pose_by_joints, py::arg("machine"), py::arg("joints"),
           "World pose of the bucket at given joints; the bucket does not move. joints: (joints,), "
           "rad or m, or (N, joints). Returns (position, rotation), (3,) and x, y, z, w, (4,), or "
           "(N, 3) and (N, 4). Raises ValueError for a machine without joints, or for another "
           "number of joints.")
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
          "come_to_rest",
          [](Site& s) {
            require_good(s.with([](Session& session) { return session.come_to_rest(); }));
          },
          "Lets soil that is too steep or overhangs come to rest, as at the end of a run.")
      .def(
          "heights",
          [](Site& s, const py::object& xy) { return heights(s, xy, &Session::heights); },
          py::arg("xy"),
          "Heights of the topmost soil at xy (N, 2), m, world: (N,) float64, NaN where there is no "
          "ground. They come straight from the soil's samples, linear between columns of voxels. "
          "After an update one costs about 30 us, each of many some tens of ns.")
      .def(
          "mesh_heights",
          [](Site& s, const py::object& xy) { return heights(s, xy, &Session::mesh_heights); },
          py::arg("xy"),
          "As heights(), on the surface of mesh(): for pictures. It meshes what changed since the "
          "last call, which takes milliseconds.")
      .def("height_map", &height_map, py::kw_only(), py::arg("machine") = none,
           py::arg("origin") = none, py::arg("pose") = none, py::arg("shape"), py::arg("cell"),
           py::arg("turned") = true, py::arg("layer") = "height", py::arg("ceiling") = none,
           py::arg("out") = none,
           "Map of square cells, shape (ny, nx), side cell, m: (ny, nx) float64. Give one of: "
           "origin (x, y), the middle of cell [0, 0]; machine, around the middle of its lip; pose, "
           "a 4x4 array, as of a machine there. Around a machine or pose, x looks out of the mouth "
           "and y along the lip, unless turned is False; else x and y are the world's. layer: "
           "'height', mean height of the soil in a cell, so that sums are volumes; 'loose', depth "
           "of the loose soil; 'dug', depth below the terrain; NaN where there is no ground. "
           "ceiling: only soil below this height is looked at. out: a float32 or float64 array to "
           "fill and return. Cells of the voxel's size cost about 10 ns each, wider ones as much "
           "for each voxel in them.")
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
           "loose volumes of pours, hoppers and failed slopes: poured_m3, hauled_m3, slid_m3.")
      .def(
          "change_m3",
          [](Site& s) { return s.with([](Session& session) { return session.change_m3(); }); },
          "Volume of the ground minus that of the terrain, counted anew, m3.")
      .def(
          "ground_hash",
          [](Site& s) { return s.with([](Session& session) { return session.ground_hash(); }); },
          "Hash of the ground: `state_hash` of a run's summary.json, as a number.")
      .def_property_readonly(
          "voxel_size",
          [](Site& s) { return s.with([](Session& session) { return session.voxel_size_m(); }); })
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
      .def(
          "write",
          [](Site& s, const std::filesystem::path& file) {
            s.with([&](Session& session) { session.write(file); });
          },
          py::arg("file"),
          "Writes a snapshot for soilvdb and other programs; its name must end with .vdb. `soilvdb "
          "export` makes rasters and meshes from it.")
      .def(
          "save",
          [](Site& s) {
            return py::bytes(s.with([](Session& session) { return session.save(); }));
          },
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
            return std::make_unique<Site>(s.with([](Session& session) { return session.clone(); }),
                                          s.made_from());
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
          "acknowledged",
          [](Site& s) {
            return pair(s.with([](Session& session) { return session.acknowledged(); }));
          },
          "(updates, time) of the part of the recording that is on disk for certain.")
      .def(
          "flush", [](Site& s) { s.with([](Session& session) { session.flush(); }); },
          "Waits until the whole recording is on disk.")
      .def(
          "stop_recording",
          [](Site& s) { s.with([](Session& session) { session.stop_recording(); }); },
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
      .def("__enter__", [](py::object self) { return self; })
      .def("__exit__", [](Site& s, const py::args&) { s.close(); })
      .def("__reduce__", [](const py::object& self) {
        auto& site = self.cast<Site&>();
        const py::bytes state(site.with([](Session& session) { return session.save(); }));
        return py::make_tuple(py::module_::import("soilvdb").attr("_unpickle"),
                              py::make_tuple(site.made_from(), state));
      });

  m.def("height_maps", &height_maps, py::arg("sites"), py::kw_only(), py::arg("machine") = none,
        py::arg("origin") = none, py::arg("shape"), py::arg("cell"), py::arg("turned") = true,
        py::arg("layer") = "height", py::arg("ceiling") = none, py::arg("out") = none,
        "Site.height_map() of many sites, on all cores: (sites, ny, nx).");
  m.def(
      "update_many", &update_sites, py::arg("sites"), py::arg("machine"), py::kw_only(),
      py::arg("positions"), py::arg("rotations") = none, py::arg("time") = none,
      "One update for each of many sites, on all cores: positions (N, 3), rotations (N, 4). Raises "
      "the error of the first bad site; the others have moved.");
}

}  // namespace soilvdb::python
