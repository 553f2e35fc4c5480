// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A scenario: terrain, machines with their motions, soil that moves, and what to write. YAML,
// format version 1.
#pragma once

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "soilvdb/bucket.h"
#include "soilvdb/earthmoving.h"
#include "soilvdb/initial_terrain.h"
#include "soilvdb/io/error.h"
#include "soilvdb/io/motion_file.h"
#include "soilvdb/io/motion_source.h"
#include "soilvdb/io/recorded_scans.h"
#include "soilvdb/io/swept_boxes.h"
#include "soilvdb/motion.h"
#include "soilvdb/site.h"
#include "soilvdb/survey.h"

namespace soilvdb::inline v0::io {

struct PlaneTerrain {
  double height_m = 0;        ///< at x = y = 0
  Vec2 slope = Vec2::Zero();  ///< dz/dx, dz/dy
};
/// Posts of a raster in memory, row-major with rising y and x; NaN where there is no height.
struct RasterHeights {
  HeightGrid grid;
  std::vector<float> values;
};
struct RasterTerrain {
  std::filesystem::path file;                              ///< empty with `heights`
  std::shared_ptr<const RasterHeights> heights = nullptr;  ///< in place of a file
};
struct LevelSetTerrain {
  std::filesystem::path file;  ///< a snapshot or any closed level set
  std::string grid = {};       ///< of several in the file; empty: the only one, or `surface`
};
using Terrain = std::variant<PlaneTerrain, RasterTerrain, LevelSetTerrain>;

struct MachineInput {
  /// A machine with a motion in memory.
  MachineInput(std::string name, Bucket bucket, Motion motion);
  /// A machine without a motion, which the caller moves: by poses or, with a chain, by joints.
  MachineInput(std::string name, Bucket bucket, std::optional<Chain> chain = std::nullopt);

  std::string name;
  Bucket bucket;
  MotionFile motion;
  SweptBoxes swept;                  ///< of the bucket
  std::optional<Chain> chain;        ///< of a machine that moves by joints
  std::filesystem::path chain_file;  ///< its URDF; empty without
  double lip_sigma_m = SiteMachine{}.lip_sigma_m;
  std::optional<Gnss> gnss = {};
  /// Of its motion in MCAP files, or without files, of what a live site listens to.
  std::optional<McapTopic> topic = {};
  AngleUnit angles = AngleUnit::kRadians;  ///< in its motion

  bool has_motion() const { return motion.rows() > 0; }
};

/// A sensor of a scenario.
struct SensorInput {
  Sensor sensor = {};                       ///< its pose is in the world, or on `machine`
  bool by_transforms = false;               ///< it has no place: a recording says where it was
  std::optional<std::size_t> machine = {};  ///< whose link carries the sensor
  std::optional<Chain> link = {};           ///< to that link; without it the bucket is meant
  /// Of the joints of `link`, their numbers among those of the machine.
  std::vector<std::size_t> joints = {};
  std::size_t carrier_joints = 0;  ///< of the machine, with a `link`

  /// Where it is on its machine, world. @param bucket world_from_bucket, without a `link`
  /// @param values a configuration of the machine's chain, with a `link`
  Pose carried(const Pose& bucket, std::span<const double> values) const;
};

/// A scan that corrects the ground at a time.
struct ScanInput : SensorInput {
  std::filesystem::path file = {};  ///< of points, or the first of a recording
  double time_s = 0;
  bool in_world = false;                          ///< points are the world's; else the sensor's
  std::shared_ptr<RecordedScans> recording = {};  ///< has the points; null: the file does
  std::size_t number = 0;                         ///< of the recording's scans

  struct Seen {
    Sensor sensor;               ///< where it was, world
    std::vector<Vec3> points_m;  ///< world
  };
  /// Reads the points. @param carrier the motion of `machine` at that time, or null without one
  /// @throw InputError if the file was changed
  Seen read(const Motion* carrier) const;
};

struct Scenario {
  std::filesystem::path file;
  std::string name;
  double voxel_size_m = 0;
  Terrain terrain;
  std::vector<MachineInput> machines;  ///< names are unique; may be empty only with pours
  std::optional<SoilProperties> soil;  ///< empty: soil is rigid
  std::vector<Pour> pours;      ///< names are unique and differ from machines'; only with soil
  std::vector<Hopper> hoppers;  ///< the same; no two in the same place at the same time
  std::map<std::string, SensorInput> sensors;  ///< by name
  std::vector<ScanInput> scans;                ///< by time
  std::optional<double> snapshot_every_s;
  bool incremental_snapshots = false;
  std::optional<std::size_t> snapshots_kept;  ///< number of newest ones, 2 or more; empty: all
  std::optional<std::string> mesh;            ///< "ply", "obj", "stl" or "glb"
  std::optional<double> raster_cell_m;
  bool mcap = false;          ///< record ground and loads as they change
  bool force = false;         ///< updates.csv has the force on the bucket; only with soil
  double journal_sync_s = 1;  ///< interval between syncs of the journal, s; 0: every update
  std::vector<std::filesystem::path> inputs;  ///< motions and URDFs
  /// About unused columns, joints beyond limits, left-out bad rows, doubtful soil and buckets.
  std::vector<std::string> warnings;

  /// Unless it is there.
  void add_input(const std::filesystem::path& path) {
    if (std::find(inputs.begin(), inputs.end(), path) == inputs.end()) inputs.push_back(path);
  }
};

/// Receives the number of bytes read of all motions, and their total.
using ReadProgress = std::function<void(std::int64_t done, std::int64_t total)>;

/// Must machines have a motion?
enum class Motions { kRequired, kOptional };

/// Reads a scenario with all its machines, and their motions to the end; does not open the terrain.
/// @throw InputError naming file, line, what is wrong and what would be right.
Scenario read_scenario(const std::filesystem::path& file, const ReadProgress& progress = {},
                       Motions motions = Motions::kRequired);

/// The values of a scenario's file by key ("machines[0].bucket.width"), without comments, quotes
/// and white space.
using ScenarioValues = std::map<std::string, std::string>;
/// @throw InputError if the file can't be read or is not YAML.
ScenarioValues scenario_values(const std::filesystem::path& file);
/// The first difference in words, "voxel_size was 0.05 and is 0.025"; empty if there is none.
std::string difference(const ScenarioValues& before, const ScenarioValues& now);

}  // namespace soilvdb::inline v0::io
