// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Writes meshes for other programs.
#pragma once

#include <filesystem>

#include "core/mesher.h"

namespace soilvdb::io {

/// Writes PLY (binary), OBJ, STL (binary) or GLB by the file's suffix, in local coordinates with the
/// site's origin in the header where the format has a place for it (PLY, OBJ comments; STL header;
/// GLB asset extras). GLB is turned y up, as the format demands. Atomic (temporary, rename).
/// @throw std::runtime_error naming the file and the cause; std::invalid_argument for an unknown suffix.
void write_mesh(const std::filesystem::path& file, const Mesh& mesh, const Vec3& origin,
                const std::string& crs_wkt);

}  // namespace soilvdb::io
