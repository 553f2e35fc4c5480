// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Where ground goes that isn't needed for now.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace soilvdb::inline v0 {

/// Records of bytes by number. All members may be called from several threads.
class SwapStore {
 public:
  virtual ~SwapStore() = default;
  /// Keeps a record. @return its number, above 0. @throw std::runtime_error if it can't be kept
  virtual std::uint32_t put(std::string_view bytes) = 0;
  /// Gives it back. @throw std::runtime_error if it isn't any more what was put
  virtual void get(std::uint32_t record, std::string& bytes) const = 0;
  /// Forgets it: its number may come again. @param size in bytes
  virtual void drop(std::uint32_t record, std::size_t size) = 0;
};

}  // namespace soilvdb::inline v0
