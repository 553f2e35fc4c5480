// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Motions as text, and what is read or said of them.
#pragma once

#include <gtest/gtest.h>

#include <optional>
#include <string>

#include "soilvdb/io/motion_csv.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::io {

class MotionCsv : public ::testing::Test {
 protected:
  MotionInput read(const std::string& content) {
    return read_motion(folder_.write("m.csv", content), std::nullopt);
  }
  MotionInput read_joints(const std::string& content) {
    Chain chain;
    for (const char* name : {"boom_joint", "arm_joint"}) {
      Joint joint;
      joint.name = name;
      joint.type = Joint::Type::kRevolute;
      joint.lower = -1.22;
      joint.upper = 0.77;
      chain.joints.push_back(joint);
    }
    return read_motion(folder_.write("m.csv", content), chain);
  }
  std::string error(const std::string& content) {
    return test::message_of(folder_, [&] { read(content); });
  }
  std::string joints_error(const std::string& content) {
    return test::message_of(folder_, [&] { read_joints(content); });
  }

  test::TempFolder folder_;
};

}  // namespace soilvdb::io
