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

constexpr std::int64_t kMostGaps = 3;  // usual intervals: busy networks delay messages by a few

std::vector<std::uint32_t> streams_of(const McapFacts& facts) {
  std::vector<std::uint32_t> all;
  for (std::uint32_t i = 1; i < facts.streams.size(); ++i)
    if (!facts.streams[i].fixed) all.push_back(i);
  return all;
}

class PoseRows : public McapRows {
 public:
  PoseRows(const MotionSource& source, const std::shared_ptr<const McapFacts>& facts)
      : McapRows(source, facts, streams_of(*facts)) {
    columns_.names = {"time", "x", "y", "z", "qx", "qy", "qz", "qw"};
    columns_.quaternion = true;
    for (const std::uint32_t stream : wanted_)
      if (first_ == 0 ||
          facts_->streams[stream].times.first_ns < facts_->streams[first_].times.first_ns)
        first_ = stream;
  }

  Got next() override {
    do {
      if (!merge_.next(entry_)) return Got::kEnd;
    } while (from_ && entry_.place < *from_);
    row_ = entry_.place;
    look_at(row_);
    if (!entry_.fault.empty()) place_.fail(entry_.fault);
    return Got::kRow;
  }
  void values(std::vector<double>& v) override {
    if (entry_.stream != first_)
      place_.fail(
          fmt::format("is seen from frame '{}', and the first pose from '{}'; all must be "
                      "seen from one",
                      printable(facts_->streams[entry_.stream].names),
                      printable(facts_->streams[first_].names)));
    v[0] = stamp_s(row_.time_ns);
    std::copy(entry_.values.begin(), entry_.values.end(), v.begin() + 1);
    for (std::size_t i = 0; i < v.size(); ++i) check_number(place_, columns_.names[i], v[i]);
    seal(v);
  }
  void go_to(const RowMark& mark) override {
    from_ = place_of(mark);
    merge_.go_to(mark.bytes);
  }

 private:
  McapEntry entry_;
  std::uint32_t first_ = 0;  // the stream whose frame is the reference for all
  std::optional<McapPlace> from_;
};

}  // namespace

McapRows::McapRows(const MotionSource& source, std::shared_ptr<const McapFacts> facts,
                   const std::vector<std::uint32_t>& wanted)
    : source_(source),
      facts_(std::move(facts)),
      wanted_(wanted),
      merge_(source, facts_, wanted),
      place_(source.file) {}

std::int64_t most_gap_ns(std::int64_t usual_ns) {
  return std::max(kMostGap_ns, kMostGaps * usual_ns);
}

std::int64_t most_end_ns(std::int64_t usual_ns) {
  return std::max(kMostEnd_ns, usual_ns + usual_ns / 2);
}

std::int64_t McapRows::usual_ns(const std::vector<std::uint32_t>& streams) const {
  std::int64_t usual_ns = 0;
  for (const std::uint32_t stream : streams)
    if (const std::int64_t its_ns = facts_->streams[stream].usual_ns; its_ns > 0)
      usual_ns = usual_ns == 0 ? its_ns : std::min(usual_ns, its_ns);
  return usual_ns;
}

std::int64_t McapRows::longest_gap_ns() const {
  std::int64_t longest_ns = 0;
  for (const std::uint32_t stream : wanted_)
    longest_ns = std::max(longest_ns, most_gap_ns(facts_->streams[stream].usual_ns));
  return longest_ns;
}

std::optional<double> McapRows::most_gap_s() const {
  return static_cast<double>(most_gap_ns(usual_ns())) * 1e-9;
}

void McapRows::look_at(const McapPlace& place) {
  place_.set(facts_->files[place.file].path, place.number);
}

McapPlace McapRows::place_of(const RowMark& mark) {
  return {mark.bytes, mark.file, mark.lines + 1, mark.item};
}

RowMark McapRows::mark() const { return {row_.time_ns, row_.number - 1, row_.file, row_.item, {}}; }

void McapRows::seal(const std::vector<double>& v) {
  hash_ = std::hash<std::string_view>()(
      {reinterpret_cast<const char*>(v.data()), v.size() * sizeof(double)});
}

void McapRows::warn(std::vector<std::string>& warnings) const {
  warn_of_torn(facts_->files, warnings);
  std::int64_t unstamped = 0;
  for (const std::uint32_t stream : wanted_) unstamped += facts_->streams[stream].unstamped;
  if (unstamped > 0)
    warnings.push_back(
        fmt::format("{}: {} {} of {} {} no stamp; the time at which they were "
                    "recorded is taken",
                    source_.file.string(), unstamped,
                    facts_->type == McapType::kTransforms ? "transforms" : "messages",
                    topics_text(source_.mcap), unstamped == 1 ? "has" : "have"));
}

MotionSource McapRows::source() const {
  MotionSource known = source_;
  known.mcap.facts = facts_;
  return known;
}

std::unique_ptr<McapRows> mcap_pose_rows(const MotionSource& source,
                                         const std::shared_ptr<const McapFacts>& facts) {
  const McapTopic& wanted = source.mcap;
  const std::string topics = topics_text(wanted);
  if (facts->type != McapType::kTransforms && !wanted.frame.empty())
    throw InputError(source.file, fmt::format("{} has no transforms; remove 'frame'", topics));
  if (!wanted.more_topics.empty())
    throw InputError(source.file,
                     fmt::format("{} are of {}; several topics are for joints only, so name one",
                                 topics, type_name(facts->type)));
  if (facts->type != McapType::kTransforms) return std::make_unique<PoseRows>(source, facts);
  if (wanted.frame.empty())
    throw InputError(source.file,
                     fmt::format("{} has transforms; say which is the bucket's frame, as "
                                 "'frame: NAME' beside 'topic:'",
                                 topics));
  return mcap_tf_rows(source, facts);
}

std::unique_ptr<RowSource> mcap_rows(const MotionSource& source,
                                     const std::optional<Chain>& chain) {
  const McapTopic& wanted = source.mcap;
  const auto facts = wanted.facts ? wanted.facts : look_at(source);
  const std::string topics = topics_text(wanted);
  if (facts->type == McapType::kJointState) {
    if (!chain)
      throw InputError(source.file, fmt::format("{} has joints; the machine needs a urdf for them, "
                                                "or another topic, with poses or transforms",
                                                topics));
    if (wanted.frame.empty()) {
      if (wanted.base && chain->movable_count() == 0)
        throw InputError(source.file,
                         fmt::format("{} has joints, and the machine's urdf has none that move; "
                                     "leave the urdf out, and take the bucket's poses",
                                     topics));
      auto rows = mcap_joint_rows(source, facts, *chain);
      return wanted.base ? mcap_base_rows(std::move(rows), source) : std::move(rows);
    }
  } else if (chain) {
    throw InputError(source.file,
                     fmt::format("{} has poses, and the machine a urdf; name a topic of "
                                 "sensor_msgs/JointState, or remove the machine's urdf",
                                 topics));
  }
  return mcap_pose_rows(source, facts);
}

}  // namespace soilvdb::inline v0::io
