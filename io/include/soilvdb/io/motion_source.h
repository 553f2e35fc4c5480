// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Where a motion comes from: a CSV file, or what MCAP files hold of it.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace soilvdb::inline v0::io {

struct McapFacts;  // io/motion/mcap_index.h

/// What of MCAP files is a motion: the messages of a topic, in CDR. By their type they are
/// - sensor_msgs/JointState: joints by name, for a machine that has a chain;
/// - geometry_msgs/PoseStamped, nav_msgs/Odometry: the bucket frame in the world;
/// - tf2_msgs/TFMessage: the frame `frame`, which is the bucket's, in `parent`, which is the
/// world's.
struct McapTopic {
  std::string topic;
  std::string frame = {};   ///< for TFMessage only
  std::string parent = {};  ///< empty: the root of what `frame` hangs on
  /// What a reader has learnt of the files, for the next one that begins in their middle.
  std::shared_ptr<const McapFacts> facts = {};
  std::vector<std::string> more_topics = {};  ///< for JointState: each has some of the joints
};

struct MotionSource {
  MotionSource() = default;
  MotionSource(std::filesystem::path csv) : file(std::move(csv)) {}
  MotionSource(std::filesystem::path f, McapTopic topic)
      : file(std::move(f)), is_mcap(true), mcap(std::move(topic)) {}

  std::filesystem::path file;
  bool is_mcap = false;
  McapTopic mcap = {};
  std::vector<std::filesystem::path> more_files = {};  ///< of a recording in parts: the others

  std::vector<std::filesystem::path> files() const {
    std::vector<std::filesystem::path> all{file};
    all.insert(all.end(), more_files.begin(), more_files.end());
    return all;
  }
};

}  // namespace soilvdb::inline v0::io
