// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A machine or hopper that comes to a site, described by the keys of a scenario.
#pragma once

#include <functional>
#include <string>

#include "io/scenario/yaml_map.h"
#include "soilvdb/io/scenario.h"

namespace soilvdb::inline v0::io {

/// Reads a machine without a motion.
/// @param text a map, YAML or JSON
/// @param site what is there: voxel size, soil, names; paths are seen from its file. Receives
///        warnings.
/// @throw InputError with one line
MachineInput read_machine(const std::string& text, Scenario& site);

/// Reads a hopper. @param begin_s, end_s its presence, which is not among the keys here
Hopper read_hopper(const std::string& text, double begin_s, double end_s, const Scenario& site);

/// @throw InputError if a machine, pour or hopper has the name
void require_new_name(const std::string& name, const Scenario& site);

/// Calls `read` with the map of a text. Messages do not name its place.
void read_newcomer(const std::string& text, const Scenario& site, const char* what,
                   std::vector<std::string> known, const std::function<void(const YamlMap&)>& read);

}  // namespace soilvdb::inline v0::io
