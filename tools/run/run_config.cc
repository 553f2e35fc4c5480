// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/run_config.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <vector>

#include "io/file/file_part.h"
#include "io/file/json.h"
#include "soilvdb/io/checksum.h"
#include "soilvdb/version.h"

namespace soilvdb::tools {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr int kConfigFormat = 4;  // format 3 told scans and surveys apart by counts

/// The change of a scenario, in words. After a stop at a bad row, a run may be continued with
/// bad_rows: skip, and after a scan that saw too much, with another max_range of its sensor.
std::string change_between(io::ScenarioValues before, io::ScenarioValues now) {
  for (io::ScenarioValues* values : {&before, &now})
    std::erase_if(*values, [](const auto& value) {
      return value.first.starts_with("sensors.") && value.first.ends_with(".max_range");
    });
  std::erase_if(now, [&](const auto& value) {
    const bool skips = value.first.ends_with(".bad_rows") && value.second == "skip";
    if (skips) before.erase(value.first);
    return skips;
  });
  return io::difference(before, now);
}

/// The change of an input, in words; empty if it has not changed.
std::string change_of(const Json& input, const fs::path& file) try {
  if (input.contains("values")) {
    const std::string what =
        change_between(input["values"].get<io::ScenarioValues>(), io::scenario_values(file));
    return what.empty() ? "" : " (" + what + ")";
  }
  const auto checksum = input.value("checksum", std::string());
  return checksum.empty() || io::file_fingerprint(file) == checksum ? "" : " ";
} catch (const io::InputError& e) {  // the path may now hold a different kind of file
  return fmt::format(" ({})", e.what());
}

/// The present path of an input.
fs::path find_input(const Json& input, const fs::path& folder) {
  const fs::path relative = input.at("relative").get<std::string>();
  const fs::path resolved = input.at("resolved").get<std::string>();
  const fs::path absolute = input.at("absolute").get<std::string>();
  std::error_code none;
  std::string changed;
  const fs::path typed = (folder / relative).lexically_normal(),
                 behind_links = fs::canonical(folder, none);
  for (const fs::path& file : {typed, (behind_links / relative).lexically_normal(), absolute,
                               (behind_links / resolved).lexically_normal()}) {
    if (!fs::is_regular_file(file, none)) continue;
    const std::string change = change_of(input, file);
    if (change.empty()) return file;
    if (changed.empty()) changed = change;
  }
  if (!changed.empty())
    throw io::InputError(
        absolute,
        fmt::format("has changed since the run in {} began{}; restore it, or begin a new run",
                    folder.string(), changed == " " ? "" : changed));
  const std::string sought = fs::absolute(typed).lexically_normal() == absolute
                                 ? ""
                                 : fmt::format(", and there is no {}", typed.string());
  throw io::InputError(absolute, fmt::format("is missing{}; the run in {} needs it to go on",
                                             sought, folder.string()));
}

/// An input's path relative to the run's folder, both without resolved links, because a link's
/// target may change.
fs::path relative_as_given(const fs::path& file, const fs::path& folder) {
  return fs::absolute(file).lexically_normal().lexically_proximate(
      fs::absolute(folder / "").lexically_normal());
}

}  // namespace

std::vector<fs::path> input_files(const io::Scenario& scenario) {
  std::vector<fs::path> files{scenario.file};
  files.insert(files.end(), scenario.inputs.begin(), scenario.inputs.end());
  if (const auto* raster = std::get_if<io::RasterTerrain>(&scenario.terrain))
    files.push_back(io::file_part(raster->file).file);
  if (const auto* level_set = std::get_if<io::LevelSetTerrain>(&scenario.terrain))
    files.push_back(level_set->file);
  return files;
}

std::string to_bytes(const RunConfig& config, const io::Scenario& scenario) {
  const RunOptions& options = config.options;
  Json inputs = Json::array();
  for (const fs::path& file : input_files(scenario)) {
    // Relative paths allow moving both together.
    inputs.push_back({{"relative", relative_as_given(file, *options.out).string()},
                      {"resolved", fs::proximate(file, *options.out).string()},
                      {"absolute", fs::absolute(file).lexically_normal().string()}});
    const auto moves = [&](const io::MachineInput& m) { return m.motion.is_from(file); };
    if (file == scenario.file)
      inputs.back()["values"] = io::scenario_values(file);
    else if (std::none_of(scenario.machines.begin(), scenario.machines.end(), moves))
      inputs.back()["checksum"] = io::file_fingerprint(file);
  }
  Json json = {{"format", kConfigFormat},
               {"version", SOILVDB_VERSION},
               {"inputs", inputs},
               {"threads", options.threads},
               {"mesh", options.mesh},
               {"snapshots", options.snapshots},
               {"change_before_m3", config.change_before_m3},
               {"ends_s", config.ends_s}};
  if (scenario.soil) json["mass_before"] = config.mass_before;
  if (options.voxel_size_m) json["voxel_size_m"] = *options.voxel_size_m;
  if (options.updates) json["updates"] = *options.updates;
  if (options.memory_mb) json["memory_mb"] = *options.memory_mb;
  // CBOR instead of text: paths may hold any bytes.
  return io::to_cbor(json);
}

bool is_of_session(const std::string& bytes) { return io::from_cbor(bytes).contains("session"); }

void check_record_format(const std::string& bytes, const fs::path& folder) {
  const Json format = io::from_cbor(bytes)["session"];
  if (format != kRecordFormat)
    throw io::InputError(folder, fmt::format("is a recording of format {}; this version goes on "
                                             "with format {}",
                                             io::to_text(format), kRecordFormat));
}

RunConfig parse_run_config(const std::string& bytes, const fs::path& folder) {
  try {
    const Json json = io::from_cbor(bytes);
    if (is_of_session(bytes))
      throw io::InputError(folder,
                           "was recorded by a session, not by a run: it goes on where that is "
                           "opened again, by Session::record or in Python Site.record");
    if (const int format = json.at("format"); format != kConfigFormat)
      throw io::InputError(folder, fmt::format("is a run of format {}; this version goes on with "
                                               "format {}",
                                               format, kConfigFormat));
    RunConfig config;
    RunOptions& options = config.options;
    for (const Json& input : json.at("inputs")) {
      const fs::path file = find_input(input, folder);
      if (options.scenario.empty()) options.scenario = file;
    }
    options.out = folder;
    options.threads = json.at("threads");
    options.mesh = json.at("mesh");
    options.snapshots = json.at("snapshots");
    config.change_before_m3 = json.at("change_before_m3");
    json.at("ends_s").get_to(config.ends_s);
    config.mass_before = json.value("mass_before", std::int64_t{0});
    if (json.contains("voxel_size_m")) options.voxel_size_m = json["voxel_size_m"].get<double>();
    if (json.contains("updates")) options.updates = json["updates"].get<std::int64_t>();
    if (json.contains("memory_mb")) options.memory_mb = json["memory_mb"].get<std::int64_t>();
    return config;
  } catch (const Json::exception& e) {
    throw io::InputError(folder, fmt::format("its journal holds no configuration ({})", e.what()));
  }
}

}  // namespace soilvdb::tools
