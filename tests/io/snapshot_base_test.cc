// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a snapshot was dug from is found again, and a snapshot is what others are dug from.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <variant>

#include "soilvdb/io/snapshot.h"
#include "tests/support/snapshot_fixture.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::io {
namespace snapshot_base_test {

using test::TempFolder;
using ::testing::HasSubstr;

TEST(SnapshotBase, IsFoundAgainWhenBothHaveMoved) {
  const TempFolder folder;
  std::filesystem::create_directories(folder / "job/out");
  std::filesystem::rename(hills(folder), folder / "job/hills.tif");
  const Site site = site_on(RasterTerrain{folder / "job/hills.tif"});
  dig(*site.ground, 0, 0.3);
  write_snapshot(folder / "job/out/a.vdb", site, kInfo);
  std::filesystem::rename(folder / "job", folder / "moved");
  EXPECT_EQ(read_snapshot(folder / "moved/out/a.vdb").ground->state_hash(),
            site.ground->state_hash());
}

TEST(SnapshotBase, IsFoundAgainWhenTheSnapshotHasMoved) {
  const TempFolder folder;
  const Site site = site_on(RasterTerrain{hills(folder)});
  dig(*site.ground, 0, 0.3);
  write_snapshot(folder / "a.vdb", site, kInfo);
  std::filesystem::create_directories(folder / "far/away");
  std::filesystem::rename(folder / "a.vdb", folder / "far/away/a.vdb");
  EXPECT_EQ(read_snapshot(folder / "far/away/a.vdb").ground->state_hash(),
            site.ground->state_hash());
}

TEST(SnapshotBase, BehindALinkIsFoundAndWrittenAgainAsItWas) {
  const TempFolder folder;
  std::filesystem::create_directories(folder / "far/away/disk");
  std::filesystem::create_directories(folder / "out/run");
  std::filesystem::rename(hills(folder), folder / "far/away/disk/hills.tif");
  std::filesystem::create_directory_symlink(folder / "far/away/disk", folder / "site");
  std::filesystem::create_directory_symlink(folder / "out/run", folder / "far/run");
  const Site site = site_on(RasterTerrain{folder / "site/hills.tif"});
  dig(*site.ground, 0, 0.3);
  write_snapshot(folder / "far/run/a.vdb", site, kInfo);
  std::filesystem::create_symlink(folder / "out/run/a.vdb", folder / "a.vdb");
  write_snapshot(folder / "out/run/b.vdb", read_snapshot(folder / "a.vdb"), kInfo);
  EXPECT_EQ(content(folder / "out/run/b.vdb"), content(folder / "out/run/a.vdb"));
}

TEST(SnapshotBase, ThatIsGoneOrHasChangedIsSaid) {
  const TempFolder folder;
  const Site site = site_on(RasterTerrain{hills(folder)});
  write_snapshot(folder / "a.vdb", site, kInfo);
  std::filesystem::rename(folder / "hills.tif", folder / "else.tif");
  EXPECT_THAT(snapshot_refusal(folder, folder / "a.vdb"),
              HasSubstr("base surface hills.tif is missing"));
  std::string bytes = content(folder / "else.tif");
  bytes.back() = static_cast<char>(bytes.back() + 1);
  folder.write("hills.tif", bytes);
  EXPECT_THAT(snapshot_refusal(folder, folder / "a.vdb"),
              HasSubstr("base surface hills.tif has changed"));
}

class SnapshotTerrain : public ::testing::Test {
 protected:
  void SetUp() override {
    dig(*site_.ground, 0, 0.3);
    write_snapshot(folder_ / "a.vdb", site_, kInfo);
    scenario_.file = "dig.yaml";
    scenario_.name = "dig";
    scenario_.terrain = LevelSetTerrain{folder_ / "a.vdb"};
    scenario_.machines.push_back({"digger", bucket(), Motion({0, 1}, {pose(0.3), pose(0.4)})});
  }
  TempFolder folder_;
  const Site site_ = site_on(PlaneTerrain{100, {0, 0}});
  Scenario scenario_;
};

TEST_F(SnapshotTerrain, WithTheScenariosVoxelsIsTheGroundItself) {
  scenario_.voxel_size_m = 0.05;
  EXPECT_EQ(open_site(scenario_).ground->state_hash(), site_.ground->state_hash());
}

TEST_F(SnapshotTerrain, WithOtherVoxelsIsTheSurfaceOfThatGround) {
  scenario_.voxel_size_m = 0.1;
  const Site on_it = open_site(scenario_);
  EXPECT_TRUE(on_it.ground->chunks().empty());
  ASSERT_NE(on_it.ground->terrain().ground(), nullptr);
  EXPECT_EQ(on_it.ground->terrain().ground()->state_hash(), site_.ground->state_hash());
  EXPECT_TRUE(std::holds_alternative<PlaneTerrain>(on_it.undug().terrain));
  dig(*on_it.ground, 0.2, 1);
  // And again through a file.
  write_snapshot(folder_ / "b.vdb", on_it, kInfo);
  const Site back = read_snapshot(folder_ / "b.vdb");
  EXPECT_EQ(back.ground->state_hash(), on_it.ground->state_hash());
  EXPECT_EQ(back.ground->terrain().ground()->state_hash(), site_.ground->state_hash());
  EXPECT_TRUE(std::holds_alternative<PlaneTerrain>(back.undug().terrain));
  std::filesystem::remove(folder_ / "a.vdb");
  EXPECT_THAT(snapshot_refusal(folder_, folder_ / "b.vdb"), HasSubstr("a.vdb is missing"));
}

}  // namespace snapshot_base_test
}  // namespace soilvdb::io
