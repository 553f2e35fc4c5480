// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The part of a report about areas with a name, and their design.
#pragma once

#include <string>

#include "tools/serve/report.h"
#include "tools/serve/report_chart.h"

namespace soilvdb::tools {

/// A table and a chart for each area; empty without areas.
/// @param ticks of the charts @param moment the text of a day and time @param unit of volumes
std::string progress_html(const Report& report, const ChartTicks& ticks, const ChartTicks& moment,
                          const std::string& unit);

}  // namespace soilvdb::tools
