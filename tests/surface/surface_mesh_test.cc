// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Meshes of digs as surfaces: manifold, watertight, the same by any way to them.
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <random>

#include "core/ground/ground_writer.h"
#include "core/lattice/chunk_math.h"
#include "core/surface/surface.h"
#include "tests/support/dig_runner.h"
#include "tests/support/sanitized.h"
#include "tests/support/solids.h"

namespace soilvdb::test {
namespace surface_mesh_test {

Dig random_or_named(int k) {
  const auto& names = families();
  const int named = static_cast<int>(names.size());
  return k < named ? make_dig(names[static_cast<std::size_t>(k)], placements()[1])
                   : random_dig(static_cast<std::uint64_t>(k - named + 1));
}

TEST(SurfaceMeshOfADig, IsManifoldAndWatertight) {
  const int digs = static_cast<int>(families().size()) + (test::kLong ? 10 : 3);
  for (int k = 0; k < digs; ++k) {
    const Dig dig = random_or_named(k);
    for (const double h : {0.1, 0.05}) {
      if (h < 0.1 && (test::kSanitized || (!test::kLong && k % 3 != 0))) continue;
      const Dug dug(dig, h, 50);
      const Faults f = faults(mesh_all(dug.ground), dug.ground);
      EXPECT_EQ(f.without_area, 0) << dig.family << ", voxel " << h;
      EXPECT_EQ(f.crowded, 0) << dig.family << ", voxel " << h;
      EXPECT_EQ(f.torn, 0) << dig.family << ", voxel " << h;
    }
  }
}

TEST(SurfaceMeshOfADig, IsManifoldWhereTheSurfaceRunsThroughTheGrid) {
  Ground ground(0.05, Vec3::Zero(), make_plane(0, {0, 0}));
  Tracker tracker(ground, {Bucket{1.0, 0.6, {}, {}}});
  tracker.update(0, Pose{Vec3(0, 0, 0), from_rpy(0, -0.4, 0)});
  tracker.update(0, Pose{Vec3(0.5, 0, -0.4), from_rpy(0, -0.3, 0)});
  const Faults f = faults(mesh_all(ground), ground);
  EXPECT_EQ(f.without_area, 0);
  EXPECT_EQ(f.crowded, 0);
  EXPECT_EQ(f.torn, 0);
}

TEST(SurfaceMeshOfADig, PatchesAreTheSameWhateverElseIsMeshed) {
  const Dug dug(make_dig("overlapping", placements()[1]), 0.05, 50);
  int compared = 0;
  for (const Chunk* chunk : dug.ground.chunks()) {
    const Coord3& origin = chunk->origin;
    const Coord3 block = floor_to(origin, kBlockSide);
    const std::vector<Coord3> all = resident_chunks(dug.ground, block);
    const SurfaceBlock whole(dug.ground, all, SurfaceBlock::kMesh);
    const SurfaceBlock part(dug.ground, {&origin, 1}, SurfaceBlock::kMesh);
    std::map<std::array<float, 3>, int> places;
    const auto key = [](const SurfaceBlock& b, const ContourVertex& v) {
      const Coord3 c = b.first() + v.cell;
      return std::array<float, 3>{static_cast<float>(c.x()) + v.in[0],
                                  static_cast<float>(c.y()) + v.in[1],
                                  static_cast<float>(c.z()) + v.in[2]};
    };
    for (const ContourVertex& v : whole.contour().vertices) ++places[key(whole, v)];
    for (const auto& t : part.contour().triangles) {
      for (const std::uint32_t k : t) {
        ASSERT_TRUE(places.contains(key(part, part.contour().vertices[k])));
        ++compared;
      }
    }
  }
  EXPECT_GT(compared, 1000);
}

TEST(SurfaceMeshOfADig, IsTheSameFromAMesherThatRemembersAfterEachChange) {
  const Dig dig = make_dig("overlapping", placements()[1]);
  const Dug end(dig, 0.05, 1);  // its site
  Ground ground(0.05, end.ground.origin(), end.ground.shared_terrain());
  GroundWriter writer(ground);
  CachedMesher mesher(ground);
  std::mt19937 random(4);
  std::vector<Coord3> chunks = end.ground.origins();
  std::shuffle(chunks.begin(), chunks.end(), random);
  int meshed = 0;
  // Each chunk comes as it is in the end, goes, and comes again: what is remembered is of other
  // words, at the same place, and of the same words again.
  for (int round = 0; round < 3; ++round) {
    for (const Coord3& origin : chunks) {
      if (round == 1) {
        writer.drop(origin);
      } else {
        writer.copy_from(end.ground, origin);
      }
      if (random() % 4 != 0) continue;
      for (const Coord3& block : blocks_touched({&origin, 1})) {
        const Mesh anew = mesh_block(ground, block), again = mesher.block(block);
        ASSERT_EQ(again.triangles, anew.triangles);
        ASSERT_EQ(again.points, anew.points);
        meshed += !anew.triangles.empty();
      }
    }
  }
  EXPECT_GT(meshed, 50);
}

TEST(SurfaceMeshOfADig, IsTheSameFromAMesherThatRemembersAfterTwoSamplesAlikeChanged) {
  Dug dug(make_dig("overlapping", placements()[1]), 0.05, 50);
  CachedMesher mesher(dug.ground);
  GroundWriter writer(dug.ground);
  std::mt19937 random(6);
  int compared = 0;
  const std::vector<const Chunk*> chunks = dug.ground.chunks();
  for (std::size_t i = 0; i < 4 * chunks.size(); ++i) {
    const Coord3 origin = chunks[i % chunks.size()]->origin;
    SampleWords words;
    dug.ground.read_samples(origin, words);
    // The same sample of two cells side by side, the last ones most.
    const std::uint64_t sample = std::uint64_t{1} << (random() % 2 ? 63 : random() % 64);
    std::size_t cell = 0;
    while (cell < 511 && (words[cell] == kAllSoil || (words[cell] & sample) == 0 ||
                          words[cell + 1] == kAllSoil || (words[cell + 1] & sample) == 0))
      ++cell;
    if (cell == 511) continue;
    const Coord3 block = floor_to(origin, kBlockSide);
    mesher.block(block);
    SampleWords set{};
    set[cell] = set[cell + 1] = sample;
    ASSERT_EQ(writer.remove(origin, set), 2);
    const Mesh anew = mesh_block(dug.ground, block), again = mesher.block(block);
    ASSERT_EQ(again.triangles, anew.triangles);
    ASSERT_EQ(again.points, anew.points);
    ++compared;
  }
  EXPECT_GT(compared, 20);
}

TEST(SurfaceMeshOfADig, HasTheSameBitsForAnyNumberOfThreads) {
  const Dug dug(make_dig("swing", placements()[1]), 0.05, 50);
  const auto with = [&](std::size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    return mesh_all(dug.ground);
  };
  const Mesh one = with(1), four = with(4);
  EXPECT_EQ(one.triangles, four.triangles);
  EXPECT_EQ(one.points, four.points);
}

}  // namespace surface_mesh_test
}  // namespace soilvdb::test
