// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A bucket from the mesh of a real one.
#pragma once

#include <array>
#include <filesystem>
#include <optional>

#include "soilvdb/bucket.h"

namespace soilvdb::inline v0::io {

/// The edges of a mouth, in the coordinates of a mesh file.
struct MouthEdges {
  std::array<Vec3, 2> lip;    ///< both ends of the cutting edge, in any order
  std::optional<Vec3> upper;  ///< a point of the upper edge; without it the edge is found
};

struct MeshBucket {
  Bucket bucket;
  Pose mesh_from_bucket;  ///< the bucket frame in the file's axes, m
};

/// The inside of a bucket's mesh. The mesh may have thickness, teeth, lugs and pins, parts that
/// intersect, and gaps below half a percent of the mouth's height.
///
/// 33 sections across the middle of the lip are filled from the mouth. The section of median area
/// gives the profile, simplified to 0.15 % of the height. The width is the volume between the side
/// plates divided by the area of the profile: struck_m3() is then the volume of the mesh, also if
/// its sides taper. The mouth of a lip that is curved is the straight line between its ends.
/// @param file .stl, .obj or .dae; see read_mesh()
/// @param edges in coordinates of the file; of a .dae, which is read in metres, in metres
/// @param unit_m metres per unit of the file; 1 for .dae
/// @throw InputError naming the file, the cause and the remedy
MeshBucket read_bucket_mesh(const std::filesystem::path& file, const MouthEdges& edges,
                            double unit_m = 1);

}  // namespace soilvdb::inline v0::io
