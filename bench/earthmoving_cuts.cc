// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Vertical cuts in cohesive soil, deepened one voxel at a time: at what height they fail, and along
// which plane, against Culmann's.
#include <fmt/core.h>

#include <algorithm>
#include <optional>

#include "bench/earthmoving.h"
#include "tests/support/collapse_truths.h"
#include "tests/support/ground_window.h"

namespace soilvdb::bench {
namespace {

constexpr double kBankVoxel = 0.1, kGravity = 9.81;

struct CohesiveSoil {
  double cohesion_pa, friction_deg, density_kg_m3;
};
constexpr CohesiveSoil kSoils[] = {
    {5e3, 20, 1700}, {10e3, 30, 1835}, {8e3, 25, 1800}, {12e3, 15, 1900}, {3e3, 35, 1600}};

struct Failed {
  double stood_m = 0, failed_m = 0;  ///< greatest height that stood; the first that didn't
  double crest_m = 0;                ///< how far behind the face the crest is then
};

/// Shaves a bench off before a face, a voxel at a time, until the face fails. What lies before the
/// bench is lower than all of it from the start, so that there is no other face.
std::optional<Failed> cut(const CohesiveSoil& s, double until_m) {
  constexpr double kHalf = 3, kBench = 3, kBeyond = 2, kDeep = 12;
  const Shape shape = [](double x, double y) {
    return x > kBench || (x > 0 && std::abs(y) > kHalf) ? -kDeep : 0.0;
  };
  Ground ground(kBankVoxel, Vec3(kBankVoxel / 2, kBankVoxel / 2, kBankVoxel / 2),
                posts(shape, {Vec2(-10, -10), Vec2(10, 10)}, kBankVoxel / 2));
  Earthmoving earthmoving = loam();
  earthmoving.soil->cohesion_pa = s.cohesion_pa;
  earthmoving.soil->friction_rad = s.friction_deg * kDegree;
  earthmoving.soil->density_kg_m3 = s.density_kg_m3;
  Bucket plate;
  plate.width_m = kBench;
  plate.height_m = 2 * kBankVoxel;
  Tracker tracker(ground, {plate}, earthmoving);
  for (int stage = 1; stage * kBankVoxel <= until_m; ++stage) {
    const double z = -stage * kBankVoxel;
    const auto pose = [&](double y, double at_z) {
      return Pose{{kBench / 2, y, at_z}, from_rpy(0, 0, std::numbers::pi / 2)};
    };
    tracker.update(0, pose(-kHalf - kBeyond, 1));
    for (const Pose& to :
         {pose(-kHalf - kBeyond, z), pose(kHalf + kBeyond, z), pose(kHalf + kBeyond, 1)})
      tracker.update(0, to);
    tracker.come_to_rest();
    // From the face back to where the bank still stands as it was.
    const test::GroundWindow window(ground, {-90, 0}, 90, 1);
    int standing = window.nx() - 1;
    while (standing > 0 && window.at(standing, 0).bank < -1) --standing;
    if (standing == window.nx() - 1) continue;
    return Failed{-z - kBankVoxel, -z, (window.nx() - 1 - standing) * kBankVoxel};
  }
  return std::nullopt;
}

}  // namespace

void measure_cuts(const Options& options, Goals& goals) {
  Csv csv(options.out / "cuts.csv",
          "cohesion_pa,friction_deg,density_kg_m3,critical_m,stood_m,failed_m,crest_m,"
          "plane_crest_m");
  constexpr double kMore = 0.5;  // m beyond the critical height that are tried
  const std::size_t soils = options.quick ? 1 : std::size(kSoils);
  for (const CohesiveSoil& s : std::span(kSoils).first(soils)) {
    const double friction = s.friction_deg * kDegree;
    const double critical_m =
        test::critical_height_m(s.cohesion_pa, friction, s.density_kg_m3 * kGravity);
    const auto failed = cut(s, critical_m + kMore);
    const std::string name =
        fmt::format("vertical cut, {} kPa, {} degrees", s.cohesion_pa / 1e3, s.friction_deg);
    const std::string note = fmt::format("critical {:.2f} m; stood {:.2f} m", critical_m,
                                         failed ? failed->stood_m : critical_m + kMore);
    // Nothing is as far off as what was tried.
    const double off_m =
        failed ? std::max({0.0, failed->stood_m - critical_m, critical_m - failed->failed_m})
               : kMore;
    const double plane_m =
        failed ? failed->failed_m / std::tan(test::failure_plane_rad(friction)) : 0;
    csv.row(fmt::format("{},{},{},{:.4f},{:.4f},{:.4f},{:.4f},{:.4f}", s.cohesion_pa,
                        s.friction_deg, s.density_kg_m3, critical_m,
                        failed ? failed->stood_m : critical_m + kMore,
                        failed ? failed->failed_m : std::nan(""),
                        failed ? failed->crest_m : std::nan(""), plane_m));
    goals.add({name + ", height it fails at",
               off_m / kBankVoxel,
               "voxel off",
               1,
               {},
               failed ? note : note + ", NEVER FAILED"});
    if (!failed) continue;
    goals.add({name + ", crest", std::abs(failed->crest_m - plane_m) / kBankVoxel, "voxel off", 2});
  }
}

}  // namespace soilvdb::bench
