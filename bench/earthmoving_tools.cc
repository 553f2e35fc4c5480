// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Soil that tools touch: what is wrong with it at rest, what comes through a blade, how a lip tips,
// what a full bucket holds as it is dragged,
// where a face that fails comes to lie.
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>

#include "bench/earthmoving.h"
#include "core/constants.h"
#include "tests/support/capacity_fixture.h"
#include "tests/support/tool_scenes.h"
#include "tests/support/turned_scenes.h"

namespace soilvdb::bench {
namespace {

using test::add_way, test::each_column, test::loose_depth, test::ToolSite, test::Turn;

Eigen::Quaterniond pitched(double pitch_rad) { return from_rpy(0, pitch_rad, 0); }

/// A bucket as it stands and is dragged at random, 0.2 to 0.5 m deep, and then lifted.
void rest(const Options& options, Goals& goals) {
  const int scenes = options.quick ? 2 : 60;
  test::Random random(1);
  int wrong = 0;
  std::vector<double> p99_deg, worst_deg;
  for (int i = 0; i < scenes; ++i) {
    Bucket bucket = digger();
    bucket.width_m = random(0.6, 2.5);
    ToolSite site(i % 2 == 0 ? 0.1 : 0.05, make_plane(0, {random(-0.1, 0.1), 0}), bucket, loam());
    const double depth_m = random(0.2, 0.5), yaw = random(-3.1, 3.1);
    site.go(yaw, test::drag({-1.5, 0, 0}, 3, depth_m, 60));
    const Pose stands = site.placed(yaw, {Vec3(1, 0.4, -depth_m), pitched(0.2)});
    for (int k = 0; k < 50; ++k) {  // it trembles
      Pose at = stands;
      at.position += Vec3(random(-1, 1), random(-1, 1), random(-1, 1)) * 0.003;
      site.tracker.update(0, at);
    }
    site.tracker.update(0, {stands.position + Vec3(0, 0, 3), stands.rotation});
    site.tracker.come_to_rest();
    const test::GroundWindow window = test::all_of(site.ground);
    const test::Faults faults(window, kRepose);
    wrong += faults.needles() + faults.slits() + faults.hanging();
    p99_deg.push_back(faults.over_rad(0.99) / kDegree);
    worst_deg.push_back(faults.over_rad(1) / kDegree);
  }
  const std::string what = fmt::format("{} drags and jittered stands at rest", scenes);
  goals.add({what + ": needles, slits, hanging soil", static_cast<double>(wrong), "", 0.0});
  goals.add({"the same, slope over repose, p99", quantile(p99_deg, 1), "deg", 1.5});
  goals.add({"the same, steepest", quantile(worst_deg, 1), "deg", 3});
}

/// A blade 2.5 m high and 4 m wide is pushed 6 m, 10 cm deep.
void pushed(const Options& options, Goals& goals) {
  constexpr double kWidth = 4, kDepth = 0.1, kWay = 6;
  const double h = options.quick ? 0.1 : 0.05;
  ToolSite site(h, make_plane(0, {0, 0}), test::blade(kWidth, 2.5), loam());
  std::vector<Pose> path = {{Vec3(-0.6, 0, 0.2)}};
  add_way(path, {Vec3(0, 0, -kDepth)}, 10);
  add_way(path, {Vec3(kWay, 0, -kDepth)}, 120);
  site.go(0, path);
  site.tracker.come_to_rest();
  double behind_m3 = 0;
  std::vector<double> crest_m(static_cast<std::size_t>((kWidth - 1.6) / (2 * h)), -kDepth);
  each_column(site.ground, 0, [&](const Vec2& at, const GroundColumn& column) {
    if (at.x() > 0.5 && at.x() < kWay - test::kBladeDepth - 3 * h &&
        std::abs(at.y()) < kWidth / 2 - 0.6)
      behind_m3 += loose_depth(column) * h * h * h;
    const double slice = std::floor((at.y() + kWidth / 2 - 0.8) / (2 * h));
    if (at.x() < kWay || at.x() > kWay + 2 || slice < 0 ||
        slice >= static_cast<double>(crest_m.size()))
      return;
    double& crest = crest_m[static_cast<std::size_t>(slice)];
    crest = std::max(crest, h * column.top);
  });
  const auto [low, high] = std::minmax_element(crest_m.begin(), crest_m.end());
  goals.add({"blade of 2.5 x 4 m pushed 6 m: soil behind it, 0.6 m from its ends", behind_m3, "m3",
             0.005});
  goals.add({"the same, heap along it, level within",
             *high - *low,
             "m",
             0.1,
             {},
             fmt::format("heap {:.2f} m high", *high)});
  const double height_m = test::pushed_height_m(kWidth, kDepth, kWay, kSlope, 1.25);
  goals.add({"the same, height over that by what is cut and what stays beside the blade, less 1",
             100 * std::abs(*high / height_m - 1),
             "%",
             5,
             {},
             fmt::format("{:.3f} m", height_m)});
}

/// A full bucket tips about its level lip onto flat ground.
void tipped_ridge(const Options& options, Goals& goals) {
  Bucket bucket = digger();
  bucket.width_m = 2;
  const double h = options.quick ? 0.1 : 0.05;
  ToolSite site(h, make_plane(0, {0, 0}), bucket, loam());
  std::vector<Pose> path = test::drag({-3, 0, 0}, 4, 0.5, 60);
  const Vec3 lip(1, 8, 2);
  add_way(path, {Vec3(1, 0, 2), path.back().rotation}, 2);
  add_way(path, {lip, path.back().rotation}, 2);
  for (int i = 1; i <= 60; ++i) path.push_back({lip, pitched(-1.55 + 3.0 * i / 60)});
  site.go(0, path);
  site.tracker.come_to_rest();
  double cells = 0, top = 0, crest_x = 0;
  const auto each = [&](const auto& f) {
    each_column(site.ground, 0, [&](const Vec2& at, const GroundColumn& column) {
      if (std::abs(at.x() - lip.x()) < 3 && std::abs(at.y() - lip.y()) < 4) f(at, column);
    });
  };
  each([&](const Vec2& at, const GroundColumn& column) {
    cells += loose_depth(column);
    if (column.top > top) crest_x = at.x();
    top = std::max(top, column.top);
  });
  double first = std::numeric_limits<double>::infinity(), last = -first;
  each([&](const Vec2& at, const GroundColumn& column) {
    if (std::abs(at.x() - crest_x) > 0.75 * h || loose_depth(column) <= 0.5) return;
    first = std::min(first, at.y());
    last = std::max(last, at.y());
  });
  const double a = test::ridge_height_m(cells * h * h * h, bucket.width_m, kSlope);
  const double length_m = bucket.width_m + 2 * (a - h / 2) / kSlope;
  goals.add({"wide lip tipped on flat ground: height over a ridge's, less 1",
             100 * std::abs(h * top / (a - kSlope * h / 4) - 1),
             "%",
             5,
             {},
             fmt::format("{:.3f} m3, {:.2f} m high", cells * h * h * h, h * top)});
  goals.add({"the same, length", 100 * std::abs((last - first + h) / length_m - 1), "%", 5});
}

/// The largest change of a full bucket's load from one station to the next as it is dragged.
void dragged(const Options& options, Goals& goals) {
  for (const double h : {0.05, 0.1}) {
    if (options.quick && h < 0.1) continue;
    const Bucket bucket = digger();
    double radius_m = 0;
    for (const Vec3& p : extremes(bucket)) radius_m = std::max(radius_m, p.norm());
    const double station_m = std::max(kMinStationVoxels * h, kStationRadiusShare * radius_m);
    ToolSite site(h, make_plane(0, {0, 0}), bucket, loam());
    std::vector<Pose> path = {{Vec3(-6, 0, 0.5), pitched(0.1)}};
    add_way(path, {Vec3(-5.6, 0, -0.3), pitched(0.1)}, 20);
    site.go(0, path);
    const double struck_m3 = Capacity::of(bucket)->struck_m3();
    double swing_m3 = 0, before_m3 = 0;
    const int stations = static_cast<int>(10 / station_m);
    for (int i = 1; i <= stations; ++i) {
      const Update update =
          site.tracker.update(0, Pose{Vec3(-5.6 + station_m * i, 0, -0.3), pitched(0.1)});
      // From where it is full. What it loses lies before it, and is cut again.
      if (i > stations / 2) swing_m3 = std::max(swing_m3, std::abs(update.bucket_m3 - before_m3));
      before_m3 = update.bucket_m3;
    }
    goals.add({fmt::format("full bucket dragged, {:.0f} cm: largest swing of its load at stations",
                           100 * h),
               100 * swing_m3 / struck_m3,
               "% of struck",
               3,
               {},
               fmt::format("load {:.2f} m3 of {:.2f}", before_m3, struck_m3)});
  }
}

/// A lip half over a truck's bed tips.
void bed(const Options& options, Goals& goals) {
  Earthmoving all = loam();
  const Vec3 lip(0, 8, 2.5);
  all.hoppers.push_back({"bed", {Vec2(-3, 8), Vec2(3, 12)}, 1.5});
  ToolSite site(options.quick ? 0.1 : 0.05, make_plane(0, {0, 0}), digger(), all);
  std::vector<Pose> path = test::drag({-3, 0, 0}, 4, 0.5, 60);
  add_way(path, {lip, path.back().rotation}, 4);
  site.go(0, path);
  const std::int64_t loaded = site.tracker.total().load;
  path.clear();
  for (int i = 1; i <= 60; ++i) path.push_back({lip, pitched(-1.55 + 3.0 * i / 60)});
  site.go(0, path);
  site.tracker.come_to_rest();
  const double share = static_cast<double>(site.tracker.mass_balance().hauled) /
                       static_cast<double>(loaded - site.tracker.total().load);
  goals.add({"bed under half a lip: share in it", share, "", 0.53, 0.47});
}

/// A face dug in soil without cohesion fails along the plane through its toe at repose. What was
/// above that swells where it is, and slides from the front until it lies at repose: a layer of one
/// height on the plane and before it, up to where it meets soil that stayed.
void failed_face(const Options& options, Goals& goals) {
  constexpr double kDeep = 1.4, kFar = 3;
  const double h = options.quick ? 0.1 : 0.05;
  Earthmoving all = loam();
  all.soil->cohesion_pa = 0;
  ToolSite site(h, make_plane(0, {0, 0}), Bucket{12.0, 8.0, {}, {}}, all);
  for (const Vec3& to :
       {Vec3(-kFar, 0, 1), Vec3(-kFar, 0, -kDeep), Vec3(kFar, 0, -kDeep), Vec3(kFar, 0, 3)})
    site.tracker.update(0, Pose{to});
  site.tracker.come_to_rest();
  // At a height u above the toe the layer meets soil that only swelled: swollen * (kDeep - u) is
  // layer_m. What slid, swollen * u^2 / 2, is what lies before the toe, layer_m^2 / 2.
  const double swollen = 1 + all.soil->swell;
  const double layer_m = swollen * kDeep / (1 + std::sqrt(swollen));
  std::vector<double> off_cells;
  each_column(site.ground, 0, [&](const Vec2& at, const GroundColumn& column) {
    const double ought_m = -kDeep + layer_m + kSlope * (-at.x() - kFar);
    if (std::abs(at.y()) < 1 && at.x() < 0 && ought_m > -kDeep + h && ought_m < -h)
      off_cells.push_back(column.top - ought_m / h);
  });
  add(goals, "face 1.4 m high without cohesion, dug and failed", off(std::move(off_cells)), 0.5,
      1.5);
}

/// Two cycles, the second tips low onto the first's heap; and the same turned by 180 degrees.
void turned(const Options& options, Goals& goals) {
  const double h = options.quick ? 0.1 : 0.05;
  const int half = static_cast<int>(10 / h);
  const auto play = [&](const Turn& turn) {
    ToolSite site(h, make_plane(0, {0, 0}), digger(), loam());
    for (const int n : {0, 1})
      for (const Pose& pose : test::cycle({-3 + 0.3 * n, -2 - 0.8 * n, 0}, 0.4, 60, 4.5))
        site.tracker.update(0, turn(pose));
    site.tracker.come_to_rest();
    return test::GroundWindow(site.ground, {-half, -half}, 2 * half + 1, 2 * half + 1);
  };
  const test::GroundWindow straight = play({}), round = play({std::numbers::pi});
  double differ = 0, moved = 0, square = 0;
  int columns = 0;
  for (int x = 0; x <= 2 * half; ++x) {
    for (int y = 0; y <= 2 * half; ++y) {
      const double a = straight.at(x, y).top, b = round.at(2 * half - x, 2 * half - y).top;
      if (std::max(std::abs(a), std::abs(b)) < 0.1) continue;
      moved += std::abs(a);
      differ += std::abs(a - b);
      square += (a - b) * (a - b);
      ++columns;
    }
  }
  goals.add({"turned by 180 degrees: heights, of what moved", 100 * differ / moved, "%", 1});
  goals.add({"the same, rms", std::sqrt(square / columns), "voxel", 0.1});
}

/// Random scenes of two cycles, shifted by whole voxels, mirrored, and turned by 30 degrees.
void random_scenes(const Options& options, Goals& goals) {
  const int scenes = options.quick ? 4 : 40;
  std::vector<double> like, aslant;
  for (int n = 0; n < scenes; ++n) {
    test::Random random(4000 + static_cast<std::uint64_t>(n));
    const test::Cycles cycles(random, options.quick ? 0.1 : 0.05);
    const test::Outcome straight = test::outcome_of(cycles, {});
    const Turn mirror{0, true}, turn{std::numbers::pi / 6};
    const auto rms = [&](const Turn& how, const Coord2& shift) {
      return test::heights_apart(straight, test::outcome_of(cycles, how, shift), how).rms;
    };
    like.push_back(rms({}, {17, -9}));
    like.push_back(rms(mirror, {0, 0}));
    aslant.push_back(rms(turn, {0, 0}));
  }
  const auto beyond = [](const std::vector<double>& all, double most) {
    return 100.0 *
           static_cast<double>(
               std::count_if(all.begin(), all.end(), [&](double v) { return v > most; })) /
           static_cast<double>(all.size());
  };
  const std::string what =
      fmt::format("{} random scenes of two cycles, shifted and mirrored", scenes);
  goals.add({what + ": heights rms, median", quantile(like, 0.5), "voxel", 0.1});
  goals.add({"the same, over 0.1 voxel", beyond(like, 0.1), "%", 0.0});
  goals.add({"the same, largest", quantile(like, 1), "voxel", 0.1});
  goals.add({"turned by 30 degrees: heights rms, median", quantile(aslant, 0.5), "voxel", 0.3});
  goals.add({"the same, over 0.3 voxel", beyond(aslant, 0.3), "%", 0.0});
}

}  // namespace

void measure_tools(const Options& options, Goals& goals) {
  rest(options, goals);
  pushed(options, goals);
  tipped_ridge(options, goals);
  dragged(options, goals);
  bed(options, goals);
  failed_face(options, goals);
  turned(options, goals);
  random_scenes(options, goals);
}

}  // namespace soilvdb::bench
