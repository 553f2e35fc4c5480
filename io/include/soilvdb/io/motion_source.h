// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The source of a motion: a CSV file, or messages of MCAP files.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace soilvdb::inline v0::io {

struct McapFacts;  // io/motion/mcap_index.h

/// The messages of MCAP files that make a motion: those of a topic, in CDR, by type:
/// - sensor_msgs/JointState: joints by name, for a machine with a chain;
/// - geometry_msgs/PoseStamped, nav_msgs/Odometry: the bucket frame in the world;
/// - tf2_msgs/TFMessage: the bucket's frame `frame` in the world's frame `parent`.
struct McapTopic {
  std::string topic;
  std::string frame = {};   ///< for TFMessage only
  std::string parent = {};  ///< empty: the root of the tree above `frame`
  /// Facts that a reader has learnt of the files, for a reader that begins in their middle.
  std::shared_ptr<const McapFacts> facts = {};
  std::vector<std::string> more_topics = {};  ///< for JointState: topics of more joints
  /// For JointState, of a machine that drives: messages with the poses of its base.
  std::shared_ptr<const McapTopic> base = {};
};

struct MotionSource {
  MotionSource() = default;
  MotionSource(std::filesystem::path csv) : file(std::move(csv)) {}
  MotionSource(std::filesystem::path f, McapTopic topic)
      : file(std::move(f)), is_mcap(true), mcap(std::move(topic)) {}

  std::filesystem::path file;
  bool is_mcap = false;
  McapTopic mcap = {};
  std::vector<std::filesystem::path> more_files = {};  ///< the other parts of a recording in parts

  std::vector<std::filesystem::path> files() const {
    std::vector<std::filesystem::path> all{file};
    all.insert(all.end(), more_files.begin(), more_files.end());
    return all;
  }
};

}  // namespace soilvdb::inline v0::io
