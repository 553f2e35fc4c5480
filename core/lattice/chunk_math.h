// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Indices of voxels and of the chunks that they are in.
#pragma once

#include "soilvdb/base_surface.h"

namespace soilvdb::inline v0 {

/// One coordinate of the first voxel of the chunk that a voxel is in.
inline int chunk_floor(int voxel) { return voxel & ~(kChunkSide - 1); }

}  // namespace soilvdb::inline v0
