// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What the parts of a window came to, made one: ground, machines, and at the end the journal.
#pragma once

#include <filesystem>

#include "soilvdb/io/scenario.h"
#include "tools/run/split_plan.h"

namespace soilvdb::tools {

/// Writes the snapshot that the next window begins with; of the last window the journal of a run of
/// the whole in `folder`, and its final snapshot, which `soilvdb resume` makes a finished run of.
/// Each chunk of the ground is as the one part left it that changed it, so the result is that of
/// one process, bit for bit.
/// @throw std::runtime_error where a part isn't finished or damaged, two parts changed one chunk,
///        or a file can't be written; io::InputError where a file can't be read
void merge_window(const std::filesystem::path& folder, const SplitPlan& plan, std::size_t window,
                  const io::Scenario& scenario);

/// Has it been merged?
bool is_merged(const std::filesystem::path& folder, const SplitPlan& plan, std::size_t window);

}  // namespace soilvdb::tools
