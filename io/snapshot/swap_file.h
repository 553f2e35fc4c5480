// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Ground that is unused for now, in an unnamed file that disappears with the program.
#pragma once

#include <filesystem>
#include <mutex>
#include <vector>

#include "soilvdb/swap_store.h"

namespace soilvdb::inline v0::io {

/// Each record has a CRC-64 of its bytes and its place. The file grows to its largest content; room
/// of removed records is used again.
class SwapFile final : public SwapStore {
 public:
  /// @param folder of the file. @throw std::runtime_error if the file can't be made
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
  mutable std::mutex mutex_;                      // guards the following members
  std::vector<std::vector<std::uint32_t>> gaps_;  // by length in units
  std::uint32_t end_ = 1;                         // the first unit that was never used
};

}  // namespace soilvdb::inline v0::io
