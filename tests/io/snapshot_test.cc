// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "soilvdb/io/snapshot.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <filesystem>
#include <string>

#include "io/snapshot/snapshot_format.h"
#include "soilvdb/io/checksum.h"
#include "soilvdb/surface_height.h"
#include "tests/support/snapshot_fixture.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::io {
namespace snapshot_test {

using test::TempFolder;
using ::testing::HasSubstr;

std::string output_of(const std::string& command) {
  std::FILE* pipe = ::popen((command + " 2>&1").c_str(), "r");
  std::string text;
  char buffer[4096];
  for (std::size_t n; (n = std::fread(buffer, 1, sizeof buffer, pipe)) > 0;) text.append(buffer, n);
  return ::pclose(pipe) == 0 ? text : "";
}

class Snapshot : public ::testing::TestWithParam<const char*> {
 protected:
  Terrain terrain() const {
    if (std::string(GetParam()) == "raster") return RasterTerrain{hills(folder_)};
    return PlaneTerrain{100 - 400000 * 0.1 + 5000000 * 0.2, {0.1, -0.2}};
  }
  TempFolder folder_;
};

INSTANTIATE_TEST_SUITE_P(Terrains, Snapshot, ::testing::Values("plane", "raster"));

TEST_P(Snapshot, GivesBackTheSameBits) {
  const Site site = site_on(terrain());
  dig(*site.ground, 0, 1);
  ASSERT_FALSE(site.ground->chunks().empty());
  write_snapshot(folder_ / "a.vdb", site, kInfo);
  SnapshotInfo info;
  const Site back = read_snapshot(folder_ / "a.vdb", &info);
  EXPECT_EQ(back.ground->state_hash(), site.ground->state_hash());
  EXPECT_EQ(back.ground->chunks().size(), site.ground->chunks().size());
  EXPECT_EQ(back.ground->origin(), site.ground->origin());
  EXPECT_EQ(back.ground->voxel_size_m(), site.ground->voxel_size_m());
  EXPECT_EQ(back.crs_wkt, site.crs_wkt);
  EXPECT_EQ(back.bounds.min(), site.bounds.min());
  EXPECT_EQ(back.reference.checksum, site.reference.checksum);
  EXPECT_EQ(info.scenario, kInfo.scenario);
  EXPECT_EQ(info.time_s, kInfo.time_s);
  EXPECT_EQ(info.cut_m3, kInfo.cut_m3);
  EXPECT_EQ(info.captured_m3, kInfo.captured_m3);
  EXPECT_EQ(info.displaced_m3, kInfo.displaced_m3);
  EXPECT_EQ(info.dumped_m3, kInfo.dumped_m3);
  for (const Chunk* chunk : site.ground->chunks()) {
    const Chunk* other = back.ground->find(chunk->origin);
    ASSERT_NE(other, nullptr);
    SampleWords before, now;
    site.ground->read_samples(chunk->origin, before);
    back.ground->read_samples(chunk->origin, now);
    EXPECT_EQ(now, before);
  }
}

TEST_P(Snapshot, DiggingOnFromItEndsInTheSameBits) {
  const Site site = site_on(terrain());
  dig(*site.ground, 0, 0.6);
  write_snapshot(folder_ / "a.vdb", site, kInfo);
  const Site back = read_snapshot(folder_ / "a.vdb");
  dig(*site.ground, 0.5, 1);
  dig(*back.ground, 0.5, 1);
  EXPECT_EQ(back.ground->state_hash(), site.ground->state_hash());
}

TEST_P(Snapshot, TheSameGroundMakesTheSameBytes) {
  const Site site = site_on(terrain());
  dig(*site.ground, 0, 1);
  write_snapshot(folder_ / "a.vdb", site, kInfo);
  write_snapshot(folder_ / "b.vdb", site, kInfo);
  EXPECT_EQ(content(folder_ / "a.vdb"), content(folder_ / "b.vdb"));
  write_snapshot(folder_ / "c.vdb", read_snapshot(folder_ / "a.vdb"), kInfo);
  EXPECT_EQ(content(folder_ / "a.vdb"), content(folder_ / "c.vdb"));
}

TEST_P(Snapshot, OfGroundThatWasNeverTouchedIsEmptyButWhole) {
  const Site site = site_on(terrain());
  write_snapshot(folder_ / "a.vdb", site, kInfo);
  const Site back = read_snapshot(folder_ / "a.vdb");
  EXPECT_TRUE(back.ground->chunks().empty());
  EXPECT_EQ(surface_height(*back.ground, 400001, 5000001),
            surface_height(*site.ground, 400001, 5000001));
}

TEST_P(Snapshot, IsAPlainVdbForOthers) {
  const Site site = site_on(terrain());
  dig(*site.ground, 0, 1);
  write_snapshot(folder_ / "a.vdb", site, kInfo);
  const std::string text = output_of("vdb_print -l " + (folder_ / "a.vdb").string());
  if (text.empty()) GTEST_SKIP() << "vdb_print is not there";
  EXPECT_THAT(text, HasSubstr("Name: surface"));
  EXPECT_THAT(text, HasSubstr("class: level set"));
  EXPECT_THAT(text, HasSubstr("voxel size: 0.05"));
  EXPECT_THAT(text, HasSubstr("soilvdb_origin: [400000, 5e+06, 100]"));
}

TEST_P(Snapshot, IsReadByOpenVdbsPythonModule) {
  if (output_of("/usr/bin/python3 -c 'import pyopenvdb; print(1)'").empty())
    GTEST_SKIP() << "python3-openvdb is not installed";
  const Site site = site_on(terrain());
  dig(*site.ground, 0, 0.6);
  SnapshotInfo info = kInfo;
  write_snapshot(folder_ / "a.vdb", site, info);
  const std::string a = content(folder_ / "a.vdb");
  info.parent = SnapshotParent{"a.vdb", {a.size(), crc64(a)}};
  info.tracker_state = "state";
  write_snapshot(folder_ / "b.vdb", site, info);
  for (const char* name : {"a.vdb", "b.vdb"}) {
    folder_.write("read.py", R"(
import sys, pyopenvdb as vdb
file = sys.argv[1]
grids, meta = vdb.readAll(file)
assert [g.name for g in grids] == ['surface'], grids
assert [g.name for g in vdb.readAllGridMetadata(file)] == ['surface']
surface = vdb.read(file, 'surface')
assert surface.gridClass == vdb.GridClass.LEVEL_SET
assert surface.activeVoxelCount() > 0
for at in (meta, surface.metadata, vdb.readMetadata(file)):
    assert tuple(at['soilvdb_origin']) == (400000, 5000000, 100), at
print('read')
)");
    EXPECT_EQ(output_of(fmt::format("/usr/bin/python3 {} {}", (folder_ / "read.py").string(),
                                    (folder_ / name).string())),
              "read\n");
  }
}

TEST_P(Snapshot, OfAnotherFormatIsRefusedWithWhatToDo) {
  const Site site = site_on(terrain());
  write_snapshot(folder_ / "a.vdb", site, kInfo);
  std::string bytes = content(folder_ / "a.vdb");
  const std::string key = std::string("soilvdb_format") + std::string("\5\0\0\0int32", 9);
  const std::size_t at = bytes.find(key);
  ASSERT_NE(at, std::string::npos);
  bytes[at + key.size() + 4] = 2;
  bytes.resize(bytes.size() - kTrailerSize);
  folder_.write("b.vdb", bytes + trailer(bytes));
  EXPECT_THAT(snapshot_refusal(folder_, folder_ / "b.vdb"),
              HasSubstr("b.vdb: is a snapshot of format 2, this version reads format 3; run its "
                        "scenario again to make it anew"));
}

TEST_P(Snapshot, ThatIsDamagedIsStillKnownAsOurs) {
  const Site site = site_on(terrain());
  dig(*site.ground, 0, 0.3);
  write_snapshot(folder_ / "a.vdb", site, kInfo);
  const std::string good = content(folder_ / "a.vdb");
  for (const std::size_t size : {std::size_t{60}, good.size() / 2, good.size() - 1}) {
    folder_.write("b.vdb", good.substr(0, size));
    EXPECT_TRUE(is_snapshot(folder_ / "b.vdb")) << size;
    EXPECT_THAT(snapshot_refusal(folder_, folder_ / "b.vdb"), HasSubstr("b.vdb: is damaged"))
        << size;
  }
  for (std::size_t at = 0; at < good.size(); at += 1 + good.size() / 50) {
    std::string bad = good;
    bad[at] = static_cast<char>(bad[at] ^ 16);
    folder_.write("b.vdb", bad);
    EXPECT_TRUE(is_snapshot(folder_ / "b.vdb")) << at;
    EXPECT_THAT(snapshot_refusal(folder_, folder_ / "b.vdb"), HasSubstr("b.vdb: is damaged")) << at;
  }
  EXPECT_THAT(snapshot_refusal(folder_, folder_.write("c.vdb", "")),
              HasSubstr("is not a snapshot"));
  EXPECT_THAT(snapshot_refusal(folder_, folder_ / "d.vdb"), HasSubstr("no such file"));
}

TEST(SnapshotFile, ThatCantBeWrittenIsNamedAndNothingIsLeft) {
  const TempFolder folder;
  const Site site = site_on(PlaneTerrain{100, {0, 0}});
  EXPECT_THAT(test::message_of(folder, [&] { write_snapshot(folder / "no/a.vdb", site, kInfo); }),
              HasSubstr("no/a.vdb: can't be written"));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
  EXPECT_FALSE(is_snapshot(folder / "no/a.vdb"));
  EXPECT_FALSE(is_snapshot(folder.path()));
}

}  // namespace snapshot_test
}  // namespace soilvdb::io
