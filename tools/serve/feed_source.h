// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Where the lines of a feed come from.
#pragma once

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
    kLost,   ///< nothing is heard of it, or it broke off
    kEnded,  ///< it said goodbye
  };
  std::string name = {};
  Link link = Link::kLive;
  double silent_s = 0;  ///< since it was last heard, of the time in which it was listened to
};

}  // namespace soilvdb::tools
