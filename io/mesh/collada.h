// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Meshes of COLLADA files (.dae), as those of many URDFs.
#pragma once

#include <array>
#include <filesystem>
#include <vector>

#include "soilvdb/types.h"

namespace soilvdb::inline v0::io {

/// The triangles of the file's scene, with the transforms of its nodes, in metres by the file's
/// unit, in the file's axes. Faces with more than three corners must be convex. Without a scene all
/// geometries count, where they are.
/// @throw InputError if the file is damaged, or has what isn't read: skinned meshes, skews, holes
std::vector<std::array<Vec3, 3>> read_collada(const std::filesystem::path& file);

}  // namespace soilvdb::inline v0::io
