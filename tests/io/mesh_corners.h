// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "soilvdb/mesher.h"

namespace soilvdb::io {

/// The corners of triangles, whatever their points' order.
inline std::vector<Eigen::Vector3f> corners(const Mesh& mesh) {
  std::vector<Eigen::Vector3f> all;
  for (const auto& t : mesh.triangles)
    for (const std::uint32_t k : t) all.push_back(mesh.points[k]);
  return all;
}

}  // namespace soilvdb::io
