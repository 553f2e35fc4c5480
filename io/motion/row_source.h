// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The rows of a motion one by one, as numbers that nobody has checked yet.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "io/motion/motion_columns.h"
#include "soilvdb/io/csv.h"
#include "soilvdb/io/motion_source.h"
#include "soilvdb/kinematics.h"

namespace soilvdb::inline v0::io {

class RowSource {
 public:
  enum class Got { kEnd, kBlank, kRow };

  virtual ~RowSource() = default;

  virtual const RowPlace& place() const = 0;
  virtual const Columns& columns() const = 0;

  /// Goes on to the next row. @throw LineError if that is none; the ones after it can be read
  virtual Got next() = 0;
  /// The numbers of that row, in the order of columns().names. @throw LineError
  virtual void values(std::vector<double>& v) = 0;
  virtual std::string time_text() const = 0;  ///< of that row
  virtual std::size_t hash() const = 0;       ///< of all that the row says

  virtual RowMark mark() const = 0;  ///< of that row
  virtual void go_to(const RowMark& mark) = 0;
  virtual std::int64_t bytes_read() const = 0;

  /// Time from one row to the next that goes without saying; nothing: any does.
  virtual std::optional<double> most_gap_s() const { return {}; }
  virtual void warn(std::vector<std::string>& warnings) const = 0;
  /// With what is known of the file by now.
  virtual MotionSource source() const = 0;
};

/// Of a CSV file. @throw InputError if its head is none of a motion, as the other does
std::unique_ptr<RowSource> csv_rows(const std::filesystem::path& file,
                                    const std::optional<Chain>& chain);
/// Of MCAP files. @throw InputError if they hold no such motion
std::unique_ptr<RowSource> mcap_rows(const MotionSource& source, const std::optional<Chain>& chain);

}  // namespace soilvdb::inline v0::io
