// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/app/part.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <map>
#include <regex>
#include <string>
#include <utility>

#include "io/file/text.h"
#include "soilvdb/io/checksum.h"
#include "soilvdb/io/snapshot.h"
#include "tools/app/commands.h"
#include "tools/run/run.h"
#include "tools/run/run_config.h"
#include "tools/run/run_folder.h"
#include "tools/run/split_merge.h"
#include "tools/run/split_plan.h"
#include "tools/run/text.h"

namespace soilvdb::tools {
namespace {

namespace fs = std::filesystem;

struct PartOptions {
  std::string work;  ///< plan, dig or merge
  fs::path path;     ///< the scenario to plan, or else the folder that has the plan
  RunOptions run;
  std::int64_t parts = 0;
  std::size_t window = 0, part = 0;
};

/// A folder that holds a plan of another scenario, or anything but a plan, is left alone.
void check_same(const SplitPlan& plan, const PartOptions& options) {
  std::error_code none;
  std::string what;
  const auto differs = [&](const char* name, const auto& was, const auto& is) {
    if (was != is && what.empty()) what = fmt::format("--{} was another", name);
  };
  if (!fs::equivalent(plan.options.scenario, options.path, none))
    what = plan.options.scenario.string();
  else
    what = io::difference(plan.values, io::scenario_values(options.path));
  differs("voxel", plan.options.voxel_size_m, options.run.voxel_size_m);
  differs("updates", plan.options.updates, options.run.updates);
  differs("parts", plan.parts, options.parts);
  if (!what.empty())
    throw io::InputError(
        *options.run.out,
        fmt::format("holds another split ({}); remove it or name another --out", what));
}

void print(const SplitPlan& plan) {
  const auto updates = static_cast<double>(plan.updates());
  std::size_t parts = 0;
  for (const SplitPlan::Window& window : plan.windows) parts += window.parts.size();
  fmt::print("{} in {} in {}; at best {:.2g} times as fast as one after another\n",
             counted(updates, "update"), counted(static_cast<double>(parts), "part"),
             counted(static_cast<double>(plan.windows.size()), "window"),
             updates / static_cast<double>(plan.longest()));
}

/// The folder's plan, if it has one, is gone on with.
bool go_on(const PartOptions& options) {
  const fs::path& out = *options.run.out;
  std::error_code none;
  if (!fs::exists(out / kPlanName, none)) return false;
  SplitPlan before = read_plan(out);
  check_same(before, options);
  check_unchanged(before);
  if (const auto& mb = options.run.memory_mb; mb && mb != before.options.memory_mb) {
    before.options.memory_mb = mb;
    write_plan(out, before);
  }
  print(before);
  return true;
}

/// What is left of another split would be taken for parts and windows of this one, and what is no
/// split's would go with the parts once they are merged.
void refuse_parts(const fs::path& folder) {
  static const std::regex ours(
      R"(job\.lock|[0-9]+_[0-9]+|window_0\.vdb|\.window_0\.vdb\.[0-9]+-[0-9]+\.tmp)");
  std::error_code none;
  for (const auto& entry : fs::directory_iterator(folder / kPartsName, none)) {
    const std::string name = entry.path().filename().string();
    const bool merged = name.starts_with("window_") && name.ends_with(".vdb") &&
                        entry.path() != window_start(folder, 0);
    if (merged || fs::exists(entry.path() / kJournalName, none))
      throw io::InputError(entry.path(),
                           "is of a split whose plan is gone; remove the folder that it is in, or "
                           "name another --out");
    if (!std::regex_match(name, ours))
      throw io::InputError(entry.path(),
                           "is in the folder of the parts, which goes once they are merged; move "
                           "it away or name another --out");
  }
}

std::map<std::string, std::string> fingerprints(const io::Scenario& scenario) {
  std::map<std::string, std::string> all;
  for (const fs::path& file : input_files(scenario)) {
    const auto moves = [&](const io::MachineInput& m) { return m.motion.is_from(file); };
    if (file != scenario.file &&
        std::none_of(scenario.machines.begin(), scenario.machines.end(), moves))
      all[file.string()] = io::file_fingerprint(file);
  }
  return all;
}

void plan(const PartOptions& options) {
  if (!options.run.out || options.parts < 2)
    throw io::InputError("soilvdb part plan needs --out DIR and --parts N, of 2 or more");
  if (go_on(options)) return;
  const fs::path& out = *options.run.out;
  RunOptions run = options.run;
  run.scenario = options.path;
  io::Scenario scenario = read_to_dig(run);
  SplitPlan made = make_plan(run, scenario, options.parts);
  made.inputs = fingerprints(scenario);
  plan_text(out, made);  // before there is anything to take back
  const io::Site site = io::open_site(scenario);
  warn_of_underground(scenario, *site.soil);
  RunFolder folder(out);
  for (const fs::path& input : input_files(scenario)) folder.spare(input);
  folder.make();
  try {
    folder.lock();
    if (go_on(options)) return;  // another's, made meanwhile
    std::error_code none;
    if (fs::exists(out / kJournalName, none))
      throw io::InputError(out, "holds a run; remove it or name another --out");
    folder.replace([&](const std::string& name) { return writes(scenario, run, name); });
    refuse_parts(out);
  } catch (...) {
    folder.unmake();
    throw;
  }
  for (const std::string& warning : scenario.warnings) say("warning: " + warning);
  if (scenario.snapshot_every_s)
    say("warning: 'output: snapshots: every' is left out: of what is dug in parts only the end is "
        "there as a snapshot");
  if (scenario.mcap)
    say(
        fmt::format("warning: for 'output: mcap' one process digs all once more at the end: parts "
                    "leave no {}",
                    kMcapName));
  fs::create_directories(out / kPartsName);
  io::write_snapshot(window_start(out, 0), site, {scenario.name, made.windows.front().begin_s});
  write_plan(out, made);
  print(made);
}

void dig(const PartOptions& options) {
  const fs::path& folder = options.path;
  const SplitPlan plan = read_plan(folder);
  check_unchanged(plan);
  RunOptions run = part_options(folder, plan, options.window, options.part);
  run.threads = options.run.threads;
  std::error_code none;
  if (!fs::exists(*run.out / kJournalName, none)) return soilvdb::tools::run(run);
  check_is_part(io::read_journal(*run.out / kJournalName), run);
  resume({*run.out, run.memory_mb});
}

void merge(const PartOptions& options) {
  const fs::path& path = options.path;
  const SplitPlan plan = read_plan(path);
  const std::size_t window = options.window;
  if (window >= plan.windows.size())
    throw io::InputError(path, fmt::format("its plan has no window {}", window));
  RunFolder folder(path);
  folder.lock();
  if (is_merged(path, plan, window)) return;
  check_unchanged(plan);
  merge_window(path, plan, window, read_to_dig(whole_options(path, plan)));
}

}  // namespace

int part_main(int argc, char** argv) {
  PartOptions options;
  CLI::App app("", "soilvdb part");
  app.set_help_flag();
  app.add_option("WORK", options.work)->required()->check(CLI::IsMember({"plan", "dig", "merge"}));
  app.add_option("PATH", options.path)->required();
  app.add_option("--out", options.run.out);
  app.add_option("--parts", options.parts);
  app.add_option("--voxel", options.run.voxel_size_m)->check(CLI::Range(1e-4, 100.0));
  app.add_option("--updates", options.run.updates)->check(CLI::Range(1, 100'000'000));
  app.add_option("--memory", options.run.memory_mb)->check(CLI::Range(16, 10'000'000));
  app.add_option("--threads", options.run.threads)->check(CLI::Range(1, 1024));
  app.add_option("--window", options.window)->check(CLI::Range(0, 63));
  app.add_option("--part", options.part)->check(CLI::Range(0, 1'000'000));
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    throw io::InputError(fmt::format("soilvdb part: {}", io::printable(e.what())));
  }
  // CLI::Range lets it pass.
  if (options.run.voxel_size_m && std::isnan(*options.run.voxel_size_m))
    throw io::InputError("soilvdb part: --voxel: Value nan is no number of metres");
  if (options.work == "plan") plan(options);
  if (options.work == "dig") dig(options);
  if (options.work == "merge") merge(options);
  return 0;
}

}  // namespace soilvdb::tools
