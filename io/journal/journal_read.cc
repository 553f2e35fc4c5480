// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Reads journals, also damaged ones.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>

#include "io/file/text.h"
#include "io/journal/journal_format.h"
#include "io/journal/update_coding.h"
#include "soilvdb/io/journal.h"

namespace soilvdb::inline v0::io {
namespace {

bool take_string(std::string_view& bytes, std::string& text) {
  std::uint32_t size = 0;
  if (!try_take(bytes, size) || bytes.size() < size) return false;
  text = bytes.substr(0, size);
  bytes.remove_prefix(size);
  return true;
}

/// Appends a move's new rows to a machine's rows, and drops rows that end before `begin_s`; false
/// if they do not fit.
bool add_rows(MotionRows& rows, const MotionRows& fresh, bool anew, double begin_s) {
  if (anew) {
    rows = fresh;
  } else {
    if (rows.joints != fresh.joints || rows.columns != fresh.columns) return false;
    rows.times_s.insert(rows.times_s.end(), fresh.times_s.begin(), fresh.times_s.end());
    rows.values.insert(rows.values.end(), fresh.values.begin(), fresh.values.end());
  }
  if (rows.times_s.empty()) return false;
  if (std::isnan(begin_s)) return true;
  const auto after = std::upper_bound(rows.times_s.begin(), rows.times_s.end(), begin_s);
  const std::ptrdiff_t first = std::min<std::ptrdiff_t>(
      after - rows.times_s.begin() - 1, static_cast<std::ptrdiff_t>(rows.times_s.size()) - 2);
  if (first <= 0) return true;
  rows.times_s.erase(rows.times_s.begin(), rows.times_s.begin() + first);
  rows.values.erase(rows.values.begin(),
                    rows.values.begin() + first * static_cast<std::ptrdiff_t>(rows.columns));
  return true;
}

bool take_file(std::string_view& bytes, JournalFile& file) {
  return try_take(bytes, file.updates) && try_take(bytes, file.size) && try_take(bytes, file.crc) &&
         take_string(bytes, file.name) && take_string(bytes, file.parent);
}

}  // namespace

JournalReader::JournalReader(const std::filesystem::path& file) : file_(file) {
  check_readable(file);
  in_.open(file, std::ios::binary);
  size_ = std::filesystem::file_size(file);
  if (next_frame() && frame_.front() == kConfigTag) return;
  std::uint32_t mark = 0;
  in_.clear();
  in_.seekg(0);
  if (in_.read(reinterpret_cast<char*>(&mark), sizeof mark) &&
      std::find(std::begin(kFormerFrameMarks), std::end(kFormerFrameMarks), mark) !=
          std::end(kFormerFrameMarks))
    throw InputError(
        file,
        "is a journal of an older version, which isn't read any more: dig the scenario "
        "anew, or feed the session anew");
  throw InputError(file, "is not a journal, or damaged at its start");
}

JournalReader::~JournalReader() = default;

/// Decodes an update, and adds the rows that it shares with the update before.
bool JournalReader::take(std::string_view& bytes, JournalUpdate& update) {
  bool anew = false;
  if (!take_update(bytes, update, anew, before_)) return false;
  if (!update.has_rows()) {
    update.rows = {};
    return !anew;
  }
  if (rows_.size() <= update.machine) rows_.resize(update.machine + 1);
  MotionRows& rows = rows_[update.machine];
  if (!add_rows(rows, update.rows, anew, update.begin_s)) return false;
  update.rows = rows;
  return true;
}

std::optional<JournalRecord> JournalReader::next() {
  if (at_ == frame_.size() && !next_frame()) return std::nullopt;
  std::string_view rest = std::string_view(frame_).substr(at_ + 1);
  const auto taken = [&](auto record, bool good) -> JournalRecord {
    if (!good)
      throw InputError(
          file_,
          fmt::format("has an invalid record before byte {}; a newer soilvdb may read it", good_));
    at_ = frame_.size() - rest.size();
    return record;
  };
  JournalConfig config;
  JournalUpdate update;
  JournalFile file;
  JournalRemoval removed;
  switch (frame_[at_]) {
    case kConfigTag: {
      const bool good = take_string(rest, config.text);
      return taken(std::move(config), good);
    }
    case kUpdateTag: {
      const bool good = take(rest, update);
      return taken(std::move(update), good);
    }
    case kFileTag: {
      const bool good = take_file(rest, file);
      return taken(std::move(file), good);
    }
    case kGoneTag: {
      const bool good = take_string(rest, removed.name);
      return taken(std::move(removed), good);
    }
    case kEndTag:
      return taken(JournalEnd{}, true);
    default:
      return taken(JournalEnd{}, false);
  }
}

/// Reads the frame at good_; false at the end or at a bad frame, and then sets damaged_.
bool JournalReader::next_frame() {
  if (at_end_) return false;
  FrameHead head;
  std::string bytes(FrameHead::kSize, '\0');
  in_.clear();
  in_.seekg(static_cast<std::streamoff>(good_));
  if (size_ - good_ > FrameHead::kSize && in_.read(bytes.data(), FrameHead::kSize) &&
      head.parse(bytes, good_) && head.length > 0 &&
      head.length <= size_ - good_ - FrameHead::kSize) {
    frame_.resize(head.length);
    if (in_.read(frame_.data(), head.length) && crc64(frame_) == head.crc) {
      good_ += FrameHead::kSize + head.length;
      at_ = 0;
      return true;
    }
  }
  at_end_ = true;
  frame_.clear();
  at_ = 0;
  damaged_ = synced_past(good_);
  return false;
}

/// Does a frame after `place` prove that the file was once on disk beyond `place`?
bool JournalReader::synced_past(std::uint64_t place) {
  constexpr std::size_t kBlock = std::size_t{1} << 20;
  std::string block;
  for (std::uint64_t start = place; start + FrameHead::kSize <= size_; start += kBlock) {
    // Blocks overlap by a head.
    block.resize(std::min<std::uint64_t>(kBlock + FrameHead::kSize, size_ - start));
    in_.clear();
    in_.seekg(static_cast<std::streamoff>(start));
    if (!in_.read(block.data(), static_cast<std::streamsize>(block.size())))
      throw InputError(file_, fmt::format("can't be read at byte {}", start));
    const std::string_view all = block;
    const std::string_view mark(reinterpret_cast<const char*>(&kFrameMark), sizeof kFrameMark);
    for (std::size_t at = all.find(mark); at != all.npos; at = all.find(mark, at + 1)) {
      FrameHead head;
      if (head.parse(all.substr(at), start + at) && head.synced > place) return true;
    }
  }
  return false;
}

bool is_journal(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::uint32_t mark = 0;
  return in.read(reinterpret_cast<char*>(&mark), sizeof mark) && mark == kFrameMark;
}

JournalContent read_journal(const std::filesystem::path& file) {
  JournalReader reader(file);
  JournalContent content;
  while (const std::optional<JournalRecord> record = reader.next()) {
    if (const auto* config = std::get_if<JournalConfig>(&*record)) {
      content.config = *config;
    } else if (const auto* update = std::get_if<JournalUpdate>(&*record)) {
      content.done.add(*update);
    } else if (const auto* written = std::get_if<JournalFile>(&*record)) {
      std::erase_if(content.files, [&](const auto& f) { return f.name == written->name; });
      std::erase(content.removed, written->name);
      content.files.push_back(*written);
    } else if (const auto* removed = std::get_if<JournalRemoval>(&*record)) {
      std::erase_if(content.files, [&](const auto& f) { return f.name == removed->name; });
      content.removed.push_back(removed->name);
    } else {
      content.ended = true;
    }
  }
  std::stable_sort(content.files.begin(), content.files.end(),
                   [](const auto& a, const auto& b) { return a.updates < b.updates; });
  content.good_bytes = reader.good_bytes();
  content.torn_bytes = reader.torn_bytes();
  content.damaged = reader.damaged();
  return content;
}

std::uint64_t updates_until(const std::filesystem::path& file, double time_s,
                            std::optional<std::uint32_t> machine) {
  constexpr double kNoTime = std::numeric_limits<double>::quiet_NaN();
  const auto each_update = [&](const auto& use) {
    JournalReader reader(file);
    JournalExtent made;
    while (const std::optional<JournalRecord> record = reader.next()) {
      const auto* update = std::get_if<JournalUpdate>(&*record);
      if (update == nullptr || !update->ends_update) continue;
      // kRest carries the time of the most advanced machine, not one of its own.
      const bool of_machine = update->has_rows() || update->kind == JournalUpdate::Kind::kClock;
      const bool timed = machine ? of_machine && update->machine == *machine
                                 : update->kind != JournalUpdate::Kind::kRest;
      use(*update, timed ? update->end_s : kNoTime, made.updates);
      made.add(*update);
    }
    return made.updates;
  };
  constexpr std::uint64_t kNone = std::numeric_limits<std::uint64_t>::max();
  std::uint64_t later = kNone;                 // number of updates before the first later one
  std::map<std::uint32_t, std::uint64_t> set;  // updates before a clock was last set
  const std::uint64_t all =
      each_update([&](const JournalUpdate& update, double end_s, std::uint64_t before) {
        if (update.kind == JournalUpdate::Kind::kClock) set[update.machine] = before;
        if (end_s > time_s) later = std::min(later, before);
      });
  // Pours may have fallen by the clock of any machine.
  const auto set_later = [&](const JournalUpdate& update, std::uint64_t before) {
    return std::any_of(set.begin(), set.end(), [&](const auto& clock) {
      const bool its = update.kind == JournalUpdate::Kind::kPours || clock.first == update.machine;
      return its && before < clock.second;
    });
  };
  if (!set.empty() && later != kNone) {
    later = kNone;
    bool perhaps_ahead = false;  // the clock of the later update may have been ahead
    each_update([&](const JournalUpdate& update, double end_s, std::uint64_t before) {
      if (end_s > time_s && later == kNone) {
        later = before;
        perhaps_ahead = set_later(update, before);
      } else if (end_s <= time_s && perhaps_ahead) {
        later = kNone;
        perhaps_ahead = false;
      }
    });
  }
  return std::min(later, all);
}

}  // namespace soilvdb::inline v0::io
