// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Messages of scans as robots record them.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tests/support/mcap_fixture.h"

namespace soilvdb::io {

/// The bytes of numbers. @param big_endian most significant first
template <typename... T>
std::string bytes_of(bool big_endian, T... values) {
  std::string bytes;
  const auto put = [&](auto value) {
    const std::string one(reinterpret_cast<const char*>(&value), sizeof value);
    if (big_endian)
      bytes.append(one.rbegin(), one.rend());
    else
      bytes += one;
  };
  (put(values), ...);
  return bytes;
}

/// A list of bytes.
inline void put_bytes(CdrWriter& cdr, const std::string& bytes) {
  cdr.put(static_cast<std::uint32_t>(bytes.size()));
  for (const char c : bytes) cdr.put(c);
}

/// A sensor_msgs/PointCloud2.
struct CloudMessage {
  struct Field {
    std::string name;
    std::uint32_t offset = 0;
    std::uint8_t datatype = 7;
  };
  std::uint32_t height = 1, width = 0;
  std::vector<Field> fields = {{"x", 0}, {"y", 4}, {"z", 8}};
  bool big_endian = false;
  std::uint32_t point_step = 12, row_step = 0;
  std::string data = {};

  CdrWriter cdr(double stamp_s, const std::string& frame = "lidar") const {
    CdrWriter cdr = Recording::stamped(stamp_s, frame);
    cdr.put_all(height, width, static_cast<std::uint32_t>(fields.size()));
    for (const Field& field : fields) {
      cdr.put(std::string_view(field.name));
      cdr.put(field.offset);
      cdr.put(field.datatype);
      cdr.put(std::uint32_t{1});
    }
    cdr.put(static_cast<std::uint8_t>(big_endian));
    cdr.put_all(point_step, row_step);
    put_bytes(cdr, data);
    cdr.put(std::uint8_t{1});
    return cdr;
  }
};

/// A cloud of one point.
inline CloudMessage one_point(float x, float y, float z) {
  CloudMessage cloud;
  cloud.width = 1;
  cloud.data = bytes_of(false, x, y, z);
  return cloud;
}

/// A sensor_msgs/Image.
struct DepthMessage {
  std::uint32_t height = 2, width = 3;
  std::string encoding = "16UC1";
  bool big_endian = false;
  std::uint32_t step = 6;
  std::string data = {};

  CdrWriter cdr(double stamp_s, const std::string& frame = "optical") const {
    CdrWriter cdr = Recording::stamped(stamp_s, frame);
    cdr.put_all(height, width);
    cdr.put(std::string_view(encoding));
    cdr.put(static_cast<std::uint8_t>(big_endian));
    cdr.put(step);
    put_bytes(cdr, data);
    return cdr;
  }
};

/// A sensor_msgs/CameraInfo.
struct InfoMessage {
  std::uint32_t height = 2, width = 3;
  double fx = 100, fy = 50, cx = 1, cy = 0.5;
  double distortion = 0;
  std::uint32_t binning = 0;

  CdrWriter cdr(double stamp_s) const {
    CdrWriter cdr = Recording::stamped(stamp_s, "optical");
    cdr.put_all(height, width);
    cdr.put(std::string_view("plumb_bob"));
    cdr.put(std::uint32_t{5});
    for (int i = 0; i < 5; ++i) cdr.put(i == 4 ? distortion : 0.0);
    cdr.put_all(fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0);
    for (int i = 0; i < 9 + 12; ++i) cdr.put(0.25 * i);
    cdr.put_all(binning, binning, std::uint32_t{0}, std::uint32_t{0}, std::uint32_t{0},
                std::uint32_t{0});
    cdr.put(std::uint8_t{0});
    return cdr;
  }
};

}  // namespace soilvdb::io
