// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The ground at a time, against the ground at another: what people ask of it.
#pragma once

#include <cstdint>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "soilvdb/initial_terrain.h"
#include "soilvdb/session.h"
#include "tools/serve/block_message.h"
#include "tools/serve/history.h"

namespace soilvdb::tools {

/// Heights of a surface, one by one.
Heights heights_of(const InitialTerrain& surface);

/// Origins of the blocks that ground is resident in, in order.
std::vector<Coord3> resident_blocks(const Ground& ground);

/// For one thread at a time. Members throw std::invalid_argument in one line for what can't be.
class GroundView {
 public:
  /// @param now its log is null where it is the live site
  /// @param before null: the ground before digging
  /// @param design null: there is none
  GroundView(Past now, std::shared_ptr<Session> before,
             std::shared_ptr<const InitialTerrain> design);

  nlohmann::ordered_json height(const Vec2& at);
  /// Heights at so many points, even along a line.
  nlohmann::ordered_json section(const Vec2& from, const Vec2& to, int points);
  /// What was cut and filled inside a boundary, as `soilvdb diff` counts it.
  nlohmann::ordered_json volume(const std::vector<Vec2>& boundary);

  std::string block(const Coord3& block, std::uint32_t view);
  const Session& now() const { return *now_; }
  /// What site_state() says of it.
  nlohmann::ordered_json state() const;

 private:
  Heights now_heights(), before_heights();
  std::shared_ptr<Session> now_, before_;
  std::shared_ptr<const WorkLog> log_;
  std::shared_ptr<const InitialTerrain> design_;
};

}  // namespace soilvdb::tools
