// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// CDR, the encoding of ROS 2 messages (OMG DDSI-RTPS 10.2, CORBA 15.3): four bytes with the byte
// order, then fields, each aligned to its size relative to the end of these four bytes.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>

namespace soilvdb::inline v0::io {

/// Not CDR, or truncated.
struct CdrError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Reads the fields of a message in order. All members throw CdrError.
class CdrReader {
 public:
  explicit CdrReader(std::string_view message) {
    if (message.size() < kHead) throw CdrError("has no head of four bytes");
    const auto kind = static_cast<std::uint8_t>(message[1]);
    if (message[0] != 0 || kind > 1)
      throw CdrError("has a head that isn't that of plain CDR, 00 00 or 00 01");
    swap_ = kind == 0;  // big-endian
    bytes_ = message.substr(kHead);
  }

  template <typename T>
  requires std::is_arithmetic_v<T> T number() {
    skip_to(sizeof(T));
    T value;
    char* raw = reinterpret_cast<char*>(&value);
    std::memcpy(raw, take(sizeof value).data(), sizeof value);
    if (swap_) std::reverse(raw, raw + sizeof value);
    return value;
  }
  /// Without the terminating zero.
  std::string_view text() {
    std::string_view text = take(number<std::uint32_t>());
    if (text.ends_with('\0')) text.remove_suffix(1);
    if (text.find('\0') != text.npos) throw CdrError("has a zero within a text");
    return text;
  }
  /// A list of bytes.
  std::string_view bytes() { return take(number<std::uint32_t>()); }
  /// Number of the following elements of at least `least` bytes each; never more than fit.
  std::uint32_t count(std::size_t least) {
    const auto n = number<std::uint32_t>();
    if (n > (bytes_.size() - at_) / least) throw CdrError("is shorter than a list in it");
    return n;
  }

 private:
  static constexpr std::size_t kHead = 4;

  void skip_to(std::size_t alignment) {
    const std::size_t over = at_ % alignment;
    if (over > 0) take(alignment - over);
  }
  std::string_view take(std::size_t size) {
    if (size > bytes_.size() - at_) throw CdrError("ends within a field");
    at_ += size;
    return bytes_.substr(at_ - size, size);
  }

  std::string_view bytes_;
  std::size_t at_ = 0;
  bool swap_ = false;
};

/// Writes a message, little-endian.
class CdrWriter {
 public:
  template <typename T>
  requires std::is_arithmetic_v<T>
  void put(T value) {
    const std::size_t over = (bytes_.size() - kHead) % sizeof(T);
    if (over > 0) bytes_.append(sizeof(T) - over, '\0');
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof value);
  }
  void put(std::string_view text) {
    put(static_cast<std::uint32_t>(text.size() + 1));
    bytes_ += text;
    bytes_ += '\0';
  }
  template <typename... T>
  void put_all(T... values) {
    (put(values), ...);
  }
  const std::string& bytes() const { return bytes_; }

 private:
  static constexpr std::size_t kHead = 4;
  std::string bytes_ = std::string("\0\1\0\0", kHead);
};

}  // namespace soilvdb::inline v0::io
