// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Rows from tracks, and the messages about their gaps.
#include <fmt/format.h>

#include <algorithm>

#include "io/motion/mcap_rows.h"
#include "io/motion/motion_checks.h"

namespace soilvdb::inline v0::io {
namespace {

std::string seconds(std::int64_t ns) {
  std::string text = stamp_text(ns);
  text.erase(text.find_last_not_of('0') + 1);
  if (text.ends_with('.')) text.pop_back();
  return text;
}

std::string gap_text(const std::string& what, std::int64_t from_ns, std::int64_t to_ns,
                     std::string_view why, std::int64_t most_ns) {
  return fmt::format("{} isn't known from {} to {} s, {}; at most {} s are bridged", what,
                     seconds(from_ns), seconds(to_ns), why, seconds(most_ns));
}

}  // namespace

void TrackRows::add_track(std::string what, bool makes_rows) {
  Track& track = tracks_.emplace_back();
  track.what = std::move(what);
  track.makes_rows = makes_rows;
}

void TrackRows::add_stream(std::size_t i, std::uint32_t stream) {
  Track& track = tracks_[i];
  const McapStream& from = facts_->streams[stream];
  track.streams.push_back(stream);
  track.times.add(from.times.first_ns);
  track.times.add(from.times.last_ns);
  track.usual_ns = usual_ns(track.streams);
}

McapTimes TrackRows::row_times() const {
  McapTimes times;
  for (const Track& track : tracks_) {
    if (!track.makes_rows) continue;
    times.add(track.times.first_ns);
    times.add(track.times.last_ns);
  }
  return times;
}

/// Are all tracks known at the time of the first waiting row, or known to stay unknown?
bool TrackRows::ready() const {
  if (ended_) return true;
  if (waiting_.empty()) return !faults_.empty();
  const std::int64_t at_ns = waiting_.front().time_ns;
  if (newest_ns_ <= at_ns) return false;  // more samples may have this time
  return std::all_of(tracks_.begin(), tracks_.end(), [&](const Track& track) {
    return (!track.samples.empty() && track.samples.back().time_ns >= at_ns) ||
           at_ns >= track.times.last_ns || newest_ns_ - at_ns > track.most_ns();
  });
}

bool TrackRows::read_more() {
  McapEntry entry;
  if (!merge_.next(entry)) return false;
  newest_ns_ = entry.place.time_ns;
  look_at(entry.place);
  if (!entry.fault.empty()) {
    add_fault(newest_ns_, entry.fault);
    return true;
  }
  try {
    take(entry);
  } catch (const LineError& e) {
    faults_.push_back({newest_ns_, e});
  }
  return true;
}

void TrackRows::add_fault(std::int64_t time_ns, const std::string& why) {
  faults_.push_back({time_ns, LineError(place_.file(), place_.number(), why)});
}

void TrackRows::check_same(const Track& track, std::int64_t time_ns, const double* values,
                           std::size_t n) const {
  if (track.samples.empty() || track.samples.back().time_ns != time_ns ||
      same_values({values, n}, {track.samples.back().values.data(), n}))
    return;
  place_.fail(fmt::format(
      "has other values of {} at {} s than a message before it; one of the two is wrong",
      track.what, seconds(time_ns)));
}

void TrackRows::put(Track& track, const McapPlace& place, const double* values, std::size_t n) {
  const std::int64_t time_ns = place.time_ns;
  if (!track.samples.empty()) {
    const std::int64_t before_ns = track.samples.back().time_ns;
    if (before_ns == time_ns) return;
    if (track.tells_gaps && time_ns - before_ns > track.most_ns())
      add_fault(time_ns, gap_text(track.what, before_ns, time_ns, "a gap", track.most_ns()));
  }
  track.samples.push_back({time_ns});
  std::copy(values, values + n, track.samples.back().values.begin());
  if (track.makes_rows && (waiting_.empty() || waiting_.back().time_ns < time_ns))
    waiting_.push_back(place);
}

/// Adds a fault if a track that makes rows ended while others continued.
void TrackRows::find_early_end() {
  std::int64_t end_ns = -kLatest_ns;
  for (const Track& track : tracks_) end_ns = std::max(end_ns, track.times.last_ns);
  for (const Track& track : tracks_)
    if (track.tells_gaps && !track.samples.empty() &&
        end_ns - track.samples.back().time_ns > track.most_ns()) {
      look_at(row_);
      add_fault(end_ns, gap_text(track.what, track.samples.back().time_ns, end_ns,
                                 "where others go on", track.most_ns()));
    }
}

RowSource::Got TrackRows::next() {
  while (true) {
    while (!ready()) ended_ = !read_more();
    if (waiting_.empty() && ended_ && !looked_at_end_) {
      looked_at_end_ = true;
      find_early_end();
    }
    if (!faults_.empty() &&
        (waiting_.empty() || faults_.front().time_ns <= waiting_.front().time_ns)) {
      const Fault fault = std::move(faults_.front());
      faults_.pop_front();
      if (from_ && fault.time_ns < from_->time_ns) continue;
      throw fault.why;
    }
    if (waiting_.empty()) return Got::kEnd;
    const McapPlace row = waiting_.front();
    waiting_.pop_front();
    if (from_ && row < *from_) continue;
    row_ = row;
    look_at(row_);
    return Got::kRow;
  }
}

TrackRows::Values TrackRows::at_row(Track& track) const {
  const std::int64_t at_ns = row_.time_ns;
  auto& samples = track.samples;
  while (samples.size() > 1 && samples[1].time_ns <= at_ns) samples.pop_front();
  const auto refuse = [&](std::int64_t from_ns, std::int64_t to_ns, const char* why,
                          std::int64_t most_ns) {
    place_.fail(gap_text(track.what, from_ns, to_ns, why, most_ns));
  };
  std::int64_t next_ns = kLatest_ns;  // of the first sample after the row
  const std::size_t after = samples.empty() || samples.front().time_ns > at_ns ? 0 : 1;
  if (samples.size() > after) {
    next_ns = samples[after].time_ns;
  } else {
    for (const std::uint32_t stream : track.streams)
      next_ns = std::min(next_ns, merge_.next_time(stream).value_or(kLatest_ns));
  }
  if (after == 0) {
    const std::int64_t begin_ns = row_times().first_ns;
    if (next_ns == kLatest_ns || track.times.first_ns < at_ns)
      refuse(at_ns, std::min(next_ns, row_times().last_ns), "a gap", track.most_ns());
    if (next_ns - begin_ns > track.most_end_ns() || samples.empty())
      refuse(begin_ns, next_ns, "where it begins", track.most_end_ns());
    return samples.front().values;
  }
  const Sample& before = samples.front();
  if (before.time_ns == at_ns) return before.values;
  if (next_ns == kLatest_ns) {
    const std::int64_t end_ns = row_times().last_ns;
    if (end_ns - before.time_ns > track.most_end_ns())
      refuse(before.time_ns, end_ns, "where the motion ends", track.most_end_ns());
    return before.values;
  }
  if (samples.size() == 1 || next_ns - before.time_ns > track.most_ns())
    refuse(before.time_ns, next_ns, "a gap", track.most_ns());
  return between(
      track, before.values, samples[1].values,
      static_cast<double>(at_ns - before.time_ns) / static_cast<double>(next_ns - before.time_ns));
}

void TrackRows::go_to(const RowMark& mark) {
  for (Track& track : tracks_) track.samples.clear();
  waiting_.clear();
  faults_.clear();
  ended_ = looked_at_end_ = false;
  newest_ns_ = -kLatest_ns;
  from_ = place_of(mark);
  merge_.go_to(mark.bytes - longest_gap_ns());
}

}  // namespace soilvdb::inline v0::io
