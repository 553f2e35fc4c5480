// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a run records: the same bytes whatever happens to it, and the ground as it is.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "io/mcap/mcap_reader.h"
#include "io/mcap/mcap_writer.h"
#include "soilvdb/change_follower.h"
#include "soilvdb/initial_terrain.h"
#include "soilvdb/surface_height.h"
#include "soilvdb/tracker.h"
#include "tests/program/resume_fixture.h"
#include "tools/run/elevation_map.h"

namespace soilvdb::test {
namespace mcap_output_test {

class McapOutput : public Resume {
 protected:
  void SetUp() override {
    Resume::SetUp();
    std::string text = read_file(folder() / "dig.yaml");
    text.replace(text.find("mesh: ply"), 9, "mesh: ply, mcap: true");
    write_file(folder() / "dig.yaml", text);
  }
  std::string recording() const { return read_file(out() / "soil.mcap"); }
};

TEST_F(McapOutput, HasTheSameBytesForAnyNumberOfThreads) {
  // Two machines whose updates end together at times, and soil that slides.
  std::string second = HalfSine{3, 0, 0.5}.csv(29);
  write_file(folder() / "second.csv", second);
  write_file(folder() / "two.yaml",
             "soilvdb: 1\nvoxel_size: 0.05\nterrain: {plane: {z: 0}}\n"
             "soil: {repose_angle: 0.61, swell: 0.25}\nmachines:\n"
             "  - {name: a, bucket: &b {width: 0.2, height: 0.3, profile: [[0, 0], [-0.2, 0.1], "
             "[0, 0.3]]}, motion: dig.csv}\n"
             "  - {name: b, bucket: *b, motion: second.csv}\n"
             "pours:\n  - {name: truck, at: [0.5, 1, 1], time: [1, 3.5], volume: 0.05}\n"
             "output: {mcap: true, force: true}\n");
  good("run two.yaml --threads 1 --out one");
  good("run two.yaml --threads 2 --out two");
  const std::string one = read_file(folder() / "one/soil.mcap");
  EXPECT_GT(one.size(), 1000u);
  EXPECT_TRUE(one == read_file(folder() / "two/soil.mcap"));
  EXPECT_EQ(read_json(folder() / "one/summary.json")["state_hash"],
            read_json(folder() / "two/summary.json")["state_hash"]);
}

TEST_F(McapOutput, IsMadeAgainWhereverTheRunEnded) {
  run_whole();
  const std::string whole = recording();
  EXPECT_THAT(summary()["files"], ::testing::Contains("soil.mcap"));
  for (const double share : {0.0, 0.3, 0.7}) {
    SCOPED_TRACE(share);
    interrupt(share);
    write_file(out() / "soil.mcap", "of a run before");
    write_file(out() / "soil.mcap.part", whole.substr(0, whole.size() / 2));
    expect_goes_on_to_the_same();
    EXPECT_TRUE(recording() == whole);
    EXPECT_FALSE(fs::exists(out() / "soil.mcap.part"));
  }
  damage("soil.mcap", whole.size() / 2);
  bad("verify out/dig", "soil.mcap");
  expect_goes_on_to_the_same();
  EXPECT_TRUE(recording() == whole);
  // Where it is whole only what isn't is dug again.
  damage("soil_3.vdb", 1000);
  EXPECT_NE(good("resume out/dig").out.find("going on from soil_2.vdb"), std::string::npos);
  EXPECT_TRUE(recording() == whole);
}

TEST_F(McapOutput, HasTheSameForcesAndPlacesWhereTheRunWentOn) {
  std::string text = read_file(folder() / "dig.yaml");
  text.replace(text.find("mcap: true"), 10, "mcap: true, force: true");
  write_file(folder() / "dig.yaml", text + "soil: {repose_angle: 0.61, swell: 0.25}\n");
  run_whole();
  const std::string whole = recording();
  io::McapReader reader(out() / "soil.mcap");
  io::McapReader::Message message;
  std::map<std::string, int> counts;
  while (reader.next(message)) ++counts[message.channel->topic];
  EXPECT_GT(counts["/digger/soil_wrench"], 10);
  EXPECT_EQ(counts["/tf"], counts["/digger/soil_wrench"]);
  interrupt(0.6);
  good("resume out/dig");
  EXPECT_TRUE(recording() == whole);
}

TEST_F(McapOutput, OfARunThatStoppedAtABadRowGoesOnToWhatAGoodOneHas) {
  run_whole();
  const std::string whole = recording(), rows = read_file(folder() / "dig.csv");
  std::string spoilt = rows;
  const auto line = spoilt.find("\n3.5");
  ASSERT_NE(line, spoilt.npos);
  spoilt.replace(line + 1, 3, "x.y");
  write_file(folder() / "dig.csv", spoilt);
  fs::remove_all(out());
  bad("run dig.yaml", "x.y");
  EXPECT_LT(recording().size(), whole.size());
  write_file(folder() / "dig.csv", rows);
  expect_goes_on_to_the_same();
  EXPECT_TRUE(recording() == whole);
}

TEST_F(McapOutput, OfGroundThatWasDugBeforeShowsThatToo) {
  run_whole();
  write_file(
      folder() / "on.yaml",
      "soilvdb: 1\nvoxel_size: 0.05\nterrain: {level_set: out/dig/soil_final.vdb}\nmachines:\n"
      "  - {name: digger, bucket: {width: 0.2, height: 0.5}, motion: air.csv}\n"
      "output: {mcap: true}\n");
  write_file(folder() / "air.csv", "time,x,y,z\n0,0.3,0,1\n1,0.6,0,1\n");
  good("run on.yaml --out on");
  io::McapReader reader(folder() / "on/soil.mcap");
  io::McapReader::Message message;
  std::map<std::string, int> counts;
  while (reader.next(message)) ++counts[message.channel->topic];
  EXPECT_EQ(counts["/ground"], 1);
  EXPECT_EQ(counts["/elevation"], 1);
  EXPECT_GE(counts["/load/digger"], 2);
}

TEST(ElevationMap, HasTheHeightsOfTheGroundAsItIs) {
  // Strokes here and there: the map grows, comes to wider cells, and looks only where they were.
  const double h = 0.05;
  const auto plane_m = [](double x) { return 20.013 + 0.05 * (x - 500000); };
  Ground ground(h, Vec3(500000, 5400000, 20), make_plane(plane_m(0), {0.05, 0}));
  Bucket bucket;
  bucket.width_m = 0.6;
  bucket.height_m = 0.5;
  Tracker tracker(ground, {bucket});
  tools::ElevationMap map(ground);
  ChangeFollower changes(ground);
  std::mt19937 random(1);
  std::uniform_real_distribution<double> place(-1, 1);
  double cell_m = 0;
  for (int stroke = 0; stroke < 12; ++stroke) {
    const double reach_m = stroke < 6 ? 2 : 9;
    Vec3 from(500000 + reach_m * place(random), 5400000 + reach_m * place(random), 0);
    from.z() = plane_m(from.x()) - 0.2;
    for (const double x : {0.0, 0.7, 1.4}) {
      Pose pose;
      pose.position = from + Vec3(x, 0, 0);
      tracker.update(0, pose);
    }
    map.update(changes.take());
    const auto heights_m = map.heights_m();
    SurfaceHeight surface(ground);
    std::size_t dug = 0;
    for (std::size_t y = 0; y < map.size_y(); ++y)
      for (std::size_t x = 0; x < map.size_x(); ++x) {
        const Vec2 at =
            ground.origin().head<2>() + map.corner_m() +
            map.cell_m() * Vec2(static_cast<double>(x) + 0.5, static_cast<double>(y) + 0.5);
        const auto height_m = surface.at(at.x(), at.y());
        ASSERT_TRUE(height_m);
        ASSERT_NEAR(heights_m[y * map.size_x() + x], *height_m - ground.origin().z(), 1e-5);
        dug += *height_m < plane_m(at.x()) - 0.1;
      }
    EXPECT_GT(dug, 0u);
    EXPECT_LE(heights_m.size(), static_cast<std::size_t>(tools::ElevationMap::kMostCells));
    EXPECT_GE(map.cell_m(), cell_m);
    cell_m = map.cell_m();
  }
  EXPECT_GT(cell_m, h);
}

TEST(McapWriter, WhatWasFlushedIsThereWhateverBecomesOfTheWriter) {
  const test::TempFolder folder;
  const io::McapSchema schema{"a", "jsonschema", "{}"};
  const std::string large(3 << 20, 'x');
  const auto read = [&](bool ended) {
    io::McapReader reader(folder / "a.mcap");
    io::McapReader::Message message;
    std::vector<std::string> all;
    while (reader.next(message)) {
      EXPECT_EQ(message.channel->schema, "a");
      all.push_back(message.channel->topic + " " + std::string(message.data));
    }
    EXPECT_EQ(!reader.torn_at(), ended);
    return all;
  };
  {
    io::McapWriter writer(folder / "a.mcap");
    const auto one = writer.add_channel("/one", schema, "json");
    writer.write(one, 5, "first");
    EXPECT_TRUE(read(false).empty());
    writer.flush();
    EXPECT_THAT(read(false), ::testing::ElementsAre("/one first"));
    const auto two = writer.add_channel("/two", schema, "json");
    writer.write(two, 6, large);
    writer.write(one, 7, "lost");
    EXPECT_THAT(read(false), ::testing::ElementsAre("/one first", "/two " + large));
  }
  EXPECT_EQ(read(false).size(), 2u);
  {
    io::McapWriter writer(folder / "a.mcap");
    writer.write(writer.add_channel("/one", schema, "json"), 5, "only");
    writer.close();
  }
  EXPECT_THAT(read(true), ::testing::ElementsAre("/one only"));
}

}  // namespace mcap_output_test
}  // namespace soilvdb::test
