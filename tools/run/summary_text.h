// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a run tells people at its end.
#pragma once

#include "io/journal/report.h"
#include "tools/run/run_folder.h"

namespace soilvdb::tools {

/// Prints a run's summary to stdout. @param motion_s how long the motion was that it went through
void print_summary(const io::Summary& summary, double motion_s, const RunFolder& folder);

}  // namespace soilvdb::tools
