// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/motion/mcap_merge.h"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>

namespace soilvdb::inline v0::io {

McapMerge::McapMerge(const MotionSource& source, std::shared_ptr<const McapFacts> facts,
                     const std::vector<std::uint32_t>& wanted)
    : topic_(source.mcap), facts_(std::move(facts)), wanted_(facts_->streams.size()) {
  wanted_[0] = true;
  for (const std::uint32_t stream : wanted) wanted_[stream] = true;
  for (const McapBlock& block : facts_->blocks) {
    Block mine{{}, &block};
    for (const McapBlock::Stream& s : block.streams) {
      if (!wanted_[s.stream]) continue;
      mine.times.add(s.times.first_ns);
      mine.times.add(s.times.last_ns);
    }
    if (mine.times.first_ns <= mine.times.last_ns) blocks_.push_back(mine);
  }
  std::stable_sort(blocks_.begin(), blocks_.end(), [](const Block& a, const Block& b) {
    return a.times.first_ns < b.times.first_ns;
  });
  go_to(-kLatest_ns);
}

std::string clock_fault(std::int64_t time_ns, std::int64_t behind_ns) {
  return fmt::format(
      "has the stamp {} s, later than that of a message that was recorded {:.3g} s after it; "
      "a clock was set, or a stamp is wrong",
      stamp_text(time_ns), static_cast<double>(behind_ns) * 1e-9);
}

void McapMerge::go_to(std::int64_t time_ns) {
  waiting_.clear();
  loaded_ = 0;
  from_ns_ = time_ns;
  last_log_ns_.assign(facts_->streams.size(), 0);
}

bool McapMerge::next(McapEntry& entry) {
  while (loaded_ < blocks_.size() &&
         (waiting_.empty() || blocks_[loaded_].times.first_ns <= waiting_.begin()->first.time_ns)) {
    const Block& block = blocks_[loaded_++];
    if (block.times.last_ns >= from_ns_) {
      load(*block.block);
      continue;
    }
    for (const McapBlock::Stream& s : block.block->streams)
      last_log_ns_[s.stream] = std::max(last_log_ns_[s.stream], s.last_log_ns);
  }
  if (waiting_.empty()) return false;
  auto first = waiting_.extract(waiting_.begin());
  entry = std::move(first.mapped().entry);
  const std::int64_t log_ns = first.mapped().log_ns;
  std::int64_t& last_log_ns = last_log_ns_[entry.stream];
  if (log_ns < last_log_ns - kMostBehind_ns && entry.fault.empty())
    entry.fault = clock_fault(entry.place.time_ns, last_log_ns - log_ns);
  last_log_ns = std::max(last_log_ns, log_ns);
  return true;
}

std::optional<std::int64_t> McapMerge::next_time(std::uint32_t stream) const {
  std::int64_t first_ns = kLatest_ns;
  for (const auto& [place, waiting] : waiting_)
    if (waiting.entry.stream == stream) {
      first_ns = place.time_ns;
      break;
    }
  for (std::size_t i = loaded_; i < blocks_.size(); ++i)
    for (const McapBlock::Stream& s : blocks_[i].block->streams)
      if (s.stream == stream) first_ns = std::min(first_ns, s.times.first_ns);
  return first_ns == kLatest_ns ? std::nullopt : std::optional(first_ns);
}

McapReader& McapMerge::reader(std::uint32_t file) {
  if (!reader_ || reader_file_ != file)
    reader_ = std::make_unique<McapReader>(facts_->files[file].path, facts_->files[file].channels);
  reader_file_ = file;
  return *reader_;
}

void McapMerge::add(const McapPlace& place, std::uint32_t stream, std::int64_t log_ns,
                    std::vector<double> values, std::string fault) {
  if (place.time_ns < from_ns_) {
    last_log_ns_[stream] = std::max(last_log_ns_[stream], log_ns);
    return;
  }
  waiting_.emplace(place, Waiting{{place, stream, std::move(values), std::move(fault)}, log_ns});
}

void McapMerge::load(const McapBlock& block) {
  McapReader& reader = this->reader(block.file);
  reader.go_to({block.record, 0});
  McapReader::Message message;
  std::int64_t time_ns = block.time_before_ns;
  McapPlace place{0, block.file, block.before, 0};
  for (long left = block.messages; left > 0 && reader.next(message);) {
    if (!is_topic(topic_, message.channel->topic)) continue;
    --left;
    ++place.number;
    place.item = 0;
    try {
      read_items(facts_->type, message.data, items_);
    } catch (const CdrError& e) {
      place.time_ns = time_ns;
      add(place, 0, message.log_ns, {},
          fmt::format("is not a {} in CDR: it {}", type_name(facts_->type), e.what()));
      continue;
    }
    for (McapItem& item : items_) {
      time_ns = item.stamp_ns == 0 ? message.log_ns : item.stamp_ns;
      for (const McapBlock::Stream& s : block.streams) {
        const McapStream& stream = facts_->streams[s.stream];
        if (!wanted_[s.stream] || s.stream == 0 || stream.names != item.names ||
            stream.topic != message.channel->topic)
          continue;
        place.time_ns = stream.time_of(item.stamp_ns, message.log_ns);
        add(place, s.stream, message.log_ns, std::move(item.values), "");
        break;
      }
      ++place.item;
    }
  }
  const std::int64_t bytes = std::accumulate(
      facts_->files.begin(), facts_->files.begin() + block.file, reader.bytes_read(),
      [](std::int64_t sum, const McapFacts::File& file) { return sum + file.bytes; });
  bytes_ = std::max(bytes_, bytes);
}

}  // namespace soilvdb::inline v0::io
