// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A run's summary for people.
#pragma once

#include "io/journal/report.h"
#include "tools/run/run_folder.h"

namespace soilvdb::tools {

/// Prints a run's summary to stdout. @param motion_s duration of the motion
void print_summary(const io::Summary& summary, double motion_s, const RunFolder& folder);

}  // namespace soilvdb::tools
