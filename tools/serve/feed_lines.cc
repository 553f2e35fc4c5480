// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/feed_lines.h"

#include <algorithm>

#include "tools/serve/live_site.h"

namespace soilvdb::tools {

bool FeedLines::feed(const Feed& feed) {
  const auto until = std::chrono::steady_clock::now() + kFeedTurn;
  while (at_ < lines_.size()) {
    const std::size_t end = std::min(lines_.find('\n', at_), lines_.size());
    const std::string_view line = std::string_view(lines_).substr(at_, end - at_);
    at_ = end + 1;
    if (line.find_first_not_of(" \t\r") == std::string_view::npos) continue;
    if (!answers_.empty()) answers_ += '\n';
    const std::string answer = feed(line);
    any_taken_ |= !is_refusal(answer);
    answers_ += answer;
    if (std::chrono::steady_clock::now() >= until) break;
  }
  if (at_ < lines_.size()) return true;
  if (answers_.empty()) answers_ = R"({"error":"an empty message; send a line of JSON"})";
  return false;
}

}  // namespace soilvdb::tools
