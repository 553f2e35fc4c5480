// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Decodes the ROS messages of scans from CDR.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <string>
#include <string_view>

#include "io/mcap/cdr.h"
#include "soilvdb/io/point_cloud.h"

namespace soilvdb::inline v0::io {

/// A message is CDR, but no scan that is read. The message lacks its subject.
struct ScanFault : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// std_msgs/Header
struct ScanHeader {
  std::int64_t stamp_ns = 0;
  std::string frame_id;
};
ScanHeader read_scan_header(std::string_view cdr);

/// A pinhole camera: pixel (u, v) at depth z is ((u - cx) z / fx, (v - cy) z / fy, z).
struct CameraModel {
  std::uint32_t width = 0, height = 0;
  double fx = 0, fy = 0, cx = 0, cy = 0;  ///< pixels; centres of pixels have whole numbers

  /// What pixel (u, v) sees at a depth, m.
  Vec3 point(std::size_t u, std::size_t v, double depth) const {
    return {(static_cast<double>(u) - cx) / fx * depth, (static_cast<double>(v) - cy) / fy * depth,
            depth};
  }
  bool operator==(const CameraModel&) const = default;
};

/// sensor_msgs/CameraInfo. @throw CdrError; ScanFault if the camera is no plain pinhole
CameraModel read_camera_info(std::string_view cdr);
/// sensor_msgs/PointCloud2. @param most points that it may have @throw CdrError; ScanFault
PointCloud read_point_cloud2(std::string_view cdr,
                             std::size_t most = std::numeric_limits<std::size_t>::max());
/// sensor_msgs/Image of depths. @throw CdrError; ScanFault
PointCloud read_depth_image(std::string_view cdr, const CameraModel& camera);

}  // namespace soilvdb::inline v0::io
