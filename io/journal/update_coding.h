// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A journal's updates as bytes: about as many as the rows have as decimal text. An update is coded
// as the difference from the machine's update before; decimals are coded as whole numbers.
#pragma once

#include <cstdint>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "soilvdb/io/journal.h"

namespace soilvdb::inline v0::io {

/// A lossless series of numbers. A decimal with few digits takes about a byte for two digits of its
/// difference from the number before; other numbers take nine bytes.
class Series {
 public:
  void append(std::string& bytes, double value);
  /// Takes a number off the front of `bytes`; false if there is no number.
  bool take(std::string_view& bytes, double& value);

 private:
  double last_ = 0;
  int decimals_ = 0;         // of the last number that was a decimal
  std::int64_t scaled_ = 0;  // that number, in units of its last decimal
};

/// The reference for a machine's or a pour's next update, which is coded as a difference.
struct UpdateBefore {
  bool first = true;  ///< of this writer: there is no update before
  double end_s = std::numeric_limits<double>::quiet_NaN();
  std::int64_t bucket_samples = 0;
  /// Time of the last row written (a reader has the rows). NaN: no row continues it.
  double last_row_s = std::numeric_limits<double>::quiet_NaN();
  bool joints = false;
  Series ends_s, times_s;
  std::vector<Series> values;  ///< by column
};

/// Appends an update, and makes it the reference in `before`, which has one per machine and pour.
void append_update(std::string& bytes, const JournalUpdate& update,
                   std::vector<UpdateBefore>& before);

/// Takes an update off the front of `bytes`, with only the rows that its predecessor lacks.
/// @param anew set if these rows replace the machine's rows
/// @return false if there is no valid update
bool take_update(std::string_view& bytes, JournalUpdate& update, bool& anew,
                 std::vector<UpdateBefore>& before);

}  // namespace soilvdb::inline v0::io
