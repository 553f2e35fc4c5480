// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Meshes of blocks by dual contouring and by OpenVDB's volumeToMesh, on one thread: CPU time of a
// block, and what is wrong with the mesh of all of them.
#include <benchmark/benchmark.h>
#include <tbb/global_control.h>

#include <cmath>
#include <ctime>
#include <map>
#include <numbers>
#include <random>
#include <set>

#include "bench/peers/volume_to_mesh.h"
#include "bench/report.h"
#include "bench/stages.h"
#include "core/surface/surface.h"
#include "soilvdb/change_follower.h"
#include "soilvdb/io/site.h"
#include "tests/support/dig_runner.h"
#include "tests/support/solids.h"

namespace soilvdb::bench {
namespace {

using test::Solid;

struct MeshedGround {
  std::shared_ptr<Ground> ground;
  std::optional<Solid> solid;
  std::shared_ptr<void> keeps = {};
};

MeshedGround meshed(Solid solid, double h) {
  std::shared_ptr<Ground> ground = test::sampled(solid, h);
  return {std::move(ground), std::move(solid)};
}

/// Digs data/excavator.yaml at 10 Hz.
/// @param after each update
std::shared_ptr<Ground> dig_excavator(double h, const std::function<void(Ground&)>& after) {
  io::Scenario scenario = io::read_scenario(SOILVDB_SOURCE_DIR "/data/excavator.yaml");
  scenario.voxel_size_m = h;
  std::shared_ptr<Ground> ground = io::open_site(scenario).ground;
  const io::MachineInput& machine = scenario.machines[0];
  Tracker tracker(*ground, {machine.bucket});
  for (std::size_t i = 0; i < machine.motion.parts(); ++i) {
    const auto motion = machine.motion.part(i);
    for (double t = motion->begin_s(), next; t < motion->end_s(); t = next) {
      next = std::min(t + 0.1, motion->end_s());
      tracker.update(0, *motion, t, next);
      after(*ground);
    }
  }
  return ground;
}

std::vector<MeshedGround> excavator(double h) {
  return {{dig_excavator(h, [](Ground&) {}), {}}};
}

std::vector<MeshedGround> digs(double h) {
  std::vector<MeshedGround> all;
  const auto add = [&](const test::Dig& dig) {
    const auto dug = std::make_shared<test::Dug>(dig, h, 50);
    all.push_back({{dug, &dug->ground}, {}});
  };
  for (const std::string& family : test::families()) add(make_dig(family, test::placements()[1]));
  for (std::uint64_t seed = 1; seed <= 10; ++seed) add(test::random_dig(seed));
  return all;
}

std::vector<MeshedGround> trenches(double h) {
  std::vector<MeshedGround> all;
  for (const double yaw : {0.0, 33.0, 61.0})
    all.push_back(meshed(test::half_sine_trench(yaw * std::numbers::pi / 180), h));
  return all;
}

const Pose kTurned{Vec3(0.013, 0.008, 0.009), from_rpy(0.1, 0.15, 0.5)};
const Pose kYawed{Vec3(0.013, 0.008, 0.009), from_rpy(0, 0, 0.3)};
const Pose kBelow{Vec3(0.5, 0.1, -0.2), from_rpy(0, 0, 0.3)};

std::vector<MeshedGround> box(double h) {
  return {meshed(test::ground_less("box", {0.2, 0.1}, {{kTurned, {0.5, 0.3, 0.3}}}), h)};
}
std::vector<MeshedGround> undercut(double h) {
  return {meshed(
      test::ground_less("undercut", {0, 0}, {{kYawed, {0.4, 0.3, 0.3}}, {kBelow, {0.4, 0.2, 0.1}}}),
      h)};
}
std::vector<MeshedGround> walls(double h) {
  std::vector<MeshedGround> all;
  for (const auto& [roll, yaw] : {std::pair{0.0, 0.0}, {0.0, 0.5}, {0.2, 0.3}, {0.0, 0.785}})
    all.push_back(meshed(test::thin_wall(h, roll, yaw, 0.0077), h));
  return all;
}
/// Walls, or slots, so many voxels thick, in twenty attitudes.
std::vector<MeshedGround> turned(bool wall, double h, double voxels) {
  std::vector<MeshedGround> all;
  for (int k = 0; k < 20; ++k) {
    const double thick = voxels * h, roll = 0.022 * k, yaw = 0.074 * k;
    all.push_back(meshed((wall ? test::thin_wall : test::thin_slot)(thick, roll, yaw, 0.0077), h));
  }
  return all;
}
std::vector<MeshedGround> walls_turned(double h) { return turned(true, h, 1); }
std::vector<MeshedGround> walls_thinner(double h) { return turned(true, h, 0.8); }
std::vector<MeshedGround> slots_turned(double h) { return turned(false, h, 1); }
std::vector<MeshedGround> slots_thinner(double h) { return turned(false, h, 0.8); }

/// What boxes of one to three voxels leave that lie and turn at random.
std::vector<MeshedGround> rubble(double h) {
  std::mt19937 random(1);
  const auto between = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(random()) * 0x1p-32;
  };
  std::vector<test::Box> boxes(100);
  for (test::Box& box : boxes) {
    box.half = h * Vec3(between(0.5, 1.5), between(0.5, 1.5), between(0.5, 1.5));
    box.world_from_box.position = h * Vec3(between(-10, 10), between(-10, 10), between(-6, 1));
    box.world_from_box.rotation = from_rpy(between(-3, 3), between(-1.5, 1.5), between(-3, 3));
  }
  return {{test::sampled(test::ground_less("rubble", {0, 0}, boxes), h), {}}};
}

/// Volume between a mesh and the base surface.
double dug_m3(const Mesh& mesh, const Ground& ground) {
  double sum = 0;
  for (const auto& t : mesh.triangles) {
    Vec3 p[3];
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3 world = ground.origin() + mesh.points[t[k]].cast<double>();
      p[k] = mesh.points[t[k]].cast<double>();
      p[k].z() += ground.origin().z() - ground.terrain().height(world.x(), world.y()).value_or(0);
    }
    const Vec3 a = p[1] - p[0], b = p[2] - p[0];
    sum -= (a.x() * b.y() - a.y() * b.x()) / 2 * (p[0].z() + p[1].z() + p[2].z()) / 3;
  }
  return sum;
}

/// Corners less edges and triangles: 1 for a pit, whatever its shape; 2 less for each hole in a
/// wall, 1 more for each part that has come off.
int euler(const Mesh& mesh) {
  std::set<std::pair<std::uint32_t, std::uint32_t>> edges;
  for (const auto& t : mesh.triangles) {
    for (std::size_t k = 0; k < 3; ++k) edges.insert(std::minmax(t[k], t[(k + 1) % 3]));
  }
  return static_cast<int>(mesh.points.size() + mesh.triangles.size()) -
         static_cast<int>(edges.size());
}

/// Distances of vertices from the true surface, voxels, but those on untouched ground.
void add_errors(const Mesh& mesh, const Solid& solid, double h, std::vector<double>& errors) {
  for (const Eigen::Vector3f& point : mesh.points) {
    const Vec3 p = point.cast<double>();
    const bool untouched =
        test::features_near(solid, p, 1.5 * h) == 1 && std::abs(solid.features[0](p)) < 1.5 * h;
    if (!untouched) errors.push_back(test::distance_m(solid, p, 0.02 * h) / h);
  }
}

using MeshBlock = std::function<Mesh(const Ground&, const Coord3&)>;
using Patches = std::map<Coord3, Mesh, Before>;

void mesh_blocks(benchmark::State& state, const std::vector<MeshedGround>& grounds, double h,
                 const MeshBlock& mesh_block) {
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  std::vector<std::pair<const Ground*, Coord3>> blocks;
  test::Faults faults;
  double worst = 0, topology = 0;
  std::vector<double> errors, us;
  for (const MeshedGround& g : grounds) {
    Patches patches;
    for (const Coord3& block : blocks_touched(g.ground->origins())) {
      Mesh patch = mesh_block(*g.ground, block);
      if (patch.triangles.empty()) continue;
      patches[block] = std::move(patch);
      blocks.push_back({g.ground.get(), block});
    }
    const Mesh mesh = weld(patches);
    const test::Faults found = test::faults(mesh, *g.ground);
    faults.without_area += found.without_area;
    faults.crowded += found.crowded;
    faults.torn += found.torn;
    const double error = dug_m3(mesh, *g.ground) / -g.ground->change_m3() - 1;
    if (std::abs(error) > std::abs(worst)) worst = error;
    if (!g.solid) continue;
    topology += euler(mesh) != 1;
    add_errors(mesh, *g.solid, h, errors);
  }
  std::size_t i = 0;
  for (auto _ : state) {
    const auto& [ground, block] = blocks[i++ % blocks.size()];
    const std::clock_t begin = std::clock();
    benchmark::DoNotOptimize(mesh_block(*ground, block));
    us.push_back(1e6 * static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC);
  }
  state.counters["blocks"] = static_cast<double>(blocks.size());
  state.counters["median_us"] = quantile(us, 0.5);
  state.counters["crowded"] = faults.crowded;
  state.counters["torn"] = faults.torn;
  state.counters["without_area"] = faults.without_area;
  state.counters["volume_percent"] = 100 * worst;
  if (errors.empty()) return;
  state.counters["p99_voxel"] = quantile(errors, 0.99);
  state.counters["wrong_topology"] = topology;
}

/// Blocks that an update changed, each time one did: made anew, and with what is known of before.
void mesh_changed_blocks(benchmark::State& state) {
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const double h = static_cast<double>(state.range(0)) / 1000;
  std::vector<double> anew_us, us;
  const auto timed = [](std::vector<double>& all, const auto& make) {
    const std::clock_t begin = std::clock();
    benchmark::DoNotOptimize(make());
    all.push_back(1e6 * static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC);
  };
  for (auto _ : state) {
    std::optional<CachedMesher> mesher;
    std::optional<ChangeFollower> changes;
    bool first = false;  // which goes first: it has the colder caches
    dig_excavator(h, [&](Ground& ground) {
      if (!mesher) mesher.emplace(ground);
      if (!changes) changes.emplace(ground);
      for (const Coord3& block : blocks_touched(changes->take())) {
        if (resident_chunks(ground, block).empty()) continue;
        first = !first;
        if (first) timed(us, [&] { return mesher->block(block); });
        timed(anew_us, [&] { return mesh_block(ground, block); });
        if (!first) timed(us, [&] { return mesher->block(block); });
      }
    });
  }
  state.counters["blocks"] = static_cast<double>(us.size());
  state.counters["anew_us"] = quantile(anew_us, 0.5);
  state.counters["median_us"] = quantile(us, 0.5);
  state.counters["p99_us"] = quantile(us, 0.99);
}

}  // namespace

void register_mesh_blocks() {
  using Make = std::vector<MeshedGround> (*)(double);
  static const std::vector<std::pair<const char*, Make>> kScenes{{"excavator", excavator},
                                                                 {"digs", digs},
                                                                 {"trenches", trenches},
                                                                 {"box", box},
                                                                 {"undercut", undercut},
                                                                 {"walls", walls},
                                                                 {"walls_turned", walls_turned},
                                                                 {"walls_thinner", walls_thinner},
                                                                 {"slots_turned", slots_turned},
                                                                 {"slots_thinner", slots_thinner},
                                                                 {"rubble", rubble}};
  benchmark::RegisterBenchmark("MeshChangedBlock/soilvdb/excavator", mesh_changed_blocks)
      ->ArgName("voxel_mm")
      ->Unit(benchmark::kMillisecond)
      ->Iterations(1)
      ->Arg(50)
      ->Arg(100);
  static std::map<std::pair<std::string, std::int64_t>, std::vector<MeshedGround>> known;
  for (const auto& scene : kScenes) {
    const auto add = [&](const std::string& mesher, const auto& mesh_block) {
      auto* b = benchmark::RegisterBenchmark(
          ("MeshBlock/" + mesher + "/" + scene.first).c_str(),
          [make = scene.second, name = scene.first, mesh_block](benchmark::State& state) {
            const double h = static_cast<double>(state.range(0)) / 1000;
            std::vector<MeshedGround>& grounds = known[{name, state.range(0)}];
            if (grounds.empty()) grounds = make(h);
            VolumeToMeshTimes times;
            mesh_blocks(state, grounds, h, mesh_block(times));
            const double n = times.calls / 1e6;
            if (n == 0) return;
            state.counters["models_us"] = times.models / n;
            state.counters["field_us"] = times.field / n;
            state.counters["topology_us"] = times.topology / n;
            state.counters["vertices_us"] = times.vertices / n;
          });
      b->ArgName("voxel_mm")->Unit(benchmark::kMicrosecond)->Iterations(100)->Arg(50)->Arg(100);
    };
    add("soilvdb", [](VolumeToMeshTimes&) -> MeshBlock { return mesh_block; });
    const auto add_peer = [&](const std::string& name, VolumeToMesh how) {
      add(name, [how](VolumeToMeshTimes& times) -> MeshBlock {
        return [how, &times](const Ground& ground, const Coord3& block) {
          return volume_to_mesh(ground, block, how, times);
        };
      });
    };
    add_peer("openvdb_distances", VolumeToMesh::kDistances);
    add_peer("openvdb_planes", VolumeToMesh::kPlanes);
    add_peer("openvdb_repaired", VolumeToMesh::kRepaired);
  }
}

}  // namespace soilvdb::bench
