// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a session holds. For its own files alone.
#pragma once

#include <deque>
#include <limits>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "soilvdb/session.h"
#include "soilvdb/surface_height.h"
#include "tools/run/recorder.h"

namespace soilvdb::inline v0 {

struct Session::State {
  using Chunks = std::set<Coord3, SurfaceMesh::Less>;

  State(std::vector<SessionMachine> machines_, Earthmoving earthmoving_, io::Site site_);

  /// What a machine was fed last; its pose is NaN before that.
  struct Fed {
    double time_s = std::numeric_limits<double>::quiet_NaN();
    Pose pose = {Vec3::Constant(std::numeric_limits<double>::quiet_NaN()), {1, 0, 0, 0}};
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
  /// All that the next update depends on besides the ground, as bytes and back.
  std::string progress() const;
  /// @throw std::invalid_argument if it isn't of these machines
  void set_progress(std::string_view bytes);
  io::SnapshotInfo snapshot_info() const;
  /// All of a site that what comes of a state depends on.
  /// @param ground also what had been dug when it was opened
  nlohmann::json description(bool ground) const;
  struct Found;
  Found find_start(const std::filesystem::path& folder, const io::JournalContent& journal);
  std::int64_t samples(double m3) const;
  std::int64_t mass(double loose_m3) const;
  void require_room();
  template <typename Result>
  void record(const io::JournalState& state, Result& made);
  template <typename Result>
  void record(const MachineState& state, const Update& update, Result& made);
  bool is_snapshot_due(double time_s);
  void write_snapshot(double time_s);
  void limit_memory();
  template <typename Result, typename Work>
  Result guarded(const Work& work) noexcept;

  std::vector<SessionMachine> machines;
  Earthmoving earthmoving;
  io::Site site;
  std::unique_ptr<Tracker> tracker;
  MassUnits units;
  std::vector<Fed> fed;                                        ///< of each machine
  double poured_s = -std::numeric_limits<double>::infinity();  ///< up to which pours came down
  std::string broken = {};                                     ///< why nothing can be done any more
  std::uint64_t memory_bytes = 0;                              ///< at most; 0: as it comes
  std::filesystem::path cold_folder = {};                      ///< where memory is limited
  std::uint64_t fed_count = 0;                                 ///< since it was opened
  Recording recording = {};                                    ///< of its scenario, or as it is
  std::filesystem::path scenario = {};                         ///< absolute; empty: there is none
  // Of who looks; nothing that updates depend on.
  std::unique_ptr<SurfaceHeight> heights = {};
  Chunks unmeshed = {};                ///< that changed since changed_patches()
  std::optional<Chunks> unsaved = {};  ///< since the last snapshot, if those are incremental
  std::unique_ptr<tools::Recorder> recorder = {};  ///< goes first: it reads the site
};

/// The first thing in which two sites' descriptions differ: "machines/0/bucket"; empty: nothing.
std::string difference(const nlohmann::json& before, const nlohmann::json& now);

}  // namespace soilvdb::inline v0
