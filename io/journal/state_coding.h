// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a session was fed as bytes, each told by what is different from the machine's before it.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "io/journal/move_coding.h"
#include "soilvdb/io/journal.h"

namespace soilvdb::inline v0::io {

/// Turns a journal's states into bytes in their order, or bytes into states.
class StateCoding {
 public:
  void append(std::string& bytes, const JournalState& state);
  /// Takes a state off the front of `bytes`. @return false if there is none
  bool take(std::string_view& bytes, JournalState& state);

 private:
  struct Before {
    Series time_s;
    std::vector<Series> values;
    std::int64_t bucket_samples = 0;
  };
  /// Poses and joints of a machine are told apart.
  std::map<std::pair<std::uint32_t, JournalState::Kind>, Before> before_;
  bool first_ = true;  ///< of its writer: a reader forgets what came before
};

}  // namespace soilvdb::inline v0::io
