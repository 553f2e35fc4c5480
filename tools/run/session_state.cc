// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Steps of a session's state.
#include "tools/run/session_state.h"

#include <fmt/format.h>

#include <cmath>
#include <stdexcept>
#include <utility>

#include "tools/run/text.h"

namespace soilvdb::inline v0 {
void Session::State::become(SiteState&& other) {
  std::optional<HeightMap> of_other;
  if (height_map) of_other.emplace(*other.site.ground, *height_map);
  patches.switch_to(*other.site.ground);
  chunks.switch_to(*other.site.ground);
  mesh_heights.reset();
  height_map = std::move(of_other);
  const std::shared_ptr<const SiteModel> model = model_;  // keeps references to it valid
  SiteState::operator=(std::move(other));
  model_ = model;
  set_memory_limit();
}

void Session::State::require_recording() {
  if (!recorder) return;
  try {
    recorder->check();
  } catch (const std::exception& e) {
    throw std::runtime_error(recording_error(e.what()));
  }
}

std::string Session::State::recording_error(const std::string& why) const {
  return fmt::format("{}; {} is good to {} s; stop recording or mend that and open it again", why,
                     folder->path().string(), tools::time_text(recorder->acknowledged().time_s));
}

/// Updates do not wait for snapshots: while one is being written, a later one takes its place.
bool Session::State::is_snapshot_due(double time_s) {
  if (!recorder || !recorder->error().empty() || !std::isfinite(time_s)) return false;
  return !(recorder->would_be_due(time_s) && recorder->is_busy()) && recorder->due(time_s);
}

}  // namespace soilvdb::inline v0
