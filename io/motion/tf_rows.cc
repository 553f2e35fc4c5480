// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Rows of a motion out of transforms: a row for each that moves the bucket's frame in what carries
// it, with the frames above that where they are at its time.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <functional>
#include <map>

#include "io/file/text.h"
#include "io/motion/mcap_rows.h"
#include "io/motion/motion_checks.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::int64_t kMostWait_ns = 1'000'000'000;  // for what comes later from slower senders
constexpr std::size_t kMostWaiting = 4096, kMostSamples = 1 << 16;
constexpr std::size_t kMostFrames = 100'000, kMostLinks = 1000;
constexpr double kUnitTolerance = 0.01;  // as that of a row's quaternion

std::string static_topic(const McapTopic& topic) { return topic.topic + "_static"; }

Pose pose_of(const TransformMessage& transform) {
  const auto& v = transform.values;
  return {{v[0], v[1], v[2]}, Eigen::Quaterniond(v[6], v[3], v[4], v[5])};
}

/// Reads the file for which frame hangs on which, and the way from the bucket's up.
std::vector<McapFacts::Link> find_links(const MotionSource& source, const McapChannels& channels) {
  struct Frame {
    std::string parent;
    Pose pose;
    bool moves = false;
  };
  const McapTopic& wanted = source.mcap;
  std::map<std::string, Frame, std::less<>> frames;
  McapReader reader(source.file, channels);
  McapReader::Message message;
  std::vector<TransformMessage> transforms;
  while (reader.next(message)) {
    const bool moves = message.channel->topic == wanted.topic;
    if (!moves && message.channel->topic != static_topic(wanted)) continue;
    try {
      read_message(message.data, transforms);
    } catch (const CdrError&) {
      continue;  // a bad row, when it comes to that
    }
    for (const TransformMessage& transform : transforms) {
      auto at = frames.find(transform.child);
      if (at == frames.end()) {
        if (frames.size() >= kMostFrames)
          throw InputError(source.file,
                           fmt::format("has more than {} frames in its transforms", kMostFrames));
        at = frames.try_emplace(std::string(transform.child)).first;
        at->second.parent = transform.parent;
      }
      Frame& frame = at->second;
      if (frame.parent != transform.parent)
        throw InputError(
            source.file,
            fmt::format("frame '{}' hangs on '{}', and on '{}' later; it must have one parent",
                        printable(transform.child), printable(frame.parent),
                        printable(transform.parent)));
      if (!moves) frame.pose = pose_of(transform);
      frame.moves = frame.moves || moves;
    }
  }
  std::vector<McapFacts::Link> links;
  std::string way = "'" + printable(wanted.frame) + "'";
  bool moves = false;
  for (std::string child = wanted.frame; child != wanted.parent;) {
    const auto at = frames.find(child);
    if (at == frames.end()) {
      if (wanted.parent.empty() && !links.empty()) break;  // the root
      std::vector<std::string> names;
      for (const auto& [name, frame] : frames) names.push_back(name);
      const std::string near = nearest(links.empty() ? wanted.frame : wanted.parent, names);
      throw InputError(
          source.file,
          links.empty()
              ? fmt::format("topic '{}' has no transform of frame '{}'{}", printable(wanted.topic),
                            printable(wanted.frame),
                            near.empty() ? "" : "; did you mean '" + printable(near) + "'?")
              : fmt::format("frame '{}' doesn't hang on '{}'; the way up is {}",
                            printable(wanted.frame), printable(wanted.parent), way));
    }
    const Frame& frame = at->second;
    links.push_back(
        {child, frame.parent, frame.moves ? std::nullopt : std::optional<Pose>(frame.pose)});
    moves = moves || frame.moves;
    if (links.size() > kMostLinks)
      throw InputError(source.file, fmt::format("frame '{}' hangs on itself, or on more than {} "
                                                "others",
                                                printable(wanted.frame), kMostLinks));
    if (links.size() < 10) way += " on '" + printable(frame.parent) + "'";
    child = frame.parent;
  }
  if (!moves)
    throw InputError(source.file,
                     fmt::format("frame '{}' never moves: topic '{}' has no transform on its way "
                                 "up, {}",
                                 printable(wanted.frame), printable(wanted.topic), way));
  return links;
}

class TfRows : public McapRows {
 public:
  explicit TfRows(const MotionSource& source) : McapRows(source) {
    columns_.names = {"time", "x", "y", "z", "qx", "qy", "qz", "qw"};
    columns_.quaternion = true;
    if (!facts_ || facts_->links.empty()) {
      McapFacts facts;
      facts.channels = reader_.channels();
      facts.links = find_links(source, facts.channels);
      facts_ = std::make_shared<const McapFacts>(std::move(facts));
    }
    for (const McapFacts::Link& link : facts_->links) {
      if (link.fixed) continue;
      if (moves_rows_ == nullptr)
        moves_rows_ = &link;
      else
        others_.push_back({&link, {}});
    }
  }

  Got next() override {
    while (true) {
      while (!ready()) ended_ = !read_more();
      if (waiting_.empty()) break;
      const Row row = waiting_.front();
      waiting_.pop_front();
      if (row.number <= after_) continue;
      after_ = row.number;
      // The others may not have been heard of yet.
      if (!std::all_of(others_.begin(), others_.end(), [&](const Other& other) {
            return !other.samples.empty() && other.samples.front().stamp_ns <= row.stamp.ns();
          }))
        continue;
      any_ = true;
      place_.set_number(row.number);
      stamp_ = row.stamp;
      compose(row);
      return Got::kRow;
    }
    if (!any_)
      throw InputError(
          source_.file,
          fmt::format("never has all transforms from '{}' up to '{}' at one time",
                      printable(source_.mcap.frame), printable(facts_->links.back().parent)));
    return Got::kEnd;
  }

  void values(std::vector<double>& v) override {
    v[0] = stamp_.seconds();
    const Vec3& p = pose_.position;
    const auto& q = pose_.rotation.coeffs();
    const std::array<double, 7> numbers = {p[0], p[1], p[2], q[0], q[1], q[2], q[3]};
    std::copy(numbers.begin(), numbers.end(), v.begin() + 1);
    for (std::size_t i = 0; i < v.size(); ++i) check_number(place_, columns_.names[i], v[i]);
    if (bad_link_ == nullptr) return;
    place_.fail(fmt::format("the transform of frame '{}' has a quaternion of another norm than 1",
                            printable(bad_link_->child)));
  }
  std::size_t hash() const override {
    std::string bytes;
    const auto add = [&](const double* begin, std::size_t n) {
      bytes.append(reinterpret_cast<const char*>(begin), n * sizeof(double));
    };
    const double time_s = stamp_.seconds();
    add(&time_s, 1);
    add(pose_.position.data(), 3);
    add(pose_.rotation.coeffs().data(), 4);
    return std::hash<std::string>()(bytes);
  }

  /// Where the oldest message begins that the next row may need.
  RowMark mark() const override {
    RowMark oldest = here();
    const auto look = [&](const RowMark& mark) {
      if (mark.lines < oldest.lines) oldest = mark;
    };
    for (const Other& other : others_)
      if (!other.samples.empty()) look(other.samples.front().mark);
    if (!waiting_.empty()) look(waiting_.front().mark);
    oldest.after = after_;
    return oldest;
  }
  void go_to(const RowMark& mark) override {
    for (Other& other : others_) other.samples.clear();
    waiting_.clear();
    ended_ = false;
    any_ = true;
    McapRows::go_to(mark);
    read_ = mark.lines;
    after_ = mark.after;
  }

 private:
  /// Where a frame was that others hang on.
  struct Sample {
    std::int64_t stamp_ns = 0;
    Pose pose;
    RowMark mark;  // of its message
  };
  struct Other {
    const McapFacts::Link* link = nullptr;
    std::deque<Sample> samples;  // in the order of time, from the last before the row on
  };
  struct Row {
    long number = 0;  // of the message
    RosTime stamp;
    Pose pose;     // of the frame that makes rows
    RowMark mark;  // of its message
  };

  const char* type_name() const override { return "tf2_msgs/TFMessage"; }

  RowMark here() const {
    const McapReader::Mark mark = reader_.mark();
    return {mark.record, read_, mark.within};
  }

  /// Are the others known at the time of the first row that waits, or late?
  bool ready() const {
    if (ended_) return true;
    if (waiting_.empty()) return false;
    const std::int64_t at_ns = waiting_.front().stamp.ns();
    if (waiting_.size() > kMostWaiting || waiting_.back().stamp.ns() - at_ns > kMostWait_ns)
      return true;
    return std::all_of(others_.begin(), others_.end(), [&](const Other& other) {
      return !other.samples.empty() && other.samples.back().stamp_ns >= at_ns;
    });
  }

  /// Takes in one more message. @return false at the end
  bool read_more() {
    McapReader::Message message;
    const RowMark mark = here();
    do {
      if (!reader_.next(message)) return false;
    } while (message.channel->topic != source_.mcap.topic);
    ++read_;
    try {
      read_message(message.data, transforms_);
    } catch (const CdrError&) {
      place_.set_number(read_);
      decoded([] { throw; });
    }
    std::optional<Row> row;  // a message moves a frame once
    for (const TransformMessage& transform : transforms_) {
      if (transform.child == moves_rows_->child)
        row = {read_, transform.stamp, pose_of(transform), mark};
      for (Other& other : others_) {
        if (transform.child != other.link->child) continue;
        auto& samples = other.samples;
        const std::int64_t stamp_ns = transform.stamp.ns();
        if (!samples.empty() && stamp_ns <= samples.back().stamp_ns) continue;
        samples.push_back({stamp_ns, pose_of(transform), mark});
        if (samples.size() > kMostSamples) samples.pop_front();
      }
    }
    if (row) waiting_.push_back(*row);
    return true;
  }

  /// Where a frame is at a time, and forgets what was before.
  static Pose pose_at(Other& other, std::int64_t at_ns) {
    auto& samples = other.samples;
    while (samples.size() > 1 && samples[1].stamp_ns <= at_ns) samples.pop_front();
    const Sample& before = samples.front();
    if (samples.size() == 1 || before.stamp_ns >= at_ns) return before.pose;
    const Sample& after = samples[1];
    return interpolate(before.pose, after.pose,
                       static_cast<double>(at_ns - before.stamp_ns) /
                           static_cast<double>(after.stamp_ns - before.stamp_ns));
  }

  void compose(const Row& row) {
    bad_link_ = nullptr;
    auto other = others_.begin();
    bool first = true;
    for (const McapFacts::Link& link : facts_->links) {
      Pose pose = link.fixed             ? *link.fixed
                  : &link == moves_rows_ ? row.pose
                                         : pose_at(*other++, row.stamp.ns());
      if (facts_->links.size() > 1) {
        if (!(std::abs(pose.rotation.norm() - 1) <= kUnitTolerance)) bad_link_ = &link;
        pose.rotation.normalize();
      }
      pose_ = first ? pose : pose * pose_;
      first = false;
    }
  }

  const McapFacts::Link* moves_rows_ = nullptr;  // the nearest to the bucket's frame that moves
  std::vector<Other> others_;                    // those above it that do
  std::vector<TransformMessage> transforms_;
  std::deque<Row> waiting_;
  long read_ = 0, after_ = 0;  // messages so far; that of the last row
  bool ended_ = false, any_ = false;
  Pose pose_;  // of the row
  const McapFacts::Link* bad_link_ = nullptr;
};

}  // namespace

std::unique_ptr<RowSource> mcap_tf_rows(const MotionSource& source) {
  return std::make_unique<TfRows>(source);
}

}  // namespace soilvdb::inline v0::io
