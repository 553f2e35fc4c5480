// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What is booked for a site, as its summary says it.
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
  };
  const Ground& ground;
  std::optional<SoilProperties> properties;  ///< nothing: soil is rigid
  Ledger total;
  MassBalance balance;
  std::vector<Machine> machines;
  /// Of a site that was dug before: the ground's change and that of its mass by then.
  double change_before_m3 = 0;
  std::int64_t mass_before = 0;
};

/// Puts volumes, masses, machines and the ground's size and hash into a summary.
void put_totals(const RunTotals& totals, io::Summary& summary);

}  // namespace soilvdb::tools
