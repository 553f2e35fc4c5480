// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The lines of a feed's message, or of a post.
#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <string>
#include <string_view>
#include <utility>

namespace soilvdb::tools {

/// Longest work of a feed before others have their turn.
inline constexpr std::chrono::microseconds kFeedTurn{200};

/// Feeds lines one after another, in turns, so that other clients have theirs in between.
class FeedLines {
 public:
  /// Feeds a line. @return its answer, a line of JSON
  using Feed = std::function<std::string(std::string_view)>;

  FeedLines() = default;
  explicit FeedLines(std::string lines) : lines_(std::move(lines)) {}

  /// Feeds the next lines for a short time. @return are more left?
  bool feed(const Feed& feed);
  /// Of the lines so far, a line each. Without any, an error tells so.
  const std::string& answers() const { return answers_; }
  /// Was a line not refused?
  bool any_taken() const { return any_taken_; }

 private:
  std::string lines_, answers_;
  std::size_t at_ = 0;  ///< of the next of `lines_`
  bool any_taken_ = false;
};

}  // namespace soilvdb::tools
