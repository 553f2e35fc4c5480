// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What messages of MCAP files say, in the order of their stamps, whatever order files, chunks and
// messages are in.
#pragma once

#include <compare>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "io/motion/mcap_index.h"

namespace soilvdb::inline v0::io {

/// The place of an item in the order; those of one time are in that of the files.
struct McapPlace {
  std::int64_t time_ns = 0;
  std::uint32_t file = 0;
  long number = 0;         ///< of its message in the file, from 1 on
  std::uint32_t item = 0;  ///< of the message

  auto operator<=>(const McapPlace&) const = default;
};

struct McapEntry {
  McapPlace place;
  std::uint32_t stream = 0;
  std::vector<double> values;
  std::string fault;  ///< why it can't be used
};

/// In memory for blocks of which the times overlap.
class McapMerge {
 public:
  /// @param wanted of its streams; messages that can't be decoded come anyway
  McapMerge(const MotionSource& source, std::shared_ptr<const McapFacts> facts,
            const std::vector<std::uint32_t>& wanted);

  /// @return false at the end
  bool next(McapEntry& entry);
  /// The time of the stream's first item that is yet to come.
  std::optional<std::int64_t> next_time(std::uint32_t stream) const;
  /// Goes on with the first item of that time or later.
  void go_to(std::int64_t time_ns);

  std::int64_t bytes_read() const { return bytes_; }

 private:
  struct Waiting {
    McapEntry entry;
    std::int64_t log_ns = 0;
  };
  struct Block {
    McapTimes times;
    const McapBlock* block = nullptr;
  };
  void load(const McapBlock& block);
  void add(const McapPlace& place, std::uint32_t stream, std::int64_t log_ns,
           std::vector<double> values, std::string fault);
  McapReader& reader(std::uint32_t file);

  McapTopic topic_;
  std::shared_ptr<const McapFacts> facts_;
  std::vector<bool> wanted_;
  std::vector<Block> blocks_;  // by their first times
  std::size_t loaded_ = 0;     // so many of them
  std::map<McapPlace, Waiting> waiting_;
  std::vector<std::int64_t> last_log_ns_;  // of each stream's items so far
  std::int64_t from_ns_ = -kLatest_ns, bytes_ = 0;
  std::unique_ptr<McapReader> reader_;
  std::uint32_t reader_file_ = 0;
  std::vector<McapItem> items_;
};

}  // namespace soilvdb::inline v0::io
