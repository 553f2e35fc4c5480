// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Progress of a run as a bar on stderr, with rate and time left, if stderr is a terminal.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>

namespace soilvdb::tools {

/// A short duration: "27 ms", "1.8 s", "42 s", "3:05", "1:02:03".
std::string short_duration(double seconds);

/// A count with a k, M or G: "950", "12.3k", "1.50M".
std::string short_count(double count);

/// The bar's line, at most columns - 1 characters long.
/// @param unit of `done` and `total`, with the space before it: " updates", "B"
std::string progress_line(const std::string& title, std::int64_t done, std::int64_t total,
                          const std::string& unit, double elapsed_s, int columns);

/// Draws the line at most ten times a second, and erases it at the end.
class Progress {
 public:
  Progress(std::string title, std::int64_t total, std::string unit);
  ~Progress() { clear(); }
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  void update(std::int64_t done) {
    if (on_) draw(done);
  }
  void clear();

 private:
  using Clock = std::chrono::steady_clock;
  void draw(std::int64_t done);

  std::string title_;
  std::int64_t total_;
  std::string unit_;
  bool on_, drawn_ = false;
  Clock::time_point begin_ = Clock::now(), next_ = begin_ + std::chrono::milliseconds(200);
};

}  // namespace soilvdb::tools
