// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Laws of the cut: where, how large and in which order one digs doesn't matter; and the surface
// that phi and the mesh show is the one that the samples count.
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>

#include "core/excavate.h"
#include "core/mesher.h"
#include "tests/dig_runner.h"
#include "tests/families.h"

namespace soilvdb::testing {
namespace {

constexpr double kVoxel = 0.05;
constexpr int kUpdates = 40;
/// Standard errors that two counts of one cut, on other cells, may differ by.
constexpr double kSigmas = 5;
constexpr double kWorstCellError = 0.09;   // root mean square in the worst direction, in cells

double count_error(const Soil& soil) {
  return kSigmas * kWorstCellError * std::pow(soil.voxel_size_m(), 3) *
         std::sqrt(2 * static_cast<double>(border_cells(soil)));
}

TEST(Cut, IsTheSameSamplesAtUtmCoordinates) {
  for (const char* family : {"half_sine", "drag_curl", "raster", "steep"}) {
    const Dig near = make_dig(family, {0.3, {0, 0, 0}});
    const Dig far = make_dig(family, {0.3, {500000, 4200000, 128}});
    const Dug a(near, kVoxel, kUpdates), b(far, kVoxel, kUpdates);
    // Coordinates of 4e6 m are rounded to 1e-9 m, so a sample in 1e6 may change sides.
    EXPECT_NEAR(a.cut_m3(), b.cut_m3(), 1e-5 * a.cut_m3()) << family;
    EXPECT_EQ(a.soil.chunks().size(), b.soil.chunks().size()) << family;
  }
}

TEST(Cut, HardlyDependsOnYaw) {
  const Dug ahead(make_dig("drag", {0, {0.013, 0.021, 0.007}}), kVoxel, kUpdates);
  for (const double yaw : {0.2, 0.9, 1.3, 2.6, 4.4}) {
    const Dug turned(make_dig("drag", {yaw, {0.013, 0.021, 0.007}}), kVoxel, kUpdates);
    EXPECT_NEAR(turned.cut_m3(), ahead.cut_m3(), count_error(ahead.soil)) << yaw;
  }
}

TEST(Cut, ScalesWithTheScene) {
  const Dig dig = make_dig("half_sine", {});
  const double truth = Dug(dig, kVoxel, kUpdates).cut_m3();
  for (const double scale : {1e-2, 10.0, 100.0}) {   // buckets are 1 mm to 100 m
    Dig scaled = dig;
    scaled.bucket.width_m *= scale;
    scaled.bucket.height_m *= scale;
    std::vector<Pose> poses;
    for (const double t : dig.motion.times_s()) {
      poses.push_back(dig.motion.pose(t));
      poses.back().position *= scale;
    }
    scaled.motion = Motion(dig.motion.times_s(), poses);
    const double cut = Dug(scaled, kVoxel * scale, kUpdates).cut_m3();
    EXPECT_NEAR(cut / std::pow(scale, 3), truth, 1e-5 * truth) << scale;
  }
}

TEST(Cut, TheSamePathAgainRemovesNothing) {
  for (const std::string& family : families()) {
    const Dig dig = make_dig(family, placements()[1]);
    Soil soil(kVoxel, dig.origin, dig.ground);
    const auto path = dig.motion.trace(0, 1, dig.bucket, kVoxel * 5e-4, kVoxel * 16);
    const auto faces = facets(dig.bucket);
    EXPECT_GT(excavate(soil, faces, path).captured, 0) << family;
    EXPECT_EQ(excavate(soil, faces, path).captured, 0) << family << " again";
    const std::vector<Pose> back(path.rbegin(), path.rend());
    EXPECT_EQ(excavate(soil, faces, back).captured, 0) << family << " backwards";
  }
}

TEST(Cut, TheOrderOfDisjointCutsDoesNotMatter) {
  const Dig one = make_dig("drag", {0, Vec3::Zero()}), two = make_dig("drag", {0, {0, 3, 0}});
  const auto dig_both = [&](const Dig& first, const Dig& second) {
    Soil soil(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
    Tracker tracker(soil, {first.bucket, second.bucket});
    run(tracker, first, kUpdates, 0);
    run(tracker, second, kUpdates, 1);
    tracker.flush();
    return soil.state_hash();
  };
  EXPECT_EQ(dig_both(one, two), dig_both(two, one));
}

TEST(Cut, SoilOnlyShrinks) {
  const Dig dig = make_dig("drag_curl_retreat", placements()[1]);
  Soil soil(kVoxel, dig.origin, dig.ground);
  Tracker tracker(soil, {dig.bucket});
  std::map<const Chunk*, std::vector<float>> before;
  for (int i = 0; i < kUpdates; ++i) {
    tracker.update(0, dig.motion.trace(i / 40.0, (i + 1) / 40.0, dig.bucket, tracker.tolerance_m(),
                                       tracker.stride_m()));
    for (const Chunk* chunk : soil.chunks()) {
      std::vector<float>& old = before[chunk];
      for (std::size_t n = 0; n < old.size(); ++n) ASSERT_GE(chunk->phi[n], old[n]);
      old.assign(chunk->phi, chunk->phi + kLeafSize);
    }
  }
}

/// What the oracle says about a point in the frame of the family.
bool truly_soil(const Family& f, const Sweep& sweep, const Vec3& p) {
  return p.z() < f.height_m + f.slope.dot(p.head<2>()) && !passes_through(sweep, p);
}

const Family& family_named(const std::string& name) {
  return *std::find_if(all_families().begin(), all_families().end(),
                       [&](const Family& f) { return f.name == name; });
}

class Surface : public ::testing::TestWithParam<std::string> {};

TEST_P(Surface, PhiAndSamplesAgreeOnWhatIsSoil) {
  const Dig dig = make_dig(GetParam(), placements()[1]);
  const double h = 0.025;
  const Dug dug(dig, h, 200);
  std::int64_t near = 0, wrong = 0, far_wrong = 0;
  for (const Chunk* chunk : dug.soil.chunks()) {
    SampleWords samples;
    dug.soil.read_samples(chunk->origin, samples);
    for (int n = 0; n < kLeafSize; ++n) {
      const int count = std::popcount(samples[static_cast<std::size_t>(n)]);
      const bool differ = (chunk->phi[n] < 0) != (count > 32);
      // A cell reaches 0.87 voxels from its centre.
      if (std::abs(chunk->phi[n]) < 0.87 * h) {
        ++near;
        wrong += differ && (count == 0 || count == 64);
      } else {
        far_wrong += count != (chunk->phi[n] < 0 ? 64 : 0);
      }
    }
  }
  EXPECT_GT(near, 0);
  EXPECT_EQ(wrong, 0) << "of " << near << " cells near the surface";
  EXPECT_EQ(far_wrong, 0);
}

TEST_P(Surface, ZeroOfPhiLiesOnTheTrueSurface) {
  const Family& f = family_named(GetParam());
  const Sweep sweep = f.sweep();
  const Dig dig = make_dig(GetParam(), {0, {0.0131, 0.0077, 0.0093}});
  // Errors of phi away from creases; creases are where the truth isn't flat within a voxel.
  std::map<double, double> worst;
  for (const double h : {0.05, 0.025}) {
    const Dug dug(dig, h, 200);
    const auto truth = [&](const Vec3& p) {
      return truly_soil(f, sweep, p - dig.placement.offset);
    };
    for (const Chunk* chunk : dug.soil.chunks()) {
      for (int n = 0; n < kLeafSize; n += 3) {
        const int x = n >> 6, y = n >> 3 & 7, z = n & 7;
        if (x == 0 || y == 0 || z == 0 || x == 7 || y == 7 || z == 7) continue;
        const float v = chunk->phi[n];
        if (std::abs(v) > 0.5 * h) continue;
        const Vec3 slope(chunk->phi[n + 64] - chunk->phi[n - 64], chunk->phi[n + 8] - chunk->phi[n - 8],
                         chunk->phi[n + 1] - chunk->phi[n - 1]);
        const Vec3 normal = slope.normalized();
        const Vec3 p = dug.soil.world_from_index((chunk->origin + Coord3(x, y, z)).cast<double>());
        const Vec3 on = p - static_cast<double>(v) * normal;   // where phi says it is zero
        // Flat here: the truth on discs a voxel wide, a quarter of a voxel to both sides.
        const Vec3 u = normal.unitOrthogonal(), w = normal.cross(u);
        bool flat = true;
        for (int k = 0; k < 8 && flat; ++k) {
          const double a = k * std::numbers::pi / 4;
          const Vec3 rim = on + 2 * h * (std::cos(a) * u + std::sin(a) * w);
          flat = truth(rim - 0.3 * h * normal) && !truth(rim + 0.3 * h * normal);
        }
        if (!flat) continue;
        double in = -0.3 * h, out = 0.3 * h;
        if (!truth(on + in * normal) || truth(on + out * normal)) {
          worst[h] = std::max(worst[h], 0.3 * h);
          continue;
        }
        for (int k = 0; k < 20; ++k) {
          const double mid = (in + out) / 2;
          (truth(on + mid * normal) ? in : out) = mid;
        }
        worst[h] = std::max(worst[h], std::abs(in));
      }
    }
    // Bends of these digs have radii of 0.16 m or more (the half-sine's sharpest: b^2 / a = 0.125 m
    // is its end's); phi is a distance to first order in h / radius.
    EXPECT_LT(worst[h], h * h / 0.125) << "voxel " << h;
  }
}

INSTANTIATE_TEST_SUITE_P(Of, Surface, ::testing::Values("half_sine", "drag", "curl_outside_pin"),
                         [](const auto& dig) { return dig.param; });

/// Volume between a mesh and z = 0, by the divergence theorem; the flat parts add nothing.
double below_flat_m3(const Mesh& mesh, double ground_z) {
  double sum = 0;
  for (const auto& t : mesh.triangles) {
    const Vec3 a = mesh.points[t[0]].cast<double>(), b = mesh.points[t[1]].cast<double>(),
               c = mesh.points[t[2]].cast<double>();
    const double area = ((b - a).head<2>().x() * (c - a).head<2>().y() -
                         (b - a).head<2>().y() * (c - a).head<2>().x()) / 2;
    sum -= area * ((a.z() + b.z() + c.z()) / 3 - ground_z);
  }
  return sum;
}

TEST(MeshOfACut, EnclosesWhatTheLedgerBooks) {
  std::map<double, double> errors;
  for (const char* family : {"half_sine", "drag", "drag_curl"}) {
    for (const double h : {0.05, 0.025}) {
      const Dig dig = make_dig(family, {0.4, {0.0131, 0.0077, 0.0093}});
      const Dug dug(dig, h, 200);
      const double shown = below_flat_m3(mesh_all(dug.soil), dig.placement.offset.z());
      const double error = shown / dug.cut_m3() - 1;
      errors[h] += error * error;
      // Creases and rims are cut off by at most half a voxel's square along their length: a box of
      // width w, depth d and length l loses less than h^2 / 2 (2 l + ...) < 6 h^2 of length 4.
      EXPECT_LT(std::abs(shown - dug.cut_m3()), 0.5 * h * h * 12) << family << ", voxel " << h;
    }
  }
  EXPECT_LT(errors[0.025], errors[0.05] / 8) << "second order quarters the error: 16 in squares";
}

TEST(MeshOfACut, IsWatertightButForItsRim) {
  for (const char* family : {"drag_curl", "undercut", "overlapping"}) {
    const Dug dug(make_dig(family, placements()[1]), kVoxel, kUpdates);
    const Mesh mesh = mesh_all(dug.soil);
    std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;   // there less back
    for (const auto& t : mesh.triangles) {
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t a = t[k], b = t[(k + 1) % 3];
        edges[{std::min(a, b), std::max(a, b)}] += a < b ? 1 : -1;
      }
    }
    // Open edges may only lie where a neighbouring chunk isn't resident.
    int open = 0, torn = 0;
    for (const auto& [edge, balance] : edges) {
      if (balance == 0) continue;
      ++open;
      const Vec3 mid = (mesh.points[edge.first] + mesh.points[edge.second]).cast<double>() / 2;
      const Vec3 index = mid / kVoxel;
      bool rim = false;
      for (int corner = 0; corner < 27; ++corner) {
        const Vec3 step = Vec3(corner % 3 - 1, corner / 3 % 3 - 1, corner / 9 - 1) * 1.5;
        const Coord3 chunk = ((index + step) / kLeafSide).array().floor().matrix().cast<int>() * kLeafSide;
        rim |= dug.soil.find(chunk) == nullptr;
      }
      torn += !rim;
    }
    EXPECT_GT(open, 0) << family;
    EXPECT_EQ(torn, 0) << family;
  }
}

}  // namespace
}  // namespace soilvdb::testing
