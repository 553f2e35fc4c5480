// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/run/run_mcap.h"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <iterator>
#include <stdexcept>
#include <system_error>

#include "io/file/atomic_file.h"

namespace soilvdb::tools {
namespace {

constexpr double kBlocksEvery_s = 0.5, kElevationEvery_s = 1;

std::filesystem::path part_of(std::filesystem::path file) { return file += ".part"; }

SoilMcap::Site site_of(const io::Scenario& scenario, const io::Site& site) {
  SoilMcap::Site all{site.soil->origin(), site.soil->voxel_size_m(), site.crs_wkt};
  for (const io::MachineInput& machine : scenario.machines) all.machines.push_back(machine.name);
  return all;
}

}  // namespace

RunMcap::RunMcap(std::filesystem::path file, const io::Scenario& scenario, const io::Site& site,
                 double begin_s, double end_s)
    : file_(std::move(file)),
      part_(part_of(file_)),
      schedule_(kBlocksEvery_s, begin_s, end_s),
      elevation_schedule_(kElevationEvery_s, begin_s, end_s),
      mcap_(part_, site_of(scenario, site), *site.soil, begin_s) {
  std::vector<Coord3> all;
  for (const Chunk* chunk : site.soil->chunks()) all.push_back(chunk->origin);
  mcap_.blocks(begin_s, all);
}

RunMcap::~RunMcap() {
  if (!closed_) std::remove(part_.c_str());
}

void RunMcap::ground(double time_s, std::span<const Coord3> changed) {
  mcap_.blocks(time_s, changed);
  if (elevation_schedule_.due(time_s)) mcap_.elevation(time_s);
}

void RunMcap::close(double time_s, std::span<const Coord3> changed) {
  mcap_.blocks(time_s, changed);
  mcap_.elevation(time_s);
  mcap_.close();
  if (std::rename(part_.c_str(), file_.c_str()) != 0)
    throw std::runtime_error(fmt::format("{}: can't be written: {}", file_.string(),
                                         std::generic_category().message(errno)));
  closed_ = true;
  io::sync_folder(file_);
}

}  // namespace soilvdb::tools
