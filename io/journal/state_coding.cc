// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/journal/state_coding.h"

#include "io/journal/journal_format.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::uint64_t kMostStateValues = 1000;
constexpr std::uint8_t kKinds = 5;
constexpr std::uint8_t kFirstState = 64;  // beside the kind

}  // namespace

void StateCoding::append(std::string& bytes, const JournalState& state) {
  bytes += static_cast<char>(static_cast<std::uint8_t>(state.kind) | (first_ ? kFirstState : 0));
  first_ = false;
  append_count(bytes, state.machine);
  append_count(bytes, state.values.size());
  Before& before = before_[{state.machine, state.kind}];
  before.time_s.append(bytes, state.time_s);
  before.values.resize(state.values.size());
  for (std::size_t i = 0; i < state.values.size(); ++i)
    before.values[i].append(bytes, state.values[i]);
  append_difference(bytes, before.bucket_samples, state.bucket_samples);
  before.bucket_samples = state.bucket_samples;
  for (const std::int64_t value : {state.cut_samples, state.ns, state.spilled, state.slid})
    append_difference(bytes, 0, value);
}

bool StateCoding::take(std::string_view& bytes, JournalState& state) {
  std::uint8_t head = 0;
  std::uint64_t machine = 0, values = 0;
  if (!take_raw(bytes, head) || (head & ~kFirstState) >= kKinds || !take_count(bytes, machine) ||
      machine >= kMostMachines || !take_count(bytes, values) || values > kMostStateValues)
    return false;
  if (head & kFirstState) before_.clear();
  state.kind = static_cast<JournalState::Kind>(head & ~kFirstState);
  state.machine = static_cast<std::uint32_t>(machine);
  Before& before = before_[{state.machine, state.kind}];
  if (!before.time_s.take(bytes, state.time_s)) return false;
  before.values.resize(values);
  state.values.resize(values);
  for (std::size_t i = 0; i < values; ++i)
    if (!before.values[i].take(bytes, state.values[i])) return false;
  if (!take_difference(bytes, before.bucket_samples, state.bucket_samples)) return false;
  before.bucket_samples = state.bucket_samples;
  for (std::int64_t* value : {&state.cut_samples, &state.ns, &state.spilled, &state.slid})
    if (!take_difference(bytes, 0, *value)) return false;
  return true;
}

}  // namespace soilvdb::inline v0::io
