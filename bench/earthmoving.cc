// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Soil that moves: where it comes to lie against where it must, how well mass closes, what it
// costs, and that the time step doesn't matter. Each figure beside its goal.
#include "bench/earthmoving.h"

#include <fmt/core.h>

#include <exception>
#include <utility>

namespace soilvdb::bench {
namespace {

void run(const Options& options) {
  constexpr std::pair<const char*, void (*)(const Options&, Goals&)> kParts[] = {
      {"cones", measure_cones},   {"pours", measure_pours},      {"collapse", measure_collapse},
      {"cuts", measure_cuts},     {"buckets", measure_buckets},  {"tools", measure_tools},
      {"cycles", measure_cycles}, {"random work", measure_work}, {"a fleet", measure_fleet}};
  Goals goals(options.out);
  Progress progress(std::size(kParts));
  for (const auto& [name, measure] : kParts) {
    measure(options, goals);
    progress.step(name);
  }
  goals.print();
}

}  // namespace
}  // namespace soilvdb::bench

int main(int argc, char** argv) {
  try {
    soilvdb::bench::run(soilvdb::bench::parse(argc, argv, "earthmoving"));
    return 0;
  } catch (const std::exception& e) {
    fmt::print(stderr, "bench_earthmoving: {}\n", e.what());
    return 1;
  }
}
