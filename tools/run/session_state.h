// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a session holds. For its own files alone.
#pragma once

#include <deque>
#include <limits>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "soilvdb/session.h"
#include "soilvdb/surface_height.h"

namespace soilvdb::inline v0 {

struct Session::State {
  using Chunks = std::set<Coord3, SurfaceMesh::Less>;

  State(std::vector<SessionMachine> machines_, Earthmoving earthmoving_, io::Site site_);

  /// What a machine was fed last.
  struct Fed {
    double time_s = std::numeric_limits<double>::quiet_NaN();
    Pose pose = {};
    std::vector<double> joints = {};  ///< none: it was a pose
  };

  /// To go on apart from the other.
  State(const State& other);
  State(State&&) = default;
  State& operator=(State&&) = default;

  void note_changes();
  std::string name(std::size_t machine) const;
  void require(std::size_t machine) const;
  Move move(const Session& session, const MachineState& state, Fed& last,
            std::deque<Motion>& motions) const;
  double last_s() const;
  void pour(double until_s);
  template <typename Result, typename Work>
  Result guarded(const Work& work) noexcept;

  std::vector<SessionMachine> machines;
  Earthmoving earthmoving;
  io::Site site;
  std::unique_ptr<Tracker> tracker;
  std::vector<Fed> fed;                                        ///< of each machine
  double poured_s = -std::numeric_limits<double>::infinity();  ///< up to which pours came down
  std::string broken = {};                                     ///< why nothing can be done any more
  // Of who looks; nothing that updates depend on.
  std::unique_ptr<SurfaceHeight> heights = {};
  Chunks unmeshed = {};  ///< that changed since changed_patches()
};

}  // namespace soilvdb::inline v0
