// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Queries of the ground at one time, compared with another time.
#pragma once

#include <cstdint>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "soilvdb/initial_terrain.h"
#include "soilvdb/session.h"
#include "tools/run/outputs.h"
#include "tools/serve/block_message.h"
#include "tools/serve/history.h"
#include "tools/serve/live_forces.h"

namespace soilvdb::tools {

/// Origins of the resident blocks, in order.
std::vector<Coord3> resident_blocks(const Ground& ground);

/// One thread at a time. Members throw std::invalid_argument with one line for impossible queries.
class GroundQuery {
 public:
  /// @param now its log is null for the live site
  /// @param before null: the ground before digging
  /// @param design null: no design
  /// @param live heights of the live site; empty: of `now`
  GroundQuery(Past now, std::shared_ptr<Session> before,
              std::shared_ptr<const InitialTerrain> design, Heights live = {});

  nlohmann::ordered_json height(const Vec2& at);
  /// Heights at this number of points, evenly spaced along a line, and the areas of cut and fill.
  /// Between points farther apart than a voxel, each is the mean of the way half to the next.
  nlohmann::ordered_json section(const Vec2& from, const Vec2& to, int points);
  /// Cut and fill inside a boundary, as `soilvdb diff` counts it.
  nlohmann::ordered_json volume(const std::vector<Vec2>& boundary);
  BoundaryVolume inside(const std::vector<Vec2>& boundary);
  /// The same if nothing had been dug.
  BoundaryVolume inside_undug(const std::vector<Vec2>& boundary) const;

  /// Looks up sigmas of heights, if there were scans; else empty.
  Sigmas sigmas();
  /// Sigmas of the heights that scans or surveys saw, see "The sigmas" in tools/guide/live.md.
  std::string sigma_map();

  std::string block(const Coord3& block, std::uint32_t view);
  /// The message about forces. @param view its number
  std::string forces(std::uint32_t view) { return force_message(*now_, view); }
  const Session& now() const { return *now_; }
  /// site_state() at this time.
  nlohmann::ordered_json state() const;

 private:
  Heights now_heights(), before_heights();
  std::shared_ptr<Session> now_, before_;
  std::shared_ptr<const WorkLog> log_;
  std::shared_ptr<const InitialTerrain> design_;
  Heights live_;
};

/// The answer to a query of one place. @param design null: no design
nlohmann::ordered_json height_answer(const Vec2& at, const Heights& now, const Heights& before,
                                     const InitialTerrain* design);

}  // namespace soilvdb::tools
