// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Each stage alone. Names pair with other engines': Stage/engine/voxel_mm:25/site_m:100.
#include "bench/stages.h"

#include <benchmark/benchmark.h>

#include <cmath>
#include <memory>

#include "bench/engine.h"
#include "bench/site.h"
#include "core/constants.h"
#include "core/cut/excavator.h"
#include "core/cut/facet.h"
#include "core/lattice/lanes.h"
#include "soilvdb/io/snapshot.h"
#include "soilvdb/mesher.h"
#include "soilvdb/tracker.h"

namespace soilvdb::bench {
namespace {

double voxel_m(const benchmark::State& state) { return static_cast<double>(state.range(0)) / 1000; }
double site_m(const benchmark::State& state) { return static_cast<double>(state.range(1)); }

/// A drag of 3 m, 0.3 m deep, turning a little.
Motion drag() {
  std::vector<double> times;
  std::vector<Pose> poses;
  for (int i = 0; i <= 60; ++i) {
    const double s = i / 60.0;
    times.push_back(s);
    Pose pose;
    pose.position = {3 * s - 1.5, 0, hill_height(0, 0) - 0.3};
    pose.rotation = from_rpy(0, 0.5 * s, 0.1);
    poses.push_back(pose);
  }
  return {times, poses};
}

constexpr int kUpdates = 100;

void trace(benchmark::State& state) {
  const Motion motion = drag();
  const double h = voxel_m(state);
  int i = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(motion.trace(i / 100.0, (i + 1) / 100.0, excavator_bucket(),
                                          kMaxBend * h, kPathStride * h));
    i = (i + 1) % kUpdates;
  }
}

/// What one update takes out of the samples; a fresh site each hundred updates.
void excavate(benchmark::State& state) {
  const Motion motion = drag();
  const Bucket bucket = excavator_bucket();
  Excavator excavator(bucket);
  const double h = voxel_m(state);
  std::unique_ptr<Ground> ground;
  int i = 0;
  std::int64_t samples = 0;
  for (auto _ : state) {
    if (i == 0) {
      state.PauseTiming();
      ground = std::make_unique<Ground>(h, Vec3::Zero(), make_hills(site_m(state)));
      state.ResumeTiming();
    }
    const auto path =
        motion.trace(i / 100.0, (i + 1) / 100.0, bucket, kMaxBend * h, kPathStride * h);
    samples += excavator.sweep(*ground, path).all.captured;
    i = (i + 1) % kUpdates;
  }
  state.counters["cut_voxels"] =
      benchmark::Counter(static_cast<double>(samples) / 64, benchmark::Counter::kIsRate);
}

/// The same stroke over ground where it was cut already.
void excavate_again(benchmark::State& state) {
  const Motion motion = drag();
  const Bucket bucket = excavator_bucket();
  Excavator excavator(bucket);
  const double h = voxel_m(state);
  Ground ground(h, Vec3::Zero(), make_hills(site_m(state)));
  const auto whole = motion.trace(0, 1, bucket, kMaxBend * h, kPathStride * h);
  excavator.sweep(ground, whole);
  int i = 0;
  for (auto _ : state) {
    const auto path =
        motion.trace(i / 100.0, (i + 1) / 100.0, bucket, kMaxBend * h, kPathStride * h);
    benchmark::DoNotOptimize(excavator.sweep(ground, path));
    i = (i + 1) % kUpdates;
  }
}

/// A stroke in the air.
void miss(benchmark::State& state) {
  const double h = voxel_m(state);
  Ground ground(h, Vec3::Zero(), make_hills(site_m(state)));
  Tracker tracker(ground, {excavator_bucket()});
  Pose pose;
  pose.position.z() = 12;
  int i = 0;
  for (auto _ : state) {
    pose.position.x() = 0.03 * (i++ % 100);
    benchmark::DoNotOptimize(tracker.update(0, pose));
  }
}

void cut(benchmark::State& state, const MakeEngine& make) {
  const Motion motion = drag();
  Task task;
  task.voxel_m = voxel_m(state);
  task.bucket = excavator_bucket();
  task.motion = &motion;
  task.terrain = make_hills(site_m(state));
  for (const double t : {0.0, 0.5, 1.0}) {
    for (const Vec3& corner : mouth_outline(task.bucket, motion.pose(t))) task.reach.extend(corner);
  }
  std::unique_ptr<Engine> engine;
  int i = 0;
  for (auto _ : state) {
    state.PauseTiming();
    if (i == 0) engine = make(task);
    const Step step{i / 100.0, (i + 1) / 100.0};
    engine->prepare(step);
    state.ResumeTiming();
    engine->advance(step);
    i = (i + 1) % kUpdates;
  }
}

/// What one core can do: products and sums, not fused, of floats that never leave the registers.
SOILVDB_FOR_CPUS void multiply_and_add(Lanes* values, float factor, float sum, int times) {
  Lanes v[16];
  for (int i = 0; i < 16; ++i) v[i] = values[i];
  for (int n = 0; n < times; ++n) {
    for (Lanes& lanes : v) lanes = lanes * factor + sum;
  }
  for (int i = 0; i < 16; ++i) values[i] = v[i];
}

constexpr auto kRate = benchmark::Counter::kIsRate;

void arithmetic(benchmark::State& state) {
  constexpr int kTimes = 10000;
  Lanes values[16] = {};
  double operations = 0;
  for (auto _ : state) {
    multiply_and_add(values, 0.999f, 0.001f, kTimes);
    benchmark::DoNotOptimize(values);
    operations += 2.0 * 16 * kChunkSide * kTimes;
  }
  state.counters["operations"] = benchmark::Counter(operations, kRate);
}

/// The innermost loop: which samples of a cell a stroke passes. The mouth's plane passes a part of
/// a layer of 8 x 8 cells; all inside the mouth, or 2 x 8 of them on the sides of a narrow mouth,
/// where it also counts where the plane is passed.
void cut_samples(benchmark::State& state, double width_m, double cells) {
  Bucket bucket;
  bucket.width_m = width_m;
  bucket.height_m = 20;
  const Facet facet = facets(bucket).front();
  const auto frame = [&](double x) {
    return AffineFrame(Eigen::Matrix3d::Identity(), {x, 3.5, -5}, Coord3::Zero());
  };
  const Stroke stroke(frame(2.6), frame(2.85), frame(3.1), facet, 1);  // voxels of a metre
  SampleWords all;
  all.fill(kAllSoil);
  Samples soil;
  soil.assign(all);
  double tested = 0, cut = 0;
  for (auto _ : state) {
    Samples ground = soil, loose;
    cut += static_cast<double>(
        soilvdb::cut_samples(ground, loose, Coord3::Zero(), stroke, facet, 1, Booking::kCaptured)
            .all.captured);
    tested += cells;
  }
  state.counters["cells"] = benchmark::Counter(tested, kRate);
  state.counters["cut_per_cell"] = cut / tested;
}
void cut_inner_cells(benchmark::State& state) { cut_samples(state, 40, 64); }
void cut_edge_cells(benchmark::State& state) { cut_samples(state, 1, 16); }

void make_chunks(benchmark::State& state, const std::shared_ptr<const InitialTerrain>& terrain,
                 double z_m) {
  const double h = voxel_m(state);
  std::unique_ptr<Ground> ground;
  int i = 0;
  const int z = static_cast<int>(std::floor(z_m / h / 8)) * 8;
  for (auto _ : state) {
    if (i == 0) {
      state.PauseTiming();
      ground = std::make_unique<Ground>(h, Vec3::Zero(), terrain);
      state.ResumeTiming();
    }
    const Coord3 origin(8 * (i % 64), 8 * (i / 64), z);
    benchmark::DoNotOptimize(GroundWriter(*ground).remove(origin, {}));
    i = (i + 1) % 4096;
  }
}
void make_chunk_plane(benchmark::State& state) { make_chunks(state, make_plane(0, {0.1, 0}), 0); }
void make_chunk_height_field(benchmark::State& state) {
  make_chunks(state, make_hills(site_m(state)), hill_height(0, 0));
}

/// A site with some digging behind it.
io::Site dug_site(double h, double side_m) {
  io::Site site;
  site.ground = std::make_unique<Ground>(h, Vec3::Zero(), make_hills(side_m));
  Tracker tracker(*site.ground, {excavator_bucket()});
  const DigCycles machine({0, 0}, 0.4);
  for (int tick = 0; tick < 2000; ++tick) tracker.update(0, machine.world_from_bucket(0.1 * tick));
  return site;
}

void mesh_one_block(benchmark::State& state) {
  const io::Site site = dug_site(voxel_m(state), site_m(state));
  const std::vector<Coord3> blocks = blocks_touched(site.ground->origins());
  std::size_t i = 0;
  for (auto _ : state)
    benchmark::DoNotOptimize(mesh_block(*site.ground, blocks[i++ % blocks.size()]));
  state.counters["blocks"] = static_cast<double>(blocks.size());
}

void snapshot(benchmark::State& state) {
  const io::Site site = dug_site(voxel_m(state), site_m(state));
  std::size_t bytes = 0;
  for (auto _ : state) bytes = io::snapshot_bytes("stages.vdb", site, {}).size();
  state.counters["bytes"] = static_cast<double>(bytes);
  state.counters["chunks"] = static_cast<double>(site.ground->chunks().size());
}

void sizes(benchmark::internal::Benchmark* b) {
  b->ArgNames({"voxel_mm", "site_m"})->Unit(benchmark::kMicrosecond);
  for (const int voxel_mm : {25, 50, 100}) b->Args({voxel_mm, 100});
}
void sizes_and_sites(benchmark::internal::Benchmark* b) {
  sizes(b);
  b->Args({50, 1000})->Args({50, 10000});
}

BENCHMARK(trace)->Name("Trace/soilvdb")->Apply(sizes);
BENCHMARK(arithmetic)->Name("Arithmetic");
BENCHMARK(cut_inner_cells)->Name("CutSamples/soilvdb/inside");
BENCHMARK(cut_edge_cells)->Name("CutSamples/soilvdb/edge");
BENCHMARK(excavate)->Name("Excavate/soilvdb")->Apply(sizes_and_sites);
BENCHMARK(excavate_again)->Name("ExcavateAgain/soilvdb")->Apply(sizes);
BENCHMARK(miss)->Name("Miss/soilvdb")->Apply(sizes_and_sites);
BENCHMARK(make_chunk_plane)->Name("MakeChunk/soilvdb_plane")->Apply(sizes);
BENCHMARK(make_chunk_height_field)->Name("MakeChunk/soilvdb_height_field")->Apply(sizes);
BENCHMARK(mesh_one_block)->Name("MeshBlock/soilvdb")->Apply(sizes);
BENCHMARK(snapshot)->Name("Snapshot/soilvdb")->Apply(sizes);

}  // namespace
}  // namespace soilvdb::bench

int main(int argc, char** argv) {
  using namespace soilvdb::bench;
  for (const Peer& peer : engines()) {
    auto* b = benchmark::RegisterBenchmark(
        ("Cut/" + peer.name).c_str(), [&peer](benchmark::State& state) { cut(state, peer.make); });
    b->ArgNames({"voxel_mm", "site_m"})->Unit(benchmark::kMicrosecond);
    b->Args({50, 100})->Args({100, 100});
    if (peer.name == "soilvdb") b->Args({25, 100})->Args({50, 1000});
  }
  register_mesh_blocks();
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  benchmark::RunSpecifiedBenchmarks();
}
