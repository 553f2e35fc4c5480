// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Scenarios on a terrain, and why one is refused.
#pragma once

#include <string>

#include "soilvdb/io/site.h"
#include "tests/support/shared_data.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::io {

/// A bucket of 1 m x 0.5 m whose lip goes from one place to another in 10 s, mouth to +x.
inline Scenario scenario_of(const Terrain& terrain, const Vec3& from, const Vec3& to) {
  Bucket bucket;
  bucket.width_m = 1;
  bucket.height_m = 0.5;
  Scenario scenario;
  scenario.file = "dig.yaml";
  scenario.name = "dig";
  scenario.voxel_size_m = 0.1;
  scenario.terrain = terrain;
  Pose first, last;
  first.position = from;
  last.position = to;
  scenario.machines.push_back({"digger", bucket, Motion({0, 10}, {first, last})});
  return scenario;
}

template <typename F>
std::string refusal(const test::TempFolder& folder, F f) {
  bool refused = false;
  const std::string message = test::message_of(folder, [&] {
    try {
      f();
    } catch (const InputError&) {
      refused = true;
      throw;
    }
  });
  return refused ? message : "accepted: " + message;
}

}  // namespace soilvdb::io
