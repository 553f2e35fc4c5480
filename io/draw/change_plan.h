// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A picture of the changes between two states of a site.
#pragma once

#include <filesystem>

#include "soilvdb/ground.h"
#include "soilvdb/io/picture.h"

namespace soilvdb::inline v0::io {

/// write_plan() of the ground `after`, with cut and fill since `before` in colour.
/// @param changed box of all changes, world, m; the picture adds a margin
/// @param filled true if soil was added anywhere
/// @throw std::runtime_error naming the file and the cause.
void write_change_plan(const std::filesystem::path& file, const Ground& before, const Ground& after,
                       const Eigen::AlignedBox2d& changed, bool filled, const Caption& caption);

}  // namespace soilvdb::inline v0::io
