// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The totals of a site, as in its summary.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "io/journal/report.h"
#include "soilvdb/bucket.h"
#include "soilvdb/earthmoving.h"
#include "soilvdb/ground.h"
#include "soilvdb/tracker.h"

namespace soilvdb::tools {

struct RunTotals {
  struct Machine {
    std::string name;
    Bucket bucket;
    Ledger ledger;
    std::int64_t bad_rows = 0;
    std::optional<Estimate> lip_error_m = {};  ///< where there were scans
  };
  const Ground& ground;
  std::optional<SoilProperties> properties;  ///< empty: soil is rigid
  Ledger total;
  MassBalance balance;
  std::vector<Machine> machines;
  /// Of a site that was dug before: its ground's earlier change in volume and mass.
  double change_before_m3 = 0;
  std::int64_t mass_before = 0;
  std::optional<Surveyed> surveyed = {};  ///< where there were scans
};

/// Adds volumes, masses, machines, and the ground's size and hash to a summary.
void put_totals(const RunTotals& totals, io::Summary& summary);

}  // namespace soilvdb::tools
