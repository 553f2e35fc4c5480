// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Speed and scale, each figure beside its goal.
#include "bench/speed.h"

#include <fmt/core.h>

#include <exception>

int main(int argc, char** argv) try {
  using namespace soilvdb::bench;
  const Options options = parse(argc, argv, "speed");
  fmt::print("{}\n", machine());
  Goals goals(options.out);
  {
    Progress progress(6);
    progress.step("memory");
    measure_memory(options, goals);
    progress.step("against the side of the site");
    measure_site_sizes(options, goals);
    progress.step("against voxel and bucket size");
    measure_voxel_sizes(options, goals);
    progress.step("against peers");
    measure_peers(options, goals);
    progress.step("replay of a shift");
    measure_replay(options, goals);
    progress.step("latency");
    measure_latency(options, goals);
  }
  goals.print();
} catch (const std::exception& e) {
  fmt::print(stderr, "bench speed: {}\n", e.what());
  return 1;
}
