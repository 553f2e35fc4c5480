// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A site at earlier times, from a recording or a run's folder.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "soilvdb/session.h"
#include "tools/serve/live_site.h"
#include "tools/serve/work_log.h"

namespace soilvdb::tools {

struct Past {
  std::shared_ptr<Session> site;
  std::shared_ptr<const WorkLog> log;
};

/// One thread at a time. All members throw std::exception with one line if they fail.
class History {
 public:
  struct Times {
    /// Empty before the first recorded time. While a recording goes on, `to_s` is the last time at
    /// the first query.
    std::optional<double> from_s, to_s;
    std::vector<double> snapshots_s;
  };
  /// @param start the session before its first state
  History(Session start, std::filesystem::path folder)
      : start_(std::move(start)), folder_(std::move(folder)) {}

  Times times();
  /// Ground and machines at the newest recorded time up to `time_s`.
  Past at(double time_s) const;
  /// As above, the site only.
  std::shared_ptr<Session> ground_at(double time_s) const;
  /// A machine's states later than a time.
  StatesAfter states_after(std::size_t machine, double time_s) const;
  /// The recording without such states, and what it has.
  /// @param snapshot_every_s as in Recording @param go_on an exception from it ends that
  std::pair<std::shared_ptr<Undone>, FedStates> without(const StatesAfter& states,
                                                        std::optional<double> snapshot_every_s,
                                                        const std::function<void()>& go_on) const;

 private:
  WorkLog log(const Session& there, double time_s) const;

  Session start_;
  std::filesystem::path folder_;
  Times times_;
};

/// A folder of a run or a recording, opened for viewing.
struct Opened {
  Session session;  ///< in its last state
  WorkLog log;      ///< up to that state
  ChangeBefore before;
  std::string name;
  std::unique_ptr<History> history;
};
/// @throw io::InputError if the folder holds neither
Opened open_folder(const std::filesystem::path& folder);

}  // namespace soilvdb::tools
