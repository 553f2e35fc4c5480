// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Under sanitizers code takes ten times as long, so tests whose finest scenes run the code of
// coarser ones leave those out. Long forms of tests are for releases.
#pragma once

#include <cstdlib>
#include <ctime>

namespace soilvdb::test {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
inline constexpr bool kSanitized = true;
#else
inline constexpr bool kSanitized = false;
#endif

/// CPU time that a test may take, by std::clock(): the time of a clock is that of a machine's other
/// work as well.
inline constexpr std::clock_t cpu_s(double seconds) {
  return static_cast<std::clock_t>((kSanitized ? 10 : 1) * seconds * CLOCKS_PER_SEC);
}

/// `tools/test --long` sets it.
inline const bool kLong = std::getenv("SOILVDB_LONG") != nullptr;

}  // namespace soilvdb::test
