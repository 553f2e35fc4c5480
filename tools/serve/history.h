// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a site was like before: from a recording, or from the snapshots of a run.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "soilvdb/session.h"

namespace soilvdb::tools {

/// For one thread at a time.
class History {
 public:
  struct Times {
    double from_s = 0, to_s = 0;  ///< NaN: nothing is recorded yet; of one that goes on `to_s` is
                                  ///< of when first asked
    std::vector<double> snapshots_s;
  };

  virtual ~History() = default;
  virtual Times times() = 0;
  /// The ground as it was at a time, the newest that isn't later.
  /// @throw std::exception in one line if it can't be had
  virtual std::shared_ptr<Session> at(double time_s) = 0;
};

/// @param start the session before its first state
std::unique_ptr<History> make_recorded_history(Session start, std::filesystem::path folder);

/// A folder that can be looked at: a run's or a recording's.
struct Opened {
  Session session;  ///< as it was in the end
  std::string name;
  std::unique_ptr<History> history;
};
/// @throw io::InputError if there is none of both
Opened open_folder(const std::filesystem::path& folder);

}  // namespace soilvdb::tools
