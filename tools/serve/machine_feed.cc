// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/machine_feed.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <stdexcept>
#include <utility>

#include "io/file/text.h"

namespace soilvdb::tools {
namespace {

constexpr std::array<const char*, 3> kFixWords = {"rtk_fixed", "rtk_float", "single"};
/// States whose answers a program may ask for again.
constexpr std::size_t kMostKnown = 1024;

double seconds_since(MachineFeed::Clock::time_point time) {
  return std::chrono::duration<double>(MachineFeed::Clock::now() - time).count();
}

}  // namespace

Fix fix_of(const std::string& word) {
  const auto found = std::find(kFixWords.begin(), kFixWords.end(), word);
  if (found == kFixWords.end())
    throw std::invalid_argument(fmt::format(
        "'fix' is '{}'; there are 'rtk_fixed', 'rtk_float' and 'single'", io::printable(word)));
  return static_cast<Fix>(found - kFixWords.begin());
}

const char* word_of(Fix fix) { return kFixWords[static_cast<std::size_t>(fix)]; }

const SequenceCheck::Known* SequenceCheck::find(std::uint64_t number) const {
  const auto found = std::find_if(known_.rbegin(), known_.rend(),
                                  [&](const Known& known) { return known.number == number; });
  return found == known_.rend() ? nullptr : &*found;
}

SequenceCheck::Place SequenceCheck::check(std::uint64_t number, std::size_t content) const {
  if (!next_) return {};
  if (number >= *next_) return {number - *next_, {}};
  const Known* known = find(number);
  if (known != nullptr && known->content == content) return {0, known->answer};
  if (number == 0 || known_.empty() || number > known_.back().number) return {};
  throw std::invalid_argument(
      fmt::format("'sequence' is {}, which {}; the next is {}, and 0 begins another count", number,
                  known != nullptr ? "another state had" : "came long ago", *next_));
}

void SequenceCheck::taken(std::uint64_t number, std::size_t content, const std::string& answer) {
  if (!known_.empty() && number <= known_.back().number) {  // another count
    known_.clear();
    next_.reset();
  }
  known_.push_back({number, content, answer});
  if (known_.size() > kMostKnown) known_.pop_front();
  next_ = std::max(next_.value_or(0), number + 1);
}

void SequenceCheck::refused(std::uint64_t number) {
  next_ = std::max(next_.value_or(0), number + 1);
}

std::optional<std::uint64_t> SequenceCheck::last() const {
  return known_.empty() ? std::nullopt : std::optional(known_.back().number);
}

void MachineFeed::require_owner(const FeedSource* by, const std::string& machine) const {
  if (by == nullptr || source == nullptr || source.get() == by ||
      source->link != FeedSource::Link::kLive)
    return;
  throw std::invalid_argument(fmt::format(
      "machine '{}' is fed by {}, heard {:.1f} s ago; another feed takes over when that one ends "
      "or is silent for 5 s",
      machine, source->name, silent_s().value_or(0)));
}

const char* MachineFeed::link() const {
  if (source == nullptr || source->link == FeedSource::Link::kEnded) return "none";
  return source->is_lost() ? "lost" : "live";
}

std::optional<double> MachineFeed::silent_s() const {
  return heard ? std::optional(seconds_since(*heard)) : std::nullopt;
}

}  // namespace soilvdb::tools
