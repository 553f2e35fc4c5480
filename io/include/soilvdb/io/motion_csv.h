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

/// What a motion's angles are in: those of joints that turn, and roll, pitch and yaw.
enum class AngleUnit { kRadians, kDegrees };

struct MotionInput {
  Motion motion;
  std::vector<std::string> warnings;  ///< unused columns, joints beyond their limits
};

/// Rows that can't be what a machine did: fields missing, too many or no numbers; numbers no site
/// and no sensor has; times that don't increase, but for a row that is there twice; a joint beyond
/// its limits by more than 0.1 rad or m; a bucket or joint faster than any machine's since the last
/// good row, or a joint more than twice as fast as its URDF has it. Of MCAP files, too: a joint or
/// frame that isn't known at the row's time.
struct BadRows {
  std::int64_t count = 0;
  std::string first;             ///< "FILE:LINE: what is wrong and what would be right"
  std::optional<double> good_s;  ///< time of the last good row before it, if there is one
  std::int64_t at_odds = 0;      ///< rows that are bad only by what the good row before them says
  long at_odds_with = 0;  ///< the line of the row that most of them in a row are at odds with
  std::filesystem::path at_odds_in;  ///< its file
  /// As many of them in a row as outnumber all good rows up to the one that they are at odds with,
  /// at that line; 0: there is none.
  std::int64_t outnumbering = 0;
  long outnumbered = 0;
  std::filesystem::path outnumbered_in;
};

/// Reads `time` (s, strictly increasing) and, without a chain, x,y,z (m) with roll,pitch,yaw (rad,
/// missing ones are 0) or qx,qy,qz,qw: the bucket frame in the world; with a chain, a column for
/// each of its movable joints (rad or m). Degrees are made radians where `angles` says so.
///
/// UTF-8 with or without a byte order mark, LF or CR LF line ends, spaces around commas, quoted
/// fields, blank lines at the end. Columns it has no use for are skipped unread, with one warning.
/// A row of MCAP files is what messages of one stamp say, its time that of the header's stamp,
/// seconds since 1970; by transforms, a message that moves the frame. Rows are in the order of
/// their stamps, whatever order the files are in. Messages of other machines are passed over.
/// A joint that may go all the way round and wraps goes on past a whole turn.
/// @throw InputError naming file, line, what is wrong and what would be right; so does a bad row.
MotionInput read_motion(const MotionSource& source, const std::optional<Chain>& chain,
                        AngleUnit angles = AngleUnit::kRadians);

/// Reads the same part by part, in memory for one part. Parts join: each begins with the last row
/// of the one before. Bad rows are left out, as if the file hadn't got them.
class MotionReader {
 public:
  /// @throw InputError as read_motion() does; so does next().
  MotionReader(const MotionSource& source, const std::optional<Chain>& chain,
               AngleUnit angles = AngleUnit::kRadians);
  ~MotionReader();
  MotionReader(const MotionReader&) = delete;
  MotionReader& operator=(const MotionReader&) = delete;

  /// The row it is at and up to `most_steps` more; goes on to the last of them. One row: the end.
  Motion next(std::int64_t most_steps);
  /// Of the text of the rows that next() returned last; differs from one process to the next.
  std::size_t digest() const;

  RowMark mark() const;  ///< of the row it is at
  void go_to(const RowMark& mark);
  std::int64_t bytes_read() const;

  /// What it reads, with what it has learnt of the file.
  MotionSource source() const;

  const BadRows& bad_rows() const;  ///< of all rows read so far
  /// @throw InputError if so many angles of all rows read so far are beyond a turn that they must
  /// be
  ///        degrees, and should be radians.
  void check_angles() const;
  /// What read_motion() would warn of, for all rows read so far.
  std::vector<std::string> warnings() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace soilvdb::inline v0::io
