// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A motion of any length, with a part of it in memory.
#pragma once

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "soilvdb/io/motion_csv.h"
#include "soilvdb/motion.h"

namespace soilvdb::inline v0::io {

/// A run's reaction to a bad row: it ends before the row, or leaves the row out.
enum class OnBadRow { kStop, kSkip };

/// A checked motion that is read in parts, each a Motion that begins with the last row of the part
/// before. A motion of one part stays in memory. Of a longer motion only the parts' positions stay,
/// and part() reads the file again.
class MotionFile {
 public:
  /// Steps between rows in each part but the last; about a megabyte.
  static constexpr std::int64_t kPartSteps = 1 << 14;

  /// No motion: the caller moves the machine.
  MotionFile() = default;

  /// One part, in memory.
  MotionFile(Motion motion);

  /// Reads and checks a file as read_motion() does, without its bad rows.
  /// @param look receives each part, and the number of bytes read so far
  /// @param warnings receives the warnings of read_motion(), and one about left-out bad rows
  /// @throw InputError as read_motion() does. Bad rows throw only if no good row remains, if kStop
  ///        leaves nothing to dig before them, or if at least half of all rows contradict good
  ///        ones: then the good ones may be wrong. With kStop also if the good rows before a bad
  ///        one are outnumbered.
  MotionFile(const MotionSource& source, const std::optional<Chain>& chain, AngleUnit angles,
             OnBadRow on_bad_row,
             const std::function<void(const Motion& part, std::int64_t bytes)>& look,
             std::vector<std::string>& warnings);

  std::int64_t rows() const { return rows_; }
  double begin_s() const { return begin_s_; }
  double end_s() const { return end_s_; }
  const std::filesystem::path& file() const { return source_.file; }  ///< empty: no file
  /// Does the motion come from this file, among others?
  bool is_from(const std::filesystem::path& file) const {
    const std::vector<std::filesystem::path> files = source_.files();
    return std::find(files.begin(), files.end(), file) != files.end();
  }
  /// A reader of the file, at the first row.
  MotionReader reader() const { return {source_, chain_, angles_}; }
  const BadRows& bad_rows() const { return bad_rows_; }
  /// Does digging end at bad_rows().good_s?
  bool stops() const { return stop_ && bad_rows_.count > 0; }

  std::size_t parts() const { return parts_.size(); }
  /// Thread-safe.
  /// @throw std::runtime_error if the file has changed since it was checked.
  std::shared_ptr<const Motion> part(std::size_t i) const;

 private:
  struct Part {
    RowMark mark;
    std::size_t digest = 0;
  };
  void check_odds() const;

  MotionSource source_;
  std::optional<Chain> chain_;
  AngleUnit angles_ = AngleUnit::kRadians;
  bool stop_ = false;
  BadRows bad_rows_;
  std::vector<Part> parts_;
  std::shared_ptr<const Motion> only_;  // if there is one part
  std::int64_t rows_ = 0;
  double begin_s_ = std::numeric_limits<double>::infinity(), end_s_ = -begin_s_;
};

}  // namespace soilvdb::inline v0::io
