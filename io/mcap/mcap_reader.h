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

/// Later times (after 2096) become this one, so that differences of two times fit into 64 bits.
inline constexpr std::int64_t kLastLog_ns = 4'000'000'000'000'000'000;

struct McapChannel {
  std::string topic;
  std::string encoding;  ///< of its messages, such as "cdr"
  std::string schema;    ///< such as "sensor_msgs/msg/JointState"
};
using McapChannels = std::map<std::uint16_t, McapChannel>;

/// Reads a file from start to end, with or without chunks, index or footer; holds the largest chunk
/// in memory. Chunks may be plain, lz4 or zstd. A file of a killed recorder ends at its last whole
/// record, see torn_at().
///
/// Sizes are checked before memory is allocated, and all checksums that the file has.
class McapReader {
 public:
  /// @param known channels of this file, for a reader that begins in its middle
  /// @throw InputError unless the file exists and begins as an MCAP file
  explicit McapReader(const std::filesystem::path& file, McapChannels known = {});

  struct Message {
    const McapChannel* channel = nullptr;
    std::string_view data;    ///< valid until the next call
    std::int64_t log_ns = 0;  ///< time of recording, at most kLastLog_ns
    std::int64_t record = 0;  ///< offset in the file of its record, or of its chunk's record
    bool in_chunk = false;
  };
  /// @return false at the end
  /// @throw InputError if the file is damaged, or needs an unsupported feature
  bool next(Message& message);

  /// Where a message begins: its record's or chunk's offset, and its offset within the chunk.
  struct Mark {
    std::int64_t record = 0, within = 0;
  };
  Mark mark() const;  ///< of the next message
  void go_to(const Mark& mark);

  const McapChannels& channels() const { return channels_; }  ///< so far
  /// Where the file ends if its footer is missing.
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
  std::int64_t record_at_ = 0;      // offset of the current record
  McapOp op_ = McapOp::kHeader;
  std::string record_, unpacked_;  // content of the record; of the chunk
  std::string_view chunk_;         // the chunk's uncompressed content; empty: not in a chunk
  std::size_t chunk_at_ = 0;
  std::map<std::uint16_t, std::string> schemas_;  // names
  McapChannels channels_;
  std::optional<std::int64_t> torn_at_;
  std::uint32_t crc_ = 0;  // of all bytes before record_at_, while known
  bool crc_known_ = true, ended_ = false;
};

}  // namespace soilvdb::inline v0::io
