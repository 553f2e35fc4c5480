// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Cut volumes against the truth, for every family of digs, placement and voxel size. With the
// environment variable SOILVDB_TABLE set, prints every error.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdlib>
#include <numbers>
#include <random>

#include "tests/support/dig_runner.h"
#include "tests/support/sanitized.h"

namespace soilvdb::test {
namespace accuracy_test {

struct Resolution {
  double voxel_size_m;
  double required;            ///< relative error of digs by buckets of 0.5 m or wider
  double required_half_sine;  ///< of the narrow bucket of the half-sine dig
};
constexpr std::array<Resolution, 3> kResolutions{
    {{0.05, 4e-3, 4e-3}, {0.025, 1e-3, 1.5e-3}, {0.0125, 3e-4, 3e-4}}};
constexpr double kRequiredOrder = 1.8;
constexpr double kRequiredSpread = 3e-4;  // over numbers of updates

constexpr double kSigmas = 5;
/// What the parabola of a segment leaves out of a point's path, voxels: sqrt(3) / 216 of its third
/// derivative, at most 1.5 times the turn (0.13 rad with kMaxBend on a bucket of ten voxels) times
/// the second, 8 kMaxBend.
constexpr double kPathBend = 2.5e-4;
constexpr int kUpdates = 50;

struct Result {
  std::string dig;
  double voxel_size_m, error, required, sigma;  // relative to the exact volume
  double bound;
};

std::vector<Dig> all_digs() {
  std::vector<Dig> digs;
  for (const std::string& family : families()) {
    std::vector<Placement> places = placements();
    if (!kLong) places.resize(kSanitized ? 1 : 2);
    for (const Placement& placement : places) digs.push_back(make_dig(family, placement));
  }
  for (std::uint64_t seed = 1; seed <= (kLong ? 10 : 5); ++seed) digs.push_back(random_dig(seed));
  return digs;
}

/// Every dig at every resolution, dug once for all tests.
const std::vector<Result>& results() {
  static const std::vector<Result> all = [] {
    std::vector<Result> list;
    for (const Dig& dig : all_digs()) {
      for (const Resolution& r : kResolutions) {
        const double h = r.voxel_size_m;
        const Dug dug(dig, h, kUpdates);
        const double cells = static_cast<double>(border_cells(dug.ground));
        const double sigma = count_error_m3(h, cells, kCountError);
        const double bend = kPathBend * h * cells * h * h;
        const double bound = kSigmas * count_error_m3(h, cells) + bend + dig.uncertainty_m3;
        list.push_back({fmt::format("{} at {:.1f} degrees", dig.family,
                                    dig.placement.yaw_rad * 180 / std::acos(-1.0)),
                        h, dug.cut_m3() / dig.exact_m3 - 1,
                        dig.family == "half_sine" ? r.required_half_sine : r.required,
                        sigma / dig.exact_m3, bound / dig.exact_m3});
      }
    }
    if (std::getenv("SOILVDB_TABLE") != nullptr) {
      fmt::print("{:36}{:>9}{:>11}{:>11}\n", "dig", "voxel/m", "error/%", "sigma/%");
      for (const Result& r : list) {
        fmt::print("{:36}{:9}{:+11.4f}{:11.4f}\n", r.dig, r.voxel_size_m, 100 * r.error,
                   100 * r.sigma);
      }
    }
    return list;
  }();
  return all;
}

TEST(CutVolume, IsWithinTheRequiredErrorForEveryDig) {
  for (const Result& r : results()) {
    EXPECT_LE(std::abs(r.error), r.required) << r.dig << ", voxel " << r.voxel_size_m;
  }
}

TEST(CutVolume, ErrsNoMoreThanSamplingExplains) {
  double sum = 0;
  for (const Result& r : results()) {
    EXPECT_LE(std::abs(r.error), r.bound) << r.dig << ", voxel " << r.voxel_size_m;
    sum += std::pow(r.error / r.sigma, 2);
  }
  // All together err like independent cells would: sqrt(n) of the mean square's spread allowed.
  const double n = static_cast<double>(results().size());
  EXPECT_LE(sum / n, 1 + kSigmas * std::sqrt(2 / n));
}

TEST(CutVolume, ErrsToNeitherSide) {
  double sum = 0;
  for (const Result& r : results()) sum += r.error / r.sigma;
  EXPECT_LE(std::abs(sum), kSigmas * std::sqrt(static_cast<double>(results().size())));
}

TEST(CutVolume, ConvergesInSecondOrder) {
  if (test::kSanitized) GTEST_SKIP() << "the same code once more";
  // Errors are random, so an order takes many digs: with n of them it is uncertain by
  // sqrt(1 / n) / ln(coarse / fine), 0.08 here. Only digs whose truth is surer than that.
  const int kPlacements = kLong ? 20 : 10;
  constexpr double kSure = 2e-6;
  const double fine = kResolutions.back().voxel_size_m, coarse = kResolutions.front().voxel_size_m;
  std::mt19937_64 random(11);
  std::uniform_real_distribution<double> unit(0, 1);
  double squares[2] = {0, 0};
  for (const std::string& family : families()) {
    for (int i = 0; i < kPlacements; ++i) {
      const Vec3 offset(unit(random), unit(random), unit(random));
      const Dig dig = make_dig(family, {2 * std::numbers::pi * unit(random), offset});
      if (dig.uncertainty_m3 > kSure * dig.exact_m3) break;
      squares[0] += std::pow(Dug(dig, coarse, kUpdates).cut_m3() / dig.exact_m3 - 1, 2);
      squares[1] += std::pow(Dug(dig, fine, kUpdates).cut_m3() / dig.exact_m3 - 1, 2);
    }
  }
  const double order = std::log(squares[0] / squares[1]) / 2 / std::log(coarse / fine);
  if (std::getenv("SOILVDB_TABLE") != nullptr) fmt::print("order of convergence {:.2f}\n", order);
  EXPECT_GE(order, kRequiredOrder);
}

TEST(CutVolume, DoesNotDependOnTheNumberOfUpdates) {
  for (const char* family : {"half_sine", "drag_curl_retreat"}) {
    const Dig dig = make_dig(family, placements()[1]);
    double least = 2 * dig.exact_m3, most = 0;
    for (const int updates : {20, 100, 1000, 5000}) {
      const double cut = Dug(dig, 0.025, updates).cut_m3();
      least = std::min(least, cut);
      most = std::max(most, cut);
    }
    EXPECT_LE(most - least, kRequiredSpread * dig.exact_m3) << family;
  }
}

}  // namespace accuracy_test
}  // namespace soilvdb::test
