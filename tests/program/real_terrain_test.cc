// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Digs on other measured terrain, with and without heights.
#include <cmath>
#include <numbers>

#include "tests/program/real_site_fixture.h"

namespace soilvdb::test {
namespace real_terrain_test {

class RealTerrain : public RealSite {
 protected:
  /// A bucket goes 0.3 m into level ground at a place, along x for 2 m, and out again.
  void write_dig(const std::string& raster, double x_m, double y_m, double z_m) const {
    std::string csv = "time,x,y,z,pitch\n";
    for (int i = 0; i <= 40; ++i) {
      const double s = i / 40.0;
      csv += fmt::format("{},{},{},{},{}\n", 4 * s, x_m + 2 * s, y_m,
                         z_m + 0.2 - 0.5 * std::sin(std::numbers::pi * s), -0.3);
    }
    write_file(folder() / "dig.csv", csv);
    write_file(folder() / "dig.yaml",
               fmt::format("soilvdb: 1\nname: dig\nvoxel_size: 0.05\nterrain: {{raster: "
                           "{}/dem/{}}}\nmachines:\n  - name: digger\n    bucket: {{width: 0.7, "
                           "height: 1.1}}\n    motion: dig.csv\n",
                           data_.string(), raster));
  }
  /// Of about 2 m x 0.7 m x 0.17 m, on ground that isn't quite level.
  void expect_cut() const {
    const auto volume = read_json(folder() / "out/dig/summary.json")["volume_m3"];
    ASSERT_TRUE(volume.is_object());
    EXPECT_NEAR(volume["cut"], 0.21, 0.1);
    EXPECT_LT(std::abs(volume["residual"].get<double>()), 1e-9);
  }
};

TEST_F(RealTerrain, ARasterWithoutCrsIsDugInMetres) {
  write_dig("DEM-kootenai_37x50_1x1.asc", 556481, 5394935.5, 539.4);
  good("run dig.yaml");
  expect_cut();
}

TEST_F(RealTerrain, AGullyWithNodataZeroIsDugWhereItHasHeights) {
  write_dig("west_bijou_gully.asc", 559733.5, 4380458.5, 1724.603);
  good("run dig.yaml");
  expect_cut();
}

TEST_F(RealTerrain, AGullyWithNodataZeroIsNotDugAtItsEdge) {
  write_dig("west_bijou_gully.asc", 559793, 4380479.5, 1725.43);  // heights end at 559793.5
  expect_refused("run dig.yaml", "without a height");
}

TEST_F(RealTerrain, UndeclaredNodataIsNoGroundEither) {
  write_dig("hugo_site_filled.asc", 235, 285, 1707);
  run("run dig.yaml");
  expect_cut();
  fs::remove_all(folder() / "out");
  write_dig("hugo_site_filled.asc", 384, 524, 1708);  // heights end at 385
  expect_refused("run dig.yaml", "without a height");
  write_dig("hugo_site_filled.asc", 5, 5, -9999);
  expect_refused("run dig.yaml", "without a height");
}

}  // namespace real_terrain_test
}  // namespace soilvdb::test
