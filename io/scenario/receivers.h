// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A machine's satellite receiver in a scenario: its key `gnss`.
#pragma once

#include "io/scenario/yaml_map.h"
#include "soilvdb/gnss.h"

namespace soilvdb::inline v0::io {

Gnss read_gnss(const YamlMap& machine);

}  // namespace soilvdb::inline v0::io
