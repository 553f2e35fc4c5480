// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Snapshots written beside updates: the bytes of those for which updates would have waited.
#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "soilvdb/change_follower.h"
#include "soilvdb/ground_copy.h"
#include "soilvdb/io/snapshot.h"
#include "tests/support/dig_runner.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::test {
namespace snapshot_beside_test {

std::string content(const std::filesystem::path& file) {
  std::ostringstream text;
  text << std::ifstream(file, std::ios::binary).rdbuf();
  return text.str();
}

class SnapshotsBeside : public ::testing::TestWithParam<bool> {};
INSTANTIATE_TEST_SUITE_P(Threads, SnapshotsBeside, ::testing::Bool(),
                         [](const auto& thread) { return thread.param ? "OneOfItsOwn" : "None"; });

TEST_P(SnapshotsBeside, UpdatesHaveTheBytesOfThoseWrittenAtOnce) {
  const test::TempFolder folder;
  const Dig dig = make_dig("drag_curl_retreat", placements()[2]);
  io::Site site;
  site.ground = std::make_unique<Ground>(0.05, dig.origin, dig.terrain);
  site.reference = {io::PlaneTerrain{1.5, {0.1, 0.2}}, ""};
  site.crs_wkt = "LOCAL_CS[\"site\"]";
  const io::Site copy = io::undug_site(site);
  Tracker tracker(*site.ground, {dig.bucket});
  ChangeFollower changes(*site.ground);
  std::vector<std::filesystem::path> files;
  std::vector<std::string> expected;
  {
    GroundCopy ground_copy(*copy.ground, GetParam(), 2);
    constexpr int kUpdates = 60;
    const double end = dig.motion.end_s();
    for (int i = 0; i < kUpdates; ++i) {
      tracker.update(0, dig.motion, end * i / kUpdates, end * (i + 1) / kUpdates);
      if (i % 10 != 9) continue;
      ground_copy.post(*site.ground, changes.take());
      files.push_back(folder / (std::to_string(i) + ".vdb"));
      const io::SnapshotInfo info{"dig", double(i), tracker.total().cut_m3()};
      expected.push_back(io::snapshot_bytes(files.back(), site, info));
      ground_copy.run([&copy, file = files.back(), info] { io::write_snapshot(file, copy, info); });
    }
  }  // with snapshots still to be written
  ASSERT_GT(tracker.total().captured, 0);
  for (std::size_t i = 0; i < files.size(); ++i) EXPECT_TRUE(content(files[i]) == expected[i]) << i;
}

TEST(SnapshotBeside, AFolderThatIsNotThereIsReported) {
  const test::TempFolder folder;
  io::Site site;
  site.ground = std::make_unique<Ground>(0.05, Vec3::Zero(), make_plane(0, {0, 0}));
  const io::Site copy = io::undug_site(site);
  GroundCopy ground_copy(*copy.ground);
  const auto write = [&] {  // run() itself says so where the job was that fast
    ground_copy.run([&] { io::write_snapshot(folder / "not" / "there.vdb", copy, {}); });
    ground_copy.finish();
  };
  EXPECT_THROW(write(), std::runtime_error);
  EXPECT_NO_THROW(ground_copy.finish());
}

}  // namespace snapshot_beside_test
}  // namespace soilvdb::test
