// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Motions of buckets, by poses or by joints: one row per time, of a CSV file or an MCAP file.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "soilvdb/io/csv.h"
#include "soilvdb/io/motion_source.h"
#include "soilvdb/motion.h"

namespace soilvdb::inline v0::io {

/// Unit of a motion's angles: turning joints, and roll, pitch and yaw.
enum class AngleUnit { kRadians, kDegrees };

struct MotionInput {
  Motion motion;
  std::vector<std::string> warnings;  ///< unused columns, joints beyond their limits
};

/// Rows that cannot be true: missing or surplus fields; values that are not numbers, or that no
/// sensor sends; times that do not increase (a repeated row is allowed); a joint more than 0.1 rad
/// or m beyond its limits; a bucket or joint that moved faster since the last good row than any
/// machine does, or a joint at more than twice its URDF velocity. In MCAP files also: a joint or
/// frame that is unknown at the row's time.
struct BadRows {
  std::int64_t count = 0;
  std::string first;             ///< "FILE:LINE: what is wrong and what would be right"
  std::optional<double> good_s;  ///< time of the last good row before `first`, if any
  std::int64_t at_odds = 0;      ///< rows that are bad only in comparison with the last good row
  long at_odds_with = 0;         ///< line of the good row that the longest run of these contradicts
  std::filesystem::path at_odds_in;  ///< its file
  /// Longest run of such rows that outnumbers all good rows up to the row it contradicts, which is
  /// at `outnumbered`; 0: there is no such run.
  std::int64_t outnumbering = 0;
  long outnumbered = 0;
  std::filesystem::path outnumbered_in;
};

/// Reads the rows of a motion: `time` (s, strictly increasing) and the bucket frame in the world,
/// or joints. Without a chain: x,y,z (m) with roll,pitch,yaw (rad, default 0) or qx,qy,qz,qw. With
/// a chain: a column for each movable joint (rad or m). `angles` is the unit of the file's angles;
/// the motion is in radians.
///
/// CSV: UTF-8 with or without a byte order mark, LF or CR LF line ends, spaces around commas,
/// quoted fields, blank lines at the end. Other columns are skipped with one warning.
///
/// MCAP: a row consists of the messages with one header stamp, which is its time, in seconds since
/// 1970. With transforms, each message that moves the frame makes a row. Rows are in the order of
/// their stamps, whatever the order of the files. Messages of other machines are skipped.
///
/// A joint that wraps continues past a whole turn, if it can go all the way round.
/// @throw InputError naming file, line, what is wrong and what would be right; also for a bad row.
MotionInput read_motion(const MotionSource& source, const std::optional<Chain>& chain,
                        AngleUnit angles = AngleUnit::kRadians);

/// Reads the same in parts, with one part in memory. Each part begins with the last row of the part
/// before. Bad rows are left out.
class MotionReader {
 public:
  /// @throw InputError as read_motion() does; so does next().
  MotionReader(const MotionSource& source, const std::optional<Chain>& chain,
               AngleUnit angles = AngleUnit::kRadians);
  ~MotionReader();
  MotionReader(const MotionReader&) = delete;
  MotionReader& operator=(const MotionReader&) = delete;

  /// The current row and up to `most_steps` rows after it, the last of which becomes current. A
  /// single row marks the end.
  Motion next(std::int64_t most_steps);
  /// Hash of the text of the rows that next() returned last; valid within this process only.
  std::size_t digest() const;

  RowMark mark() const;  ///< of the current row
  void go_to(const RowMark& mark);
  std::int64_t bytes_read() const;

  /// The source, with the facts learnt about its files.
  MotionSource source() const;

  const BadRows& bad_rows() const;  ///< of all rows read so far
  /// @throw InputError if so many angles of the rows read so far exceed a turn that they must be
  ///        degrees.
  void check_angles() const;
  /// The warnings of read_motion() for all rows read so far.
  std::vector<std::string> warnings() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace soilvdb::inline v0::io
