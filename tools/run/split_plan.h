// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// How one scenario is dug as several runs: which machines go apart from which, in which window of
// its time.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "soilvdb/io/journal.h"
#include "soilvdb/io/scenario.h"
#include "tools/run/run_options.h"

namespace soilvdb::tools {

/// What a folder's plan.json says. Windows follow on each other: each begins with what the parts of
/// the one before left. In a window no machine comes where one of another part does.
struct SplitPlan {
  struct Group {
    std::vector<std::string> machines;
    std::int64_t updates = 0;
  };
  /// Updates that end after begin_s and no later than end_s.
  struct Window {
    double begin_s = 0, end_s = 0;
    std::vector<Group> parts;
  };
  RunOptions options;      ///< scenario, voxel size, updates, memory
  std::int64_t parts = 0;  ///< most at once, as was asked for
  io::ScenarioValues values;
  /// Fingerprints of the scenario's other inputs. Not of motions: those are compared by their rows.
  std::map<std::string, std::string> inputs;
  std::vector<double> ends_s;  ///< of the motions
  std::vector<Window> windows;

  std::int64_t updates() const;
  /// Of the updates, those of the largest part of each window: what has to be waited for.
  std::int64_t longest() const;
};

/// The fewest windows, up to 64, that come within a tenth of what most would gain on so many
/// processes.
/// @throw io::InputError saying why a scenario can't be split: its soil moves, or its machines
///        always meet
SplitPlan make_plan(const RunOptions& options, const io::Scenario& scenario, std::int64_t parts);

/// @throw io::InputError if a path can't be written down
std::string plan_text(const std::filesystem::path& folder, const SplitPlan& plan);
/// @throw std::runtime_error naming the file and the cause; as plan_text().
void write_plan(const std::filesystem::path& folder, const SplitPlan& plan);
/// Has the folder one? @throw io::InputError if that can't be read
SplitPlan read_plan(const std::filesystem::path& folder);

/// Parts that are dug from another scenario, terrain or URDF than their neighbours don't make one
/// site. @throw io::InputError naming what has changed since the plan was made
void check_unchanged(const SplitPlan& plan);
/// @throw io::InputError if the run in a part's folder is no run of that part
void check_is_part(const io::JournalContent& journal, const RunOptions& part);

/// One part as a run, and how the whole goes on with what they came to.
RunOptions part_options(const std::filesystem::path& folder, const SplitPlan& plan,
                        std::size_t window, std::size_t part);
RunOptions whole_options(const std::filesystem::path& folder, const SplitPlan& plan);

/// The snapshot that a window begins with.
std::filesystem::path window_start(const std::filesystem::path& folder, std::size_t window);

inline constexpr const char* kPlanName = "plan.json";
inline constexpr const char* kPartsName = "parts";

}  // namespace soilvdb::tools
