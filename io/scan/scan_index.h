// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The index of recorded scans, made by a first pass: where each is, in the order of their times.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "io/motion/mcap_index.h"
#include "io/scan/scan_messages.h"
#include "soilvdb/io/recorded_scans.h"

namespace soilvdb::inline v0::io {

enum class ScanType : std::uint8_t { kPointCloud2, kImage };
/// The ROS name, "sensor_msgs/Image".
const char* type_name(ScanType type);

/// A message of the scans' topic.
struct ScanPlace {
  std::int64_t time_ns = 0, log_ns = 0;
  std::uint32_t file = 0;
  long number = 0;  ///< of the topic's messages in the file, from 1
  McapReader::Mark mark;
  std::string fault = {};  ///< why it is left out
};

/// What a camera is from a time on.
struct CameraSince {
  std::int64_t time_ns = 0;
  CameraModel camera;
  std::string fault = {};  ///< why it can't be used
};

struct ScanIndex {
  ScanType type = ScanType::kPointCloud2;
  std::vector<McapFacts::File> files;
  std::vector<ScanPlace> scans;      ///< in the order of their times
  std::vector<CameraSince> cameras;  ///< the same; changes only
  std::string tf_topic;              ///< with transforms; empty: there are none
  std::int64_t unstamped = 0;        ///< scans whose log time counts
};

/// Reads all files from end to end.
/// @param source files, not folders
/// @throw InputError if a file is damaged, or if the topic has no scans
ScanIndex index_scans(const ScanSource& source);

/// The source's, or the one beside its images.
std::string camera_info_topic(const ScanSource& source);

}  // namespace soilvdb::inline v0::io
