// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The unchecked rows of a motion, one by one.
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

  /// Moves to the next row. @throw LineError if it is bad; later rows can still be read
  virtual Got next() = 0;
  /// The numbers of the row, in the order of columns().names. @throw LineError
  virtual void values(std::vector<double>& v) = 0;
  virtual std::string time_text() const = 0;  ///< of the row
  virtual std::size_t hash() const = 0;       ///< of the row's content

  virtual RowMark mark() const = 0;  ///< of the row
  virtual void go_to(const RowMark& mark) = 0;
  virtual std::int64_t bytes_read() const = 0;

  /// Longest time between rows that is no finding; empty: any time.
  virtual std::optional<double> most_gap_s() const { return {}; }
  virtual void warn(std::vector<std::string>& warnings) const = 0;
  /// With the facts learnt about the files so far.
  virtual MotionSource source() const = 0;
};

/// Rows of a CSV file. @throw InputError if its header is not that of a motion
std::unique_ptr<RowSource> csv_rows(const std::filesystem::path& file,
                                    const std::optional<Chain>& chain);
/// Rows of MCAP files. @throw InputError if they hold no such motion
std::unique_ptr<RowSource> mcap_rows(const MotionSource& source, const std::optional<Chain>& chain);

}  // namespace soilvdb::inline v0::io
