// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Reads a scenario section by section; motions, which can be long, come last.
#include "soilvdb/io/scenario.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "io/file/file_part.h"
#include "io/file/text.h"
#include "io/motion/mcap_files.h"
#include "io/scenario/earthmoving.h"
#include "io/scenario/newcomer.h"
#include "io/scenario/receivers.h"
#include "io/scenario/scans.h"
#include "io/scenario/yaml_map.h"
#include "soilvdb/io/mesh_file.h"
#include "soilvdb/io/urdf.h"
#include "soilvdb/tool_shape.h"

namespace soilvdb::inline v0::io {
namespace {

constexpr double kMinVoxelM = 1e-4, kMaxVoxelM = 100;
constexpr double kMinEveryS = 1e-3, kMaxEveryS = 1e9;
constexpr std::size_t kMaxKept = 1'000'000;
constexpr double kMaxSyncS = 3600;
constexpr double kMinCellM = 1e-3, kMaxCellM = 1e4;
constexpr std::array kMeshFormats = {"ply", "obj", "stl", "glb"};

void check_version(const YamlMap& scenario) {
  const std::string version = scenario.text("soilvdb");
  if (version != "1") {
    scenario.fail("soilvdb", fmt::format("format version is '{}'; this program reads version 1",
                                         printable(version)));
  }
}

std::string read_name(const YamlMap& scenario, const std::filesystem::path& file) {
  if (scenario.has("name")) return scenario.name("name");
  const std::string stem = file.stem().string();
  try {
    check_name(stem);
  } catch (const std::invalid_argument&) {
    scenario.fail("name", "key 'name' is missing in scenario");
  }
  return stem;
}

/// The path under `key`, of an existing file.
std::filesystem::path read_path(const YamlMap& map, const std::string& key) {
  const auto path = map.path(key);
  try {
    check_readable(file_part(path).file);
  } catch (const InputError& e) {
    map.fail(key, fmt::format("{}: {}", key, e.what()));
  }
  return path;
}

Terrain read_terrain(const YamlMap& scenario) {
  const YamlMap terrain = scenario.map("terrain", {"plane", "raster", "level_set", "grid"});
  const int kinds = terrain.has("plane") + terrain.has("raster") + terrain.has("level_set");
  if (kinds != 1) {
    scenario.fail("terrain", fmt::format("terrain has {}; it must have exactly one of plane, "
                                         "raster and level_set",
                                         kinds == 0 ? "no kind" : fmt::format("{} kinds", kinds)));
  }
  if (terrain.has("grid") && !terrain.has("level_set")) {
    terrain.fail("grid", "'grid' is for a level_set, the name of the grid in its file; remove it");
  }
  if (terrain.has("raster")) return RasterTerrain{read_path(terrain, "raster")};
  if (terrain.has("level_set")) {
    return LevelSetTerrain{read_path(terrain, "level_set"),
                           terrain.has("grid") ? terrain.text("grid") : ""};
  }
  const YamlMap map = terrain.map("plane", {"z", "slope"});
  PlaneTerrain plane;
  plane.height_m = map.number("z");
  if (map.has("slope")) {
    const auto slope = map.numbers("slope", 2);
    plane.slope = {slope[0], slope[1]};
  }
  return plane;
}

/// A machine's tool, of any shape. @param voxel_size_m the scenario's
Bucket read_tool(const YamlMap& machine, double voxel_size_m, Scenario& result) {
  const YamlMap map = machine.map("tool", {"mesh", "voxel"});
  const std::filesystem::path file = read_path(map, "mesh");
  const double voxel_m =
      map.has("voxel") ? map.number("voxel", kMinCellM, kMaxCellM, "m") : voxel_size_m / 2;
  result.add_input(file);
  try {
    const Mesh mesh = read_mesh(file);
    const ToolShape shape(mesh, voxel_m);
    if (const std::string lost = lost_by(shape, mesh); !lost.empty())
      result.warnings.push_back(fmt::format("{}: {}", file.string(), lost));
    Bucket bucket = tool_of(shape);
    bucket.validate();
    return bucket;
  } catch (const std::invalid_argument& e) {
    map.fail("mesh", fmt::format("mesh: {}: {}", file.string(), e.what()));
  }
}

Bucket read_bucket(const YamlMap& machine, bool soil_moves) {
  const YamlMap map =
      machine.map("bucket", {"width", "height", "profile", "dump_angle", "edge", "plate"});
  Bucket bucket;
  bucket.width_m = map.number("width");
  bucket.height_m = map.number("height");
  if (map.has("profile")) {
    bucket.profile = map.points("profile");
    if (bucket.profile.empty()) {
      map.fail("profile", "profile is empty; give its points, or leave it out");
    }
  }
  if (map.has("dump_angle")) bucket.dump_angle_rad = map.number("dump_angle");
  if (map.has("edge")) bucket.edge_m = map.number("edge");
  if (map.has("plate")) bucket.plate_m = map.number("plate");
  if (soil_moves) check_capacity(map, bucket);
  try {
    bucket.validate();
  } catch (const std::invalid_argument& e) {
    const std::string message = e.what();  // begins with the key
    map.fail(message.substr(0, message.find(' ')), message);
  }
  return bucket;
}

Pose read_pose(const YamlMap& map) {
  Pose pose;
  if (map.has("xyz")) pose.position = Vec3(map.numbers("xyz", 3).data());
  if (map.has("rpy")) {
    const auto rpy = map.numbers("rpy", 3);
    for (const double angle : rpy) {
      if (std::abs(angle) > 2 * std::numbers::pi)
        map.fail("rpy", fmt::format("rpy has {}; angles must be in radians, within a turn", angle));
    }
    pose.rotation = from_rpy(rpy[0], rpy[1], rpy[2]);
  }
  return pose;
}

std::optional<Chain> read_machine_chain(const YamlMap& machine, Scenario& result) {
  if (!machine.has("urdf")) {
    for (const char* key : {"base", "lip"}) {
      if (machine.has(key)) {
        machine.fail(key, fmt::format("'{}' is for a machine with a 'urdf'; add that, or remove "
                                      "'{}'",
                                      key, key));
      }
    }
    return std::nullopt;
  }
  const auto file = read_path(machine, "urdf");
  if (!machine.has("lip")) {
    machine.fail("urdf", "key 'lip' is missing in machine; a 'urdf' needs it to place the bucket");
  }
  const YamlMap lip = machine.map("lip", {"link", "xyz", "rpy"});
  Chain chain;
  try {
    chain = read_chain(file, lip.text("link"));
  } catch (const std::invalid_argument& e) {
    lip.fail("link", e.what());
  }
  if (const std::string doubt = limits_in_degrees(chain); !doubt.empty()) {
    const std::string warning = file.string() + ": " + doubt;
    if (std::find(result.warnings.begin(), result.warnings.end(), warning) == result.warnings.end())
      result.warnings.push_back(warning);
  }
  chain.link_from_bucket = read_pose(lip);
  if (machine.has("base")) chain.world_from_root = read_pose(machine.map("base", {"xyz", "rpy"}));
  return chain;
}

OnBadRow read_on_bad_row(const YamlMap& machine) {
  const std::string policy = machine.has("bad_rows") ? machine.text("bad_rows") : "stop";
  if (policy != "stop" && policy != "skip") {
    machine.fail("bad_rows",
                 fmt::format("bad_rows is '{}'; it must be stop or skip: the run ends "
                             "before the first bad row of the motion, or leaves all out",
                             printable(policy)));
  }
  return policy == "stop" ? OnBadRow::kStop : OnBadRow::kSkip;
}

AngleUnit read_angle_unit(const YamlMap& machine) {
  const std::string unit = machine.has("angles") ? machine.text("angles") : "radians";
  if (unit != "radians" && unit != "degrees") {
    machine.fail("angles", fmt::format("angles is '{}'; it must be radians or degrees: what the "
                                       "joints, or roll, pitch and yaw, of the motion are in",
                                       printable(unit)));
  }
  return unit == "radians" ? AngleUnit::kRadians : AngleUnit::kDegrees;
}

void read_output(const YamlMap& scenario, Scenario& result) {
  if (!scenario.has("output")) return;
  const YamlMap output =
      scenario.map("output", {"snapshots", "mesh", "raster", "mcap", "force", "journal"});
  if (output.has("snapshots")) {
    const YamlMap snapshots = output.map("snapshots", {"every", "incremental", "keep"});
    result.snapshot_every_s = snapshots.number("every", kMinEveryS, kMaxEveryS, "s");
    result.incremental_snapshots = snapshots.has("incremental") && snapshots.flag("incremental");
    if (snapshots.has("keep")) result.snapshots_kept = snapshots.count("keep", 2, kMaxKept);
  }
  if (output.has("mesh")) {
    result.mesh = output.text("mesh");
    if (std::find(kMeshFormats.begin(), kMeshFormats.end(), *result.mesh) == kMeshFormats.end()) {
      output.fail("mesh", fmt::format("mesh is '{}'; it must be ply, obj, stl or glb",
                                      printable(*result.mesh)));
    }
  }
  if (output.has("raster")) {
    result.raster_cell_m = output.map("raster", {"cell"}).number("cell", kMinCellM, kMaxCellM, "m");
  }
  if (output.has("mcap")) result.mcap = output.flag("mcap");
  if (output.has("force")) result.force = output.flag("force");
  if (result.force && !scenario.has("soil"))
    output.fail("force", "force needs 'soil', which resists the bucket; add it, or remove 'force'");
  if (output.has("journal")) {
    const YamlMap journal = output.map("journal", {"sync"});
    const std::string sync = journal.text("sync");
    if (sync != "always" && !parse_number(sync)) {
      journal.fail("sync", fmt::format("sync is '{}'; it must be a number of seconds, or always",
                                       printable(sync)));
    }
    result.journal_sync_s =
        sync == "always" ? 0 : journal.number("sync", kMinEveryS, kMaxSyncS, "s");
  }
}

/// @param whose frame it is
McapTopic read_topic(const YamlMap& map, const std::string& name, const std::string& whose) {
  if (map.has("parent") && !map.has("frame"))
    map.fail("parent",
             fmt::format("'parent' goes with 'frame', the {}'s, which is seen from there; "
                         "add that, or remove 'parent'",
                         whose));
  McapTopic topic{name, map.has("frame") ? map.text("frame") : "",
                  map.has("parent") ? map.text("parent") : ""};
  if (map.has("parent") && topic.frame == topic.parent)
    map.fail("parent", fmt::format("'parent' is '{}', as 'frame' is; name the world's frame",
                                   printable(topic.parent)));
  return topic;
}

/// The motion's CSV file, or its topic in MCAP files; without these, its file is empty.
MotionSource read_motion_source(const YamlMap& machine, Motions motions) {
  if (!machine.is_map("motion")) {
    const std::filesystem::path path = machine.path("motion");
    if (std::filesystem::is_directory(path))
      machine.fail("motion", fmt::format("motion: {}: is a folder; name a file, or say which topic "
                                         "of the .mcap files in it: 'motion: {{mcap: FOLDER, "
                                         "topic: /joint_states}}'",
                                         path.string()));
    return read_path(machine, "motion");
  }
  const YamlMap map = machine.map("motion", {"mcap", "topic", "frame", "parent", "base"});
  std::vector<std::string> topics = map.texts("topic");
  McapTopic topic = read_topic(map, topics.front(), "bucket");
  topic.more_topics.assign(topics.begin() + 1, topics.end());
  if (map.has("base")) {
    if (!machine.has("urdf"))
      map.fail("base",
               "'base' is where a machine with a 'urdf' stands; add that, or remove 'base'");
    const YamlMap base = map.map("base", {"topic", "frame", "parent"});
    topic.base = std::make_shared<McapTopic>(read_topic(base, base.text("topic"), "urdf's root"));
  }
  if (!map.has("mcap")) {
    if (motions == Motions::kOptional) return {{}, std::move(topic)};
    map.fail("topic",
             "the motion has no 'mcap'; name the recording. Topics alone move machines of 'soilvdb "
             "serve --ros'");
  }
  std::vector<std::filesystem::path> files;
  for (const auto& path : map.paths("mcap")) {
    try {
      const auto some = mcap_files(path);
      files.insert(files.end(), some.begin(), some.end());
    } catch (const InputError& e) {
      map.fail("mcap", fmt::format("mcap: {}", e.what()));
    }
  }
  MotionSource source(files.front(), std::move(topic));
  source.more_files.assign(files.begin() + 1, files.end());
  return source;
}

/// A machine's section of a scenario; the rows of its motion come last.
struct Section {
  MachineInput machine;
  std::optional<MotionSource> motion = {};
  OnBadRow on_bad_row = OnBadRow::kStop;
};

/// A machine without its motion.
MachineInput read_unmoved(const YamlMap& machine, const std::string& name, Scenario& result) {
  if (machine.has("bucket") && machine.has("tool"))
    machine.fail("tool", "a machine has a bucket or a tool, not both; remove one of them");
  MachineInput read(name, machine.has("tool") ? read_tool(machine, result.voxel_size_m, result)
                                              : read_bucket(machine, result.soil.has_value()));
  if (!read.bucket.shape) warn_if_never_dumps(machine, name, read.bucket, result);
  read.chain = read_machine_chain(machine, result);
  if (read.chain) read.chain_file = machine.path("urdf");
  if (machine.has("known"))
    read.lip_sigma_m = machine.map("known", {"lip"}).number("lip", 0, 10, "m");
  if (machine.has("gnss")) read.gnss = read_gnss(machine);
  return read;
}

/// Reads the shapes of machines before a scan needs them.
void read_bodies(Scenario& scenario) {
  for (const MachineInput& machine : scenario.machines) {
    if (!machine.chain) continue;
    std::string warning = machine.chain->bodies->take_warning();
    if (!warning.empty() && std::find(scenario.warnings.begin(), scenario.warnings.end(),
                                      warning) == scenario.warnings.end())
      scenario.warnings.push_back(std::move(warning));
  }
}

std::vector<Section> read_machines(const YamlMap& scenario, Motions motions, Scenario& result,
                                   Names& names) {
  std::vector<Section> sections;
  if (!scenario.has("machines") && scenario.has("pours")) return sections;
  for (const YamlMap& machine :
       scenario.maps("machines", "machine",
                     {"name", "bucket", "tool", "motion", "angles", "bad_rows", "urdf", "base",
                      "lip", "known", "gnss"})) {
    Section& section = sections.emplace_back(
        Section{read_unmoved(machine, names.take(machine, "machine"), result)});
    section.machine.angles = read_angle_unit(machine);
    section.on_bad_row = read_on_bad_row(machine);
    std::optional<MotionSource> motion;
    if (motions == Motions::kRequired || machine.has("motion"))
      motion = read_motion_source(machine, motions);
    if (motion && motion->is_mcap) section.machine.topic = motion->mcap;
    if (motion && !motion->file.empty()) {
      for (const auto& file : motion->files()) result.add_input(file);
      section.motion = std::move(motion);
    } else {
      for (const char* key : {"angles", "bad_rows"})
        if (machine.has(key))
          machine.fail(key, fmt::format("'{}' goes with a motion; without 'motion:' states are in "
                                        "radians, and each is answered",
                                        key));
    }
    if (section.machine.chain) result.inputs.push_back(section.machine.chain_file);
  }
  return sections;
}

}  // namespace

MachineInput::MachineInput(std::string n, Bucket b, Motion m)
    : name(std::move(n)), bucket(std::move(b)), motion(std::move(m)) {
  swept.add(*motion.part(0), bucket);
}

MachineInput::MachineInput(std::string n, Bucket b, std::optional<Chain> c)
    : name(std::move(n)), bucket(std::move(b)), chain(std::move(c)) {}

MachineInput read_machine(const std::string& text, Scenario& site) {
  std::optional<MachineInput> read;
  read_newcomer(text, site, "machine",
                {"name", "bucket", "tool", "urdf", "base", "lip", "known", "gnss"},
                [&](const YamlMap& machine) {
                  const std::string name = machine.name("name");
                  require_new_name(name, site);
                  read = read_unmoved(machine, name, site);
                });
  if (read->chain) read->chain->bodies->all();  // not while a scan waits
  return *read;
}

Scenario read_scenario(const std::filesystem::path& file, const ReadProgress& progress,
                       Motions motions) {
  const YamlMap map = YamlMap::load(file, "scenario",
                                    {"soilvdb", "name", "voxel_size", "terrain", "soil", "machines",
                                     "pours", "hoppers", "sensors", "scans", "output"});
  check_version(map);
  Scenario scenario;
  scenario.file = file;
  scenario.name = read_name(map, file);
  scenario.voxel_size_m = map.number("voxel_size", kMinVoxelM, kMaxVoxelM, "m");
  scenario.terrain = read_terrain(map);
  read_output(map, scenario);
  read_soil(map, scenario);
  Names names;
  std::vector<Section> sections = read_machines(map, motions, scenario, names);
  read_pours(map, scenario, names);
  read_hoppers(map, scenario, names);

  std::int64_t done = 0, total = 0;
  const auto size = [](const Section& section) {
    std::int64_t bytes = 0;
    if (section.motion)
      for (const auto& path : section.motion->files())
        bytes += static_cast<std::int64_t>(std::filesystem::file_size(path));
    return bytes;
  };
  for (const Section& section : sections) total += size(section);
  for (Section& section : sections) {
    MachineInput& machine = section.machine;
    if (section.motion) {
      machine.motion = MotionFile(
          *section.motion, machine.chain, machine.angles, section.on_bad_row,
          [&](const Motion& part, std::int64_t bytes) {
            machine.swept.add(part, machine.bucket);
            if (progress) progress(done + bytes, total);
          },
          scenario.warnings);
      done += size(section);
    }
    scenario.machines.push_back(std::move(machine));
  }
  read_scan_inputs(map, scenario);
  if (motions == Motions::kOptional || !scenario.scans.empty()) read_bodies(scenario);
  return scenario;
}

}  // namespace soilvdb::inline v0::io
