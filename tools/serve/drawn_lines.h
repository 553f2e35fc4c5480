// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The lines of a design for viewers.
#pragma once

#include <string>

#include "io/terrain/design_lines.h"
#include "soilvdb/io/site.h"

namespace soilvdb::tools {

/// {"lines": [[[x, y, z], ..], ..]}, world, m. Lines without heights lie on the ground before
/// digging, and are not there where it has none.
std::string drawn_lines(const io::DesignLines& lines, const io::Site& site);

}  // namespace soilvdb::tools
