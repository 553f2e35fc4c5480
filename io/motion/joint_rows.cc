// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Rows of a motion from JointState messages: a row for each stamp of any message with the machine's
// joints.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <unordered_map>

#include "io/file/text.h"
#include "io/motion/mcap_rows.h"
#include "io/motion/motion_angles.h"
#include "io/motion/motion_checks.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::size_t kMostJointsShown = 12;  // joints

std::vector<std::uint32_t> joint_streams(const McapFacts& facts,
                                         const std::vector<std::string>& joints) {
  std::vector<std::uint32_t> wanted;
  for (std::uint32_t i = 1; i < facts.streams.size(); ++i) {
    const std::vector<std::string> names = split_names(facts.streams[i].names);
    if (joints.empty() ||
        std::find_first_of(names.begin(), names.end(), joints.begin(), joints.end()) != names.end())
      wanted.push_back(i);
  }
  return wanted;
}

class JointRows : public TrackRows {
 public:
  JointRows(const MotionSource& source, const std::shared_ptr<const McapFacts>& facts,
            const Chain& chain)
      : TrackRows(source, facts, joint_streams(*facts, chain.movable())) {
    const std::vector<std::string> movable = chain.movable();
    columns_.names = {"time"};
    columns_.names.insert(columns_.names.end(), movable.begin(), movable.end());
    for (const Joint& joint : chain.joints)
      if (joint.moves_itself()) {
        add_track("joint '" + printable(joint.name) + "'", true);
        goes_round_.push_back(may_wrap(joint));
      }
    if (tracks_.empty()) add_track("the machine", true);  // nothing moves
    for (const std::uint32_t stream : wanted_) {
      const std::vector<std::string> names = split_names(facts_->streams[stream].names);
      for (std::size_t i = 0; i < movable.size(); ++i) {
        const auto at = std::find(names.begin(), names.end(), movable[i]);
        if (at == names.end()) continue;
        parts_[stream].emplace_back(static_cast<std::size_t>(at - names.begin()), i);
        add_stream(i, stream);
      }
      if (movable.empty()) add_stream(0, stream);
    }
    refuse_missing(movable);
  }

  void values(std::vector<double>& v) override {
    v[0] = stamp_s(row_.time_ns);
    for (std::size_t i = 1; i < v.size(); ++i) v[i] = at_row(tracks_[i - 1])[0];
    check_number(place_, columns_.names[0], v[0]);
    seal(v);
  }

 private:
  void take(const McapEntry& entry) override {
    if (columns_.names.size() == 1) return put(tracks_[0], entry.place, nullptr, 0);
    const auto& parts = parts_[entry.stream];
    for (const auto& [at, i] : parts) {
      check_number(place_, columns_.names[i + 1], entry.values[at]);
      check_same(tracks_[i], entry.place.time_ns, &entry.values[at], 1);
    }
    for (const auto& [at, i] : parts) put(tracks_[i], entry.place, &entry.values[at], 1);
  }

  Values between(const Track& track, const Values& a, const Values& b, double s) const override {
    double way = b[0] - a[0];
    if (goes_round_[static_cast<std::size_t>(&track - tracks_.data())] && std::abs(way) > kTurn / 2)
      way = std::remainder(way, kTurn);
    return {a[0] + s * way};
  }

  void refuse_missing(const std::vector<std::string>& movable) const {
    std::vector<std::string> missing;
    for (std::size_t i = 0; i < movable.size(); ++i)
      if (tracks_[i].streams.empty()) missing.push_back(movable[i]);
    if (missing.empty()) return;
    const std::string topics = topics_text(source_.mcap);
    if (missing.size() < movable.size())
      throw InputError(
          source_.file,
          fmt::format("no message of {} has joint{} {}; the machine needs {}, which may be of "
                      "several topics: 'topic: [/a, /b]'",
                      topics, missing.size() == 1 ? "" : "s", quoted_list(missing),
                      quoted_list(movable)));
    std::set<std::string> there;
    for (const McapStream& stream : facts_->streams)
      for (const std::string& name : split_names(stream.names))
        if (there.size() < kMostJointsShown) there.insert(printable(name));
    const std::vector<std::string> others(there.begin(), there.end());
    throw InputError(
        source_.file,
        fmt::format("no message of {} has a joint of the machine: {}; they have {}", topics,
                    quoted_list(movable), others.empty() ? "no joints" : quoted_list(others)));
  }

  std::vector<bool> goes_round_;  // of the joints
  /// By stream: pairs of an index into its values and a joint.
  std::unordered_map<std::uint32_t, std::vector<std::pair<std::size_t, std::size_t>>> parts_;
};

}  // namespace

std::unique_ptr<RowSource> mcap_joint_rows(const MotionSource& source,
                                           const std::shared_ptr<const McapFacts>& facts,
                                           const Chain& chain) {
  return std::make_unique<JointRows>(source, facts, chain);
}

}  // namespace soilvdb::inline v0::io
