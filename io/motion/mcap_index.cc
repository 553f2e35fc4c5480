// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/motion/mcap_index.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <unordered_map>

#include "io/file/text.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::size_t kMostTopicsShown = 12;  // topics
constexpr std::size_t kMostStreams = 100'000;
constexpr std::size_t kMostStamps = 4096;  // of a stream, for the median interval
constexpr long kBlockMessages = 256;       // block size in files without chunks
constexpr std::int64_t kLongest_ns = 100'000'000'000'000'000;  // three years: 64 bits hold a few

/// @throw InputError if the topic's type or encoding is not that of a motion
McapType type_of(const std::filesystem::path& file, const McapChannel& channel) {
  const std::string topic = printable(channel.topic), type = plain_type(channel.schema);
  if (channel.encoding != "cdr")
    throw InputError(file, fmt::format("topic '{}' is encoded as '{}'; it must be cdr, as ROS 2 "
                                       "records it",
                                       topic, printable(channel.encoding)));
  for (const McapType known :
       {McapType::kJointState, McapType::kPoseStamped, McapType::kOdometry, McapType::kTransforms})
    if (type == type_name(known)) return known;
  throw InputError(file, fmt::format("topic '{}' is of {}; it must be of sensor_msgs/JointState, "
                                     "geometry_msgs/PoseStamped, nav_msgs/Odometry or "
                                     "tf2_msgs/TFMessage",
                                     topic, type.empty() ? "no type" : printable(type)));
}

class Look {
 public:
  explicit Look(const MotionSource& source) : source_(source) {
    facts_->streams.emplace_back();
    more_.emplace_back();
  }

  std::shared_ptr<const McapFacts> facts() {
    for (const auto& path : source_.files()) look_at_file(path);
    if (!type_) refuse();
    facts_->type = *type_;
    for (std::size_t i = 1; i < more_.size(); ++i) finish(facts_->streams[i], more_[i]);
    return std::move(facts_);
  }

 private:
  /// Data that is needed only while reading.
  struct More {
    std::vector<std::pair<std::int64_t, std::int64_t>> some;  // stamps and log times
    McapTimes unstamped_log;
    std::int64_t last_log_ns = 0;
  };

  void look_at_file(const std::filesystem::path& path) {
    McapReader reader(path);
    McapReader::Message message;
    file_ = static_cast<std::uint32_t>(facts_->files.size());
    number_ = 0;
    time_ns_.reset();
    in_block_ = false;
    while (reader.next(message)) {
      const std::string& topic = message.channel->topic;
      if (is_topic(source_.mcap, topic)) {
        const McapType type = type_of(path, *message.channel);
        if (type_ && *type_ != type)
          throw InputError(
              path, fmt::format("{} has messages of {} and of {}; they must be of one "
                                "type",
                                topics_text(source_.mcap), type_name(*type_), type_name(type)));
        type_ = type;
        take(message);
      } else if (topic == source_.mcap.topic + "_static") {
        take_fixed(message);
      }
    }
    facts_->files.push_back({path, static_cast<std::int64_t>(std::filesystem::file_size(path)),
                             reader.channels(), reader.torn_at()});
  }

  void take(const McapReader::Message& message) {
    std::vector<McapBlock>& blocks = facts_->blocks;
    const bool same = in_block_ && (message.in_chunk ? blocks.back().record == message.record
                                                     : blocks.back().messages < kBlockMessages &&
                                                           !last_in_chunk_);
    if (!time_ns_) time_ns_ = message.log_ns;
    if (!same) blocks.push_back({file_, message.record, number_, 0, *time_ns_, {}});
    in_block_ = true;
    last_in_chunk_ = message.in_chunk;
    ++number_;
    ++blocks.back().messages;
    try {
      read_items(*type_, message.data, items_);
    } catch (const CdrError&) {
      add(0, *time_ns_, message.log_ns);
      return;
    }
    for (const McapItem& item : items_) {
      const std::uint32_t id = stream(message.channel->topic, item, message.log_ns, false);
      if (item.stamp_ns == 0) add(id, message.log_ns, message.log_ns);  // time_of() may take either
      add(id, item.stamp_ns, message.log_ns);
      time_ns_ = item.stamp_ns == 0 ? message.log_ns : item.stamp_ns;
    }
  }

  void take_fixed(const McapReader::Message& message) {
    try {
      read_items(McapType::kTransforms, message.data, items_);
    } catch (const CdrError&) {
      return;  // a missing frame is reported later
    }
    for (const McapItem& item : items_) stream(message.channel->topic, item, message.log_ns, true);
  }

  /// Adds a time of a stream to the current block.
  void add(std::uint32_t id, std::int64_t time_ns, std::int64_t log_ns) {
    auto& streams = facts_->blocks.back().streams;
    auto at = std::find_if(streams.begin(), streams.end(),
                           [&](const McapBlock::Stream& s) { return s.stream == id; });
    if (at == streams.end()) at = streams.insert(at, {id, {}, 0});
    at->times.add(time_ns);
    at->last_log_ns = std::max(at->last_log_ns, log_ns);
  }

  /// Counts an item in its stream. @return the stream's number
  std::uint32_t stream(const std::string& topic, const McapItem& item, std::int64_t log_ns,
                       bool fixed) {
    key_.assign(topic).push_back('\0');
    key_ += item.names;
    const auto [at, is_new] = ids_.try_emplace(key_, static_cast<std::uint32_t>(more_.size()));
    if (is_new) {
      if (more_.size() > kMostStreams)
        throw InputError(source_.file,
                         fmt::format("has more than {} frames or sets of joints in {}",
                                     kMostStreams, topics_text(source_.mcap)));
      McapStream& fresh = facts_->streams.emplace_back();
      fresh.topic = topic;
      fresh.names = item.names;
      fresh.fixed = fixed;
      fresh.stamped_since_ns = kLatest_ns;
      more_.emplace_back();
    }
    McapStream& stream = facts_->streams[at->second];
    More& more = more_[at->second];
    if (stream.count++ > 0 && item.values != stream.values) stream.moves = true;
    if (log_ns >= more.last_log_ns) stream.values = item.values;
    more.last_log_ns = std::max(more.last_log_ns, log_ns);
    stream.ahead = stream.ahead && item.stamp_ns > log_ns;
    if (item.stamp_ns == 0) {
      more.unstamped_log.add(log_ns);
      ++stream.unstamped;
    } else {
      stream.times.add(item.stamp_ns);
      stream.stamped_since_ns = std::min(stream.stamped_since_ns, log_ns);
    }
    if (more.some.size() < kMostStamps) more.some.emplace_back(item.stamp_ns, log_ns);
    return at->second;
  }

  static void finish(McapStream& stream, More& more) {
    if (stream.stamped_since_ns == kLatest_ns) stream.stamped_since_ns = -kLatest_ns / 2;  // none
    if (stream.unstamped > 0) {
      stream.times.add(stream.time_of(0, more.unstamped_log.first_ns));
      stream.times.add(stream.time_of(0, more.unstamped_log.last_ns));
      if (stream.time_of(0, more.unstamped_log.last_ns) == 0) stream.unstamped = 0;
    }
    std::vector<std::int64_t> times;
    for (const auto& [stamp_ns, log_ns] : more.some)
      times.push_back(stream.time_of(stamp_ns, log_ns));
    std::sort(times.begin(), times.end());
    times.erase(std::unique(times.begin(), times.end()), times.end());
    if (times.size() < 2) return;
    for (std::size_t i = times.size() - 1; i > 0; --i) times[i] -= times[i - 1];
    const auto middle = times.begin() + 1 + static_cast<std::ptrdiff_t>((times.size() - 2) / 2);
    std::nth_element(times.begin() + 1, middle, times.end());
    stream.usual_ns = std::min(*middle, kLongest_ns);
  }

  [[noreturn]] void refuse() const {
    throw InputError(source_.file,
                     fmt::format("has no message of {}; {}", topics_text(source_.mcap),
                                 topics_there(facts_->files)));
  }

  const MotionSource& source_;
  std::shared_ptr<McapFacts> facts_ = std::make_shared<McapFacts>();
  std::vector<More> more_;  // of the streams
  std::unordered_map<std::string, std::uint32_t> ids_;
  std::optional<McapType> type_;
  std::vector<McapItem> items_;
  std::string key_;
  std::uint32_t file_ = 0;
  long number_ = 0;
  std::optional<std::int64_t> time_ns_;  // of the previous item
  bool in_block_ = false, last_in_chunk_ = false;
};

}  // namespace

std::shared_ptr<const McapFacts> look_at(const MotionSource& source) {
  return Look(source).facts();
}

std::string topics_there(const std::vector<McapFacts::File>& files) {
  std::set<std::string> topics;
  for (const McapFacts::File& file : files)
    for (const auto& [id, channel] : file.channels) topics.insert(printable(channel.topic));
  std::vector<std::string> some(topics.begin(), topics.end());
  if (some.size() > kMostTopicsShown) some.resize(kMostTopicsShown);
  return some.empty() ? "it has no topics" : "its topics are " + quoted_list(some);
}

void warn_of_torn(const std::vector<McapFacts::File>& files, std::vector<std::string>& warnings) {
  for (const McapFacts::File& file : files)
    if (file.torn_at)
      warnings.push_back(fmt::format(
          "{}: has no footer, as after a killed recorder; the part up to byte {} is used",
          file.path.string(), *file.torn_at));
}

bool is_topic(const McapTopic& source, const std::string& topic) {
  return topic == source.topic || std::find(source.more_topics.begin(), source.more_topics.end(),
                                            topic) != source.more_topics.end();
}

std::string topics_text(const McapTopic& source) {
  std::vector<std::string> all{printable(source.topic)};
  for (const std::string& topic : source.more_topics) all.push_back(printable(topic));
  return (all.size() == 1 ? "topic " : "topics ") + quoted_list(all);
}

}  // namespace soilvdb::inline v0::io
