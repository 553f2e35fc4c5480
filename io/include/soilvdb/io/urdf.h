// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Machines from URDF: the chain of joints from the root to the link with the bucket.
#pragma once

#include <filesystem>
#include <string>

#include "soilvdb/io/error.h"
#include "soilvdb/kinematics.h"

namespace soilvdb::inline v0::io {

/// Reads the joints from the root link to `link`, and those that they mimic; ignores all other
/// joints. Axes become unit vectors. `world_from_root` and `link_from_bucket` remain identity. Of
/// `bodies`, whose meshes are opened when a scan needs them, are all links that these joints place.
/// Thread-safe.
/// @throw InputError if the file is no URDF, has a document type or entity declarations, or if the
///        chain has a floating or planar joint, a zero axis, or a loop.
/// @throw std::invalid_argument naming the nearest link, if there is no such link.
Chain read_chain(const std::filesystem::path& file, const std::string& link);

/// A message about revolute joints whose limits are so far beyond a turn that they must be degrees;
/// empty if there are none.
std::string limits_in_degrees(const Chain& chain);

}  // namespace soilvdb::inline v0::io
