// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A motion of any length in memory for a part of it.
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

/// What a run does at a bad row: ends before it, or goes on as if it weren't there.
enum class OnBadRow { kStop, kSkip };

/// A checked motion whose rows come part by part, each part a Motion. Parts join: each begins with
/// the last row of the one before. A file of one part stays in memory; of a longer one only where
/// its parts begin, and part() reads again.
class MotionFile {
 public:
  /// Steps between rows in each part but the last: about a megabyte.
  static constexpr std::int64_t kPartSteps = 1 << 14;

  /// None: a machine that is moved by whoever runs it.
  MotionFile() = default;

  /// One part, in memory.
  MotionFile(Motion motion);

  /// Reads and checks a file as read_motion() does, its bad rows left out.
  /// @param look is shown each part, and how many bytes of the file have been read
  /// @param warnings what read_motion() warns of is added, and the bad rows that are left out
  /// @throw InputError as read_motion() does; for a bad row only where there is no good one, none
  ///        to dig before it, or as many contradict good ones as not, so that those may be what is
  ///        wrong; where it would stop, also where those before a bad one are outnumbered.
  MotionFile(const MotionSource& source, const std::optional<Chain>& chain, AngleUnit angles,
             OnBadRow on_bad_row,
             const std::function<void(const Motion& part, std::int64_t bytes)>& look,
             std::vector<std::string>& warnings);

  std::int64_t rows() const { return rows_; }
  double begin_s() const { return begin_s_; }
  double end_s() const { return end_s_; }
  const std::filesystem::path& file() const { return source_.file; }  ///< empty: it has none
  /// Is it one of the files that the motion is read from?
  bool is_from(const std::filesystem::path& file) const {
    const std::vector<std::filesystem::path> files = source_.files();
    return std::find(files.begin(), files.end(), file) != files.end();
  }
  /// Of its file, at the first row.
  MotionReader reader() const { return {source_, chain_, angles_}; }
  const BadRows& bad_rows() const { return bad_rows_; }
  /// Is it to be dug up to bad_rows().good_s only?
  bool stops() const { return stop_ && bad_rows_.count > 0; }

  std::size_t parts() const { return parts_.size(); }
  /// Safe to call from several threads.
  /// @throw std::runtime_error if the file is not what it was when it was checked.
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
  std::shared_ptr<const Motion> only_;  // where there is one part
  std::int64_t rows_ = 0;
  double begin_s_ = std::numeric_limits<double>::infinity(), end_s_ = -begin_s_;
};

}  // namespace soilvdb::inline v0::io
