// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soilvdb run: digs a scenario and writes its outputs.
#include "tools/run/run.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <memory>
#include <optional>
#include <regex>
#include <string>
#include <utility>
#include <vector>

#include "io/scenario/underground.h"
#include "soilvdb/io/snapshot.h"
#include "tools/app/child.h"
#include "tools/app/commands.h"
#include "tools/run/progress.h"
#include "tools/run/text.h"

namespace soilvdb::tools {

namespace {

namespace fs = std::filesystem;

/// Reads a foreign .vdb in a child process, because a damaged one crashes OpenVDB.
void try_out(const io::Terrain& terrain) {
  const auto* level_set = std::get_if<io::LevelSetTerrain>(&terrain);
  if (!level_set || io::is_snapshot(level_set->file)) return;
  read_in_child(kLevelSet + level_set->grid, level_set->file);
}

/// With voxels of four times its size a bucket seems to dig nothing.
void check_voxels(const io::Scenario& scenario) {
  for (const io::MachineInput& machine : scenario.machines)
    if (scenario.voxel_size_m > 2 * std::max(machine.bucket.width_m, machine.bucket.height_m))
      throw io::InputError(scenario.file,
                           voxel_doubt(machine.name, machine.bucket, scenario.voxel_size_m));
}

fs::path folder_of(const RunOptions& options, const io::Scenario& scenario) {
  if (options.out) return *options.out;
  const std::string& name = scenario.name;
  if (name.empty() || name == "." || name == ".." || name.find('/') != std::string::npos)
    throw io::InputError(scenario.file, fmt::format("the name '{}' can't be that of a folder; "
                                                    "give --out DIR",
                                                    name));
  return fs::path("out") / name;
}

}  // namespace

bool writes(const io::Scenario& scenario, const RunOptions& options, const std::string& name) {
  if (name == kSummaryName || name == kUpdatesName) return true;
  if (options.mesh && scenario.mesh && name == "soil_final." + *scenario.mesh) return true;
  if (scenario.mcap && name == kMcapName) return true;
  if (scenario.raster_cell_m && name == "soil_final.tif") return true;
  if (!options.snapshots) return false;
  static const std::regex on_the_way(R"(soil_-?[0-9.]+\.vdb)");
  return name == kFinalName || (scenario.snapshot_every_s && std::regex_match(name, on_the_way));
}

io::Scenario read_to_dig(const RunOptions& options) {
  std::optional<Progress> progress;
  const auto tell = [&](std::int64_t done, std::int64_t total) {
    if (!progress) progress.emplace("reading motions", total, "B");
    progress->update(done);
  };
  io::Scenario scenario = io::read_scenario(options.scenario, tell);
  progress.reset();
  if (options.voxel_size_m) scenario.voxel_size_m = *options.voxel_size_m;
  check_voxels(scenario);
  warn_of_voxels(scenario);
  try_out(scenario.terrain);
  return scenario;
}

void warn_of_voxels(io::Scenario& scenario) {
  for (const io::MachineInput& machine : scenario.machines)
    if (const std::string doubt = voxel_doubt(machine.name, machine.bucket, scenario.voxel_size_m);
        !doubt.empty())
      scenario.warnings.push_back(fmt::format("{}: {}", scenario.file.string(), doubt));
}

void warn_of_underground(io::Scenario& scenario, const Ground& ground) {
  if (ground.chunks().empty()) return io::warn_of_underground(scenario, ground.terrain());
  io::warn_of_underground(scenario, *make_ground_terrain({std::shared_ptr<void>(), &ground}));
}

void run(const RunOptions& options) {
  const Run::Clock::time_point begin = Run::Clock::now();
  io::Scenario scenario = read_to_dig(options);
  RunFolder folder(folder_of(options, scenario));
  with_threads(options.threads, [&](int threads) {
    ResumePoint start{std::make_unique<SiteState>(model_of(scenario), io::open_site(scenario))};
    scenario.warnings.insert(scenario.warnings.end(), start.state->site.warnings.begin(),
                             start.state->site.warnings.end());
    warn_of_underground(scenario, *start.state->site.ground);
    for (const fs::path& input : input_files(scenario)) folder.spare(input);
    RunConfig config{options, start.state->site.ground->change_m3(), ends_of(scenario.machines), 0};
    config.options.out = folder.path();
    folder.make();
    try {
      folder.lock();
      folder.replace([&](const std::string& name) { return writes(scenario, options, name); });
      folder.clear();
      const std::vector<std::string> warnings = scenario.warnings;
      const std::string ground = beneath_text(*start.state->site.ground);
      Run run(std::move(config), std::move(scenario), folder, std::move(start), threads, begin);
      if (!ground.empty()) say("the terrain is " + ground);
      for (const std::string& warning : warnings) say("warning: " + warning);
      run.run();
    } catch (...) {
      folder.unmake();
      throw;
    }
  });
}

}  // namespace soilvdb::tools
