// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Level sets that OpenVDB made, in one place because its templates take long to compile.
#pragma once

#include <openvdb/openvdb.h>

namespace soilvdb::test {

openvdb::FloatGrid::Ptr level_set_sphere(float radius_m, const openvdb::Vec3f& centre,
                                         float voxel_size_m);

}  // namespace soilvdb::test
