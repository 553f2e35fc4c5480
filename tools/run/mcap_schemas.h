// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Schemas of the messages in soil.mcap.
#pragma once

#include "io/mcap/mcap_writer.h"

namespace soilvdb::tools {

io::McapSchema scene_update_schema();
io::McapSchema grid_map_schema();
io::McapSchema transforms_schema();
io::McapSchema wrench_schema();
io::McapSchema load_schema();

}  // namespace soilvdb::tools
