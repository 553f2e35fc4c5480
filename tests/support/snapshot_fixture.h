// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A site that is dug, and what is said of its snapshots.
#pragma once

#include <cmath>
#include <filesystem>
#include <fstream>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "soilvdb/io/raster.h"
#include "soilvdb/io/snapshot.h"
#include "soilvdb/tracker.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::io {

inline const SnapshotInfo kInfo{"dig", 1.0 / 3, 0.5, 0.4, 0.1, 0.05};

inline Bucket bucket() {
  Bucket b;
  b.width_m = 0.5;
  b.height_m = 0.4;
  return b;
}

/// A pose of the bucket on its way through the ground of `open()`.
inline Pose pose(double s) {
  return {{400001 + 0.8 * s, 5000002 + 0.1 * s, 99.9 - 0.3 * std::sin(3 * s)},
          from_rpy(0.1, -0.4 + s, 0.2)};
}

inline std::filesystem::path hills(const test::TempFolder& folder) {
  const HeightGrid grid{21, 21, {399996, 4999996}, {0.5, 0.5}};
  std::vector<float> heights;
  for (int i = 0; i < 21 * 21; ++i) heights.push_back(100 + 0.3f * std::sin(float(i)));
  write_geotiff(folder / "hills.tif", grid, {{"z", heights}}, "");
  return folder / "hills.tif";
}

inline Site site_on(const Terrain& terrain) {
  Base base = open_base(terrain);
  return {std::make_unique<Ground>(0.05, Vec3(400000, 5000000, 100), base.surface), base.reference,
          "LOCAL_CS[\"site\"]", base.bounds};
}

inline void dig(Ground& ground, double from, double to) {
  Tracker tracker(ground, {bucket()});
  for (int i = 0; i <= 20; ++i) tracker.update(0, pose(from + (to - from) * i / 20));
}

inline std::string content(const std::filesystem::path& file) {
  std::ostringstream text;
  text << std::ifstream(file, std::ios::binary).rdbuf();
  return text.str();
}

inline std::string snapshot_refusal(const test::TempFolder& folder,
                                    const std::filesystem::path& file) {
  bool refused = false;
  const std::string message = test::message_of(folder, [&] {
    try {
      read_snapshot(file);
    } catch (const InputError&) {
      refused = true;
      throw;
    }
  });
  return refused ? message : "accepted: " + message;
}

}  // namespace soilvdb::io
