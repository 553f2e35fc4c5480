// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Scans of all formats: whatever the bytes, their points are finite and near, or they are refused.
#include "soilvdb/io/point_cloud.h"
#include "tests/fuzz/fuzz.h"

using namespace soilvdb;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const test::TempFolder folder;
  const auto file = folder.write("a.scan", fuzz::text(data, size));
  fuzz::expect_read_or_refused([&] {
    const io::PointCloud cloud = io::read_points(file);
    fuzz::require(cloud.points_m.size() + cloud.without_return > 0, "a scan has points");
    for (const Vec3& p : cloud.points_m)
      fuzz::require(p.cwiseAbs().maxCoeff() <= 1e9, "points are near");
  });
  return 0;
}
