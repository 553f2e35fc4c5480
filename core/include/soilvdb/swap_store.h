// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Storage for ground that is not in memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace soilvdb::inline v0 {

/// Numbered byte records. Threads may call all members concurrently.
class SwapStore {
 public:
  virtual ~SwapStore() = default;
  /// Stores a record. @return its number, > 0. @throw std::runtime_error if storing fails
  virtual std::uint32_t put(std::string_view bytes) = 0;
  /// Reads a record. @throw std::runtime_error if the bytes are no longer those stored
  virtual void get(std::uint32_t record, std::string& bytes) const = 0;
  /// Removes a record; its number may be reused. @param size bytes
  virtual void drop(std::uint32_t record, std::size_t size) = 0;
};

}  // namespace soilvdb::inline v0
