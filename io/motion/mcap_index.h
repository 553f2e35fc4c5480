// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The index of a motion in MCAP files, made by a first pass: its streams, and the times in each
// part of a file. It allows reading in the order of stamps with few messages in memory.
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

// Largest disorder of one sender's messages, as networks and multi-threaded recorders cause. A
// larger one means that a clock was set.
inline constexpr std::int64_t kMostBehind_ns = 1'000'000'000;
inline constexpr std::int64_t kLatest_ns = std::numeric_limits<std::int64_t>::max();

/// A range of times.
struct McapTimes {
  std::int64_t first_ns = kLatest_ns, last_ns = -kLatest_ns;

  void add(std::int64_t ns) {
    first_ns = std::min(first_ns, ns);
    last_ns = std::max(last_ns, ns);
  }
};

/// Messages of one topic about the same joints, or about the same frame in the same parent.
struct McapStream {
  std::string topic, names;  ///< names as McapItem has them
  bool fixed = false;        ///< from /tf_static
  std::int64_t count = 0;
  McapTimes times;
  std::int64_t usual_ns = 0;          ///< median time between two items; 0: unknown
  std::int64_t stamped_since_ns = 0;  ///< recording time of the first item with a stamp
  std::int64_t unstamped = 0;         ///< items with stamp 0, whose log time counts
  std::vector<double> values;         ///< of the last item
  bool moves = false;                 ///< some values differ
  bool ahead = true;                  ///< all stamps are later than their recording times

  /// The time of an item. Stamp 0 is the beginning of simulated time, or means that there is no
  /// stamp.
  std::int64_t time_of(std::int64_t stamp_ns, std::int64_t log_ns) const {
    return stamp_ns == 0 && log_ns - stamped_since_ns > kMostBehind_ns ? log_ns : stamp_ns;
  }
};

/// Messages of one chunk, or consecutive messages.
struct McapBlock {
  struct Stream {
    std::uint32_t stream = 0;
    McapTimes times;
    std::int64_t last_log_ns = 0;
  };
  std::uint32_t file = 0;
  std::int64_t record = 0;  ///< offset of the first record
  long before = 0;          ///< number of the file's messages before it
  long messages = 0;
  std::int64_t time_before_ns = 0;  ///< time of the message before it in the file
  std::vector<Stream> streams;
};

/// The result of the first pass.
struct McapFacts {
  struct File {
    std::filesystem::path path;
    std::int64_t bytes = 0;
    McapChannels channels;
    std::optional<std::int64_t> torn_at;
  };
  McapType type = McapType::kJointState;
  std::vector<File> files;
  std::vector<McapStream> streams;  ///< streams[0]: messages that can't be decoded
  std::vector<McapBlock> blocks;
};

/// Reads all files from end to end.
/// @throw InputError if a file is damaged, or if no topic of the source is a motion
std::shared_ptr<const McapFacts> look_at(const MotionSource& source);

/// "its topics are '/a' and '/b'"
std::string topics_there(const std::vector<McapFacts::File>& files);
/// Adds a warning about each file without a footer.
void warn_of_torn(const std::vector<McapFacts::File>& files, std::vector<std::string>& warnings);

/// Is it one of the source's topics?
bool is_topic(const McapTopic& source, const std::string& topic);
/// "topic '/a'" or "topics '/a' and '/b'"
std::string topics_text(const McapTopic& source);

}  // namespace soilvdb::inline v0::io
