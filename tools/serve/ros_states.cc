// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/ros_states.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "io/file/text.h"
#include "io/motion/motion_angles.h"
#include "soilvdb/io/error.h"

namespace soilvdb::tools {
namespace {

constexpr std::int64_t kMostWait_ns = io::kMostEnd_ns;
constexpr std::int64_t kMostLate_ns = 1'000'000'000;  // more means that a clock was set back
constexpr std::size_t kTrackSamples = 1000;
constexpr std::size_t kMostFrames = 1000, kMostFixedFrames = 10'000;  // which come only once
constexpr double kUnit = 0.01;  // tolerance of a quaternion's norm, as of a row's

/// A value isn't known at a stamp: not yet, or never.
struct NotKnown : std::runtime_error {
  NotKnown(const std::string& why, bool may_come_) : runtime_error(why), may_come(may_come_) {}
  bool may_come;
};

Pose unit_pose(const double* values) {
  Pose pose = pose_of(values);
  pose.rotation.normalize();
  return pose;
}

bool is_pose(const io::McapItem& item) {
  return std::all_of(item.values.begin(), item.values.end(),
                     [](double v) { return std::isfinite(v); }) &&
         std::abs(pose_of(item.values.data()).rotation.norm() - 1) <= kUnit;
}

bool names_topic(const io::McapTopic& topic, const std::string& name) {
  return topic.topic == name || std::find(topic.more_topics.begin(), topic.more_topics.end(),
                                          name) != topic.more_topics.end();
}

}  // namespace

/// @return false if it says nothing new
bool RosStates::Track::put(std::int64_t time_ns, const Values& values) {
  if (!samples.empty() && time_ns < samples.back().time_ns - kMostLate_ns) samples.clear();
  auto after = samples.end();
  while (after != samples.begin() && std::prev(after)->time_ns >= time_ns) --after;
  if (after != samples.end() && after->time_ns == time_ns) return false;
  samples.insert(after, {time_ns, values});
  if (samples.size() > kTrackSamples) samples.pop_front();
  return true;
}

RosStates::RosStates(std::vector<RosMachine> machines) {
  for (RosMachine& machine : machines) {
    const io::McapTopic& topic = machine.topic;
    if (machine.chain && topic.frame.empty()) {
      listen(topic.topic, {io::McapType::kJointState});
      for (const std::string& more : topic.more_topics) listen(more, {io::McapType::kJointState});
      if (topic.base) listen_to_poses(machine, *topic.base, "base: ");
    } else if (machine.chain) {
      throw io::InputError(fmt::format(
          "machine '{}': motion: 'frame' is that of a bucket, and the machine has a urdf; name a "
          "topic of sensor_msgs/JointState without 'frame', or remove the urdf",
          machine.name));
    } else if (!topic.more_topics.empty()) {
      throw io::InputError(fmt::format(
          "machine '{}': motion: several topics are for joints only, so name one", machine.name));
    } else {
      listen_to_poses(machine, topic, "");
    }
    Machine& made = machines_.emplace_back(Machine{std::move(machine)});
    if (!made.of.chain) continue;
    for (const Joint& joint : made.of.chain->joints)
      if (joint.moves_itself()) {
        made.names.push_back(joint.name);
        made.goes_round.push_back(io::may_wrap(joint));
      }
    made.joints.resize(made.names.size());
  }
}

void RosStates::listen(const std::string& topic, std::vector<io::McapType> types, bool fixed) {
  for (const Input& input : inputs_) {
    if (input.topic != topic) continue;
    if (input.types != types)
      throw io::InputError(fmt::format("topic '{}' can't be both {} and {}", io::printable(topic),
                                       type_name(input.types.front()), type_name(types.front())));
    return;
  }
  inputs_.push_back({topic, std::move(types), fixed});
}

void RosStates::listen_to_poses(const RosMachine& machine, const io::McapTopic& topic,
                                const char* whose) {
  if (topic.frame.empty())
    return listen(topic.topic, {io::McapType::kOdometry, io::McapType::kPoseStamped});
  if (topic.parent.empty())
    throw io::InputError(fmt::format(
        "machine '{}': motion: {}name the world's frame as 'parent: map' beside 'frame'; while "
        "transforms come in, the root of their tree isn't known",
        machine.name, whose));
  listen(topic.topic, {io::McapType::kTransforms});
  listen(topic.topic + "_static", {io::McapType::kTransforms}, true);
}

std::vector<std::size_t> RosStates::take(std::size_t input, io::McapType type, std::string_view cdr,
                                         std::int64_t now_ns, std::int64_t host_ns) {
  heard_.clear();
  const Input& of = inputs_[input];
  read_items(type, cdr, items_);
  for (const io::McapItem& item : items_) {
    const Row row{item.stamp_ns == 0 ? host_ns : item.stamp_ns, now_ns};
    if (type == io::McapType::kJointState) {
      take_joints(of.topic, item, row);
    } else if (type == io::McapType::kTransforms) {
      const std::size_t size = of.topic.size() - (of.fixed ? std::size("_static") - 1 : 0);
      take_transform(of.topic.substr(0, size), of.fixed, item, row);
    } else {
      take_pose(of.topic, item, row);
    }
  }
  return heard_;
}

void RosStates::add_fault(const Machine& machine, std::string why) {
  faults_.push_back({machine.of.machine, std::move(why)});
}

void RosStates::add_row(Machine& machine, const Row& row) {
  if (std::find(heard_.begin(), heard_.end(), machine.of.machine) == heard_.end())
    heard_.push_back(machine.of.machine);
  if (machine.done_ns && row.time_ns <= *machine.done_ns) {
    if (row.time_ns >= *machine.done_ns - kMostLate_ns) return;  // its way was dug
    machine.rows.clear();  // another clock, which the site judges
    machine.done_ns.reset();
  }
  auto after = machine.rows.end();
  while (after != machine.rows.begin() && std::prev(after)->time_ns >= row.time_ns) --after;
  if (after == machine.rows.end() || after->time_ns != row.time_ns) machine.rows.insert(after, row);
  if (machine.rows.size() > kTrackSamples) machine.rows.pop_front();
}

void RosStates::take_joints(const std::string& topic, const io::McapItem& item, const Row& row) {
  const std::vector<std::string> names = io::split_names(item.names);
  for (Machine& machine : machines_) {
    if (!machine.of.chain || !names_topic(machine.of.topic, topic)) continue;
    bool any = machine.names.empty();
    for (std::size_t i = 0; i < machine.names.size(); ++i) {
      const auto at = std::find(names.begin(), names.end(), machine.names[i]);
      if (at == names.end()) continue;
      const double value = item.values[static_cast<std::size_t>(at - names.begin())];
      any = true;
      if (std::isfinite(value))
        machine.joints[i].put(row.time_ns, {value});
      else
        add_fault(machine, fmt::format("joint '{}' is {}", io::printable(machine.names[i]), value));
    }
    if (!any) continue;
    add_row(machine, row);
  }
}

bool RosStates::is_in_chain(const io::McapTopic& topic, std::string_view frame) const {
  const auto frames = frames_.find(topic.topic);
  if (frames == frames_.end()) return false;
  std::string_view child = topic.frame;
  for (std::size_t i = 0; i < kMostFrames && child != topic.parent; ++i) {
    if (child == frame) return true;
    const auto found = frames->second.named.find(child);
    if (found == frames->second.named.end()) return false;
    child = found->second.parent;
  }
  return false;
}

bool RosStates::is_needed(const std::string& topic, std::string_view frame) const {
  return std::any_of(machines_.begin(), machines_.end(), [&](const Machine& machine) {
    const io::McapTopic* of = machine.poses();
    return of != nullptr && of->topic == topic && is_in_chain(*of, frame);
  });
}

/// Of a tree of many robots, frames that move no machine make room. They come again.
bool RosStates::make_room(const std::string& topic, bool fixed) {
  Frames& frames = frames_[topic];
  auto& named = frames.named;
  const std::size_t count = fixed ? frames.fixed : named.size() - frames.fixed;
  if (count < (fixed ? kMostFixedFrames : kMostFrames)) return true;
  const auto found = std::find_if(named.begin(), named.end(), [&](const auto& one) {
    return one.second.fixed == fixed && !is_needed(topic, one.first);
  });
  if (found == named.end()) return false;
  named.erase(found);
  frames.fixed -= fixed;
  return true;
}

void RosStates::take_transform(const std::string& topic, bool fixed, const io::McapItem& item,
                               const Row& row) {
  const std::vector<std::string> names = io::split_names(item.names);
  Frames& frames = frames_[topic];
  std::string fault;
  if (!is_pose(item)) {
    fault = fmt::format(
        "the transform of frame '{}' has numbers that aren't finite, or a "
        "quaternion of another norm than 1",
        io::printable(names[0]));
  } else {
    if (!frames.named.contains(names[0]) && !make_room(topic, fixed)) return;
    Frame& frame = frames.named[names[0]];
    const auto& before = frame.track.samples;
    if (frame.parent != names[1] && !before.empty()) {  // the latest holds, as tf2 has it
      const std::int64_t late_ns = before.back().time_ns - row.time_ns;
      if (late_ns > 0 && late_ns <= kMostLate_ns) return;
      frame.track.samples.clear();
    }
    frame.parent = names[1];
    if (fixed) frame.track.samples.clear();
    frames.fixed = frames.fixed + fixed - frame.fixed;
    frame.fixed = fixed;
    Values values{};
    std::copy_n(item.values.begin(), kPoseNumbers, values.begin());
    frame.track.put(row.time_ns, values);
  }
  for (Machine& machine : machines_) {
    const io::McapTopic* of = machine.poses();
    if (of == nullptr || of->topic != topic || !is_in_chain(*of, names[0])) continue;
    if (!fault.empty()) {
      add_fault(machine, fault);
      continue;
    }
    if (machine.of.chain || fixed) continue;
    // The frame nearest to the bucket that isn't fixed makes rows.
    const auto& tree = frames.named;
    std::string_view child = of->frame;
    for (auto link = tree.find(child); link != tree.end() && link->second.fixed;
         link = tree.find(child))
      child = link->second.parent;
    if (child == names[0]) add_row(machine, row);
  }
}

void RosStates::take_pose(const std::string& topic, const io::McapItem& item, const Row& row) {
  Poses& poses = poses_[topic];
  std::string fault;
  if (!is_pose(item))
    fault = fmt::format(
        "topic '{}' has a pose with numbers that aren't finite, or with a "
        "quaternion of another norm than 1",
        io::printable(topic));
  else if (!poses.track.samples.empty() && poses.frame != item.names)
    fault =
        fmt::format("topic '{}' has a pose in frame '{}', and those before it are in '{}'",
                    io::printable(topic), io::printable(item.names), io::printable(poses.frame));
  if (fault.empty()) {
    poses.frame = item.names;
    Values values{};
    std::copy_n(item.values.begin(), kPoseNumbers, values.begin());
    poses.track.put(row.time_ns, values);
  }
  for (Machine& machine : machines_) {
    const io::McapTopic* of = machine.poses();
    if (of == nullptr || of->topic != topic) continue;
    if (!fault.empty())
      add_fault(machine, fault);
    else if (!machine.of.chain)
      add_row(machine, row);
  }
}

std::vector<const RosStates::Frame*> RosStates::links_of(const io::McapTopic& topic) const {
  std::vector<const Frame*> links;
  static const Frames kNone;
  const auto tree = frames_.find(topic.topic);
  const auto& frames = (tree != frames_.end() ? tree->second : kNone).named;
  std::string_view child = topic.frame;
  std::string way = "'" + io::printable(topic.frame) + "'";
  while (child != topic.parent) {
    const auto found = frames.find(child);
    if (found == frames.end() || links.size() > kMostFrames)
      throw NotKnown(fmt::format("frame '{}' isn't below '{}' so far; its chain is {}",
                                 io::printable(topic.frame), io::printable(topic.parent), way),
                     true);
    links.push_back(&found->second);
    child = found->second.parent;
    if (links.size() < 10) way += " on '" + io::printable(std::string(child)) + "'";
  }
  return links;
}

/// @throw NotKnown
RosStates::Values RosStates::at(const Track& track, const Row& row, std::int64_t now_ns,
                                const std::string& what, bool angle, bool pose) const {
  const auto& samples = track.samples;
  const std::int64_t at_ns = row.time_ns;
  const auto fail = [&](const char* why, std::int64_t other_ns, bool may_come) {
    throw NotKnown(fmt::format("{} isn't known at {} s: {} {} s", what, io::stamp_text(at_ns), why,
                               io::stamp_text(other_ns)),
                   may_come);
  };
  if (samples.empty()) throw NotKnown(fmt::format("{} isn't known yet", what), true);
  const auto next = std::lower_bound(
      samples.begin(), samples.end(), at_ns,
      [](const Track::Sample& sample, std::int64_t ns) { return sample.time_ns < ns; });
  if (next == samples.end()) {
    const std::int64_t last_ns = samples.back().time_ns;
    const bool waited = now_ns - row.came_ns > kMostWait_ns;
    if (!waited || at_ns - last_ns > io::kMostEnd_ns) fail("its last value is of", last_ns, true);
    return samples.back().values;
  }
  if (next->time_ns == at_ns) return next->values;
  if (next == samples.begin()) {
    if (next->time_ns - at_ns > io::kMostEnd_ns)
      fail("its first value is of", next->time_ns, false);
    return next->values;
  }
  const Track::Sample& before = *std::prev(next);
  const std::int64_t gap_ns = next->time_ns - before.time_ns;
  if (gap_ns > io::kMostGap_ns)
    fail("at most one second is bridged, and its value before that is of", before.time_ns, false);
  const double s = static_cast<double>(at_ns - before.time_ns) / static_cast<double>(gap_ns);
  if (pose)
    return row_of(interpolate(unit_pose(before.values.data()), unit_pose(next->values.data()), s));
  double way = next->values[0] - before.values[0];
  if (angle && std::abs(way) > io::kTurn / 2) way = std::remainder(way, io::kTurn);
  return {before.values[0] + s * way};
}

Pose RosStates::pose_at(const io::McapTopic& topic, const Row& row, std::int64_t now_ns) const {
  if (topic.frame.empty()) {
    const auto found = poses_.find(topic.topic);
    if (found == poses_.end())
      throw NotKnown(fmt::format("topic '{}' has no pose yet", io::printable(topic.topic)), true);
    return pose_of(at(found->second.track, row, now_ns,
                      fmt::format("the pose of topic '{}'", io::printable(topic.topic)), false,
                      true)
                       .data());
  }
  const std::vector<const Frame*> links = links_of(topic);
  Pose pose;
  for (std::size_t i = 0; i < links.size(); ++i) {
    const std::string what = fmt::format("a frame on '{}'", io::printable(links[i]->parent));
    const Values values = links[i]->fixed ? links[i]->track.samples.back().values
                                          : at(links[i]->track, row, now_ns, what, false, true);
    Pose up = pose_of(values.data());
    if (links.size() > 1) up.rotation.normalize();
    pose = i == 0 ? up : up * pose;
  }
  return pose;
}

RosStates::State RosStates::state_at(const Machine& machine, const Row& row,
                                     std::int64_t now_ns) const {
  State state{machine.of.machine, row.time_ns, {}, {}};
  for (std::size_t i = 0; i < machine.joints.size(); ++i)
    state.joints.push_back(at(machine.joints[i], row, now_ns,
                              fmt::format("joint '{}'", io::printable(machine.names[i])),
                              machine.goes_round[i], false)[0]);
  if (const io::McapTopic* of = machine.poses()) state.pose = pose_at(*of, row, now_ns);
  return state;
}

std::vector<RosStates::State> RosStates::states(std::int64_t now_ns) {
  std::vector<State> states;
  for (Machine& machine : machines_) {
    for (; !machine.rows.empty(); machine.rows.pop_front()) {
      const Row& row = machine.rows.front();
      try {
        states.push_back(state_at(machine, row, now_ns));
      } catch (const NotKnown& e) {
        if (e.may_come && now_ns - row.came_ns <= kMostWait_ns) break;
        add_fault(machine, e.what());
      }
      machine.done_ns = row.time_ns;
    }
  }
  return states;
}

std::vector<RosStates::Fault> RosStates::take_faults() { return std::exchange(faults_, {}); }

}  // namespace soilvdb::tools
