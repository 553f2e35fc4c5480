// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a run was asked for, kept in its journal so that it can be gone on with.
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
  double change_before_m3 = 0;  ///< of a site that was dug before
  std::vector<double> ends_s;   ///< of the motions, as the run began
  /// As change_before_m3, in MassUnits; of soil that moves.
  std::int64_t mass_before = 0;
};

/// All the files a run reads: the scenario first, then motions and URDFs, the terrain.
std::vector<std::filesystem::path> input_files(const io::Scenario& scenario);

/// The configuration as bytes, with the place and a fingerprint of each input but the motions:
/// those may change after what was dug, see check_motion_unchanged().
std::string to_bytes(const RunConfig& config, const io::Scenario& scenario);

/// Is it the configuration of a session's recording (Session::record)?
bool is_of_session(const std::string& bytes);

/// Takes it back, in the folder where it is now; the scenario's path is where it is now, too.
/// @throw io::InputError naming the input that has changed or gone.
RunConfig parse_run_config(const std::string& bytes, const std::filesystem::path& folder);

}  // namespace soilvdb::tools
