// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The file of ground that isn't needed for now.
#include "io/snapshot/swap_file.h"

#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/ground/ground_writer.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::test {
namespace swap_file_test {

TEST(SwapFile, GivesBackWhatWasPutAndTakesRoomThatIsLeft) {
  const test::TempFolder folder;
  io::SwapFile file(folder.path());
  std::vector<std::pair<std::uint32_t, std::string>> pieces;
  for (std::size_t round = 0; round < 3; ++round) {
    const std::uint64_t size = file.size_bytes();
    for (std::size_t i = 0; i < 200; ++i) {
      const std::string bytes(37 * i, static_cast<char>('a' + (i + round) % 26));
      pieces.emplace_back(file.put(bytes), bytes);
    }
    if (round > 0) {
      EXPECT_EQ(file.size_bytes(), size);
    }
    std::string back;
    for (const auto& [piece, bytes] : pieces) {
      EXPECT_GT(piece, 0u);
      file.get(piece, back);
      EXPECT_EQ(back, bytes);
      file.drop(piece, bytes.size());
    }
    pieces.clear();
  }
}

TEST(SwapFile, OfGroundThatIsDugAgainAndAgainTakesRoomThatIsLeft) {
  const test::TempFolder folder;
  const auto file = std::make_shared<io::SwapFile>(folder.path());
  Ground ground(0.1, Vec3::Zero(), make_plane(0.013, {0.1, 0.2}));
  GroundWriter writer(ground);
  const auto dig = [&](int i) {
    SampleWords words;
    words.fill(std::uint64_t{1} << i);
    for (int x = 0; x < 80; x += 8) writer.remove({x, 0, 0}, words);
  };
  dig(0);
  ground.set_memory_limit(ground.memory_bytes() - 1000, file);
  std::uint64_t size = 0;
  for (int i = 1; i < 30; ++i) {
    dig(i);
    ground.evict();
    if (i == 10) size = file->size_bytes();
  }
  EXPECT_GT(size, 64u);
  EXPECT_LT(file->size_bytes(), 2 * size);
}

}  // namespace swap_file_test
}  // namespace soilvdb::test
