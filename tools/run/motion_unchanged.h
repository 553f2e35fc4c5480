// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Do the motions still say what was dug? Their rows may change, come and go only after that.
#pragma once

#include <filesystem>

#include "soilvdb/io/scenario.h"
#include "tools/run/run_config.h"

namespace soilvdb::tools {

/// Holds a journal's moves, whoever dug them, against the motions as they are now: the rows that
/// took must be the same, to the last bit. Where updates left rows out that say no more than their
/// neighbours, those must still say no more.
/// @throw io::InputError at the first row that is not what was dug: FILE:LINE, what has changed and
///        what would be right; also if the journal's run is finished and a motion goes on.
void check_motion_unchanged(const std::filesystem::path& journal, const io::Scenario& scenario,
                            const RunConfig& config);

}  // namespace soilvdb::tools
