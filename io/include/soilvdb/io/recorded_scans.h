// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Scans that a robot recorded in MCAP files.
#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "soilvdb/io/point_cloud.h"

namespace soilvdb::inline v0::io {

/// The messages of MCAP files that are scans: those of a topic, in CDR, by type:
/// - sensor_msgs/PointCloud2: the fields x, y, z, m;
/// - sensor_msgs/Image: depths, as 16UC1 in mm or as 32FC1 in m, of a camera without distortion.
struct ScanSource {
  std::vector<std::filesystem::path> files;  ///< the parts of a recording, or folders of them
  std::string topic;
  /// For images: topic of sensor_msgs/CameraInfo. Empty: `camera_info` beside the images' topic.
  std::string camera_info_topic = {};
  /// Topic of tf2_msgs/TFMessage. Transforms on this name with `_static` behind are fixed.
  std::string tf_topic = "/tf";
  std::string world = {};  ///< frame of the poses; empty: the root of the tree above the sensor
};

struct RecordedScan {
  std::size_t number =
      0;                 ///< among all of the recording by time, as RecordedScans::read() takes it
  double time_s = 0;     ///< the message's stamp, or without one its time of recording
  std::string frame_id;  ///< the sensor's frame
  /// In the sensor's frame; of images in the optical frame (REP-103): z ahead, x to the right of
  /// the image, y down. Row by row. Points without a return are counted, not kept: those with a
  /// coordinate or depth that is not finite, and those at (0, 0, 0) or with depth 0 or below.
  PointCloud cloud;
  /// By the transforms, interpolated at the scan's time; empty where they do not tell it: in gaps
  /// as a recorded motion has them, before the first and after the last.
  std::optional<Pose> world_from_sensor;
};

/// The scans of a recording, in the order of their times; messages may be in any order. Holds one
/// scan in memory, and an index of all. The points of a scan count as measured at once: times of
/// points are not looked at. Not for several threads.
class RecordedScans {
 public:
  /// Reads the files twice, and with transforms up to four times.
  /// @throw InputError if a file is damaged, if no message of the topic is a scan, if images have
  ///        no CameraInfo
  explicit RecordedScans(ScanSource source);
  ~RecordedScans();

  /// Its files in MCAP, those of folders one by one.
  const std::vector<std::filesystem::path>& files() const;
  /// Calls `take` with each scan.
  /// @param warnings receives one about scans that were left out because they are damaged or their
  ///        stamps are wrong, and those about files without footers, stamps and transforms
  /// @throw InputError if no scan is left, or if `world` is given and the sensor's frame is not
  ///        below it; what `take` throws
  void each(const std::function<void(RecordedScan&&)>& take, std::vector<std::string>& warnings);
  /// One of those that each() took. Reads on from the scan before, and anew to go back.
  /// @throw InputError if the file was changed
  RecordedScan read(std::size_t number);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace soilvdb::inline v0::io
