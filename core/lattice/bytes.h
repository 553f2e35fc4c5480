// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Numbers as bytes and back, in the order of memory, which is little-endian.
#pragma once

#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>

#include "soilvdb/types.h"

namespace soilvdb::inline v0 {

template <typename T>
requires std::is_arithmetic_v<T>
void put(std::string& out, T value) {
  out.append(reinterpret_cast<const char*>(&value), sizeof(value));
}
inline void put(std::string& out, const Pose& pose) {
  for (const double v : pose.position) put(out, v);
  for (const double v : pose.rotation.coeffs()) put(out, v);
}
template <typename T, int N>
void put(std::string& out, const Eigen::Matrix<T, N, 1>& vector) {
  for (const T value : vector) put(out, value);
}
/// Several values, one after another.
template <typename A, typename B, typename... More>
void put(std::string& out, const A& first, const B& second, const More&... more) {
  put(out, first);
  put(out, second, more...);
}

inline void put_text(std::string& out, std::string_view text) {
  put(out, std::uint64_t{text.size()});
  out.append(text);
}

/// Takes a value off again. @return false if there are too few bytes
template <typename T>
requires std::is_arithmetic_v<T>
bool try_take(std::string_view& in, T& value) {
  if (in.size() < sizeof(value)) return false;
  std::memcpy(&value, in.data(), sizeof(value));
  in.remove_prefix(sizeof(value));
  return true;
}
/// The same. @throw std::invalid_argument if there are too few bytes
template <typename T>
requires std::is_arithmetic_v<T>
void take(std::string_view& in, T& value) {
  if (!try_take(in, value)) throw std::invalid_argument("the state ends too early");
}
inline void take(std::string_view& in, bool& value) {
  std::uint8_t byte = 0;
  take(in, byte);
  value = byte != 0;
}
/// An amount of soil, in samples or units of mass. @throw std::invalid_argument if it is too large
/// or negative
inline constexpr std::int64_t kMostAmount = std::int64_t{1} << 62;
inline void take_amount(std::string_view& in, std::int64_t& value,
                        std::int64_t most = kMostAmount) {
  take(in, value);
  if (value < 0 || value > most)
    throw std::invalid_argument("the state has an amount of soil that can't be");
}
inline void take(std::string_view& in, Pose& pose) {
  for (double& v : pose.position) take(in, v);
  for (double& v : pose.rotation.coeffs()) take(in, v);
}
template <typename T, int N>
void take(std::string_view& in, Eigen::Matrix<T, N, 1>& vector) {
  for (T& value : vector) take(in, value);
}
template <typename A, typename B, typename... More>
void take(std::string_view& in, A& first, B& second, More&... more) {
  take(in, first);
  take(in, second, more...);
}
inline std::string_view take_text(std::string_view& in) {
  std::uint64_t size = 0;
  take(in, size);
  if (size > in.size()) throw std::invalid_argument("the state ends too early");
  const std::string_view text = in.substr(0, size);
  in.remove_prefix(size);
  return text;
}

}  // namespace soilvdb::inline v0
