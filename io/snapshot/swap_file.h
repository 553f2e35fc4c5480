// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Ground that isn't needed for now, in a file without a name: it is gone when the program ends.
#pragma once

#include <filesystem>
#include <mutex>
#include <vector>

#include "soilvdb/swap_store.h"

namespace soilvdb::inline v0::io {

/// Each record has a CRC-64 of its bytes and its place. The file grows to what was in it at most;
/// room that records leave is taken again.
class SwapFile final : public SwapStore {
 public:
  /// @param folder in which the file is made. @throw std::runtime_error if it can't be
  explicit SwapFile(const std::filesystem::path& folder);
  ~SwapFile() override;
  SwapFile(const SwapFile&) = delete;
  SwapFile& operator=(const SwapFile&) = delete;

  std::uint32_t put(std::string_view bytes) override;
  void get(std::uint32_t number, std::string& bytes) const override;
  void drop(std::uint32_t number, std::size_t size) override;

  std::uint64_t size_bytes() const;  ///< of the file

 private:
  std::filesystem::path folder_;
  int descriptor_ = -1;
  mutable std::mutex mutex_;                      // over what follows
  std::vector<std::vector<std::uint32_t>> gaps_;  // by their length, in units
  std::uint32_t end_ = 1;                         // the first unit that was never used
};

}  // namespace soilvdb::inline v0::io
