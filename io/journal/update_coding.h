// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A journal's updates as bytes: about as many as the rows of a motion in decimals have as text.
// Each is told by what is different from the machine's update before, and decimals as whole
// numbers.
#pragma once

#include <cstdint>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "soilvdb/io/journal.h"

namespace soilvdb::inline v0::io {

/// A series of numbers, to the last bit. One that a file gave with a few decimals takes about a
/// byte for two digits of its difference to the one before; other numbers take nine.
class Series {
 public:
  void append(std::string& bytes, double value);
  /// Takes a number off the front of `bytes`; false if it isn't there.
  bool take(std::string_view& bytes, double& value);

 private:
  double last_ = 0;
  int decimals_ = 0;         // as many as the last one needed that was a decimal
  std::int64_t scaled_ = 0;  // that one, in units of its last decimal
};

/// What a machine's or a pour's next update is told by the difference to.
struct UpdateBefore {
  bool first = true;  ///< of its writer: there is none
  double end_s = std::numeric_limits<double>::quiet_NaN();
  std::int64_t bucket_samples = 0;
  /// Of the last row that was written; a reader has the rows. NaN: none goes on from it.
  double last_row_s = std::numeric_limits<double>::quiet_NaN();
  bool joints = false;
  Series ends_s, times_s;
  std::vector<Series> values;  ///< by column
};

/// Appends an update, and goes on to it in `before`, which has one for each machine and pour.
void append_update(std::string& bytes, const JournalUpdate& update,
                   std::vector<UpdateBefore>& before);

/// Takes an update off the front of `bytes`, of its rows those that weren't in the one before.
/// @param anew are those all that its machine goes on from?
/// @return false if there is none
bool take_update(std::string_view& bytes, JournalUpdate& update, bool& anew,
                 std::vector<UpdateBefore>& before);

}  // namespace soilvdb::inline v0::io
