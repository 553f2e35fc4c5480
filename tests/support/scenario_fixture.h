// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A good scenario, and what is read or said when lines of it are replaced.
#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "soilvdb/io/scenario.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::io {

/// A good scenario, a line each that a test can replace.
inline const std::vector<std::string> kGood = {
    "soilvdb: 1",
    "name: dig",
    "voxel_size: 0.05",
    "terrain:",
    "  plane: {z: 2.5, slope: [0.1, -0.2]}",
    "machines:",
    "  - name: digger",
    "    bucket:",
    "      width: 1.2",
    "      height: 0.5",
    "      profile: [[0, 0], [-0.3, 0.02], [-0.45, 0.25], [0, 0.5]]",
    "      dump_angle: 0.8",
    "    motion: m.csv",
    "output:",
    "  snapshots: {every: 2}",
    "  mesh: obj",
    "  raster: {cell: 0.1}",
};

inline const char* const kUrdf = R"(<robot name="m"><link name="base"/><link name="bucket_link"/>
<joint name="boom" type="revolute"><parent link="base"/><child link="bucket_link"/>
<origin xyz="0 0 1"/><axis xyz="0 -1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>)";

class ScenarioFile : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_.write("m.csv", "time,x,y,z\n0,0,0,0\n1,1,0,0\n");
    folder_.write("joints.csv", "time,boom\n0,0.5\n1,1.05\n");
    folder_.write("m.urdf", kUrdf);
  }
  Scenario read(const std::string& content) {
    return read_scenario(folder_.write("s.yaml", content));
  }
  std::string error_of(const std::string& content) {
    const auto message = test::message_of(folder_, [&] { read(content); });
    EXPECT_EQ(message.find('\n'), message.npos) << "one line";
    return message;
  }
  /// The good scenario with line `number` (from 1) replaced; without it if `text` is empty.
  static std::string with(std::size_t number, const std::string& text) {
    std::string content;
    for (std::size_t i = 0; i < kGood.size(); ++i) {
      const std::string& line = i + 1 == number ? text : kGood[i];
      if (!line.empty()) content += line + "\n";
    }
    return content;
  }
  std::string error(std::size_t number, const std::string& text) {
    return error_of(with(number, text));
  }

  test::TempFolder folder_;
};

}  // namespace soilvdb::io
