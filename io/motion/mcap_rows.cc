// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/motion/mcap_rows.h"

#include <fmt/format.h>

#include <algorithm>
#include <functional>

#include "io/file/text.h"
#include "io/motion/motion_checks.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::size_t kMostShown = 12;  // topics

/// "sensor_msgs/JointState" of "sensor_msgs/msg/JointState" or "sensor_msgs::msg::JointState".
std::string plain_type(std::string name) {
  for (auto at = name.find("::"); at != name.npos; at = name.find("::")) name.replace(at, 2, "/");
  if (const auto at = name.find("/msg/"); at != name.npos) name.erase(at, 4);
  return name;
}

const std::vector<std::string> kPoseNames = {"time", "x", "y", "z", "qx", "qy", "qz", "qw"};

class JointRows : public McapRows {
 public:
  JointRows(const MotionSource& source, const Chain& chain) : McapRows(source) {
    columns_.names = {"time"};
    const std::vector<std::string> movable = chain.movable();
    columns_.names.insert(columns_.names.end(), movable.begin(), movable.end());
  }

  Got next() override {
    while (next_of_topic(data_)) {
      decoded([&] { read_message(data_, message_); });
      stamp_ = message_.stamp;
      const auto first = columns_.names.begin() + 1;
      for (const std::string_view name : message_.names)
        if (std::find(first, columns_.names.end(), name) != columns_.names.end()) return Got::kRow;
      if (columns_.names.size() == 1) return Got::kRow;  // nothing moves
      for (const std::string_view name : message_.names)
        if (others_.size() < kMostShown) others_.insert(printable(name));
    }
    if (!any_)
      throw InputError(source_.file,
                       fmt::format("no message of topic '{}' has a joint of the machine: {}; they "
                                   "have {}",
                                   printable(source_.mcap.topic), quoted_list(movable()),
                                   others_.empty() ? "no joints" : quoted_list(others())));
    return Got::kEnd;
  }
  void values(std::vector<double>& v) override {
    any_ = true;
    std::vector<std::string> missing;
    v[0] = stamp_.seconds();
    for (std::size_t i = 1; i < v.size(); ++i) {
      const std::string& name = columns_.names[i];
      const auto at = std::find(message_.names.begin(), message_.names.end(), name);
      const auto k = static_cast<std::size_t>(at - message_.names.begin());
      if (at == message_.names.end() || k >= message_.positions.size())
        missing.push_back(name);
      else
        v[i] = message_.positions[k];
    }
    if (!missing.empty())
      place_.fail(fmt::format(
          "has no position of joint{} {}; a message with one of the machine's "
          "joints must have all: {}",
          missing.size() == 1 ? "" : "s", quoted_list(missing), quoted_list(movable())));
    for (std::size_t i = 0; i < v.size(); ++i) check_number(place_, columns_.names[i], v[i]);
  }
  void go_to(const RowMark& mark) override {
    any_ = true;
    McapRows::go_to(mark);
  }
  std::size_t hash() const override { return std::hash<std::string_view>()(data_); }

 private:
  const char* type_name() const override { return "sensor_msgs/JointState"; }
  std::vector<std::string> movable() const {
    return {columns_.names.begin() + 1, columns_.names.end()};
  }
  std::vector<std::string> others() const { return {others_.begin(), others_.end()}; }

  std::string_view data_;
  JointStateMessage message_;
  bool any_ = false;  // a message had one of the machine's joints
  std::set<std::string> others_;
};

class PoseRows : public McapRows {
 public:
  explicit PoseRows(const MotionSource& source) : McapRows(source) {
    columns_.names = kPoseNames;
    columns_.quaternion = true;
  }

  Got next() override {
    if (!next_of_topic(data_)) return Got::kEnd;
    decoded([&] { read_message(data_, message_); });
    stamp_ = message_.stamp;
    return Got::kRow;
  }
  void values(std::vector<double>& v) override {
    v[0] = stamp_.seconds();
    std::copy(std::begin(message_.values), std::end(message_.values), v.begin() + 1);
    for (std::size_t i = 0; i < v.size(); ++i) check_number(place_, columns_.names[i], v[i]);
  }
  std::size_t hash() const override { return std::hash<std::string_view>()(data_); }

 private:
  const char* type_name() const override { return "geometry_msgs/PoseStamped"; }

  std::string_view data_;
  PoseMessage message_;
};

}  // namespace

McapType type_of(const std::filesystem::path& file, const McapChannel& channel) {
  const std::string topic = printable(channel.topic), type = plain_type(channel.schema);
  if (channel.encoding != "cdr")
    throw InputError(file, fmt::format("topic '{}' is encoded as '{}'; it must be cdr, as ROS 2 "
                                       "records it",
                                       topic, printable(channel.encoding)));
  if (type == "sensor_msgs/JointState") return McapType::kJointState;
  if (type == "geometry_msgs/PoseStamped") return McapType::kPoseStamped;
  if (type == "tf2_msgs/TFMessage") return McapType::kTransforms;
  throw InputError(file, fmt::format("topic '{}' is of {}; it must be of sensor_msgs/JointState, "
                                     "geometry_msgs/PoseStamped or tf2_msgs/TFMessage",
                                     topic, type.empty() ? "no type" : printable(type)));
}

McapRows::McapRows(const MotionSource& source)
    : source_(source),
      reader_(source.file, source.mcap.facts ? source.mcap.facts->channels : McapChannels()),
      place_(source.file),
      facts_(source.mcap.facts) {}

bool McapRows::next_of_topic(std::string_view& data) {
  McapReader::Message message;
  const auto wanted = [&](const McapChannel& channel) {
    return channel.topic == source_.mcap.topic;
  };
  if (!next_message(wanted, message)) return false;
  data = message.data;
  place_.set_number(place_.number() + 1);
  return true;
}

void McapRows::warn(std::vector<std::string>& warnings) const {
  if (const auto& at = reader_.torn_at())
    warnings.push_back(
        fmt::format("{}: has no end, as when a recorder is killed; what is whole up "
                    "to byte {} is used",
                    source_.file.string(), *at));
}

MotionSource McapRows::source() const {
  MotionSource known = source_;
  McapFacts facts = facts_ ? *facts_ : McapFacts();
  facts.channels = reader_.channels();
  known.mcap.facts = std::make_shared<const McapFacts>(std::move(facts));
  return known;
}

RowMark McapRows::mark() const {
  const McapReader::Mark mark = reader_.mark();
  return {mark.record, place_.number(), mark.within};
}

void McapRows::go_to(const RowMark& mark) {
  reader_.go_to({mark.bytes, mark.within});
  place_.set_number(mark.lines);
}

std::unique_ptr<RowSource> mcap_rows(const MotionSource& source,
                                     const std::optional<Chain>& chain) {
  const McapTopic& wanted = source.mcap;
  McapReader reader(source.file, wanted.facts ? wanted.facts->channels : McapChannels());
  McapReader::Message message;
  const auto is_it = [&](const auto& channel) { return channel.second.topic == wanted.topic; };
  const auto find = [&] {
    const auto& all = reader.channels();
    return std::find_if(all.begin(), all.end(), is_it);
  };
  bool any = find() != reader.channels().end();
  while (!any && reader.next(message)) any = message.channel->topic == wanted.topic;
  if (!any) {
    std::set<std::string> topics;
    for (const auto& [id, channel] : reader.channels()) topics.insert(printable(channel.topic));
    std::vector<std::string> shown(topics.begin(), topics.end());
    if (shown.size() > kMostShown) shown.resize(kMostShown);
    throw InputError(
        source.file,
        fmt::format("has no message of topic '{}'; {}", printable(wanted.topic),
                    shown.empty() ? "it has no topics" : "its topics are " + quoted_list(shown)));
  }
  const McapType type = type_of(source.file, find()->second);
  const std::string topic = printable(wanted.topic);
  if (type == McapType::kJointState && !chain)
    throw InputError(source.file,
                     fmt::format("topic '{}' has joints; the machine needs a urdf for them, or "
                                 "another topic, by poses or transforms",
                                 topic));
  if (type != McapType::kJointState && chain)
    throw InputError(source.file,
                     fmt::format("topic '{}' has poses, and the machine a urdf; name a topic of "
                                 "sensor_msgs/JointState, or remove the machine's urdf",
                                 topic));
  if (type == McapType::kTransforms) {
    if (wanted.frame.empty())
      throw InputError(source.file,
                       fmt::format("topic '{}' has transforms; say which is the bucket's frame, as "
                                   "'frame: NAME' beside 'topic:'",
                                   topic));
    return mcap_tf_rows(source);
  }
  if (!wanted.frame.empty())
    throw InputError(source.file, fmt::format("topic '{}' has no transforms, which 'frame' is for; "
                                              "remove that",
                                              topic));
  if (type == McapType::kJointState) return std::make_unique<JointRows>(source, *chain);
  return std::make_unique<PoseRows>(source);
}

}  // namespace soilvdb::inline v0::io
