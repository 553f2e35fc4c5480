// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/mcap/mcap_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "io/file/text.h"
#include "io/mcap/compression.h"
#include "soilvdb/io/checksum.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::uint64_t kMostBytes = 256 << 20;  // largest record or chunk

bool is_read(McapOp op) {
  switch (op) {
    case McapOp::kSchema:
    case McapOp::kChannel:
    case McapOp::kMessage:
    case McapOp::kChunk:
    case McapOp::kDataEnd:
      return true;
    default:
      return false;
  }
}

}  // namespace

McapReader::McapReader(const std::filesystem::path& file, McapChannels known)
    : file_(file), channels_(std::move(known)) {
  check_readable(file);
  in_.open(file, std::ios::binary);
  size_ = static_cast<std::int64_t>(std::filesystem::file_size(file));
  std::array<char, kMcapMagic.size()> magic{};
  if (!read(magic.data(), magic.size()) ||
      std::string_view(magic.data(), magic.size()) != kMcapMagic)
    throw InputError(file, "is not an MCAP file of version 0");
  crc_ = crc32(kMcapMagic);
}

/// @return false if the file ends too early
bool McapReader::read(char* to, std::uint64_t size) {
  if (size > static_cast<std::uint64_t>(size_ - at_)) return false;
  in_.read(to, static_cast<std::streamsize>(size));
  if (!in_) throw InputError(file_, fmt::format("can't be read at byte {}", at_));
  at_ += static_cast<std::int64_t>(size);
  return true;
}

/// Reads the next relevant record; false at the end.
bool McapReader::next_record() {
  constexpr std::uint64_t kBlock = 1 << 16;
  while (!ended_) {
    record_at_ = at_;
    std::array<char, kMcapRecordHead> head{};
    if (!read(head.data(), head.size())) break;
    McapFields fields({head.data(), head.size()});
    op_ = static_cast<McapOp>(fields.number<std::uint8_t>());
    const auto content = fields.number<std::uint64_t>();
    if (content > static_cast<std::uint64_t>(size_ - at_)) break;
    if (is_read(op_)) {
      if (content > kMostBytes)
        throw InputError(file_, fmt::format("has a record of {} bytes at byte {}; at most {} are "
                                            "read, so give its chunks another size",
                                            content, record_at_, kMostBytes));
      record_.resize(content);
      read(record_.data(), content);
      if (op_ == McapOp::kDataEnd) end_data();
      if (crc_known_) crc_ = crc32(record_, crc32({head.data(), head.size()}, crc_));
      if (ended_) return false;
      return true;
    }
    if (crc_known_) crc_ = crc32({head.data(), head.size()}, crc_);
    for (std::uint64_t left = content; left > 0; left -= record_.size()) {
      record_.resize(std::min(left, kBlock));
      read(record_.data(), record_.size());
      if (crc_known_) crc_ = crc32(record_, crc_);
    }
  }
  if (!ended_) torn_at_ = record_at_;
  at_ = record_at_;
  ended_ = true;
  return false;
}

void McapReader::end_data() {
  ended_ = true;
  std::uint32_t crc = 0;
  try {
    crc = McapFields(record_).number<std::uint32_t>();
  } catch (const McapShort& e) {
    damaged(e.what());
  }
  if (crc_known_ && crc != 0 && crc != crc_)
    damaged("its data have another checksum than when they were written");
}

void McapReader::damaged(const std::string& why) const {
  throw InputError(file_, fmt::format("is damaged at byte {}: {}; `mcap recover` keeps what is "
                                      "good of it",
                                      record_at_, why));
}

bool McapReader::next(Message& message) {
  while (true) {
    try {
      while (chunk_at_ < chunk_.size()) {
        McapFields fields(chunk_.substr(chunk_at_));
        const auto op = static_cast<McapOp>(fields.number<std::uint8_t>());
        const std::string_view content = fields.take(fields.number<std::uint64_t>());
        chunk_at_ += kMcapRecordHead + content.size();
        if (take(op, content, message)) return true;
      }
      chunk_ = {};
      chunk_at_ = 0;
      if (!next_record()) return false;
      if (op_ == McapOp::kChunk)
        open_chunk();
      else if (take(op_, record_, message))
        return true;
    } catch (const McapShort& e) {
      damaged(e.what());
    }
  }
}

/// @return whether it is a message
bool McapReader::take(McapOp op, std::string_view content, Message& message) {
  McapFields fields(content);
  if (op == McapOp::kSchema) {
    const auto id = fields.number<std::uint16_t>();
    schemas_[id] = fields.text();
    fields.text();  // its encoding
  } else if (op == McapOp::kChannel) {
    const auto id = fields.number<std::uint16_t>();
    const auto schema = schemas_.find(fields.number<std::uint16_t>());
    McapChannel channel;
    channel.topic = fields.text();
    channel.encoding = fields.text();
    if (schema != schemas_.end()) channel.schema = schema->second;
    channels_.try_emplace(id, std::move(channel));  // a repeated channel may be in use
  } else if (op == McapOp::kMessage) {
    const auto id = fields.number<std::uint16_t>();
    const auto channel = channels_.find(id);
    if (channel == channels_.end())
      damaged(fmt::format("a message has the unknown channel {}", id));
    fields.take(4);  // its number
    const auto log_ns = std::min<std::uint64_t>(fields.number<std::uint64_t>(), kLastLog_ns);
    fields.take(8);  // when it was sent
    message = {&channel->second, fields.rest(), static_cast<std::int64_t>(log_ns), record_at_,
               !chunk_.empty()};
    return true;
  }
  return false;
}

/// Makes the current record, a chunk, the source of the next messages.
void McapReader::open_chunk() {
  McapFields fields(record_);
  fields.take(16);  // times
  const auto size = fields.number<std::uint64_t>();
  const auto crc = fields.number<std::uint32_t>();
  const std::string_view compression = fields.text();
  const std::string_view bytes = fields.take(fields.number<std::uint64_t>());
  if (size > kMostBytes)
    throw InputError(file_, fmt::format("has a chunk of {} bytes at byte {}; at most {} are read",
                                        size, record_at_, kMostBytes));
  try {
    if (compression == "zstd") {
      unpacked_ = decompress_zstd(bytes, size);
    } else if (compression == "lz4") {
      unpacked_ = decompress_lz4(bytes, size);
    } else if (!compression.empty()) {
      throw InputError(file_, fmt::format("has chunks compressed by '{}'; lz4, zstd and plain "
                                          "ones are read",
                                          printable(compression)));
    } else if (size != bytes.size()) {
      throw std::invalid_argument("have another size than declared");
    }
  } catch (const std::invalid_argument& e) {
    damaged(fmt::format("a chunk's bytes {}", e.what()));
  }
  chunk_ = compression.empty() ? bytes : std::string_view(unpacked_);
  if (crc != 0 && crc != crc32(chunk_))
    damaged("a chunk has another checksum than when it was written");
}

McapReader::Mark McapReader::mark() const {
  if (chunk_at_ < chunk_.size()) return {record_at_, static_cast<std::int64_t>(chunk_at_)};
  return {at_, 0};
}

void McapReader::go_to(const Mark& mark) {
  const bool here = !chunk_.empty() && mark.record == record_at_;
  if (!here) {
    in_.clear();
    in_.seekg(mark.record);
    at_ = mark.record;
    crc_known_ = ended_ = false;
    torn_at_.reset();
    chunk_ = {};
    if (mark.within > 0) {
      try {
        if (!next_record() || op_ != McapOp::kChunk) damaged("it isn't what it was");
        open_chunk();
      } catch (const McapShort& e) {
        damaged(e.what());
      }
    }
  }
  chunk_at_ = static_cast<std::size_t>(mark.within);
}

}  // namespace soilvdb::inline v0::io
