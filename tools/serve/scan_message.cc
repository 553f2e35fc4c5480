// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/scan_message.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "core/constants.h"
#include "core/survey/sensor_model.h"
#include "io/file/json.h"
#include "io/file/text.h"
#include "io/scan/cloud_builder.h"
#include "tools/serve/line_values.h"

namespace soilvdb::tools {
namespace {

using Line = nlohmann::json;

constexpr std::size_t kLength = 4;  // bytes with the header's length
constexpr bool kSwap = std::endian::native == std::endian::big;
constexpr const char* kCloudType = "sensor_msgs/msg/PointCloud2";

std::string text_in(const Line& json, const char* key) {
  if (!json[key].is_string())
    throw std::invalid_argument(fmt::format("header: '{}' must be a text", key));
  return json[key].get<std::string>();
}

[[noreturn]] void refuse_head(const std::string& what) {
  throw std::invalid_argument(fmt::format(
      "message: {}; it must have 4 bytes with the length of its header, little-endian, the header, "
      "and then the points",
      what));
}

/// Where the header of a message is.
std::string_view header_of(std::string_view message) {
  if (message.size() < kLength) refuse_head(fmt::format("it has {} bytes", message.size()));
  std::uint32_t length = 0;
  for (std::size_t i = 0; i < kLength; ++i)
    length |= std::uint32_t{static_cast<std::uint8_t>(message[i])} << (8 * i);
  if (length > kMostScanHeader)
    refuse_head(fmt::format("its header has {} bytes, and may have {}", length, kMostScanHeader));
  if (length > message.size() - kLength)
    refuse_head(
        fmt::format("its header has {} bytes, and {} follow", length, message.size() - kLength));
  return message.substr(kLength, length);
}

double sigma_in(const Line& json, const char* key) {
  const double sigma = number_of(json, fmt::format("header: '{}'", key));
  if (!(sigma >= 0 && sigma <= kMostSensorSigma))
    throw std::invalid_argument(
        fmt::format("header: '{}' is {:g}; it must be 0 to {}", key, sigma, kMostSensorSigma));
  return sigma;
}

using Sigmas = std::vector<std::pair<double Sensor::*, double>>;

/// Adds those of a key. @param form what it must be
void take_sigmas(const Line& header, std::string_view group, const char* form, Sigmas& sigmas) {
  if (!header.contains(group)) return;
  const Line& json = header[std::string(group)];
  if (!json.is_object()) throw std::invalid_argument(fmt::format("'{}' must be {}", group, form));
  require_keys(json, sigma_keys(group));
  for (const SensorSigma& sigma : kSensorSigmas)
    if (sigma.group == group && json.contains(sigma.key))
      sigmas.emplace_back(sigma.field, sigma_in(json[sigma.key], sigma.key));
}

/// The noise of a ray, all of it.
void take_noise(const Line& header, Sigmas& sigmas) {
  if (!header.contains("noise")) return;
  RangeNoise known;
  if (header["noise"].is_string()) known = noise_of(header["noise"].get<std::string>());
  sigmas = {{&Sensor::range_sigma_m, known.sigma_m},
            {&Sensor::range_squared_sigma_per_m, known.squared_per_m}};
  if (!header["noise"].is_string())
    take_sigmas(header, "noise", "the name of a sensor, or {\"range\": m, \"range_squared\": 1/m}",
                sigmas);
  if (std::all_of(sigmas.begin(), sigmas.end(), [](const auto& s) { return s.second == 0; }))
    throw std::invalid_argument("'noise' has neither range nor range_squared; one must be over 0");
}

ScanHead::Format format_in(const Line& json) {
  if (!json.contains("format") || !json["format"].is_string())
    throw std::invalid_argument(
        "'format' is missing; there are float32_xyz, float64_xyz, depth_float32 and cdr");
  const std::string word = json["format"].get<std::string>();
  if (word == "float32_xyz") return ScanHead::Format::kFloat32;
  if (word == "float64_xyz") return ScanHead::Format::kFloat64;
  if (word == "depth_float32") return ScanHead::Format::kDepth;
  if (word != "cdr")
    throw std::invalid_argument(
        fmt::format("'format' is '{}'; there are float32_xyz, float64_xyz, depth_float32 and cdr",
                    io::printable(word)));
  if (!json.contains("type") || json["type"] != kCloudType)
    throw std::invalid_argument(
        fmt::format("'format' is 'cdr', so 'type' must be \"{}\"", kCloudType));
  return ScanHead::Format::kCloud2;
}

io::CameraModel camera_in(const Line& json) {
  if (!json.contains("shape") || !json.contains("intrinsics"))
    throw std::invalid_argument(
        "a depth image needs 'shape', [rows, columns], and 'intrinsics', [fx, fy, cx, cy]");
  const auto shape = array_of<2>(json["shape"], "shape");
  for (const double n : shape)
    if (!(n >= 1 && n <= static_cast<double>(kMostScanPoints) && n == std::floor(n)))
      throw std::invalid_argument("'shape' must be whole numbers, [rows, columns]");
  const auto k = array_of<4>(json["intrinsics"], "intrinsics");
  if (!(k[0] > 0 && k[1] > 0 &&
        std::all_of(k.begin(), k.end(), [](double v) { return std::abs(v) <= io::kMaxNumber; })))
    throw std::invalid_argument(
        "'intrinsics' must be [fx, fy, cx, cy] in pixels, fx and fy more than 0");
  return {static_cast<std::uint32_t>(shape[1]),
          static_cast<std::uint32_t>(shape[0]),
          k[0],
          k[1],
          k[2],
          k[3]};
}

/// Keys that only some formats have.
void require_format_keys(const Line& json, ScanHead::Format format) {
  const auto only = [&](const char* key, ScanHead::Format of, const char* word) {
    if (json.contains(key) && format != of)
      throw std::invalid_argument(fmt::format("'{}' goes with the format {} only", key, word));
  };
  only("shape", ScanHead::Format::kDepth, "depth_float32");
  only("intrinsics", ScanHead::Format::kDepth, "depth_float32");
  only("type", ScanHead::Format::kCloud2, "cdr");
}

/// Number of points of `size` bytes each.
std::size_t count_of(std::string_view bytes, std::size_t size) {
  if (bytes.size() % size != 0)
    throw std::invalid_argument(fmt::format(
        "points: {} bytes follow the header, which are no whole number of points of {} bytes",
        bytes.size(), size));
  if (bytes.size() / size > kMostScanPoints)
    throw std::invalid_argument(fmt::format("points: there are {}, and may be {}; leave some out",
                                            bytes.size() / size, kMostScanPoints));
  return bytes.size() / size;
}

/// Numbers x, y, z of each point.
io::PointCloud numbers_of(std::string_view bytes, io::NumberType type, bool in_world) {
  const std::size_t size = io::size_of(type), count = count_of(bytes, 3 * size);
  io::Axes axes;
  for (std::size_t k = 0; k < axes.size(); ++k) axes[k] = {bytes.data() + k * size, 3 * size, type};
  io::CloudBuilder cloud(/*zero_is_none=*/!in_world);
  cloud.expect(count);
  if (const auto far = cloud.add(axes, count, kSwap))
    throw std::invalid_argument(fmt::format(
        "points: point {} {}", *far, io::CloudBuilder::too_far(io::point_at(axes, *far, kSwap))));
  return cloud.take();
}

io::PointCloud depths_of(std::string_view bytes, const io::CameraModel& camera) {
  const std::size_t width = camera.width, height = camera.height;
  if (height > kMostScanPoints / width)
    throw std::invalid_argument(fmt::format("header: 'shape' is {} x {} pixels; there may be {}",
                                            height, width, kMostScanPoints));
  if (bytes.size() != sizeof(float) * width * height)
    throw std::invalid_argument(
        fmt::format("points: {} bytes follow the header; {} x {} depths of "
                    "{} bytes are {}",
                    bytes.size(), height, width, sizeof(float), sizeof(float) * width * height));
  io::PointCloud cloud;
  cloud.points_m.reserve(width * height);
  for (std::size_t v = 0; v < height; ++v) {
    for (std::size_t u = 0; u < width; ++u) {
      const double z = io::number_at(bytes.data() + sizeof(float) * (v * width + u),
                                     io::NumberType::kF32, kSwap);
      if (!(z > 0 && std::isfinite(z))) {
        ++cloud.without_return;
        continue;
      }
      if (z > kMostScanRangeM)
        throw std::invalid_argument(fmt::format(
            "points: pixel ({}, {}) has the depth {:g}; depths must be in metres, at most {}: are "
            "they millimetres?",
            u, v, z, kMostScanRangeM));
      cloud.points_m.push_back(camera.point(u, v, z));
    }
  }
  return cloud;
}

io::PointCloud cloud2_of(std::string_view bytes) {
  try {
    io::PointCloud cloud = io::read_point_cloud2(bytes, kMostScanPoints);
    cloud.without_return += cloud.leave_out_far();
    return cloud;
  } catch (const io::CdrError& e) {
    throw std::invalid_argument(
        fmt::format("points: they are not a {} in CDR: it {}", kCloudType, e.what()));
  } catch (const io::ScanFault& e) {
    throw std::invalid_argument(fmt::format("points: the {} {}", kCloudType, e.what()));
  }
}

io::PointCloud cloud_of(const ScanHead& head, std::string_view bytes) {
  switch (head.format) {
    case ScanHead::Format::kFloat32:
      return numbers_of(bytes, io::NumberType::kF32, head.in_world);
    case ScanHead::Format::kFloat64:
      return numbers_of(bytes, io::NumberType::kF64, head.in_world);
    case ScanHead::Format::kDepth:
      return depths_of(bytes, head.camera);
    default:
      return cloud2_of(bytes);
  }
}

}  // namespace

ScanHead::ScanHead(std::string_view message) {
  const std::string_view header = header_of(message);
  points_at = kLength + header.size();
  if (!io::is_utf8(header)) throw std::invalid_argument("header: it is not UTF-8; JSON must be");
  try {
    const Line json = object_of(header);
    require_keys(json, {"sensor", "time", "format", "frame", "shape", "intrinsics", "type",
                        "position", "rotation", "noise", "mount", "pose", "max_range"});
    if (json.contains("sensor")) sensor = text_in(json, "sensor");
    if (json.contains("time") && !json["time"].is_null()) time_s = line_time(json["time"]);
    format = format_in(json);
    require_format_keys(json, format);
    if (json.contains("frame")) {
      if (json["frame"] != "world" && json["frame"] != "sensor")
        throw std::invalid_argument(
            "'frame' must be \"world\" or \"sensor\": what the points are in");
      in_world = json["frame"] == "world";
    }
    if (format == Format::kDepth) camera = camera_in(json);
    if (format == Format::kDepth && in_world)
      throw std::invalid_argument(
          "a depth image is in the sensor's frame; remove 'frame', or send points");
    if (json.contains("position") != json.contains("rotation"))
      throw std::invalid_argument("'position' and 'rotation' come together");
    if (json.contains("position")) pose = line_pose(json["position"], json["rotation"]);
    take_noise(json, sigmas);
    take_sigmas(json, "mount", "{\"height\": m, \"tilt\": rad, \"scale\": share}", sigmas);
    take_sigmas(json, "pose",
                "{\"shift\": m, \"turn\": rad}, standard deviations; the pose itself is 'position' "
                "and 'rotation'",
                sigmas);
    if (json.contains("max_range"))
      sigmas.emplace_back(&Sensor::max_range_m, number_of(json["max_range"], "'max_range'"));
  } catch (const std::invalid_argument& e) {
    const std::string why = e.what();
    throw std::invalid_argument(why.starts_with("header: ") ? why : "header: " + why);
  }
}

std::vector<Vec3> scan_points(const ScanHead& head, std::string_view message,
                              const Sensor& sensor) {
  io::PointCloud cloud = cloud_of(head, message.substr(head.points_at));
  std::vector<Vec3>& points_m = cloud.points_m;
  if (points_m.empty() && cloud.without_return > 0)
    throw std::invalid_argument(fmt::format(
        "points: none of {} has a return: all are 0 or not finite", cloud.without_return));
  const Vec3 eye = head.in_world ? sensor.pose.position : Vec3(0, 0, 0);
  const bool leaves_out_far = std::isfinite(sensor.max_range_m);
  for (std::size_t i = 0; i < points_m.size() && !leaves_out_far; ++i)
    if (!((points_m[i] - eye).norm() <= kMostScanRangeM))
      throw std::invalid_argument(fmt::format(
          "points: one at ({:g}, {:g}, {:g}) is {:.4g} m from the sensor; it must be within {} m: "
          "are they metres, is 'frame' right, and the sensor's place?",
          points_m[i].x(), points_m[i].y(), points_m[i].z(), (points_m[i] - eye).norm(),
          kMostScanRangeM));
  if (!head.in_world) place_points(sensor.pose, points_m);
  return std::move(points_m);
}

}  // namespace soilvdb::tools
