// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Points from numbers of all types in memory: the common part of all scans.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "soilvdb/io/point_cloud.h"

namespace soilvdb::inline v0::io {

enum class NumberType : std::uint8_t { kI8, kU8, kI16, kU16, kI32, kU32, kI64, kU64, kF32, kF64 };

constexpr std::size_t size_of(NumberType type) {
  constexpr std::array<std::uint8_t, 10> kSizes = {1, 1, 2, 2, 4, 4, 8, 8, 4, 8};
  return kSizes[static_cast<std::size_t>(type)];
}

/// The number at `at`. @param swap in the other byte order
double number_at(const char* at, NumberType type, bool swap);

/// One coordinate of all points in memory.
struct Axis {
  const char* at = nullptr;  ///< of the first point
  std::size_t stride = 0;    ///< bytes from point to point
  NumberType type = NumberType::kF32;
};
using Axes = std::array<Axis, 3>;

/// Collects the points of a cloud.
class CloudBuilder {
 public:
  /// @param zero_is_none (0, 0, 0) means that there was no return
  explicit CloudBuilder(bool zero_is_none = true) : zero_is_none_(zero_is_none) {}

  /// @param points expected number; the caller has found their bytes
  void expect(std::size_t points) { cloud_.points_m.reserve(points); }
  /// @return false, and the point is not kept, if a coordinate is too large; see too_far()
  bool add(const Vec3& p) {
    if (!p.allFinite() || (zero_is_none_ && p.isZero(0))) {
      ++cloud_.without_return;
      return true;
    }
    if (is_too_far(p)) return false;
    cloud_.points_m.push_back(p);
    return true;
  }
  /// Adds `count` points. @return the index of the first that is too far; empty if there is none
  std::optional<std::size_t> add(const Axes& axes, std::size_t count, bool swap);

  std::size_t seen() const { return cloud_.points_m.size() + cloud_.without_return; }
  PointCloud take() { return std::move(cloud_); }

  /// What is wrong with the point that add() refused.
  static std::string too_far(const Vec3& p);

 private:
  static bool is_too_far(const Vec3& p);

  PointCloud cloud_;
  bool zero_is_none_;
};

/// The point at an index of `axes`.
Vec3 point_at(const Axes& axes, std::size_t index, bool swap);

}  // namespace soilvdb::inline v0::io
