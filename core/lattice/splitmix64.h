// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Hashing of integers.
#pragma once

#include <cstdint>

namespace soilvdb::inline v0 {

/// A bijective mix of 64 bits (the finaliser of SplitMix64).
constexpr std::uint64_t splitmix64(std::uint64_t v) {
  v = (v ^ (v >> 30)) * 0xbf58476d1ce4e5b9u;
  v = (v ^ (v >> 27)) * 0x94d049bb133111ebu;
  return v ^ (v >> 31);
}

}  // namespace soilvdb::inline v0
