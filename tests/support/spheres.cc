// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tests/support/spheres.h"

#include <openvdb/tools/LevelSetSphere.h>

namespace soilvdb::test {

openvdb::FloatGrid::Ptr level_set_sphere(float radius_m, const openvdb::Vec3f& centre,
                                         float voxel_size_m) {
  return openvdb::tools::createLevelSetSphere<openvdb::FloatGrid>(radius_m, centre, voxel_size_m);
}

}  // namespace soilvdb::test
