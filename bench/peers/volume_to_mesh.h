// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A block's mesh as OpenVDB's volumeToMesh makes it, beside core/surface/dual_contour.h.
#pragma once

#include "soilvdb/mesher.h"

namespace soilvdb::bench {

enum class VolumeToMesh {
  kDistances,  ///< a level set, measured to the triangles of our own contour; vertices as they are
  kPlanes,     ///< +-1, where the models have soil; vertices moved onto the models' planes
  kRepaired    ///< the same, with signs changed where a face of voxel centres is ambiguous
};

/// CPU time of the parts, s, summed over calls.
struct VolumeToMeshTimes {
  double calls = 0, models = 0, field = 0, topology = 0, vertices = 0;
};

/// What mesh_block() makes, with volumeToMesh's topology. Patches join bit for bit.
Mesh volume_to_mesh(const Ground& ground, const Coord3& block, VolumeToMesh how,
                    VolumeToMeshTimes& times);

}  // namespace soilvdb::bench
