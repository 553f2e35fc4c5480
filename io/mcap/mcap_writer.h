// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Writes MCAP files that grow while somebody may read them, and that a crash leaves readable.
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
/// checksum, and appends those whole. close() writes the end with an index of it all; without that
/// a reader has every chunk that was appended. The same calls make the same bytes.
///
/// All throw std::runtime_error naming the file and the cause. For one thread.
class McapWriter {
 public:
  using Texts = std::map<std::string, std::string>;

  /// Begins the file anew.
  explicit McapWriter(std::filesystem::path file, std::string_view profile = "");
  /// The file stays as it is on disk.
  ~McapWriter();
  McapWriter(const McapWriter&) = delete;
  McapWriter& operator=(const McapWriter&) = delete;

  /// @param encoding of its messages @return its number
  std::uint16_t add_channel(const std::string& topic, const McapSchema& schema,
                            const std::string& encoding);
  /// Says something of the file itself; no readers need it.
  void add_metadata(const std::string& name, const Texts& texts);

  void write(std::uint16_t channel, std::uint64_t time_ns, std::string_view message);

  /// Appends what there is, so that it stays whatever becomes of the process.
  void flush();
  /// Ends the file and has it on disk for good. Nothing may follow.
  void close();

 private:
  /// A chunk that was appended, or the one that is under way.
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
    std::string entries;  // of its index in the chunk under way: time and place, each 8 bytes
    std::uint64_t messages = 0;
  };

  void append(std::string_view bytes);
  std::string chunk_index(const Chunk& chunk) const;
  std::string statistics() const;

  std::filesystem::path file_;
  int descriptor_ = -1;
  std::uint64_t at_ = 0;
  std::uint32_t crc_ = 0;  // of all before at_

  std::string plain_;           // the chunk under way
  Chunk chunk_;                 // the same
  std::uint64_t in_chunk_ = 0;  // its messages
  std::vector<Chunk> chunks_;
  std::vector<Metadata> metadata_;
  std::map<std::string, std::uint16_t> schemas_;  // by name
  std::string schema_records_, channel_records_;
  std::map<std::uint16_t, Times> channels_;
};

}  // namespace soilvdb::inline v0::io
