// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Rows of a motion from transforms: a row for each transform of one frame, combined with the frames
// above it at that time.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "io/file/text.h"
#include "io/motion/mcap_rows.h"
#include "io/motion/motion_checks.h"
#include "soilvdb/io/motion_rows.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::size_t kMostLinks = 1000, kMostLinksShown = 9;
constexpr double kUnitTolerance = 0.01;  // as for a row's quaternion

/// A frame between the bucket's frame and the root, and its parent.
struct Link {
  std::string child, parent;
  std::uint32_t stream = 0;
  bool fixed = false;  ///< constant: the value of its stream holds at all times
};

/// Frames with a parent, each with its streams.
using Frames = std::map<std::string, std::vector<std::uint32_t>, std::less<>>;

Frames frames_of(const McapFacts& facts) {
  Frames frames;
  for (std::uint32_t i = 1; i < facts.streams.size(); ++i)
    frames[split_names(facts.streams[i].names).front()].push_back(i);
  return frames;
}

/// @throw InputError if the frame has several parents
Link link_of(const MotionSource& source, const McapFacts& facts, const std::string& child,
             const std::vector<std::uint32_t>& streams) {
  Link link{child, split_names(facts.streams[streams[0]].names).back(), streams[0], true};
  for (const std::uint32_t i : streams) {
    const McapStream& stream = facts.streams[i];
    const std::string parent = split_names(stream.names).back();
    if (parent != link.parent)
      throw InputError(
          source.file,
          fmt::format("frame '{}' has the parent '{}', and later '{}'; it must have one parent",
                      printable(child), printable(link.parent), printable(parent)));
    if (stream.fixed || stream.topic.ends_with("_static")) continue;
    link.stream = i;
    // A frame that never moves and is stamped in the future is a fixed one, published repeatedly.
    link.fixed = !stream.moves && stream.ahead;
  }
  if (link.fixed && !(std::abs(pose_of(facts.streams[link.stream].values.data()).rotation.norm() -
                               1) <= kUnitTolerance))
    throw InputError(source.file,
                     fmt::format("the transform of frame '{}' has a quaternion of another norm "
                                 "than 1",
                                 printable(child)));
  return link;
}

/// "'lip' on 'boom' on 'base'"
std::string way_up(const std::string& frame, const std::vector<Link>& links) {
  std::string way = "'" + printable(frame) + "'";
  for (std::size_t i = 0; i < links.size() && i < kMostLinksShown; ++i)
    way += " on '" + printable(links[i].parent) + "'";
  return way;
}

/// The chain from a frame up; empty if it is its own parent.
std::vector<Link> links_above(const MotionSource& source, const McapFacts& facts) {
  const McapTopic& wanted = source.mcap;
  const Frames frames = frames_of(facts);
  std::vector<Link> links;
  for (std::string child = wanted.frame; child != wanted.parent;) {
    const auto at = frames.find(child);
    if (at == frames.end()) {
      if (wanted.parent.empty() && !links.empty()) break;  // the root
      std::vector<std::string> names;
      for (const auto& [name, streams] : frames) names.push_back(name);
      const std::string near = nearest(links.empty() ? wanted.frame : wanted.parent, names);
      throw InputError(
          source.file,
          links.empty()
              ? fmt::format("topic '{}' has no transform of frame '{}'{}", printable(wanted.topic),
                            printable(wanted.frame),
                            near.empty() ? "" : "; did you mean '" + printable(near) + "'?")
              : fmt::format("frame '{}' isn't below '{}'; its chain is {}", printable(wanted.frame),
                            printable(wanted.parent), way_up(wanted.frame, links)));
    }
    links.push_back(link_of(source, facts, child, at->second));
    if (links.size() > kMostLinks)
      throw InputError(source.file,
                       fmt::format("frame '{}' is its own ancestor, or has more than {} ancestors",
                                   printable(wanted.frame), kMostLinks));
    child = links.back().parent;
  }
  return links;
}

bool all_fixed(const std::vector<Link>& links) {
  return std::all_of(links.begin(), links.end(), [](const Link& link) { return link.fixed; });
}

/// The chain from the bucket's frame up.
std::vector<Link> find_links(const MotionSource& source, const McapFacts& facts) {
  const std::vector<Link> links = links_above(source, facts);
  if (all_fixed(links))
    throw InputError(
        source.file,
        fmt::format("frame '{}' never moves: topic '{}' has no transform in its chain, {}",
                    printable(source.mcap.frame), printable(source.mcap.topic),
                    way_up(source.mcap.frame, links)));
  return links;
}

std::vector<std::uint32_t> link_streams(const std::vector<Link>& links) {
  std::vector<std::uint32_t> streams;
  for (const Link& link : links)
    if (!link.fixed) streams.push_back(link.stream);
  return streams;
}

class TfRows : public TrackRows {
 public:
  TfRows(const MotionSource& source, const std::shared_ptr<const McapFacts>& facts,
         std::vector<Link> links)
      : TrackRows(source, facts, link_streams(links)), links_(std::move(links)) {
    columns_.names = {"time", "x", "y", "z", "qx", "qy", "qz", "qw"};
    columns_.quaternion = true;
    for (const std::uint32_t stream : wanted_) {
      add_track("frame '" + printable(split_names(facts_->streams[stream].names)[0]) + "'", false);
      add_stream(tracks_.size() - 1, stream);
    }
    Track& makes_rows = tracks_[row_track()];
    makes_rows.makes_rows = makes_rows.tells_gaps = true;
  }

  std::optional<double> most_gap_s() const override { return {}; }  // gaps are bad rows here
  void values(std::vector<double>& v) override {
    Pose pose;
    std::size_t next = 0;
    for (std::size_t i = 0; i < links_.size(); ++i) {
      Pose up = links_[i].fixed ? pose_of(facts_->streams[links_[i].stream].values.data())
                                : pose_of(at_row(tracks_[next++]).data());
      if (links_.size() > 1) up.rotation.normalize();
      pose = i == 0 ? up : up * pose;
    }
    v[0] = stamp_s(row_.time_ns);
    const Values row = row_of(pose);
    std::copy(row.begin(), row.end(), v.begin() + 1);
    for (std::size_t i = 0; i < v.size(); ++i) check_number(place_, columns_.names[i], v[i]);
    seal(v);
  }

 private:
  /// The track that makes rows: the nearest to the bucket, unless that one is constant and a moving
  /// one has more samples.
  std::size_t row_track() const {
    std::size_t best = 0;
    const auto stream = [&](std::size_t i) -> const McapStream& {
      return facts_->streams[wanted_[i]];
    };
    while (best + 1 < wanted_.size() && !stream(best).moves) ++best;
    return stream(best).moves && stream(best).count > stream(0).count ? best : 0;
  }

  void take(const McapEntry& entry) override {
    const auto i = static_cast<std::size_t>(
        std::find(wanted_.begin(), wanted_.end(), entry.stream) - wanted_.begin());
    const double* v = entry.values.data();
    for (std::size_t k = 0; k < entry.values.size(); ++k)
      check_number(place_, columns_.names[k + 1], v[k]);
    if (links_.size() > 1 && !(std::abs(pose_of(v).rotation.norm() - 1) <= kUnitTolerance))
      place_.fail(fmt::format("the transform of {} has a quaternion of another norm than 1",
                              tracks_[i].what));
    check_same(tracks_[i], entry.place.time_ns, v, entry.values.size());
    put(tracks_[i], entry.place, v, entry.values.size());
  }

  Values between(const Track&, const Values& a, const Values& b, double s) const override {
    return row_of(interpolate(pose_of(a.data()), pose_of(b.data()), s));
  }

  std::vector<Link> links_;
};

}  // namespace

std::optional<Pose> fixed_pose(const MotionSource& source, const McapFacts& facts) {
  const std::vector<Link> links = links_above(source, facts);
  if (!all_fixed(links)) return {};
  Pose pose;
  for (const Link& link : links) {
    Pose up = pose_of(facts.streams[link.stream].values.data());
    up.rotation.normalize();
    pose = up * pose;
  }
  return pose;
}

std::unique_ptr<McapRows> mcap_tf_rows(const MotionSource& source,
                                       const std::shared_ptr<const McapFacts>& facts) {
  return std::make_unique<TfRows>(source, facts, find_links(source, *facts));
}

}  // namespace soilvdb::inline v0::io
