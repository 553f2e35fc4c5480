// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The part of a scenario about soil that moves, and what brings it or takes it away.
#pragma once

#include <map>
#include <string>

#include "io/scenario/yaml_map.h"
#include "soilvdb/io/scenario.h"

namespace soilvdb::inline v0::io {

/// Names by which machines, pours and hoppers are told apart in what a run writes.
class Names {
 public:
  /// The name under `name` of a `kind`, "machine", "pour" or "hopper".
  /// @throw InputError if something else has it; a pour and a hopper may be one truck.
  std::string take(const YamlMap& map, const std::string& kind);

 private:
  std::map<std::string, std::string> kinds_;
};

/// Reads `soil`, and warns of what is doubtful in it.
void read_soil(const YamlMap& scenario, Scenario& result);
/// Reads `pours` and `hoppers`, which take soil that moves.
void read_pours(const YamlMap& scenario, Scenario& result, Names& names);
void read_hoppers(const YamlMap& scenario, Scenario& result, Names& names);

/// @throw InputError if a bucket's body holds nothing of soil that moves.
void check_capacity(const YamlMap& map, const Bucket& bucket);
/// Warns of a bucket that keeps all soil that it ever took, where that moves.
void warn_if_never_dumps(const YamlMap& machine, const std::string& name, const Bucket& bucket,
                         Scenario& result);

}  // namespace soilvdb::inline v0::io
