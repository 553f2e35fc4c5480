// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Journals of two machines that take turns, and all that can be read of them.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <ios>
#include <sstream>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "soilvdb/io/error.h"
#include "soilvdb/io/journal.h"
#include "soilvdb/io/motion_rows.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::io {

inline constexpr double kEvery_s = 0.1;  // between rows

inline Pose pose(int i) {
  return {{512340.0 + 0.1 * i, 5403640.0 - 0.03 * i * i, std::sin(i)},
          from_rpy(0.1 * i, -0.4, 0.2)};
}

inline Motion motion(int rows) {
  std::vector<double> times_s;
  std::vector<Pose> poses;
  for (int i = 0; i < rows; ++i) {
    times_s.push_back(kEvery_s * i);
    poses.push_back(pose(i));
  }
  return {times_s, poses};
}

/// The record of update i of two machines, which take turns.
inline JournalUpdate update(const Motion& motion, int i) {
  const double begin_s = kEvery_s * std::max(0, i / 2 - 1), end_s = kEvery_s * (i / 2);
  return {.machine = static_cast<std::uint32_t>(i % 2),
          .begin_s = begin_s,
          .end_s = end_s,
          .cut_samples = i * std::int64_t{1'000'003},
          .bucket_samples = (5 - i) * std::int64_t{70'001},
          .ns = 5500 + i,
          .rows = rows_between(motion, begin_s, end_s),
          .spilled = i % 3 == 0 ? i * std::int64_t{65'537} : 0,
          .slid = i % 4 == 0 ? i * std::int64_t{1'000'003} : 0};
}

inline std::string as_text(const JournalRecord& record) {
  std::ostringstream text;
  text << std::hexfloat << record.index() << ' ';
  if (const auto* config = std::get_if<JournalConfig>(&record)) {
    text << config->text;
  } else if (const auto* m = std::get_if<JournalUpdate>(&record)) {
    text << static_cast<int>(m->kind) << ' ' << m->machine << ' ' << m->ends_update;
    text << ' ' << m->cut_samples << ' ' << m->bucket_samples << ' ' << m->ns;
    text << ' ' << m->spilled << ' ' << m->slid << ' ' << m->rows.joints;
    if (m->hauled) text << " hauled " << *m->hauled;
    for (const double v : {m->begin_s, m->end_s}) text << ' ' << v;
    for (const double v : m->rows.times_s) text << ' ' << v;
    for (const double v : m->rows.values) text << ' ' << v;
  } else if (const auto* f = std::get_if<JournalFile>(&record)) {
    text << f->name << ' ' << f->updates << ' ' << f->size << ' ' << f->crc;
  }
  return text.str();
}

/// All that can be read of a journal, and whether it was called damaged; a refusal reads as
/// nothing.
struct Reading {
  std::vector<std::string> records;
  bool damaged = false, refused = false;
  std::uint64_t good_bytes = 0;
};

inline Reading reading(const std::filesystem::path& file) {
  Reading result;
  try {
    JournalReader reader(file);
    while (const auto record = reader.next()) result.records.push_back(as_text(*record));
    result.damaged = reader.damaged();
    result.good_bytes = reader.good_bytes();
  } catch (const InputError&) {
    result.refused = true;
  }
  return result;
}

class Journal : public ::testing::Test {
 protected:
  /// A journal of `count` updates, `per_frame` of them in each frame, and its end.
  std::string write(int count, int per_frame, bool end = true) const {
    const Motion way = motion(count);
    const auto file = folder_ / "journal";
    JournalWriter writer(file, begin_journal(file, {"configuration"}), {}, 3600);
    for (int i = 0; i < count; ++i) {
      writer.add(update(way, i));
      if (i == count / 2) writer.add(JournalFile{"soil_1.vdb", 5, 12345, 0x1234567890abcdef});
      if ((i + 1) % per_frame == 0) writer.flush();
    }
    if (end) writer.add(JournalEnd{});
    writer.flush();
    return content(file);
  }
  static std::string content(const std::filesystem::path& file) {
    std::ostringstream text;
    text << std::ifstream(file, std::ios::binary).rdbuf();
    return text.str();
  }
  /// Writes bytes into a file that stays as long as it is.
  static void poke(const std::filesystem::path& file, std::size_t at, std::string_view bytes) {
    std::fstream(file, std::ios::binary | std::ios::in | std::ios::out)
        .seekp(static_cast<std::streamoff>(at))
        .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  }
  test::TempFolder folder_;
};

}  // namespace soilvdb::io
