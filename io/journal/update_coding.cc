// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "io/journal/update_coding.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

#include "io/journal/journal_format.h"
#include "io/mcap/compression.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr std::uint64_t kMostColumns = 1000;
constexpr std::int64_t kMostSamples = std::int64_t{1} << 53;  // exact in a double

/// Flags of an update, below its kind: fields that are left out or present.
enum UpdateFlag : std::uint8_t {
  kEndsUpdate = 1,
  kFirst = 2,         // of this writer: the reader must forget earlier updates
  kAnew = 4,          // its rows replace the machine's rows, and the number of columns follows
  kJoints = 8,        // with kAnew: rows are joints
  kBeginsAtEnd = 16,  // begin_s is the end of the update before
  kNoBegin = 32,
  kSoilMoved = 64,  // spilled and slid volumes follow
};
constexpr int kKindAt = 7;
constexpr std::uint64_t kKinds = 7, kKindMask = 15;
constexpr unsigned kHasForce = 1u << 11;  // six doubles follow
constexpr unsigned kHasHauled = 1u << 12;
static_assert(kHasForce > kKindMask << (kKindAt - 1) && kHasForce >> kKindAt == kKindMask + 1);

// Head of a number in a series: one of these, or kNear plus the coded difference of whole numbers.
constexpr std::uint64_t kSame = 0, kRaw = 1, kDecimals = 2, kNear = 3;

// Powers of ten are exact, so the quotient is the double nearest to the decimal: the value that was
// read from the file.
constexpr std::array kPowers = {1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9};
constexpr double kMostScaled = 0x1p53;

double decimal(std::int64_t scaled, int decimals) {
  return static_cast<double>(scaled) / kPowers[static_cast<std::size_t>(decimals)];
}

/// Can `value` be written with this number of decimals? Sets `scaled`.
bool is_decimal(double value, int decimals, std::int64_t& scaled) {
  const double times = value * kPowers[static_cast<std::size_t>(decimals)];
  if (!(std::abs(times) < kMostScaled)) return false;
  scaled = std::llround(times);
  return same_bits(decimal(scaled, decimals), value);
}

/// Zigzag coding: small differences of either sign become small numbers.
std::uint64_t distance_coded(std::int64_t value, std::int64_t before) {
  const std::uint64_t d = static_cast<std::uint64_t>(value) - static_cast<std::uint64_t>(before);
  return (d << 1) ^ (d >> 63 ? ~std::uint64_t{0} : 0);
}

std::int64_t add_difference(std::int64_t before, std::uint64_t difference) {
  const std::uint64_t d = (difference >> 1) ^ (difference & 1 ? ~std::uint64_t{0} : 0);
  return static_cast<std::int64_t>(static_cast<std::uint64_t>(before) + d);
}

void append_count(std::string& bytes, std::uint64_t count) {
  for (; count >= 128; count >>= 7) bytes += static_cast<char>(count | 128);
  bytes += static_cast<char>(count);
}

bool take_count(std::string_view& bytes, std::uint64_t& count) {
  count = 0;
  for (int shift = 0; shift < 64; shift += 7) {
    std::uint8_t byte = 0;
    if (!try_take(bytes, byte)) return false;
    count |= static_cast<std::uint64_t>(byte & 127) << shift;
    if (byte < 128) return true;
  }
  return false;
}

void append_difference(std::string& bytes, std::int64_t before, std::int64_t value) {
  append_count(bytes, distance_coded(value, before));
}

bool take_difference(std::string_view& bytes, std::int64_t before, std::int64_t& value) {
  std::uint64_t d = 0;
  if (!take_count(bytes, d)) return false;
  value = add_difference(before, d);
  return true;
}

/// As above for samples; false if the number is too large.
bool take_samples(std::string_view& bytes, std::int64_t before, std::int64_t& value) {
  return take_difference(bytes, before, value) && -kMostSamples <= value && value <= kMostSamples;
}

}  // namespace

std::string pack_survey(std::string_view record) {
  std::string bytes;
  put(bytes, std::uint64_t{record.size()});
  return bytes + compress_zstd(record);
}

std::string unpack_survey(std::string_view bytes) {
  std::uint64_t size = 0;
  if (!try_take(bytes, size)) throw std::invalid_argument("the record of scans ends too early");
  try {
    return decompress_zstd(bytes, size);
  } catch (const std::invalid_argument& e) {
    throw std::invalid_argument(std::string("the bytes of the record of scans ") + e.what());
  }
}

void Series::append(std::string& bytes, double value) {
  std::int64_t scaled = 0;
  if (same_bits(value, last_)) {
    append_count(bytes, kSame);
    return;
  }
  last_ = value;
  if (is_decimal(value, decimals_, scaled)) {
    const std::uint64_t d = distance_coded(scaled, scaled_);
    scaled_ = scaled;
    append_count(bytes, d + kNear);
    return;
  }
  for (int decimals = 0; decimals < static_cast<int>(kPowers.size()); ++decimals) {
    if (!is_decimal(value, decimals, scaled)) continue;
    decimals_ = decimals;
    scaled_ = scaled;
    append_count(bytes, kDecimals);
    append_count(bytes, static_cast<std::uint64_t>(decimals));
    append_difference(bytes, 0, scaled);
    return;
  }
  append_count(bytes, kRaw);
  put(bytes, value);
}

bool Series::take(std::string_view& bytes, double& value) {
  std::uint64_t how = 0;
  if (!take_count(bytes, how)) return false;
  if (how == kRaw) {
    if (!try_take(bytes, last_)) return false;
  } else if (how == kDecimals) {
    std::uint64_t decimals = 0;
    if (!take_count(bytes, decimals) || decimals >= kPowers.size() ||
        !take_difference(bytes, 0, scaled_))
      return false;
    decimals_ = static_cast<int>(decimals);
    last_ = decimal(scaled_, decimals_);
  } else if (how != kSame) {
    scaled_ = add_difference(scaled_, how - kNear);
    last_ = decimal(scaled_, decimals_);
  }
  value = last_;
  return true;
}

void append_update(std::string& bytes, const JournalUpdate& update,
                   std::vector<UpdateBefore>& all) {
  if (all.size() <= update.machine) all.resize(update.machine + 1);
  UpdateBefore& before = all[update.machine];
  const MotionRows& rows = update.rows;
  const bool no_begin = std::isnan(update.begin_s);
  const bool begins_at_end = !no_begin && same_bits(update.begin_s, before.end_s);
  const bool anew = !rows.times_s.empty() &&
                    (no_begin || rows.columns != before.values.size() ||
                     rows.joints != before.joints || !(rows.times_s.front() <= before.last_row_s));
  unsigned flags = static_cast<unsigned>(update.kind) << kKindAt;
  if (update.ends_update) flags |= kEndsUpdate;
  if (before.first) flags |= kFirst;
  if (anew) flags |= kAnew | (rows.joints ? kJoints : 0);
  if (begins_at_end) flags |= kBeginsAtEnd;
  if (no_begin) flags |= kNoBegin;
  if (update.spilled != 0 || update.slid != 0) flags |= kSoilMoved;
  if (update.force) flags |= kHasForce;
  if (update.hauled) flags |= kHasHauled;
  append_count(bytes, update.machine);
  append_count(bytes, flags);
  if (anew) {
    append_count(bytes, rows.columns);
    before.joints = rows.joints;
    before.values.resize(rows.columns);
  }
  if (!begins_at_end && !no_begin) put(bytes, update.begin_s);
  before.ends_s.append(bytes, update.end_s);
  append_difference(bytes, 0, update.cut_samples);
  append_difference(bytes, before.bucket_samples, update.bucket_samples);
  if (flags & kSoilMoved) {
    append_difference(bytes, 0, update.spilled);
    append_difference(bytes, 0, update.slid);
  }
  if (update.hauled) append_difference(bytes, 0, *update.hauled);
  if (update.force)
    for (const double value : *update.force) put(bytes, value);
  if (update.kind == JournalUpdate::Kind::kSurvey) {
    append_count(bytes, update.survey.size());
    bytes += update.survey;
  }
  append_difference(bytes, 0, update.ns);
  const auto fresh = static_cast<std::size_t>(
      anew ? 0
           : std::upper_bound(rows.times_s.begin(), rows.times_s.end(), before.last_row_s) -
                 rows.times_s.begin());
  append_count(bytes, rows.times_s.size() - fresh);
  for (std::size_t row = fresh; row < rows.times_s.size(); ++row) {
    before.times_s.append(bytes, rows.times_s[row]);
    for (std::size_t k = 0; k < rows.columns; ++k)
      before.values[k].append(bytes, rows.values[row * rows.columns + k]);
  }
  before.first = false;
  before.end_s = update.end_s;
  before.bucket_samples = update.bucket_samples;
  if (!rows.times_s.empty()) before.last_row_s = rows.times_s.back();
}

bool take_update(std::string_view& bytes, JournalUpdate& update, bool& anew,
                 std::vector<UpdateBefore>& all) {
  std::uint64_t machine = 0, flags = 0, count = 0;
  if (!take_count(bytes, machine) || machine >= kMostMachines || !take_count(bytes, flags) ||
      (flags & ~std::uint64_t{kHasForce | kHasHauled}) >> kKindAt >= kKinds)
    return false;
  if (all.size() <= machine) all.resize(machine + 1);
  UpdateBefore& before = all[machine];
  if (flags & kFirst) before = {};
  update.machine = static_cast<std::uint32_t>(machine);
  update.kind = static_cast<JournalUpdate::Kind>(flags >> kKindAt & kKindMask);
  update.ends_update = flags & kEndsUpdate;
  anew = flags & kAnew;
  if (anew) {
    std::uint64_t columns = 0;
    if (!take_count(bytes, columns) || columns > kMostColumns) return false;
    before.joints = flags & kJoints;
    before.values.resize(columns);
  }
  if (flags & kBeginsAtEnd) update.begin_s = before.end_s;
  if (!(flags & (kBeginsAtEnd | kNoBegin)) && !try_take(bytes, update.begin_s)) return false;
  if (!before.ends_s.take(bytes, update.end_s) || !take_samples(bytes, 0, update.cut_samples) ||
      !take_samples(bytes, before.bucket_samples, update.bucket_samples))
    return false;
  if ((flags & kSoilMoved) &&
      (!take_samples(bytes, 0, update.spilled) || !take_samples(bytes, 0, update.slid)))
    return false;
  if ((flags & kHasHauled) && !take_samples(bytes, 0, update.hauled.emplace())) return false;
  if (flags & kHasForce)
    for (double& value : update.force.emplace())
      if (!try_take(bytes, value)) return false;
  if (update.kind == JournalUpdate::Kind::kSurvey) {
    if (!take_count(bytes, count) || count > bytes.size()) return false;
    update.survey = bytes.substr(0, count);
    bytes.remove_prefix(count);
  }
  if (!take_difference(bytes, 0, update.ns) || !take_count(bytes, count) || count > bytes.size())
    return false;
  update.rows.joints = before.joints;
  update.rows.columns = before.values.size();
  for (std::uint64_t row = 0; row < count; ++row) {
    if (!before.times_s.take(bytes, update.rows.times_s.emplace_back())) return false;
    for (Series& column : before.values)
      if (!column.take(bytes, update.rows.values.emplace_back())) return false;
  }
  before.end_s = update.end_s;
  before.bucket_samples = update.bucket_samples;
  return true;
}

}  // namespace soilvdb::inline v0::io
