// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a first look at MCAP files tells of the motion in them: who says what, and which part of a
// file has which times, so that messages can be taken in their order without all being in memory.
#pragma once

#include <cstdint>
#include <filesystem>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "io/mcap/mcap_reader.h"
#include "io/motion/mcap_messages.h"
#include "soilvdb/io/motion_source.h"

namespace soilvdb::inline v0::io {

// Messages of one sender may be recorded out of their order by that much: networks and recorders
// with several threads do so. More is a clock that was set.
inline constexpr std::int64_t kMostBehind_ns = 1'000'000'000;
inline constexpr std::int64_t kLatest_ns = std::numeric_limits<std::int64_t>::max();

/// Times, from the first to the last.
struct McapTimes {
  std::int64_t first_ns = kLatest_ns, last_ns = -kLatest_ns;

  void add(std::int64_t ns) {
    first_ns = std::min(first_ns, ns);
    last_ns = std::max(last_ns, ns);
  }
};

/// What a topic says of the same joints, or of the same frame in the same parent.
struct McapStream {
  std::string topic, names;  ///< names as McapItem has them
  bool fixed = false;        ///< of /tf_static
  std::int64_t count = 0;
  McapTimes times;
  std::int64_t usual_ns = 0;          ///< the median of the time between two items; 0: unknown
  std::int64_t stamped_since_ns = 0;  ///< when the first with a stamp was recorded
  std::int64_t unstamped = 0;         ///< items whose stamp is 0 and whose log time is taken
  std::vector<double> values;         ///< of the last item
  bool moves = false;                 ///< not all have the same values
  bool ahead = true;                  ///< all have stamps later than when they were recorded

  /// The time of an item. A stamp of 0 is the beginning of simulated time, or there is no stamp.
  std::int64_t time_of(std::int64_t stamp_ns, std::int64_t log_ns) const {
    return stamp_ns == 0 && log_ns - stamped_since_ns > kMostBehind_ns ? log_ns : stamp_ns;
  }
};

/// Messages of one chunk, or some that follow each other.
struct McapBlock {
  struct Stream {
    std::uint32_t stream = 0;
    McapTimes times;
    std::int64_t last_log_ns = 0;
  };
  std::uint32_t file = 0;
  std::int64_t record = 0;  ///< where it begins
  long before = 0;          ///< the file's messages before it
  long messages = 0;
  std::int64_t time_before_ns = 0;  ///< of what comes before it in the file
  std::vector<Stream> streams;
};

/// What is known of the files once they were looked at.
struct McapFacts {
  struct File {
    std::filesystem::path path;
    std::int64_t bytes = 0;
    McapChannels channels;
    std::optional<std::int64_t> torn_at;
  };
  McapType type = McapType::kJointState;
  std::vector<File> files;
  std::vector<McapStream> streams;  ///< the first: messages that can't be decoded
  std::vector<McapBlock> blocks;
};

/// Reads all files from end to end.
/// @throw InputError if one is damaged, or no topic of the source is a motion
std::shared_ptr<const McapFacts> look_at(const MotionSource& source);

/// Is it one of the source's topics?
bool is_topic(const McapTopic& source, const std::string& topic);
/// "topic '/a'" or "topics '/a' and '/b'"
std::string topics_text(const McapTopic& source);

}  // namespace soilvdb::inline v0::io
