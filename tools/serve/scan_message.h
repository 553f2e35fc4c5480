// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A message of the stream /scan: a header in JSON, then points.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "io/scan/scan_messages.h"
#include "soilvdb/survey.h"

namespace soilvdb::tools {

inline constexpr std::size_t kMostScanBytes = 32 << 20, kMostScanHeader = 16 << 10;
inline constexpr std::size_t kMostScanPoints = 1 << 20;

/// Before the reason why a correction that was made is not on disk.
inline const std::string kNotOnDisk =
    "the ground is corrected by this scan, but that is not on disk yet; do not send it again: ";

/// The header of a message, checked as far as that needs no site.
struct ScanHead {
  enum class Format { kFloat32, kFloat64, kDepth, kCloud2 };

  /// @param message 4 bytes with the length of the header, little-endian, the header, the points
  /// @throw std::invalid_argument with one line
  explicit ScanHead(std::string_view message);

  std::string sensor = {};  ///< empty: it is not named
  std::optional<double> time_s = {};
  Format format = Format::kFloat32;
  bool in_world = false;          ///< points are the world's; else the sensor's
  io::CameraModel camera = {};    ///< of a depth image
  std::optional<Pose> pose = {};  ///< world_from_sensor
  /// Those that the header has, and its largest range.
  std::vector<std::pair<double Sensor::*, double>> sigmas = {};
  std::size_t points_at = 0;  ///< offset of the points
};

/// Where the rays of a message ended, world. Needs no site.
/// @param sensor at its place in the world
/// @throw std::invalid_argument with one line
std::vector<Vec3> scan_points(const ScanHead& head, std::string_view message, const Sensor& sensor);

}  // namespace soilvdb::tools
