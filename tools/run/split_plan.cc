// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/split_plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>

#include "io/file/atomic_file.h"
#include "io/file/json.h"
#include "soilvdb/io/checksum.h"

namespace soilvdb::tools {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr int kPlanFormat = 2;  // 1 knew no inputs but the scenario

fs::path plain(const fs::path& path) { return fs::absolute(path / "").lexically_normal(); }

/// As it is seen from a folder: both may move together.
std::string seen_from(const fs::path& folder, const fs::path& file) {
  return fs::absolute(file).lexically_normal().lexically_proximate(plain(folder)).string();
}

Json window_json(const SplitPlan::Window& window) {
  Json parts = Json::array();
  for (const SplitPlan::Group& part : window.parts)
    parts.push_back({{"machines", part.machines}, {"updates", part.updates}});
  return {{"begin_s", window.begin_s}, {"end_s", window.end_s}, {"parts", parts}};
}

SplitPlan::Window to_window(const Json& json) {
  SplitPlan::Window window{json.at("begin_s"), json.at("end_s"), {}};
  for (const Json& part : json.at("parts"))
    window.parts.push_back(
        {part.at("machines").get<std::vector<std::string>>(), part.at("updates")});
  return window;
}

}  // namespace

std::int64_t SplitPlan::updates() const {
  std::int64_t sum = 0;
  for (const Window& window : windows)
    for (const Group& part : window.parts) sum += part.updates;
  return sum;
}

std::int64_t SplitPlan::longest() const {
  std::int64_t sum = 0;
  for (const Window& window : windows) {
    std::int64_t most = 0;
    for (const Group& part : window.parts) most = std::max(most, part.updates);
    sum += most;
  }
  return sum;
}

std::string plan_text(const fs::path& folder, const SplitPlan& plan) {
  const RunOptions& options = plan.options;
  const auto name = [&](const fs::path& file) {
    std::string text = seen_from(folder, file);
    if (!io::is_utf8(text))
      throw io::InputError(options.scenario,
                           "can't be split: the path of it or of an input is no UTF-8 text; rename "
                           "what isn't");
    return text;
  };
  Json json = {{"format", kPlanFormat},   {"scenario", name(options.scenario)},
               {"values", plan.values},   {"inputs", Json::object()},
               {"parts", plan.parts},     {"ends_s", plan.ends_s},
               {"windows", Json::array()}};
  for (const auto& [file, checksum] : plan.inputs) json["inputs"][name(file)] = checksum;
  if (options.voxel_size_m) json["voxel_size_m"] = *options.voxel_size_m;
  if (options.updates) json["updates"] = *options.updates;
  if (options.memory_mb) json["memory_mb"] = *options.memory_mb;
  for (const SplitPlan::Window& window : plan.windows)
    json["windows"].push_back(window_json(window));
  return io::to_text(json, 1) + '\n';
}

void write_plan(const fs::path& folder, const SplitPlan& plan) {
  io::write_atomically(folder / kPlanName, plan_text(folder, plan));
}

SplitPlan read_plan(const fs::path& folder) {
  const fs::path file = folder / kPlanName;
  std::ifstream in(file);
  if (!in) throw io::InputError(folder, "holds no plan of parts; name a folder that has one");
  try {
    const Json json = Json::parse(in);
    if (json.at("format") != kPlanFormat)
      throw io::InputError(file, "is of another version of soilvdb; remove the folder");
    SplitPlan plan;
    const std::string scenario = json.at("scenario");
    plan.options.scenario = (folder / scenario).lexically_normal();
    if (json.contains("voxel_size_m"))
      plan.options.voxel_size_m = json["voxel_size_m"].get<double>();
    if (json.contains("updates")) plan.options.updates = json["updates"].get<std::int64_t>();
    if (json.contains("memory_mb")) plan.options.memory_mb = json["memory_mb"].get<std::int64_t>();
    plan.parts = json.at("parts");
    json.at("values").get_to(plan.values);
    for (const auto& [input, checksum] : json.at("inputs").items())
      plan.inputs[(folder / input).lexically_normal().string()] = checksum.get<std::string>();
    json.at("ends_s").get_to(plan.ends_s);
    for (const Json& window : json.at("windows")) plan.windows.push_back(to_window(window));
    return plan;
  } catch (const Json::exception&) {
    throw io::InputError(file, "is damaged; remove the folder");
  }
}

void check_unchanged(const SplitPlan& plan) {
  const auto refuse = [](const fs::path& file, const std::string& what) {
    throw io::InputError(file,
                         fmt::format("has changed since it was split{}; put back what it was, "
                                     "or split it anew to another folder",
                                     what));
  };
  const fs::path& scenario = plan.options.scenario;
  const std::string what = io::difference(plan.values, io::scenario_values(scenario));
  if (!what.empty()) refuse(scenario, " (" + what + ")");
  for (const auto& [file, checksum] : plan.inputs)
    if (io::file_fingerprint(file) != checksum) refuse(file, "");
}

void check_is_part(const io::JournalContent& journal, const RunOptions& part) {
  const Json is = io::from_cbor(journal.config.text);
  const auto as = [](const auto& value) { return value ? Json(*value) : Json(); };
  const auto at = [&](const char* key) { return is.is_object() ? is.value(key, Json()) : Json(); };
  const Json window = at("part");
  const bool same =
      window.is_object() && window.value("machines", Json()) == Json(part.part->machines) &&
      window.value("begin_s", Json()) == Json(part.part->begin_s) &&
      window.value("end_s", Json()) == Json(part.part->end_s) &&
      at("ends_s") == Json(part.part->ends_s) && at("voxel_size_m") == as(part.voxel_size_m) &&
      at("updates") == as(part.updates);
  if (!same) throw io::InputError(*part.out, "holds a run of something else; remove it");
}

RunOptions whole_options(const fs::path& folder, const SplitPlan& plan) {
  RunOptions options = plan.options;
  options.out = folder;
  options.in_parts = true;
  return options;
}

RunOptions part_options(const fs::path& folder, const SplitPlan& plan, std::size_t window,
                        std::size_t part) {
  if (window >= plan.windows.size() || part >= plan.windows[window].parts.size())
    throw io::InputError(folder, fmt::format("its plan has no part {} of window {}", part, window));
  const SplitPlan::Window& when = plan.windows[window];
  RunOptions options = plan.options;
  options.out = folder / kPartsName / fmt::format("{}_{}", window, part);
  options.mesh = false;
  options.part = Part{window_start(folder, window), when.parts[part].machines, when.begin_s,
                      when.end_s, plan.ends_s};
  return options;
}

fs::path window_start(const fs::path& folder, std::size_t window) {
  return folder / kPartsName / fmt::format("window_{}.vdb", window);
}

}  // namespace soilvdb::tools
