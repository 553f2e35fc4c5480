// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Posts to a ground service: what a block is meshed for, and what a patch tells of them.
#include <gtest/gtest.h>

#include <initializer_list>
#include <latch>
#include <map>
#include <memory>

#include "core/ground/soil_writer.h"
#include "soilvdb/ground_service.h"

namespace soilvdb::test {
namespace ground_posts_test {

SampleWords cells(std::initializer_list<int> which) {
  SampleWords words{};
  for (const int n : which) words[static_cast<std::size_t>(n)] = kAllSoil;
  return words;
}

TEST(GroundPosts, WhereAsMuchCameAsWentABlockIsMeshedAnew) {
  const std::shared_ptr<const BaseSurface> ground = make_plane(-0.021, {0, 0});
  Soil soil(0.05, Vec3::Zero(), ground), copy(0.05, Vec3::Zero(), ground);
  GroundService service(copy, {false, true, 4});
  SoilWriter writer(soil);
  std::map<Coord3, Mesh, SurfaceMesh::Less> patches;
  const auto follow = [&] {
    service.post(soil, soil.take_touched());
    service.finish();
    for (GroundService::Patch& patch : service.take_patches())
      patches[patch.block] = std::move(patch.mesh);
  };
  const Coord3 chunk(0, 0, -8);
  writer.remove(chunk, cells({7}));
  follow();
  writer.add(chunk, cells({7}));
  writer.remove(chunk, cells({4 * 64 + 4 * 8 + 7}));
  follow();
  for (const auto& [block, mesh] : patches) EXPECT_EQ(mesh.points, mesh_block(soil, block).points);
}

TEST(GroundPosts, APatchTellsOfTheOldestOfThePostsThatItBringsNewsOf) {
  const std::shared_ptr<const BaseSurface> ground = make_plane(0.01, {0, 0});
  Soil soil(0.05, Vec3::Zero(), ground), copy(0.05, Vec3::Zero(), ground);
  GroundService service(copy, {});
  std::latch go(1);
  service.run([&] { go.wait(); });
  SoilWriter writer(soil);
  for (const int n : {7, 15, 23}) {
    writer.remove({0, 0, -8}, cells({n}));
    service.post(soil, soil.take_touched());
  }
  go.count_down();
  service.finish();
  const auto patches = service.take_patches();
  ASSERT_FALSE(patches.empty());
  for (const GroundService::Patch& patch : patches) {
    EXPECT_EQ(patch.first_post, 1u);
    EXPECT_EQ(patch.last_post, 3u);
  }
}

}  // namespace ground_posts_test
}  // namespace soilvdb::test
