// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a machine's feed is: its source, the numbers of its states, the quality of its position.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>

#include "soilvdb/types.h"
#include "tools/serve/feed_source.h"

namespace soilvdb::tools {

/// Larger times count from 1970, as computers' clocks do; smaller ones from any beginning.
inline constexpr double kLeastEpoch_s = 1e9;

/// Kinds of a position by satellites, best first.
enum class Fix { kFixed, kFloat, kSingle };
/// As in a feed. @throw std::invalid_argument for another word
Fix fix_of(const std::string& word);
const char* word_of(Fix fix);

/// Numbers that a program gives to its states, so that it may send one again whose answer was lost.
/// The numbers of one count rise by 1; a 0 begins another count.
class SequenceCheck {
 public:
  struct Place {
    std::uint64_t missed = 0;       ///< numbers before it that never came
    std::string answer_given = {};  ///< not empty: the state was taken before
  };
  /// @param content digest of the state
  /// @throw std::invalid_argument for a number that belongs to another state
  Place check(std::uint64_t number, std::size_t content) const;
  void taken(std::uint64_t number, std::size_t content, const std::string& answer);
  /// It may be sent again, with other content, too.
  void refused(std::uint64_t number);
  /// Of the last state that was taken.
  std::optional<std::uint64_t> last() const;

 private:
  struct Known {
    std::uint64_t number;
    std::size_t content;
    std::string answer;
  };
  const Known* find(std::uint64_t number) const;
  std::deque<Known> known_;                 ///< newest last
  std::optional<std::uint64_t> next_ = {};  ///< one more than any that came; empty before the first
};

struct MachineFeed {
  using Clock = std::chrono::steady_clock;

  /// @throw std::invalid_argument if another source that lives feeds it. @param source null: any
  void require_owner(const FeedSource* source, const std::string& machine) const;
  /// "live", "lost" or "none".
  const char* link() const;
  /// Since the last line of this machine, s; empty before the first.
  std::optional<double> silent_s() const;

  std::shared_ptr<const FeedSource> source = {};  ///< of its last state; null: none yet
  std::optional<Clock::time_point> heard = {};
  std::optional<Fix> fix = {};
  std::optional<double> clock_ahead_s = {};  ///< of this computer's, if its times count from 1970
  /// Where it drove in states that were not placed, since its last state.
  std::optional<Pose> driven_to = {};
  bool dug_before = true;  ///< else its next state doesn't continue a way that is known
  SequenceCheck sequence = {};
};

}  // namespace soilvdb::tools
