// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Collapse against truths in closed form.
#include <gtest/gtest.h>

#include <limits>
#include <string>

#include "core/constants.h"
#include "tests/support/collapse_scenes.h"
#include "tests/support/collapse_truths.h"

namespace soilvdb::test {
namespace collapse_test {

constexpr double kRms = 0.5, kP99 = 1.5;  // of cross-sections, sides
constexpr int kSides = 96;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

struct Soil {
  double repose_deg, swell;
  double slope() const { return std::tan(repose_deg * kDegree); }
  Repose repose() const { return {.slope = slope(), .swell = swell}; }
};
constexpr Soil kSoils[] = {{35, 1}, {35, 1.25}, {25, 1.1}, {30, 1.7}, {45, 1.4}};

Layers bank(double top) { return {0, top, top}; }
Layers rigid(double top) { return {top, top, top}; }

/// Collapses and compares, and notes the figures.
template <class T>
Collapse check(const std::string& name, const SoilColumns& ground, const Soil& soil, const T& truth,
               double rms = kRms) {
  const Collapse collapse = test::collapse(ground, soil.repose());
  const Error e = off(ground, collapse, truth);
  const std::string label = name + "_" + std::to_string(soil.repose_deg).substr(0, 2) + "_" +
                            std::to_string(soil.swell).substr(0, 4);
  const auto note = [&](const std::string& key, double value) {
    ::testing::Test::RecordProperty(label + key, std::to_string(value));
  };
  note("_rms", e.rms);
  note("_p99", e.p99);
  note("_max", e.max);
  note("_steps", collapse.iterations);
  EXPECT_GT(e.max, 0) << label << " didn't move";
  EXPECT_LE(e.rms, rms) << label;
  EXPECT_LE(e.p99, kP99) << label;
  return collapse;
}

TEST(Collapse, AWallRetreatsAndRunsOutWhateverItsDirection) {
  constexpr double kHeight = 20, kStrip = 10;
  for (const Soil& soil : kSoils) {
    for (const double turn_deg : {0, 30, 45}) {
      const double c = std::cos(turn_deg * kDegree), s = std::sin(turn_deg * kDegree);
      const SoilColumns ground = sampled(kSides, kSides, [&](double x, double y) {
        return bank(c * x + s * y < 0 ? kHeight : 0);
      });
      const double beta = wall_beta(kHeight, soil.swell);
      const Collapse collapse =
          check("wall" + std::to_string(static_cast<int>(turn_deg)), ground, soil,
                [&](double x, double y) {  // away from where the wall meets the grid's sides
                  if (turn_deg > 0 && std::abs(c * y - s * x) > kStrip) return kNan;
                  return std::clamp(beta - soil.slope() * (c * x + s * y), 0.0, kHeight);
                });
      if (turn_deg > 0) continue;
      // Crest and toe, where the slope passes half a side below the one and above the other.
      const auto passes = [&](double height) {
        int x = 0;
        const std::size_t row = kSides / 2 * kSides;
        const auto z = [&](int at) {
          return collapse.top_m[row + static_cast<std::size_t>(at)] / kSide;
        };
        while (z(x + 1) > height) ++x;
        return x + 0.5 + (z(x) - height) / (z(x) - z(x + 1)) - kSides / 2;
      };
      EXPECT_NEAR(passes(beta), 0, 0.5);
      EXPECT_NEAR(passes(kHeight - 0.5), (beta - kHeight + 0.5) / soil.slope(), 1);
      EXPECT_NEAR(passes(0.5), (beta - 0.5) / soil.slope(), 1);
    }
  }
}

TEST(Collapse, ARoundPitClosesFromItsRim) {
  constexpr double kRadius = 24, kDepth = 16;
  for (const Soil& soil : kSoils) {
    const double k = soil.slope();
    const double beta = pit_beta(kRadius, kDepth, k, soil.swell);
    check(
        "pit",
        sampled(kSides, kSides,
                [&](double x, double y) { return bank(std::hypot(x, y) < kRadius ? 0 : kDepth); }),
        soil, [&](double x, double y) {
          return std::clamp(beta + k * (std::hypot(x, y) - kRadius), 0.0, kDepth);
        });
  }
}

TEST(Collapse, ATowerComesToACone) {
  constexpr double kHeight = 32, kTowerRadius = 8;
  for (const Soil& soil : kSoils) {
    const double k = soil.slope();
    const double apex = tower_apex(kTowerRadius, kHeight, k, soil.swell);
    const Collapse collapse =
        check("tower",
              sampled(kSides, kSides,
                      [&](double x, double y) {
                        return bank(std::hypot(x, y) < kTowerRadius ? kHeight : 0);
                      }),
              soil, [&](double x, double y) { return std::max(0.0, apex - k * std::hypot(x, y)); });
    // Mean slopes along radii, but for the apex and the toe.
    const auto height = [&](double r, double turn) {
      const double x = r * std::cos(turn) + kSides / 2 - 0.5;
      const double y = r * std::sin(turn) + kSides / 2 - 0.5;
      const int i = static_cast<int>(x), j = static_cast<int>(y);
      const auto z = [&](int u, int v) {
        return collapse.top_m[static_cast<std::size_t>(v * kSides + u)] / kSide;
      };
      const double u = x - i, v = y - j;
      return (1 - v) * ((1 - u) * z(i, j) + u * z(i + 1, j)) +
             v * ((1 - u) * z(i, j + 1) + u * z(i + 1, j + 1));
    };
    // Drops of a cone to the next columns have half of second derivatives in them: along diagonals,
    // the worst, they make slopes sqrt(2) / 4 k / r less steep than k.
    const double r0 = 0.25 * apex / k, r1 = 0.9 * apex / k;
    const double bent = std::sqrt(2) / 4 * k * std::log(r1 / r0) / (r1 - r0);
    const double bound = bent / (1 + k * k) + kRestToleranceRad;
    double worst = 0;
    for (int i = 0; i < 48; ++i) {
      const double turn = i * 7.5 * kDegree;
      const double slope = (height(r0, turn) - height(r1, turn)) / (r1 - r0);
      worst = std::max(worst, std::abs(std::atan(slope) - std::atan(k)) / kDegree);
    }
    RecordProperty("cone_deg_" + std::to_string(soil.swell).substr(0, 4), std::to_string(worst));
    EXPECT_LE(worst, bound / kDegree);
  }
}

TEST(Collapse, SoilPilesUpAtARigidWallOpposite) {
  constexpr double kHeight = 20, kApart = 10;
  for (const Soil& soil : kSoils) {
    const double k = soil.slope();
    const double beta = root(
        [&](double b) {
          const double v = (kHeight - b) / k, toe = b / k;
          const double fill = toe < kApart ? b * toe / 2 : kApart * (b - k * kApart / 2);
          return fill - soil.swell * k * v * v / 2;
        },
        0, kHeight);
    check("opposite",
          sampled(kSides, 24,
                  [&](double x, double) {
                    return x < 0 ? bank(kHeight) : rigid(x < kApart ? 0 : 2 * kHeight);
                  }),
          soil, [&](double x, double) {
            return x > kApart ? 2 * kHeight : std::clamp(beta - k * x, 0.0, kHeight);
          });
  }
}

TEST(Collapse, SoilRunsOverABrinkAndDownSteepSupportToItsFoot) {
  constexpr double kHeight = 16, kFace = -20, kShelf = 6, kDrop = 24, kStrip = 6;
  for (const Soil& soil : kSoils) {
    for (const double support_deg : {90, 60}) {
      for (const double turn_deg : {0, 30}) {
        const double c = std::cos(turn_deg * kDegree), s = std::sin(turn_deg * kDegree);
        const double k = soil.slope(), flat = 1 / std::tan(support_deg * kDegree);
        // On the shelf the slope ends at the brink; the rest is a heap that leans on the support.
        const double at_face = k * kShelf, left = kHeight - at_face;
        const double heap = (soil.swell * left * left - at_face * at_face) / (2 * k);
        const double foot = std::sqrt(2 * heap / (1 / k - flat));
        ASSERT_LT(foot, kDrop - 1);
        const auto along = [&](double x, double y) { return c * x + s * y - kFace; };
        const auto support = [&](double u) {
          return u < kShelf ? 0 : std::max(-kDrop, (kShelf - u) / std::max(flat, 1e-9));
        };
        // Columns that the brink of a step cuts through are above or below: it is where it is but
        // for half of what a column measures across it, and the slope that ends there as much
        // higher.
        const bool cut = turn_deg > 0 && support_deg == 90;
        const double rms = kRms + (cut ? k * (c + s) / 2 : 0);
        const SoilColumns ground = sampled(kSides, kSides, [&](double x, double y) {
          const double u = along(x, y);
          return u < 0 ? Layers{0, kHeight, kHeight} : rigid(support(u));
        });
        const Collapse collapse = check(
            "step" + std::to_string(static_cast<int>(support_deg * 100 + turn_deg)), ground, soil,
            [&](double x, double y) {
              const double u = along(x, y);
              if (turn_deg > 0 && std::abs(c * y - s * x) > kStrip) return kNan;
              if (cut && std::abs(u - kShelf) < 0.71) return kNan;
              if (u < kShelf) return std::clamp(at_face - k * u, 0.0, kHeight);
              const double from = kShelf + (kDrop - foot) * flat;  // where it meets the support
              return std::max(support(u), u < from ? -kDrop : foot - kDrop - k * (u - from));
            },
            rms);
        for (std::size_t i = 0; i < ground.top_m.size(); ++i) {
          ASSERT_GE(collapse.top_m[i], ground.base_m[i]);
        }
      }
    }
  }
}

}  // namespace collapse_test
}  // namespace soilvdb::test
