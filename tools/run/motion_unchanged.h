// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Checks that the motions still contain the dug rows. Only later rows may change.
#pragma once

#include <filesystem>

#include "soilvdb/io/scenario.h"
#include "tools/run/run_config.h"

namespace soilvdb::tools {

/// Compares a journal's moves with the present motions: the rows of the moves must be the same, bit
/// by bit. Rows that were omitted as redundant must still be redundant.
/// @throw io::InputError at the first differing row, FILE:LINE with the change and its remedy; also
///        if the journal's run is finished and a motion continues.
void check_motion_unchanged(const std::filesystem::path& journal, const io::Scenario& scenario,
                            const RunConfig& config);

}  // namespace soilvdb::tools
