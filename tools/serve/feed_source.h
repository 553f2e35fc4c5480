// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Where the lines of a feed come from.
#pragma once

#include <string>

namespace soilvdb::tools {

/// A connection, or the standard input. The machines that it feeds share it.
struct FeedSource {
  enum class Link {
    kLive,
    kLost,   ///< nothing is heard of it, or it broke off
    kEnded,  ///< it said goodbye
  };
  std::string name = {};
  Link link = Link::kLive;
};

}  // namespace soilvdb::tools
