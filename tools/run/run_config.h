// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The configuration of a run, in its journal, so that the run can be continued.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "soilvdb/io/scenario.h"
#include "tools/run/run_options.h"

namespace soilvdb::tools {

struct RunConfig {
  RunOptions options;           ///< `out` is set
  double change_before_m3 = 0;  ///< of a site that was dug before this run
  std::vector<double> ends_s;   ///< of the motions, at the run's beginning
  /// As change_before_m3 in MassUnits, with moving soil.
  std::int64_t mass_before = 0;
};

/// All input files of a run: scenario, motions, URDFs, terrain.
std::vector<std::filesystem::path> input_files(const io::Scenario& scenario);

/// The configuration as bytes, with path and fingerprint of each input except the motions: rows
/// after the dug part may change, see check_motion_unchanged().
std::string to_bytes(const RunConfig& config, const io::Scenario& scenario);

inline constexpr int kRecordFormat = 4;  ///< states of format 3 had other members

/// Is it the configuration of a session's recording (Session::record)?
bool is_of_session(const std::string& bytes);

/// @param bytes a session's configuration
/// @throw io::InputError unless sessions of this version go on with it
void check_record_format(const std::string& bytes, const std::filesystem::path& folder);

/// Decodes it, with the present paths of the folder and the scenario.
/// @throw io::InputError naming an input that has changed or is missing.
RunConfig parse_run_config(const std::string& bytes, const std::filesystem::path& folder);

}  // namespace soilvdb::tools
