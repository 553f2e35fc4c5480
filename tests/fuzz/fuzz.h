// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What the fuzz targets share. A target reads a file that holds the fuzzer's bytes; all that may
// come of it is a result or the exceptions its reader documents. Anything else is a find: another
// exception, a sanitizer's report, more work than kMost_s, a message of two lines.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <ctime>
#include <iostream>
#include <string_view>

#include "soilvdb/io/error.h"
#include "tests/support/sanitized.h"
#include "tests/support/temp_folder.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace soilvdb::fuzz {

inline std::string_view text(const std::uint8_t* data, std::size_t size) {
  return {reinterpret_cast<const char*>(data), size};
}

inline void require(bool holds, std::string_view what) {
  if (holds) return;
  std::cerr << "does not hold: " << what << std::endl;
  std::abort();
}

/// The promise about messages: one line.
inline void check_message(const std::exception& error) {
  require(std::string_view(error.what()).find('\n') == std::string_view::npos, error.what());
}

/// CPU seconds that an input may take in a release. Sanitizers make a search in PROJ's database 25
/// times as long: 0.07 s for a CRS without its number became 1.8 s.
inline constexpr double kMost_s = 2;

/// Calls `read`, which may throw InputError and spend kMost_s.
template <typename F>
void expect_read_or_refused(F&& read) {
  const std::clock_t start = std::clock();
  try {
    read();
  } catch (const io::InputError& error) {
    check_message(error);
  }
  require(std::clock() - start < test::cpu_s(kMost_s), "no more time than an input may take");
}

}  // namespace soilvdb::fuzz
