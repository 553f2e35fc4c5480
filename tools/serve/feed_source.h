// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Where the lines of a feed come from.
#pragma once

#include <chrono>
#include <cstddef>
#include <string>

namespace soilvdb::tools {

inline constexpr std::size_t kMostFeed = 64 << 10;  ///< bytes of a message of a feed
/// Silence after which a feed is lost. Viewers must know within 5 s, and they are told once a
/// second.
inline constexpr double kLost_s = 3.8;

/// A connection, or the standard input. The machines that it feeds share it.
struct FeedSource {
  enum class Link {
    kLive,
    kSilent,  ///< nothing is heard of it
    kBroken,  ///< it broke off
    kEnded,   ///< it said goodbye
  };
  using Clock = std::chrono::steady_clock;

  bool is_lost() const { return link == Link::kSilent || link == Link::kBroken; }
  void heard() {
    silent_s = 0;
    heard_at = Clock::now();
  }
  /// @return does the link change?
  bool set_link(Link to) {
    if (link == to) return false;
    link = to;
    if (to == Link::kBroken) broke_at = Clock::now();
    return true;
  }

  std::string name = {};
  Link link = Link::kLive;
  double silent_s = 0;  ///< since it was last heard, of the time in which it was listened to
  Clock::time_point heard_at = Clock::now(), broke_at = {};
};

}  // namespace soilvdb::tools
