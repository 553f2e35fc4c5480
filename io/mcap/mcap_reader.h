// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Messages of an MCAP file, in the order of the file.
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "io/mcap/mcap_format.h"

namespace soilvdb::inline v0::io {

/// Later ones, in the year 2096, are taken for this one: differences of any two times fit 64 bits.
inline constexpr std::int64_t kLastLog_ns = 4'000'000'000'000'000'000;

struct McapChannel {
  std::string topic;
  std::string encoding;  ///< of its messages, "cdr" for one
  std::string schema;    ///< "sensor_msgs/msg/JointState" for one
};
using McapChannels = std::map<std::uint16_t, McapChannel>;

/// Reads a file from end to end, whether or not it has chunks, an index or an end; in memory for
/// its largest chunk. Chunks are plain, lz4 or zstd. What a recorder that was killed leaves ends
/// with its last whole record: torn_at() tells.
///
/// Sizes are checked before memory is taken, checksums wherever the file has them.
class McapReader {
 public:
  /// @param known channels that files of this name have, for who begins in the middle
  /// @throw InputError unless it is there and begins as an MCAP file does
  explicit McapReader(const std::filesystem::path& file, McapChannels known = {});

  struct Message {
    const McapChannel* channel = nullptr;
    std::string_view data;    ///< good until the next call
    std::int64_t log_ns = 0;  ///< when it was recorded, at most kLastLog_ns
    std::int64_t record = 0;  ///< where in the file its record begins, or its chunk's
    bool in_chunk = false;
  };
  /// @return false at the end
  /// @throw InputError if the file is damaged, or needs what isn't read
  bool next(Message& message);

  /// Where a message begins: its record, or its chunk's; then how far into the chunk's content.
  struct Mark {
    std::int64_t record = 0, within = 0;
  };
  Mark mark() const;  ///< of the message that comes next
  void go_to(const Mark& mark);

  const McapChannels& channels() const { return channels_; }  ///< so far
  /// Where the file ends, unless by an end of its own.
  const std::optional<std::int64_t>& torn_at() const { return torn_at_; }
  std::int64_t bytes_read() const { return at_; }

 private:
  bool next_record();
  bool read(char* to, std::uint64_t size);
  bool take(McapOp op, std::string_view content, Message& message);
  void open_chunk();
  void end_data();
  [[noreturn]] void damaged(const std::string& why) const;

  std::filesystem::path file_;
  std::ifstream in_;
  std::int64_t size_ = 0, at_ = 0;  // of the file
  std::int64_t record_at_ = 0;      // where the record begins that it is at
  McapOp op_ = McapOp::kHeader;
  std::string record_, unpacked_;  // content of the record, of the chunk
  std::string_view chunk_;         // the same as it is without compression; empty: in none
  std::size_t chunk_at_ = 0;
  std::map<std::uint16_t, std::string> schemas_;  // names
  McapChannels channels_;
  std::optional<std::int64_t> torn_at_;
  std::uint32_t crc_ = 0;  // of all bytes up to record_at_, while it is known
  bool crc_known_ = true, ended_ = false;
};

}  // namespace soilvdb::inline v0::io
