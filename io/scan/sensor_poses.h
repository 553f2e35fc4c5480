// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Poses of sensors by recorded transforms.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "io/motion/row_source.h"
#include "soilvdb/io/recorded_scans.h"

namespace soilvdb::inline v0::io {

class SensorPoses {
 public:
  /// @param source files, not folders @param topic of its transforms; empty: it has none
  SensorPoses(const ScanSource& source, const std::string& topic);

  /// The pose of a frame in the world; empty where the transforms do not tell it.
  /// @param time_ns not before that of the last call for this frame
  /// @throw InputError if a file is damaged, or if the source names the world, and the frame is not
  ///        below it
  std::optional<Pose> at(const std::string& frame, std::int64_t time_ns);

  /// Adds those about frames and transforms that are not known.
  void warn(std::vector<std::string>& warnings) const;

 private:
  struct Sample {
    std::int64_t time_ns = 0;
    Pose pose;
  };
  struct Frame {
    std::optional<Pose> fixed;
    std::unique_ptr<RowSource> rows;     ///< null: the pose is fixed or unknown
    std::optional<Sample> before, next;  ///< neighbours in time
    bool after_gap = false;              ///< the pose between the two is not known
    std::string fault;                   ///< the first
    long faults = 0;
  };
  Frame open(const std::string& name);
  void find_frames();
  static void step(Frame& frame);

  MotionSource transforms_;
  bool world_given_ = false;
  std::map<std::string, Frame> frames_;
  std::size_t moving_ = 0;
};

}  // namespace soilvdb::inline v0::io
