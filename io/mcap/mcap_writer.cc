// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/mcap/mcap_writer.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "io/mcap/compression.h"
#include "soilvdb/io/checksum.h"
#include "soilvdb/version.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::size_t kChunkBytes = std::size_t{1} << 20;  // uncompressed

[[noreturn]] void fail(const std::filesystem::path& file) {
  throw std::runtime_error(fmt::format("{}: can't be written: {}", file.string(),
                                       std::generic_category().message(errno)));
}

void put_texts(std::string& out, const McapWriter::Texts& texts) {
  std::string content;
  for (const auto& [key, value] : texts) {
    put_field(content, key);
    put_field(content, value);
  }
  put_field(out, std::string_view(content));
}

void put_numbers(std::string& out, const std::map<std::uint16_t, std::uint64_t>& numbers) {
  put_field(out, static_cast<std::uint32_t>(10 * numbers.size()));
  for (const auto& [key, value] : numbers) {
    put_field(out, key);
    put_field(out, value);
  }
}

}  // namespace

McapWriter::McapWriter(std::filesystem::path file, std::string_view profile)
    : file_(std::move(file)) {
  descriptor_ = open(file_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (descriptor_ < 0) fail(file_);
  std::string begin(kMcapMagic), header;
  put_field(header, profile);
  put_field(header, std::string_view("soilvdb " SOILVDB_VERSION));
  put_record(begin, McapOp::kHeader, header);
  append(begin);
}

McapWriter::~McapWriter() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

void McapWriter::append(std::string_view bytes) {
  crc_ = crc32(bytes, crc_);
  at_ += bytes.size();
  while (!bytes.empty()) {
    const ssize_t written = ::write(descriptor_, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) fail(file_);
    bytes.remove_prefix(static_cast<std::size_t>(written));
  }
}

std::uint16_t McapWriter::add_channel(const std::string& topic, const McapSchema& schema,
                                      const std::string& encoding) {
  const auto [known, is_new] =
      schemas_.try_emplace(schema.name, static_cast<std::uint16_t>(schemas_.size() + 1));
  if (is_new) {
    std::string content;
    put_field(content, known->second);
    put_field(content, schema.name);
    put_field(content, schema.encoding);
    put_field(content, schema.text);
    put_record(schema_records_, McapOp::kSchema, content);
    put_record(plain_, McapOp::kSchema, content);
  }
  const auto id = static_cast<std::uint16_t>(channels_.size());
  channels_[id];
  std::string content;
  put_field(content, id);
  put_field(content, known->second);
  put_field(content, topic);
  put_field(content, encoding);
  put_texts(content, {});
  put_record(channel_records_, McapOp::kChannel, content);
  put_record(plain_, McapOp::kChannel, content);
  return id;
}

void McapWriter::add_metadata(const std::string& name, const Texts& texts) {
  std::string content, record;
  put_field(content, name);
  put_texts(content, texts);
  put_record(record, McapOp::kMetadata, content);
  metadata_.push_back({name, at_, record.size()});
  append(record);
}

void McapWriter::write(std::uint16_t channel, std::uint64_t time_ns, std::string_view message) {
  Times& times = channels_.at(channel);
  chunk_.begin_ns = in_chunk_ == 0 ? time_ns : std::min(chunk_.begin_ns, time_ns);
  chunk_.end_ns = in_chunk_ == 0 ? time_ns : std::max(chunk_.end_ns, time_ns);
  ++in_chunk_;
  put_field(times.entries, time_ns);
  put_field(times.entries, static_cast<std::uint64_t>(plain_.size()));
  std::string head;
  put_field(head, channel);
  put_field(head, static_cast<std::uint32_t>(times.messages++));
  put_field(head, time_ns);
  put_field(head, time_ns);
  plain_ += static_cast<char>(McapOp::kMessage);
  put_field(plain_, static_cast<std::uint64_t>(head.size() + message.size()));
  plain_ += head;
  plain_ += message;
  if (plain_.size() >= kChunkBytes) flush();
}

void McapWriter::flush() {
  if (plain_.empty()) return;
  const std::string packed = compress_zstd(plain_);
  std::string content;
  put_field(content, chunk_.begin_ns);
  put_field(content, chunk_.end_ns);
  put_field(content, static_cast<std::uint64_t>(plain_.size()));
  put_field(content, crc32(plain_));
  put_field(content, std::string_view("zstd"));
  put_field(content, static_cast<std::uint64_t>(packed.size()));
  content += packed;
  std::string record;
  put_record(record, McapOp::kChunk, content);
  chunk_.at = at_;
  chunk_.bytes = record.size();
  chunk_.packed_bytes = packed.size();
  chunk_.plain_bytes = plain_.size();
  for (auto& [channel, times] : channels_) {
    if (times.entries.empty()) continue;
    chunk_.index_at[channel] = at_ + record.size();
    std::string index;
    put_field(index, channel);
    put_field(index, std::string_view(times.entries));
    put_record(record, McapOp::kMessageIndex, index);
    times.entries.clear();
  }
  chunk_.index_bytes = record.size() - chunk_.bytes;
  append(record);
  chunks_.push_back(std::exchange(chunk_, {}));
  plain_.clear();
  in_chunk_ = 0;
}

std::string McapWriter::chunk_index(const Chunk& chunk) const {
  std::string content;
  for (const std::uint64_t v : {chunk.begin_ns, chunk.end_ns, chunk.at, chunk.bytes})
    put_field(content, v);
  put_numbers(content, chunk.index_at);
  put_field(content, chunk.index_bytes);
  put_field(content, std::string_view("zstd"));
  put_field(content, chunk.packed_bytes);
  put_field(content, chunk.plain_bytes);
  return content;
}

std::string McapWriter::statistics() const {
  std::map<std::uint16_t, std::uint64_t> counts;
  std::uint64_t messages = 0, begin_ns = 0, end_ns = 0;
  for (const auto& [channel, times] : channels_) messages += counts[channel] = times.messages;
  bool first = true;
  for (const Chunk& chunk : chunks_) {
    if (chunk.index_at.empty()) continue;
    begin_ns = first ? chunk.begin_ns : std::min(begin_ns, chunk.begin_ns);
    end_ns = std::max(end_ns, chunk.end_ns);
    first = false;
  }
  std::string content;
  put_field(content, messages);
  put_field(content, static_cast<std::uint16_t>(schemas_.size()));
  put_field(content, static_cast<std::uint32_t>(channels_.size()));
  put_field(content, std::uint32_t{0});  // attachments
  put_field(content, static_cast<std::uint32_t>(metadata_.size()));
  put_field(content, static_cast<std::uint32_t>(chunks_.size()));
  put_field(content, begin_ns);
  put_field(content, end_ns);
  put_numbers(content, counts);
  return content;
}

void McapWriter::close() {
  flush();
  std::string end, crc;
  put_field(crc, crc_);
  put_record(end, McapOp::kDataEnd, crc);
  append(end);
  const std::uint64_t summary_at = at_;
  std::string summary, offsets;
  const auto add_group = [&](McapOp op, std::string_view records) {
    if (records.empty()) return;
    std::string offset;
    put_field(offset, static_cast<std::uint8_t>(op));
    put_field(offset, summary_at + summary.size());
    put_field(offset, static_cast<std::uint64_t>(records.size()));
    put_record(offsets, McapOp::kSummaryOffset, offset);
    summary += records;
  };
  add_group(McapOp::kSchema, schema_records_);
  add_group(McapOp::kChannel, channel_records_);
  std::string records;
  put_record(records, McapOp::kStatistics, statistics());
  add_group(McapOp::kStatistics, records);
  records.clear();
  for (const Chunk& chunk : chunks_) put_record(records, McapOp::kChunkIndex, chunk_index(chunk));
  add_group(McapOp::kChunkIndex, records);
  records.clear();
  for (const Metadata& metadata : metadata_) {
    std::string content;
    put_field(content, metadata.at);
    put_field(content, metadata.bytes);
    put_field(content, metadata.name);
    put_record(records, McapOp::kMetadataIndex, content);
  }
  add_group(McapOp::kMetadataIndex, records);
  const std::uint64_t offsets_at = summary_at + summary.size();
  summary += offsets;
  std::string footer;
  put_field(footer, summary_at);
  put_field(footer, offsets_at);
  summary += static_cast<char>(McapOp::kFooter);
  put_field(summary, static_cast<std::uint64_t>(footer.size() + sizeof(std::uint32_t)));
  summary += footer;
  put_field(summary, crc32(summary));
  summary += kMcapMagic;
  append(summary);
  if (fsync(descriptor_) != 0) fail(file_);
  if (::close(std::exchange(descriptor_, -1)) != 0) fail(file_);
}

}  // namespace soilvdb::inline v0::io
