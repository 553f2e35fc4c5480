// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a site was like before: from a recording, or from a run's folder.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "soilvdb/session.h"
#include "tools/serve/live_site.h"
#include "tools/serve/work_log.h"

namespace soilvdb::tools {

struct Past {
  std::shared_ptr<Session> site;
  std::shared_ptr<const WorkLog> log;
};

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
  /// Ground and machines as they were at a time, the newest that isn't later.
  /// @throw std::exception in one line if they can't be had
  virtual Past at(double time_s) = 0;
};

/// @param start the session before its first state
std::unique_ptr<History> make_recorded_history(Session start, std::filesystem::path folder);

/// A folder that can be looked at: a run's or a recording's.
struct Opened {
  Session session;  ///< as it was in the end
  WorkLog log;      ///< of that
  ChangeBefore before;
  std::string name;
  std::unique_ptr<History> history;
};
/// @throw io::InputError if there is none of both
Opened open_folder(const std::filesystem::path& folder);

}  // namespace soilvdb::tools
