// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/progress.h"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string_view>

namespace soilvdb::tools {
namespace {

bool is_terminal() {
  const char* term = std::getenv("TERM");
  return isatty(STDERR_FILENO) && term && std::string_view(term) != "dumb";
}

int terminal_columns() {
  winsize size{};
  if (ioctl(STDERR_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col == 0) return 80;
  return size.ws_col;
}

}  // namespace

std::string short_duration(double seconds) {
  if (seconds < 0.0995) return fmt::format("{:.2g} ms", seconds * 1e3);
  if (seconds < 0.9995) return fmt::format("{:.0f} ms", seconds * 1e3);
  if (seconds < 9.95) return fmt::format("{:.1f} s", seconds);
  const auto s = static_cast<std::int64_t>(std::llround(seconds));
  if (s < 60) return fmt::format("{} s", s);
  if (s < 3600) return fmt::format("{}:{:02}", s / 60, s % 60);
  return fmt::format("{}:{:02}:{:02}", s / 3600, s / 60 % 60, s % 60);
}

std::string short_count(double count) {
  if (count < 9.5) return fmt::format("{:.2g}", count);
  if (count < 999.5) return fmt::format("{:.0f}", count);
  for (const char* unit : {"k", "M", "G"}) {
    count /= 1000;
    if (count < 999.5 || *unit == 'G')
      return fmt::format("{:.{}f}{}", count, count < 9.995 ? 2 : count < 99.95 ? 1 : 0, unit);
  }
  return {};
}

std::string progress_line(const std::string& title, std::int64_t done, std::int64_t total,
                          const std::string& unit, double elapsed_s, int columns) {
  const double share = total > 0 ? static_cast<double>(done) / static_cast<double>(total) : 1;
  const double rate = elapsed_s > 0 ? static_cast<double>(done) / elapsed_s : 0;
  std::string tail =
      fmt::format(" {:3.0f} %  {}{}/s", std::floor(share * 100), short_count(rate), unit);
  if (rate > 0 && done < total)
    tail += fmt::format("  {} left", short_duration(static_cast<double>(total - done) / rate));

  const int room = columns - 1 - static_cast<int>(tail.size());
  if (room < 0) return tail.substr(0, static_cast<std::size_t>(std::max(0, columns - 1)));
  std::string head = title.empty() ? "" : title + ' ';
  constexpr int kShortestBar = 10;
  if (room < static_cast<int>(head.size()) + kShortestBar + 2) head.clear();
  const int bar = std::min(40, room - static_cast<int>(head.size()) - 2);
  if (bar < 1) return tail;
  const int full = static_cast<int>(share * bar);
  return fmt::format("{}[{}{}]{}", head, std::string(static_cast<std::size_t>(full), '#'),
                     std::string(static_cast<std::size_t>(bar - full), '.'), tail);
}

Progress::Progress(std::string title, std::int64_t total, std::string unit)
    : title_(std::move(title)), total_(total), unit_(std::move(unit)), on_(is_terminal()) {}

void Progress::draw(std::int64_t done) {
  const Clock::time_point now = Clock::now();
  if (now < next_) return;
  next_ = now + std::chrono::milliseconds(100);
  const double elapsed_s = std::chrono::duration<double>(now - begin_).count();
  const std::string line =
      progress_line(title_, done, total_, unit_, elapsed_s, terminal_columns());
  std::fputs(("\r\033[K" + line).c_str(), stderr);
  std::fflush(stderr);
  drawn_ = true;
}

void Progress::clear() {
  if (!drawn_) return;
  std::fputs("\r\033[K", stderr);
  std::fflush(stderr);
  drawn_ = false;
}

}  // namespace soilvdb::tools
