// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The same input gives the same bits: on any number of threads, run after run, and on any build and
// CPU, by golden values. Built twice more on top of a core without optimisation: with and without
// kernels for newer CPUs.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <openvdb/openvdb.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <bit>
#include <cstdlib>
#include <fstream>
#include <map>
#include <sstream>

#include "core/lattice/splitmix64.h"
#include "soilvdb/ground_grids.h"
#include "soilvdb/tracker.h"

namespace soilvdb::test {
namespace determinism_test {

#ifdef SOILVDB_UNOPTIMISED
constexpr int kRuns = 1;
constexpr int kThreads[] = {1, 2};
#else
constexpr int kRuns = 3;
constexpr int kThreads[] = {1, 2, 4, 8};
#endif

const char* const kGolden = SOILVDB_SOURCE_DIR "/tests/data/golden.txt";

/// What a dig came to: the soil, the ledger in samples, and all that updates returned but times.
struct Outcome {
  std::uint64_t state_hash = 0, updates = 0;
  std::int64_t captured = 0, displaced = 0, dumped = 0;
  bool operator==(const Outcome&) const = default;
};
std::ostream& operator<<(std::ostream& out, const Outcome& o) {
  return out << fmt::format("{:016x} {:016x} {} {} {}", o.state_hash, o.updates, o.captured,
                            o.displaced, o.dumped);
}

/// Poses are made by arithmetic alone, so that no library is in the input.
Pose at(double x, double y, double z, double pitch_quarter_turns = 0, double yaw = 0) {
  return {{x, y, z}, Eigen::Quaterniond(1, 0, pitch_quarter_turns, yaw).normalized()};
}

Bucket bucket(double width_m, double height_m, std::vector<Vec2> profile = {},
              std::optional<double> dump_angle_rad = {}) {
  Bucket b;
  b.width_m = width_m;
  b.height_m = height_m;
  b.profile = std::move(profile);
  b.dump_angle_rad = dump_angle_rad;
  return b;
}

class Dig {
 public:
  Dig(double voxel_size_m, const Vec3& origin, std::unique_ptr<InitialTerrain> terrain,
      std::vector<Bucket> buckets, Earthmoving earthmoving = {})
      : ground_(voxel_size_m, origin, std::move(terrain)),
        moves_(earthmoving.soil.has_value()),
        pours_(earthmoving.pours.size()),
        tracker_(ground_, std::move(buckets), std::move(earthmoving)) {}

  /// Rows of a motion, so many to an update.
  void along(const Motion& motion, int updates) {
    for (int i = 0; i < updates; ++i) {
      const double span = motion.end_s() - motion.begin_s();
      const double end_s = motion.begin_s() + span * (i + 1) / updates;
      add(tracker_.update(0, motion, motion.begin_s() + span * i / updates, end_s));
      for (std::size_t p = 0; p < pours_; ++p) add(tracker_.pour(p, end_s));
    }
    if (moves_) add(tracker_.come_to_rest());
  }
  void all(const std::vector<Move>& moves) {
    for (const Update& update : tracker_.update(moves)) add(update);
  }
  Outcome outcome() {
    const Ledger total = tracker_.total();
    if (moves_) {
      const MassBalance balance = tracker_.mass_balance();
      EXPECT_GT(balance.slid, 0);
      EXPECT_GT(balance.hauled, 0);
      EXPECT_EQ(balance.ground + total.load + balance.pending + balance.hauled, balance.poured);
      for (const std::int64_t mass : {balance.ground, balance.pending, balance.hauled, balance.slid,
                                      balance.fill_samples, total.load, total.spilled})
        add(static_cast<std::uint64_t>(mass));
    }
    return {ground_.state_hash(), digest_, total.captured, total.displaced, total.dumped};
  }

 private:
  void add(const Update& update) {
    add(std::bit_cast<std::uint64_t>(update.cut_m3));
    add(std::bit_cast<std::uint64_t>(update.bucket_m3));
    if (!moves_) return;
    add(std::bit_cast<std::uint64_t>(update.spilled_m3));
    add(std::bit_cast<std::uint64_t>(update.slid_m3));
  }
  void add(std::uint64_t bits) { digest_ = splitmix64(digest_ ^ bits); }
  Ground ground_;
  const bool moves_;  // the soil
  const std::size_t pours_;
  Tracker tracker_;
  std::uint64_t digest_ = 0;
};

/// A wide bucket is dragged down a slope and curls on the way.
Outcome plane() {
  Dig dig(0.05, Vec3::Zero(), make_plane(0.03, {-0.1, 0.05}), {bucket(3, 1.2)});
  std::vector<double> times;
  std::vector<Pose> poses;
  for (int i = 0; i <= 30; ++i) {
    const double s = i / 30.0;
    times.push_back(s);
    poses.push_back(at(3 * s, 0.2 * s, 0.3 - 2.4 * s * (1 - s), 0.3 - 0.9 * s, 0.1 * s));
  }
  dig.along({times, poses}, 8);
  return dig.outcome();
}

/// Bilinear hills of whole centimetres.
class Hills final : public HeightSource {
 public:
  void read(int x0, int y0, int nx, int ny, float* out) const override {
    for (int y = y0; y < y0 + ny; ++y)
      for (int x = x0; x < x0 + nx; ++x)
        *out++ = 430 + static_cast<float>(40 * x + (x * 7 + y * 13) % 17 * 3) / 100;
  }
};

/// A machine of three joints digs a hillside, in UTM coordinates.
Outcome raster() {
  const Vec3 corner(500000, 5400000, 430);
  Dig dig(0.05, corner,
          make_height_field({33, 33, corner.head<2>(), {0.5, 0.5}}, std::make_shared<Hills>()),
          {bucket(1, 0.8, {}, 0.7)});
  using Type = Joint::Type;
  Chain chain;
  chain.world_from_root = at(500010, 5400008, 435.6);
  chain.joints = {{"swing", Type::kContinuous, {}, Vec3::UnitZ(), 0, 0},
                  {"boom", Type::kRevolute, at(0.5, 0, 1), Vec3::UnitY(), 0, 0},
                  {"bucket", Type::kRevolute, at(4.5, 0, 0), Vec3::UnitY(), 0, 0}};
  chain.link_from_bucket = {{0, 0, -1}, Eigen::Quaterniond(0, 0, 0, 1)};
  std::vector<double> times, joints;
  for (int i = 0; i <= 40; ++i) {
    const double s = i / 40.0;
    times.push_back(4 * s);
    joints.insert(joints.end(), {0.2 - 0.4 * s, 1.2 * s * (1 - s), 0.9 - 2.2 * s});
  }
  dig.along({times, joints, chain}, 40);
  return dig.outcome();
}

/// Six machines at once: four apart from each other, two in one place.
Outcome fleet() {
  constexpr int kSteps = 60, kBatch = 7;
  Dig dig(0.05, Vec3(-5, 3, 0), make_plane(0, {0.05, -0.02}),
          std::vector<Bucket>(6, bucket(0.9, 0.5)));
  for (int i = 0; i < kSteps; i += kBatch) {
    std::vector<Move> moves;
    for (int k = i; k < std::min(i + kBatch, kSteps); ++k) {
      for (std::size_t m = 0; m < 6; ++m) {
        const double s = static_cast<double>(k) / kSteps;
        const double place = 12.0 * static_cast<double>(m < 4 ? m : 4);
        Move move;
        move.machine = m;
        move.to = at(place + 2 * s + 0.6 * static_cast<double>(m == 5),
                     0.1 * static_cast<double>(m), 0.1 - 1.2 * s * (1 - s), 0.2 - 0.5 * s);
        moves.push_back(move);
      }
    }
    dig.all(moves);
  }
  return dig.outcome();
}

/// A bucket with a body goes into a bank and under it, backs out and dumps.
Outcome undercut() {
  Dig dig(0.04, Vec3::Zero(), make_plane(0, {1.5, 0}),
          {bucket(1.2, 0.7, {{0, 0}, {-0.4, 0.02}, {-0.6, 0.3}, {-0.3, 0.7}, {0, 0.7}}, 0.9)});
  std::vector<double> times;
  std::vector<Pose> poses;
  const Pose way[] = {at(-0.6, 0, 0.1), at(0.9, 0, 0.15, -0.1), at(1.2, 0.1, 0.3, -0.35),
                      at(0.2, 0.1, 1.2, -0.6), at(-1.5, 0, 1.5, 0.9)};
  for (const Pose& pose : way) {
    times.push_back(static_cast<double>(times.size()));
    poses.push_back(pose);
  }
  dig.along({times, poses}, 48);
  return dig.outcome();
}

/// Ground that is a level set of other voxels: a block with a slanting top.
Outcome level_set() {
  constexpr float kVoxel = 0.08f, kBand = 3 * kVoxel;
  const auto grid = openvdb::FloatGrid::create(kBand);
  grid->setGridClass(openvdb::GRID_LEVEL_SET);
  grid->setTransform(openvdb::math::Transform::createLinearTransform(double{kVoxel}));
  auto values = grid->getAccessor();
  for (int x = -20; x < 50; ++x) {
    for (int y = -20; y < 20; ++y) {
      for (int z = -20; z < 16; ++z) {
        const float top = (0.125f * static_cast<float>(x) + static_cast<float>(z)) * 0.992f;
        const int side = std::max({-17 - x, x - 46, -17 - y, y - 16, -17 - z});
        const float d = std::max(top, static_cast<float>(side)) * kVoxel;
        values.setValue({x, y, z}, std::clamp(d, -kBand, kBand));
      }
    }
  }
  Dig dig(0.05, Vec3::Zero(), make_level_set_surface(grid, {0.02, 0.01, -0.03}),
          {bucket(1.3, 0.6)});
  std::vector<double> times;
  std::vector<Pose> poses;
  for (int i = 0; i <= 12; ++i) {
    const double s = i / 12.0;
    times.push_back(s);
    poses.push_back(at(-1.2 + 4 * s, 0.1, 0.2 - 2 * s * (1 - s), 0.2 - 0.5 * s, 0.1));
  }
  dig.along({times, poses}, 24);
  return dig.outcome();
}

/// A bucket fills up, spills, curls, is tipped over a hopper, goes through what a truck has poured
/// meanwhile, and is tipped onto another heap. In UTM coordinates.
Outcome earthmoving() {
  const Vec3 corner(500000, 5400000, 430);
  const auto in_plan = [&](double x, double y) { return Vec2(corner.x() + x, corner.y() + y); };
  Earthmoving all;
  all.soil = SoilProperties{0.61, 0.25, 1800, {}, {}};
  all.pours = {{"truck", corner + Vec3(1.5, 1.5, 5), 0, 6, 0.8},
               {"tip", corner + Vec3(-0.5, 0.3, 5), 3, 3, 0.3}};
  all.hoppers = {{"bed", {in_plan(2, -2.5), in_plan(4, -0.5)}, corner.z() + 1.2}};
  const Vec2 uphill(0.1, -0.05);
  Dig dig(0.1, corner, make_plane(corner.z() - uphill.dot(corner.head<2>()), uphill),
          {bucket(1, 0.8, {{0, 0}, {-0.45, -0.05}, {-0.8, 0.3}, {-0.6, 0.8}, {0, 0.8}})}, all);
  const Pose way[] = {
      at(-2, 0, 0.5, 0.18),    at(-1.6, 0, -0.45, 0.18),        at(0.3, 0, -0.35, 0.1),
      at(0.9, 0, 0.5, -0.7),   at(1.2, 0.2, 2.2, -0.8),         at(2.5, -1.5, 2.4, -0.8),
      at(2.5, -1.5, 2.4, 0.8), at(-1.6, 0.3, -0.5, 0.18, 0.05), at(0.4, 0.4, -0.45, 0.1, 0.05),
      at(1, 0.4, 2, -0.8),     at(1.5, 1.2, 2.2, -0.8),         at(1.5, 1.2, 2.2, 0.8)};
  std::vector<double> times;
  std::vector<Pose> poses;
  for (const Pose& pose : way) {
    times.push_back(0.8 * static_cast<double>(times.size()));
    poses.push_back({corner + pose.position, pose.rotation});
  }
  dig.along({times, poses}, 60);
  return dig.outcome();
}

const std::map<std::string, Outcome (*)()> kScenes = {
    {"plane", plane},       {"raster", raster},       {"fleet", fleet},
    {"undercut", undercut}, {"level_set", level_set}, {"earthmoving", earthmoving}};

/// The lines of the file: its head, and the outcome of each scene.
struct Golden {
  std::string head;
  std::map<std::string, std::string> outcomes;

  Golden() {
    std::ifstream in(kGolden);
    for (std::string line; std::getline(in, line);) {
      if (line.starts_with('#')) {
        head += line + '\n';
      } else {
        const std::size_t space = line.find(' ');
        outcomes[line.substr(0, space)] = line.substr(space + 1);
      }
    }
  }
  void write() const {
    std::ofstream out(kGolden);
    out << head;
    for (const auto& [name, outcome] : outcomes) out << name << ' ' << outcome << '\n';
  }
};

class Determinism : public ::testing::TestWithParam<std::string> {};

TEST_P(Determinism, SameBitsOnAnyThreadsRunsBuildsAndCpus) {
  Golden golden;
  std::string& expected = golden.outcomes[GetParam()];
  const bool regenerate = std::getenv("SOILVDB_WRITE_GOLDEN") != nullptr;
  for (const int threads : kThreads) {
    const tbb::global_control control(tbb::global_control::max_allowed_parallelism,
                                      static_cast<std::size_t>(threads));
    tbb::task_arena arena(threads);
    for (int i = 0; i < kRuns; ++i) {
      const Outcome outcome = arena.execute([&] { return kScenes.at(GetParam())(); });
      EXPECT_GT(outcome.captured, 1000) << "digs nothing to speak of";
      std::ostringstream text;
      text << outcome;
      if (regenerate && threads == 1 && i == 0) expected = text.str();
      EXPECT_EQ(text.str(), expected) << threads << " threads, run " << i;
    }
  }
  if (regenerate) golden.write();
}

INSTANTIATE_TEST_SUITE_P(Scenes, Determinism,
                         ::testing::Values("plane", "raster", "fleet", "undercut", "level_set",
                                           "earthmoving"),
                         [](const auto& scene) { return scene.param; });

}  // namespace determinism_test
}  // namespace soilvdb::test
