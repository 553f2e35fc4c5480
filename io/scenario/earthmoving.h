// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Reads the sections of a scenario about moving soil: soil, pours, hoppers.
#pragma once

#include <map>
#include <string>

#include "io/scenario/yaml_map.h"
#include "soilvdb/io/scenario.h"

namespace soilvdb::inline v0::io {

/// The names of machines, pours and hoppers, which must differ in a run's output.
class Names {
 public:
  /// The value of `name` of a `kind`: "machine", "pour" or "hopper".
  /// @throw InputError if the name is taken; but a pour and a hopper may share one (a truck).
  std::string take(const YamlMap& map, const std::string& kind);

 private:
  std::map<std::string, std::string> kinds_;
};

/// Reads `soil`, and adds warnings about doubtful values.
void read_soil(const YamlMap& scenario, Scenario& result);
/// Reads `pours` and `hoppers`, which require moving soil.
void read_pours(const YamlMap& scenario, Scenario& result, Names& names);
void read_hoppers(const YamlMap& scenario, Scenario& result, Names& names);

/// @throw InputError if a bucket's body has no capacity for moving soil.
void check_capacity(const YamlMap& map, const Bucket& bucket);
/// Warns of a bucket that never releases moving soil.
void warn_if_never_dumps(const YamlMap& machine, const std::string& name, const Bucket& bucket,
                         Scenario& result);

}  // namespace soilvdb::inline v0::io
