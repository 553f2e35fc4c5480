// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Level sets in files as ground: which are taken, what is said of others, and where they are dug.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <memory>
#include <random>
#include <string>

#include "core/ground/ground_writer.h"
#include "core/lattice/chunk_math.h"
#include "soilvdb/ground_grids.h"
#include "soilvdb/io/level_set_file.h"
#include "soilvdb/io/site.h"
#include "soilvdb/io/snapshot.h"
#include "soilvdb/surface_height.h"
#include "tests/support/site_fixture.h"
#include "tests/support/spheres.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::io {
namespace level_set_test {

using test::TempFolder;
using ::testing::HasSubstr;

void write_grids(const std::filesystem::path& file, openvdb::GridPtrVec grids) {
  openvdb::io::File(file.string()).write(grids);
}

openvdb::FloatGrid::Ptr sphere() { return test::level_set_sphere(5.0f, {0, 0, 0}, 0.25f); }

/// Balls with radii of 2 m and 5 m, by these names.
void write_spheres(const std::filesystem::path& file, const std::string& small,
                   const std::string& large) {
  const auto first = test::level_set_sphere(2, {0, 0, 0}, 0.25f), second = sphere();
  first->setName(small);
  second->setName(large);
  write_grids(file, {first, second});
}

TEST(LevelSet, AClosedOneIsGround) {
  const TempFolder folder;
  write_grids(folder / "a.vdb", {sphere()});
  const Site site =
      open_site(scenario_of(LevelSetTerrain{folder / "a.vdb"}, {-3, 0, 4.5}, {3, 0, 4.5}));
  // Trilinear in a ball's distance: second order in the file's voxels.
  EXPECT_NEAR(*surface_height(*site.ground, 0, 0), 5, 0.25 * 0.25);
  EXPECT_EQ(surface_height(*site.ground, 6, 0), std::nullopt);
}

TEST(LevelSet, ItsOriginAndCrsAreMetadata) {
  const TempFolder folder;
  const auto grid = sphere();
  grid->insertMeta(kOriginKey, openvdb::Vec3DMetadata({556000, 5394000, 100}));
  grid->insertMeta(kCrsKey, openvdb::StringMetadata("LOCAL_CS[\"x\"]"));
  write_grids(folder / "a.vdb", {grid});
  const LevelSetInput input = read_level_set(folder / "a.vdb");
  EXPECT_EQ(input.crs_wkt, "LOCAL_CS[\"x\"]");
  EXPECT_NEAR(*input.surface->height(556000, 5394000), 105, 0.25 * 0.25);
}

TEST(LevelSet, TheGridNamedSurfaceComesFirst) {
  const TempFolder folder;
  write_spheres(folder / "a.vdb", "other", "surface");
  EXPECT_NEAR(*read_level_set(folder / "a.vdb").surface->height(0, 0), 5, 0.1);
}

TEST(LevelSet, OfSeveralGridsOneIsNamed) {
  const TempFolder folder;
  write_spheres(folder / "a.vdb", "rocks", "ground");
  const auto open = [&](const std::string& grid) {
    return open_base(LevelSetTerrain{folder / "a.vdb", grid});
  };
  const Base rocks = open("rocks"), ground = open("ground");
  EXPECT_NEAR(*rocks.surface->height(0, 0), 2, 0.1);
  EXPECT_NEAR(*ground.surface->height(0, 0), 5, 0.1);
  EXPECT_EQ(refusal(folder, [&] { open(""); }),
            "a.vdb: has several level sets, 'ground' and 'rocks'; choose one, as in {level_set: "
            "a.vdb, grid: ground}");
  EXPECT_EQ(refusal(folder, [&] { open("Ground"); }),
            "a.vdb: has no level set 'Ground'; there are 'ground' and 'rocks'");
  // A snapshot knows which one it was dug from.
  Site site = open_site(
      scenario_of(LevelSetTerrain{folder / "a.vdb", "ground"}, {-3, 0, 4.5}, {3, 0, 4.5}));
  write_snapshot(folder / "b.vdb", site, {});
  EXPECT_NEAR(*read_snapshot(folder / "b.vdb").ground->terrain().height(0, 0), 5, 0.1);
  EXPECT_EQ(refusal(folder,
                    [&] {
                      open_base(LevelSetTerrain{folder / "b.vdb", "rocks"});
                    }),
            "b.vdb: is a snapshot without a grid 'rocks'; leave 'grid' out");
  write_spheres(folder / "a.vdb", "rocks", "rocks");
  EXPECT_EQ(refusal(folder, [&] { open("rocks"); }),
            "a.vdb: has 2 level sets 'rocks'; give each a name of its own");
}

TEST(LevelSet, WhatIsNotOneIsRefusedAndTheMessageNamesWhatIsThere) {
  const TempFolder folder;
  const auto said = [&](const std::string& name) {
    return refusal(folder, [&] { open_base(LevelSetTerrain{folder / name}); });
  };
  const auto fog = sphere();
  fog->setGridClass(openvdb::GRID_FOG_VOLUME);
  fog->setName("density");
  write_grids(folder / "fog.vdb", {fog});
  EXPECT_THAT(said("fog.vdb"), HasSubstr("only 'density' (fog volume, float)"));
  const auto wide = openvdb::DoubleGrid::create(0.75);
  wide->setGridClass(openvdb::GRID_LEVEL_SET);
  write_grids(folder / "double.vdb", {wide});
  EXPECT_THAT(said("double.vdb"), HasSubstr("(level set, double)"));
  write_grids(folder / "none.vdb", {});
  EXPECT_THAT(said("none.vdb"), HasSubstr("no grids at all"));
  const auto flat = sphere();
  flat->transform().preScale(openvdb::Vec3d(1, 1, 2));
  write_grids(folder / "flat.vdb", {flat});
  EXPECT_THAT(said("flat.vdb"), HasSubstr("0.25 x 0.25 x 0.5"));
  const auto turned = sphere();
  turned->transform().postRotate(0.5, openvdb::math::Z_AXIS);
  write_grids(folder / "turned.vdb", {turned});
  EXPECT_THAT(said("turned.vdb"), HasSubstr("is turned"));
  const auto half = sphere();
  for (auto leaf = half->tree().beginLeaf(); leaf; ++leaf) {
    if (leaf->origin().x() < 0) continue;
    for (openvdb::Index n = 0; n < 512; ++n) leaf->setValueOff(n, half->background());
  }
  write_grids(folder / "half.vdb", {half});
  EXPECT_THAT(said("half.vdb"), HasSubstr("is not closed"));
  write_grids(folder / "empty.vdb", {openvdb::createLevelSet<openvdb::FloatGrid>(0.1)});
  EXPECT_THAT(said("empty.vdb"), HasSubstr("is empty"));
  const auto nan = sphere();
  nan->tree().setValueOn({0, 0, 20}, std::nanf(""));
  write_grids(folder / "nan.vdb", {nan});
  EXPECT_THAT(said("nan.vdb"), HasSubstr("not numbers"));
  folder.write("text.vdb", "hello");
  EXPECT_THAT(said("text.vdb"), HasSubstr("is not a .vdb file or is damaged"));
  EXPECT_THAT(said("missing.vdb"), HasSubstr("no such file"));
  write_grids(folder / "cut.vdb", {sphere()});
  std::filesystem::resize_file(folder / "cut.vdb", 20'000);
  EXPECT_THAT(said("cut.vdb"), HasSubstr("is damaged"));
}

TEST(Occupancy, IsTheShareOfEachVoxelInABoxThatItsSamplesCount) {
  constexpr double h = 0.1;
  Ground ground(h, {500'000, 4'000'000, 0}, make_plane(0.13, {0.2, -0.1}));
  std::mt19937_64 random(8);
  GroundWriter writer(ground);
  for (int i = 0; i < 40; ++i) {
    const auto at = [&] { return static_cast<int>(random() % 4) * 8 - 16; };
    const Coord3 origin(at(), at(), at());
    SampleWords set;
    for (std::uint64_t& word : set) word = random() % 3 == 0 ? kAllSoil : random() & random();
    i % 2 == 0 ? writer.add(origin, set) : writer.remove(origin, set);
  }
  const Coord3 low(-13, -5, -17), high(14, 11, 9);
  const auto grid = occupancy_grid(
      ground, {ground.world_from_index(low.cast<double>()) - Vec3::Constant(h / 4),
               ground.world_from_index(high.cast<double>()) + Vec3::Constant(h / 4)});
  EXPECT_EQ(grid->indexToWorld(openvdb::Coord(1, 2, 3)), h * openvdb::Vec3d(1, 2, 3));
  std::uint64_t active = 0;
  SampleWords words;
  for (int x = low.x(); x <= high.x(); ++x)
    for (int y = low.y(); y <= high.y(); ++y)
      for (int z = low.z(); z <= high.z(); ++z) {
        ground.read_samples(floor_to(Coord3(x, y, z), kChunkSide), words);
        const auto word = words[static_cast<std::size_t>(cell_number({x, y, z}))];
        float value = -1;
        ASSERT_EQ(grid->tree().probeValue({x, y, z}, value), word != 0);
        ASSERT_EQ(value, static_cast<float>(std::popcount(word)) / 64);
        active += word != 0;
      }
  EXPECT_EQ(grid->activeVoxelCount(), active) << "none beyond the box";
}

TEST(LevelSet, UnderASnapshotItIsCheckedWholeBeforeItIsParsed) {
  const TempFolder folder;
  write_grids(folder / "base.vdb", {test::level_set_sphere(50.0f, {0, 0, 0}, 0.25f)});
  std::fstream file(folder / "base.vdb", std::ios::in | std::ios::out | std::ios::binary);
  ASSERT_GT(std::filesystem::file_size(folder / "base.vdb"), 5 << 20) << "not all sampled";
  const Base base = open_base(LevelSetTerrain{folder / "base.vdb"});
  const Site site{std::make_unique<Ground>(0.25, Vec3::Zero(), base.surface), base.reference, "",
                  base.bounds};
  write_snapshot(folder / "a.vdb", site, {});
  EXPECT_EQ(read_snapshot(folder / "a.vdb").reference.checksum, base.reference.checksum);
  file.seekg(70 << 10);
  const char flipped = static_cast<char>(file.get() ^ 1);
  file.seekp(70 << 10);
  file.put(flipped).flush();
  EXPECT_THAT(refusal(folder, [&] { read_snapshot(folder / "a.vdb"); }),
              HasSubstr("base.vdb has changed since"));
}

TEST(LevelSet, ARealFogVolumeIsRefused) {
  if (!std::filesystem::exists(shared("malformed/sphere.vdb"))) GTEST_SKIP() << "not there";
  const TempFolder folder;
  EXPECT_THAT(refusal(folder, [] { open_base(LevelSetTerrain{shared("malformed/sphere.vdb")}); }),
              HasSubstr("only 'density' (fog volume, float)"));
}

TEST(LevelSet, AnExportedRegionIsGroundAgain) {
  const TempFolder folder;
  const Ground ground(0.1, {1000, 2000, 0}, make_plane(0.03, {0.1, 0}));
  const auto grid = closed_level_set(ground, {Vec3(999, 1999, -2), Vec3(1001, 2001, 150)});
  grid->insertMeta(kOriginKey, openvdb::Vec3DMetadata({1000, 2000, 0}));
  write_grids(folder / "a.vdb", {grid});
  const Base base = open_base(LevelSetTerrain{folder / "a.vdb"});
  EXPECT_NEAR(*base.surface->height(1000, 2000), *surface_height(ground, 1000, 2000), 1e-4);
}

/// An exported block of flat ground, 10 m x 6 m about (1000, 2000), its underside at -2 m.
class ExportedBlock : public ::testing::Test {
 protected:
  void SetUp() override {
    const Ground ground(0.1, {1000, 2000, 0}, make_plane(0.03, {0, 0}));
    const auto grid = closed_level_set(ground, {Vec3(995, 1997, -2), Vec3(1005, 2003, 1)});
    grid->insertMeta(kOriginKey, openvdb::Vec3DMetadata({1000, 2000, 0}));
    write_grids(folder_ / "block.vdb", {grid});
  }
  std::string dig(const Vec3& from, const Vec3& to) const {
    return refusal(
        folder_, [&] { open_site(scenario_of(LevelSetTerrain{folder_ / "block.vdb"}, from, to)); });
  }
  TempFolder folder_;
};

TEST_F(ExportedBlock, IsDugInside) {
  EXPECT_THAT(dig({996, 2000, -0.3}, {1004, 2000, -0.3}), HasSubstr("accepted"));
  EXPECT_THAT(dig({996, 2002.3, -0.3}, {1004, 2002.3, -0.3}), HasSubstr("accepted"));
  EXPECT_THAT(dig({1000, 2000, 0}, {1000, 2000, -1.8}), HasSubstr("accepted"));
}

TEST_F(ExportedBlock, IsNotDugBeyondItsSidesOrItsUnderside) {
  const auto refused = HasSubstr("dig.yaml: machine 'digger' reaches ground without a height");
  EXPECT_THAT(dig({1000, 2000, -0.3}, {1006.5, 2000, -0.3}), refused);
  EXPECT_THAT(dig({1000, 2000, -0.3}, {1005.2, 2000, -0.3}), refused) << "a side's narrow band";
  EXPECT_THAT(dig({990, 2000, -0.3}, {1000, 2000, -0.3}), refused);
  EXPECT_THAT(dig({996, 2002.7, -0.3}, {1004, 2002.7, -0.3}), refused);
  EXPECT_THAT(dig({1000, 2000, 0}, {1000, 2000, -2.1}), refused);
  EXPECT_THAT(dig({1000, 2000, -0.3}, {1000, 2200, -0.3}), refused);
}

TEST_F(ExportedBlock, IsPassedOverAtAnyDistance) {
  EXPECT_THAT(dig({980, 2000, 0.3}, {1004, 2000, 0.3}), HasSubstr("accepted"));
  EXPECT_THAT(dig({1004, 2000, -0.3}, {1004, 2000, 4}), HasSubstr("accepted"));
  const Base base = open_base(LevelSetTerrain{folder_ / "block.vdb"});
  EXPECT_TRUE(base.surface->has_data({Vec3(2000, 2000, 0.3), Vec3(2001, 2001, 1)}));
  EXPECT_FALSE(base.surface->has_data({Vec3(2000, 2000, -0.3), Vec3(2001, 2001, 1)}));
}

TEST(LevelSet, ALevelSetWithoutDistancesInTheAirIsNotClosed) {
  const test::TempFolder folder;
  for (const bool in_air : {true, false}) {
    const auto half = test::level_set_sphere(5.0f, {0, 0, 0}, 0.25f);
    for (auto leaf = half->tree().beginLeaf(); leaf; ++leaf)
      for (openvdb::Index n = 0; n < 512; ++n) {
        const float value = leaf->getValue(n);
        if ((value > 0) == in_air)
          leaf->setValueOff(n, in_air ? half->background() : -half->background());
      }
    openvdb::io::File((folder / "half.vdb").string()).write(openvdb::GridPtrVec{half});
    EXPECT_THAT(test::message_of(folder, [&] { io::read_level_set(folder / "half.vdb"); }),
                ::testing::HasSubstr("is not closed"))
        << in_air;
  }
}

}  // namespace level_set_test
}  // namespace soilvdb::io
