// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a session holds. For its own files alone.
#pragma once

#include <deque>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "soilvdb/session.h"
#include "soilvdb/surface_height.h"
#include "tools/run/recorder.h"
#include "tools/run/site_state.h"

namespace soilvdb::inline v0 {

struct Session::State : tools::SiteState {
  using Chunks = std::set<Coord3, SurfaceMesh::Less>;
  /// How it is kept, which clones share.
  struct Settings {
    Recording recording = {};                ///< of its scenario, or as it is
    std::filesystem::path scenario = {};     ///< absolute; empty: there is none
    std::uint64_t memory_bytes = 0;          ///< at most; 0: as it comes
    std::filesystem::path cold_folder = {};  ///< where memory is limited
  };

  explicit State(SiteState site_state) : SiteState(std::move(site_state)) {}
  /// To go on apart from the other.
  State(const State& other)
      : SiteState(other),
        settings(other.settings),
        fed_count(other.fed_count),
        unmeshed(other.unmeshed) {}

  /// Makes ground and machines those of another of the same site: who looks sees all change.
  void become(SiteState&& other);
  void note_changes();
  void require(std::size_t machine) const;
  Move move(const Session& session, const MachineState& state, Fed& last,
            std::deque<Motion>& motions) const;
  /// All of a site that what comes of a state depends on.
  /// @param ground also what had been dug when it was opened
  nlohmann::json description(bool ground) const;
  struct Found;
  Found find_start(const std::filesystem::path& folder, std::vector<io::JournalFile> files,
                   bool whole);
  void replay(const std::filesystem::path& journal, std::uint64_t from, std::uint64_t to,
              tools::SnapshotSchedule& schedule,
              const std::function<void(const io::JournalExtent&)>& progress);
  void require_room();
  template <typename Result>
  void record(const io::JournalUpdate& update, Result& made);
  template <typename Result>
  void record(const MachineState& state, const Fed& before, const Update& update, Result& made);
  bool is_snapshot_due(double time_s);
  void write_snapshot(double time_s);
  void limit_memory();
  template <typename Result, typename Work>
  Result guarded(const Work& work) noexcept;

  Settings settings;
  std::string broken = {};      ///< why nothing can be done any more
  std::uint64_t fed_count = 0;  ///< since it was opened
  // Of who looks; nothing that updates depend on.
  std::unique_ptr<SurfaceHeight> heights = {};
  Chunks unmeshed = {};                ///< that changed since changed_patches()
  std::optional<Chunks> unsaved = {};  ///< since the last snapshot, if those are incremental
  std::unique_ptr<tools::Recorder> recorder = {};  ///< goes first: it reads the site
};

/// The first thing in which two sites' descriptions differ: "machines/0/bucket"; empty: nothing.
std::string difference(const nlohmann::json& before, const nlohmann::json& now);

}  // namespace soilvdb::inline v0
