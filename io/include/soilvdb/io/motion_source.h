// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Where a motion comes from: a CSV file, or what an MCAP file holds of it.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <utility>

namespace soilvdb::inline v0::io {

struct McapFacts;  // io/motion/mcap_rows.h

/// What of an MCAP file is a motion: the messages of a topic, in CDR. By their type they are
/// - sensor_msgs/JointState: joints by name, for a machine that has a chain;
/// - geometry_msgs/PoseStamped: the bucket frame in the world;
/// - tf2_msgs/TFMessage: the frame `frame`, which is the bucket's, in `parent`, which is the
/// world's.
struct McapTopic {
  std::string topic;
  std::string frame = {};   ///< for TFMessage only
  std::string parent = {};  ///< empty: the root of what `frame` hangs on
  /// What a reader has learnt of the file, for the next one that begins in its middle.
  std::shared_ptr<const McapFacts> facts = {};
};

struct MotionSource {
  MotionSource() = default;
  MotionSource(std::filesystem::path csv) : file(std::move(csv)) {}
  MotionSource(std::filesystem::path f, McapTopic topic)
      : file(std::move(f)), is_mcap(true), mcap(std::move(topic)) {}

  std::filesystem::path file;
  bool is_mcap = false;
  McapTopic mcap = {};
};

}  // namespace soilvdb::inline v0::io
