// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Writes MCAP files that can be read while they grow, and after a crash.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "io/mcap/mcap_format.h"

namespace soilvdb::inline v0::io {

struct McapSchema {
  std::string name, encoding, text;
};

/// Gathers messages into chunks compressed by zstd, each with its schemas, channels, index and
/// checksum, and appends whole chunks. close() writes the footer with an index. Without it a reader
/// has all appended chunks. The same calls write the same bytes.
///
/// All members throw std::runtime_error naming the file and the cause. Not thread-safe.
class McapWriter {
 public:
  using Texts = std::map<std::string, std::string>;

  /// Begins the file anew.
  explicit McapWriter(std::filesystem::path file, std::string_view profile = "");
  /// The file on disk stays as it is.
  ~McapWriter();
  McapWriter(const McapWriter&) = delete;
  McapWriter& operator=(const McapWriter&) = delete;

  /// @param encoding of its messages @return the channel's number
  std::uint16_t add_channel(const std::string& topic, const McapSchema& schema,
                            const std::string& encoding);
  /// Adds metadata of the file, which readers may ignore.
  void add_metadata(const std::string& name, const Texts& texts);

  void write(std::uint16_t channel, std::uint64_t time_ns, std::string_view message);

  /// Appends all messages so far, so that they survive a crash of the process.
  void flush();
  /// Ends the file and syncs it. Nothing may follow.
  void close();

 private:
  /// A chunk: an appended one or the current one.
  struct Chunk {
    std::uint64_t begin_ns = 0, end_ns = 0, at = 0, bytes = 0, index_bytes = 0;
    std::uint64_t packed_bytes = 0, plain_bytes = 0;
    std::map<std::uint16_t, std::uint64_t> index_at;  // by channel
  };
  struct Metadata {
    std::string name;
    std::uint64_t at = 0, bytes = 0;
  };
  struct Times {
    std::string entries;  // of its index in the current chunk: time and offset, 8 bytes each
    std::uint64_t messages = 0;
  };

  void append(std::string_view bytes);
  std::string chunk_index(const Chunk& chunk) const;
  std::string statistics() const;

  std::filesystem::path file_;
  int descriptor_ = -1;
  std::uint64_t at_ = 0;
  std::uint32_t crc_ = 0;  // of all bytes before at_

  std::string plain_;           // the current chunk
  Chunk chunk_;                 // of the current chunk
  std::uint64_t in_chunk_ = 0;  // messages in the current chunk
  std::vector<Chunk> chunks_;
  std::vector<Metadata> metadata_;
  std::map<std::string, std::uint16_t> schemas_;  // by name
  std::string schema_records_, channel_records_;
  std::map<std::uint16_t, Times> channels_;
};

}  // namespace soilvdb::inline v0::io
