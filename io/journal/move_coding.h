// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A journal's moves as bytes: about as many as the rows of a motion in decimals have as text. Each
// is told by what is different from the machine's move before it, and decimals as whole numbers.
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

/// What a machine's next move is told by the difference to.
struct MoveBefore {
  bool first = true;  ///< there is none
  double end_s = 0;
  std::int64_t bucket_samples = 0;
  double last_row_s = -std::numeric_limits<double>::infinity();  ///< written; a reader has the rows
  bool joints = false;
  Series ends_s, times_s;
  std::vector<Series> values;  ///< by column
};

/// Appends a move but for its machine's number, and goes on to it in `before`.
void append_move(std::string& bytes, const JournalMove& move, MoveBefore& before);

/// Takes a move off the front of `bytes`, of its rows those that weren't in the one before.
/// @return false if there is none
bool take_move(std::string_view& bytes, JournalMove& move, MoveBefore& before);

/// Whole numbers from 0, seven bits a byte.
void append_count(std::string& bytes, std::uint64_t count);
bool take_count(std::string_view& bytes, std::uint64_t& count);

/// Whole numbers of either sign by their difference to one before.
void append_difference(std::string& bytes, std::int64_t before, std::int64_t value);
bool take_difference(std::string_view& bytes, std::int64_t before, std::int64_t& value);

}  // namespace soilvdb::inline v0::io
