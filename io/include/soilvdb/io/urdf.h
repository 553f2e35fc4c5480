// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Machines as URDF: the chain of joints from the root to the link that carries the bucket.
#pragma once

#include <filesystem>
#include <string>

#include "soilvdb/io/error.h"
#include "soilvdb/kinematics.h"

namespace soilvdb::inline v0::io {

/// Reads the joints from the root link to `link` and those that they mimic; what else is beyond or
/// beside them is not looked at, and meshes are not opened. Axes are made unit. `world_from_root`
/// and `link_from_bucket` are left as identity. Safe to call from several threads.
/// @throw InputError if the file can't be used: not a URDF, document type or entity declarations,
///        or on the chain a floating or planar joint, a zero axis, or a loop.
/// @throw std::invalid_argument naming the nearest link, if there is no such link.
Chain read_chain(const std::filesystem::path& file, const std::string& link);

/// Says which revolute joints have limits so far beyond a turn that they must be degrees; empty if
/// there are none.
std::string limits_in_degrees(const Chain& chain);

}  // namespace soilvdb::inline v0::io
