// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Rows of bench/stages.cc from other files.
#pragma once

namespace soilvdb::bench {

void register_mesh_blocks();

}  // namespace soilvdb::bench
