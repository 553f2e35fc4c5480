// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Messages of MCAP files in the order of their stamps, whatever the order of files, chunks and
// messages.
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

/// The place of an item in the order; items of one time keep the order of the files.
struct McapPlace {
  std::int64_t time_ns = 0;
  std::uint32_t file = 0;
  long number = 0;         ///< of its message in the file, from 1
  std::uint32_t item = 0;  ///< within the message

  auto operator<=>(const McapPlace&) const = default;
};

struct McapEntry {
  McapPlace place;
  std::uint32_t stream = 0;
  std::vector<double> values;
  std::string fault;  ///< why the item is unusable
};

/// What is wrong with a message that was recorded earlier than one with an earlier stamp.
std::string clock_fault(std::int64_t time_ns, std::int64_t behind_ns);

/// Holds only blocks with overlapping times in memory.
class McapMerge {
 public:
  /// @param wanted streams to return; messages that can't be decoded are always returned
  McapMerge(const MotionSource& source, std::shared_ptr<const McapFacts> facts,
            const std::vector<std::uint32_t>& wanted);

  /// @return false at the end
  bool next(McapEntry& entry);
  /// The time of the stream's next item.
  std::optional<std::int64_t> next_time(std::uint32_t stream) const;
  /// Continues with the first item at or after this time.
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
  std::vector<Block> blocks_;  // by first time
  std::size_t loaded_ = 0;     // number of loaded blocks
  std::map<McapPlace, Waiting> waiting_;
  std::vector<std::int64_t> last_log_ns_;  // by stream, of the items so far
  std::int64_t from_ns_ = -kLatest_ns, bytes_ = 0;
  std::unique_ptr<McapReader> reader_;
  std::uint32_t reader_file_ = 0;
  std::vector<McapItem> items_;
};

}  // namespace soilvdb::inline v0::io
