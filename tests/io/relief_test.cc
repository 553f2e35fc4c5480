// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Heights for pictures.
#include "io/draw/relief.h"

#include <gtest/gtest.h>

#include <optional>

namespace soilvdb::test {
namespace relief_test {

TEST(Relief, AReliefIsSampledInTheMiddleOfItsCells) {
  const auto x = [](double east, double) { return std::optional(east); };
  const auto y = [](double, double north) { return std::optional(north); };
  const Eigen::AlignedBox2d box(Vec2(10, 20), Vec2(14, 22));
  const io::Relief along_x = io::sample_relief(x, x, box, 4, 2, 0.01, false);
  const io::Relief along_y = io::sample_relief(y, y, box, 4, 2, 0.01, false);
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 2; ++j) {
      EXPECT_NEAR(along_x.height[along_x.at(i, j)] + along_x.datum_m, 10.5 + i, 1e-5);
      EXPECT_NEAR(along_y.height[along_y.at(i, j)] + along_y.datum_m, 21.5 - j, 1e-5);
    }
  }
}

}  // namespace relief_test
}  // namespace soilvdb::test
