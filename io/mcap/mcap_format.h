// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The MCAP container format, version 0 (mcap.dev/spec): its records, and little-endian fields.
#pragma once

#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>

namespace soilvdb::inline v0::io {

/// A file begins and ends with these bytes.
inline constexpr std::string_view kMcapMagic("\x89MCAP0\r\n", 8);

/// Opcode of a record: one byte, before its content's size in eight bytes and the content.
enum class McapOp : std::uint8_t {
  kHeader = 0x01,
  kFooter = 0x02,
  kSchema = 0x03,
  kChannel = 0x04,
  kMessage = 0x05,
  kChunk = 0x06,
  kMessageIndex = 0x07,
  kChunkIndex = 0x08,
  kStatistics = 0x0B,
  kMetadata = 0x0C,
  kMetadataIndex = 0x0D,
  kSummaryOffset = 0x0E,
  kDataEnd = 0x0F,
};
inline constexpr std::size_t kMcapRecordHead = 9;

/// A record ends within a field.
struct McapShort : std::runtime_error {
  McapShort() : std::runtime_error("a record ends within a field") {}
};

/// Reads the fields of a record in order.
class McapFields {
 public:
  explicit McapFields(std::string_view bytes) : bytes_(bytes) {}

  template <typename T>
  requires std::is_integral_v<T> T number() {
    T value;
    std::memcpy(&value, take(sizeof value).data(), sizeof value);
    return value;
  }
  std::string_view text() { return take(number<std::uint32_t>()); }
  /// @throw McapShort as the other members do
  std::string_view take(std::uint64_t size) {
    if (size > bytes_.size()) throw McapShort();
    const std::string_view taken = bytes_.substr(0, static_cast<std::size_t>(size));
    bytes_.remove_prefix(taken.size());
    return taken;
  }
  std::string_view rest() const { return bytes_; }

 private:
  std::string_view bytes_;
};

template <typename T>
requires std::is_integral_v<T>
void put_field(std::string& out, T value) {
  out.append(reinterpret_cast<const char*>(&value), sizeof value);
}
inline void put_field(std::string& out, std::string_view text) {
  put_field(out, static_cast<std::uint32_t>(text.size()));
  out += text;
}
inline void put_record(std::string& out, McapOp op, std::string_view content) {
  out += static_cast<char>(op);
  put_field(out, static_cast<std::uint64_t>(content.size()));
  out += content;
}

}  // namespace soilvdb::inline v0::io
