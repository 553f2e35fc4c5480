// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/scan/sensor_poses.h"

#include <fmt/format.h>

#include <cmath>
#include <utility>

#include "io/file/text.h"
#include "io/motion/mcap_rows.h"
#include "soilvdb/io/motion_rows.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::size_t kMostMovingFrames = 64;  // of one topic; each has a reader
constexpr std::size_t kMostFramesTold = 8;
constexpr double kUnitNormTolerance = 0.01;  // as for a row's quaternion

/// Is it the root of a tree of frames?
bool is_root(const McapFacts& facts, const std::string& name) {
  bool has_child = false;
  for (const McapStream& stream : facts.streams) {
    const std::vector<std::string> names = split_names(stream.names);
    if (names.empty()) continue;
    if (names.front() == name) return false;
    has_child = has_child || names.back() == name;
  }
  return has_child;
}

bool is_rigid(const Pose& pose) {
  return pose.position.allFinite() && std::abs(pose.rotation.norm() - 1) <= kUnitNormTolerance;
}

}  // namespace

SensorPoses::SensorPoses(const ScanSource& source, const std::string& topic)
    : transforms_(source.files.front(), {topic, {}, source.world}),
      world_given_(!source.world.empty()) {
  transforms_.more_files.assign(source.files.begin() + 1, source.files.end());
}

/// Reads the files, once, to learn of their frames.
void SensorPoses::find_frames() {
  if (transforms_.mcap.facts) return;
  transforms_.mcap.facts = look_at(transforms_);
  if (transforms_.mcap.facts->type != McapType::kTransforms)
    throw InputError(
        transforms_.file,
        fmt::format("{} is of {}; it must be of {}", topics_text(transforms_.mcap),
                    type_name(transforms_.mcap.facts->type), type_name(McapType::kTransforms)));
}

SensorPoses::Frame SensorPoses::open(const std::string& name) {
  Frame frame;
  if (world_given_ && name == transforms_.mcap.parent) {
    frame.fixed = Pose{};
    return frame;
  }
  if (transforms_.mcap.topic.empty()) return frame;
  find_frames();
  const auto& facts = transforms_.mcap.facts;
  if (!world_given_ && is_root(*facts, name)) {
    frame.fixed = Pose{};
    return frame;
  }
  MotionSource source = transforms_;
  source.mcap.frame = name;
  try {
    frame.fixed = fixed_pose(source, *facts);
    if (frame.fixed && !is_rigid(*frame.fixed))
      throw InputError(source.file, fmt::format("frame '{}' has a transform above it that isn't "
                                                "rigid",
                                                printable(name)));
    if (!frame.fixed) frame.rows = mcap_tf_rows(source, facts);
  } catch (const InputError& e) {
    if (world_given_) throw;
    frame.fixed.reset();
    frame.fault = e.what();
    ++frame.faults;
    return frame;
  }
  return frame;
}

/// Moves to the next row with a pose. Gaps that are too long to interpolate are bad rows.
void SensorPoses::step(Frame& frame) {
  std::vector<double> v(frame.rows->columns().names.size());
  frame.before = std::exchange(frame.next, std::nullopt);
  frame.after_gap = false;
  while (true) {
    try {
      if (frame.rows->next() == RowSource::Got::kEnd) return;
      frame.rows->values(v);
      Sample sample{frame.rows->mark().bytes, pose_of(v.data() + 1)};
      if (!is_rigid(sample.pose))
        frame.rows->place().fail("the transform has a quaternion of another norm than 1");
      sample.pose.rotation.normalize();
      frame.next = sample;
      return;
    } catch (const LineError& e) {
      if (frame.faults++ == 0) frame.fault = e.what();
      frame.after_gap = true;
    }
  }
}

std::optional<Pose> SensorPoses::at(const std::string& name, std::int64_t time_ns) {
  auto found = frames_.find(name);
  if (found == frames_.end()) {
    found = frames_.emplace(name, open(name)).first;
    if (found->second.rows) {
      if (++moving_ > kMostMovingFrames)
        throw InputError(transforms_.file, fmt::format("has scans in more than {} moving frames; "
                                                       "the poses of so many aren't read",
                                                       kMostMovingFrames));
      step(found->second);
    }
  }
  Frame& frame = found->second;
  if (!frame.rows) return frame.fixed;
  while (frame.next && frame.next->time_ns < time_ns) step(frame);
  if (!frame.next) return {};
  if (frame.next->time_ns == time_ns) return frame.next->pose;
  if (!frame.before || frame.after_gap) return {};
  const std::int64_t gap_ns = frame.next->time_ns - frame.before->time_ns;
  return interpolate(
      frame.before->pose, frame.next->pose,
      static_cast<double>(time_ns - frame.before->time_ns) / static_cast<double>(gap_ns));
}

void SensorPoses::warn(std::vector<std::string>& warnings) const {
  std::size_t told = 0;
  for (const auto& [name, frame] : frames_) {
    if (frame.faults == 0 || ++told > kMostFramesTold) continue;
    warnings.push_back(fmt::format(
        "{}{}; poses of frame '{}' {}", frame.fault,
        frame.faults == 1 ? std::string() : fmt::format(" and {} more", frame.faults - 1),
        printable(name), frame.rows ? "are unknown there" : "are unknown"));
  }
  if (told > kMostFramesTold)
    warnings.push_back(fmt::format("{}: poses of {} more frames are unknown",
                                   transforms_.file.string(), told - kMostFramesTold));
}

}  // namespace soilvdb::inline v0::io
