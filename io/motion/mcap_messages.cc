// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/motion/mcap_messages.h"

#include <fmt/format.h>

#include <algorithm>

#include "io/file/text.h"
#include "soilvdb/types.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::int64_t kNsPerS = 1'000'000'000;

void read_item_pose(CdrReader& cdr, McapItem& item) {
  item.values.resize(kPoseNumbers);
  for (double& value : item.values) value = cdr.number<double>();
}

void read_joints(CdrReader& cdr, McapItem& item) {
  item.stamp_ns = read_stamp(cdr);
  cdr.text();  // frame
  std::vector<std::string_view> names(cdr.count(sizeof(std::uint32_t)));
  for (std::string_view& name : names) name = cdr.text();
  std::vector<double> positions(cdr.count(sizeof(double)));
  for (double& position : positions) position = cdr.number<double>();
  const std::size_t n = std::min(names.size(), positions.size());
  item.names.clear();
  for (std::size_t i = 0; i < n; ++i) item.names.append(names[i]).push_back('\0');
  item.values.assign(positions.begin(), positions.begin() + static_cast<std::ptrdiff_t>(n));
}

void read_transform(CdrReader& cdr, McapItem& item) {
  item.stamp_ns = read_stamp(cdr);
  const std::string_view parent = cdr.text(), child = cdr.text();
  item.names.assign(child).push_back('\0');
  item.names.append(parent).push_back('\0');
  read_item_pose(cdr, item);
}

}  // namespace

std::int64_t read_stamp(CdrReader& cdr) {
  const std::int64_t s = cdr.number<std::int32_t>();
  return s * kNsPerS + cdr.number<std::uint32_t>();
}

std::string plain_type(std::string name) {
  for (auto at = name.find("::"); at != name.npos; at = name.find("::")) name.replace(at, 2, "/");
  if (const auto at = name.find("/msg/"); at != name.npos) name.erase(at, 4);
  return name;
}

const char* type_name(McapType type) {
  constexpr const char* kNames[] = {"sensor_msgs/JointState", "geometry_msgs/PoseStamped",
                                    "nav_msgs/Odometry", "tf2_msgs/TFMessage"};
  return kNames[static_cast<std::size_t>(type)];
}

void read_items(McapType type, std::string_view bytes, std::vector<McapItem>& items) {
  constexpr std::size_t kLeastBytes = 8 + 2 * sizeof(std::uint32_t) + kPoseNumbers * sizeof(double);
  CdrReader cdr(bytes);
  items.resize(type == McapType::kTransforms ? cdr.count(kLeastBytes) : 1);
  for (McapItem& item : items) {
    if (type == McapType::kJointState) {
      read_joints(cdr, item);
    } else if (type == McapType::kTransforms) {
      read_transform(cdr, item);
    } else {
      item.stamp_ns = read_stamp(cdr);
      item.names = cdr.text();
      if (type == McapType::kOdometry) cdr.text();  // child_frame_id
      read_item_pose(cdr, item);
    }
  }
}

std::vector<std::string> split_names(std::string_view names) {
  std::vector<std::string> all;
  for (std::size_t end = 0; (end = names.find('\0')) != names.npos; names.remove_prefix(end + 1))
    all.emplace_back(names.substr(0, end));
  return all;
}

std::string stamp_text(std::int64_t ns) {
  const std::int64_t size = ns < 0 ? -ns : ns;
  return fmt::format("{}{}.{:09}", ns < 0 ? "-" : "", size / kNsPerS, size % kNsPerS);
}

double stamp_s(std::int64_t ns) { return *parse_number(stamp_text(ns)); }

}  // namespace soilvdb::inline v0::io
