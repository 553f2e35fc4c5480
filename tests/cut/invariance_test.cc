// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Laws of the cut: where, how large and in which order one digs doesn't matter; and the surface
// that the mesh shows is the one that the samples count.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "core/constants.h"
#include "core/cut/excavator.h"
#include "soilvdb/mesher.h"
#include "tests/support/dig_runner.h"
#include "tests/support/families.h"

namespace soilvdb::test {
namespace invariance_test {

constexpr double kVoxel = 0.05;
constexpr int kUpdates = 40;
/// Standard errors that two counts of one cut, on other cells, may differ by.
const double kSigmas = 5 * std::sqrt(2);

TEST(Cut, IsTheSameSamplesAtUtmCoordinates) {
  for (const char* family : {"half_sine", "drag_curl", "raster", "steep"}) {
    const Dig near = make_dig(family, {0.3, {0, 0, 0}});
    const Dig far = make_dig(family, {0.3, {500000, 4200000, 128}});
    const Dug a(near, kVoxel, kUpdates), b(far, kVoxel, kUpdates);
    // Coordinates of 4e6 m are rounded to 1e-9 m, so a sample in 1e6 may change sides.
    EXPECT_NEAR(a.cut_m3(), b.cut_m3(), 1e-5 * a.cut_m3()) << family;
    EXPECT_EQ(a.ground.chunks().size(), b.ground.chunks().size()) << family;
  }
}

TEST(Cut, HardlyDependsOnYaw) {
  const Dug ahead(make_dig("drag", {0, {0.013, 0.021, 0.007}}), kVoxel, kUpdates);
  for (const double yaw : {0.2, 0.9, 1.3, 2.6, 4.4}) {
    const Dug turned(make_dig("drag", {yaw, {0.013, 0.021, 0.007}}), kVoxel, kUpdates);
    EXPECT_NEAR(turned.cut_m3(), ahead.cut_m3(), kSigmas * count_error_m3(ahead.ground)) << yaw;
  }
}

TEST(Cut, ScalesWithTheScene) {
  const Dig dig = make_dig("half_sine", {});
  const double truth = Dug(dig, kVoxel, kUpdates).cut_m3();
  for (const double scale : {1e-2, 10.0, 100.0}) {  // buckets are 1 mm to 100 m
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
    Ground ground(kVoxel, dig.origin, dig.terrain);
    const auto path = dig.motion.trace(0, 1, dig.bucket, kVoxel * kMaxBend, kVoxel * kPathStride);
    Excavator excavator(dig.bucket);
    EXPECT_GT(excavator.sweep(ground, path).all.captured, 0) << family;
    EXPECT_EQ(excavator.sweep(ground, path).all.captured, 0) << family << " again";
    const std::vector<Pose> back(path.rbegin(), path.rend());
    EXPECT_EQ(excavator.sweep(ground, back).all.captured, 0) << family << " backwards";
  }
}

TEST(Cut, TheOrderOfDisjointCutsDoesNotMatter) {
  const Dig one = make_dig("drag", {0, Vec3::Zero()}), two = make_dig("drag", {0, {0, 3, 0}});
  const auto dig_both = [&](const Dig& first, const Dig& second) {
    Ground ground(kVoxel, Vec3::Zero(), make_plane(0, {0, 0}));
    Tracker tracker(ground, {first.bucket, second.bucket});
    run(tracker, first, kUpdates, 0);
    run(tracker, second, kUpdates, 1);
    return ground.state_hash();
  };
  EXPECT_EQ(dig_both(one, two), dig_both(two, one));
}

TEST(Cut, SoilOnlyShrinks) {
  const Dig dig = make_dig("drag_curl_retreat", placements()[1]);
  Ground ground(kVoxel, dig.origin, dig.terrain);
  Tracker tracker(ground, {dig.bucket});
  std::map<const Chunk*, SampleWords> before;
  for (int i = 0; i < kUpdates; ++i) {
    tracker.update(0, dig.motion, i / 40.0, (i + 1) / 40.0);
    for (const Chunk* chunk : ground.chunks()) {
      SampleWords now;
      ground.read_samples(chunk->origin, now);
      const auto [old, fresh] = before.try_emplace(chunk, now);
      for (std::size_t n = 0; n < now.size(); ++n) ASSERT_EQ(now[n] & ~old->second[n], 0u);
      old->second = now;
    }
  }
}

/// Volume between a mesh and z = 0, by the divergence theorem; the flat parts add nothing.
double below_flat_m3(const Mesh& mesh, double ground_z) {
  double sum = 0;
  for (const auto& t : mesh.triangles) {
    const Vec3 a = mesh.points[t[0]].cast<double>(), b = mesh.points[t[1]].cast<double>(),
               c = mesh.points[t[2]].cast<double>();
    const double area = ((b - a).head<2>().x() * (c - a).head<2>().y() -
                         (b - a).head<2>().y() * (c - a).head<2>().x()) /
                        2;
    sum -= area * ((a.z() + b.z() + c.z()) / 3 - ground_z);
  }
  return sum;
}

TEST(MeshOfACut, EnclosesWhatTheLedgerBooks) {
  const std::map<double, double> most = {{0.05, 1e-3}, {0.025, 3e-4}};  // of the cut
  for (const char* family : {"half_sine", "drag", "drag_curl", "reversal", "curl_outside_pin",
                             "swing", "repeated", "overlapping", "helix"}) {
    for (const auto& [h, share] : most) {
      const Dig dig = make_dig(family, {0.4, {0.0131, 0.0077, 0.0093}});
      const Dug dug(dig, h, 200);
      const double shown = below_flat_m3(mesh_all(dug.ground), dig.placement.offset.z());
      EXPECT_LT(std::abs(shown / dug.cut_m3() - 1), share) << family << ", voxel " << h;
    }
  }
}

TEST(MeshOfACut, IsWatertightButForItsRim) {
  for (const char* family : {"drag_curl", "undercut", "overlapping"}) {
    const Dug dug(make_dig(family, placements()[1]), kVoxel, kUpdates);
    const Mesh mesh = mesh_all(dug.ground);
    std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;  // there less back
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
        const Coord3 chunk =
            ((index + step) / kChunkSide).array().floor().matrix().cast<int>() * kChunkSide;
        rim |= dug.ground.find(chunk) == nullptr;
      }
      torn += !rim;
    }
    EXPECT_GT(open, 0) << family;
    EXPECT_EQ(torn, 0) << family;
  }
}

}  // namespace invariance_test
}  // namespace soilvdb::test
