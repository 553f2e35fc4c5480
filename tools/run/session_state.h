// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The state of a session. Private to the session's files.
#pragma once

#include <map>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "soilvdb/change_follower.h"
#include "soilvdb/session.h"
#include "soilvdb/surface_height.h"
#include "tools/run/recorder.h"
#include "tools/run/replay.h"
#include "tools/run/site_state.h"

namespace soilvdb::inline v0 {

/// Could a site be there, in any coordinates of the earth? Beyond, doubles would be too coarse.
inline bool is_place(const Vec3& at_m) {
  constexpr double kFarthest_m = 1e8;
  return at_m.cwiseAbs().maxCoeff() < kFarthest_m && at_m.allFinite();
}

struct Session::State : tools::SiteState {
  /// Settings, which clones share.
  struct Settings {
    Recording recording = {};                ///< of its scenario, or of its present recording
    std::filesystem::path scenario = {};     ///< absolute; empty: no scenario
    std::uint64_t memory_bytes = 0;          ///< 0: no limit
    std::filesystem::path swap_folder = {};  ///< with a memory limit
    bool limits = true;
    bool floats = false;  ///< an endless plane, whose origin is wherever work begins
    /// Of its lists of machines and hoppers since it was opened, in order, as JSON.
    std::vector<std::string> changes = {};
    std::vector<bool> retired = {};  ///< by machine; those that are missing are not
  };

  using Site::broken_, Site::fail, Site::Input, Site::input, Site::inputs_, Site::require,
      Site::survey_;

  explicit State(SiteState site_state)
      : SiteState(std::move(site_state)), patches(*site.ground), chunks(*site.ground) {
    warn_of_voxels(0);
  }
  /// A copy for a clone.
  State(const State& other)
      : SiteState(other),
        settings(other.settings),
        seen_from(other.seen_from),
        fed_count(other.fed_count),
        height_map(other.height_map ? std::optional(HeightMap(*site.ground, *other.height_map))
                                    : std::nullopt),
        patches(*site.ground, other.patches),
        chunks(*site.ground, other.chunks) {}

  /// Takes over ground and machines of the same site; changed_patches() then reports all changes.
  void become(SiteState&& other);
  void rebuild(SiteModel model, std::string_view progress);
  /// @param change as Session::change_list() takes it, with its "list"
  /// @throw as that
  void change_lists(nlohmann::json change);
  /// Makes the changes that a recording has. @throw io::InputError naming it
  void repeat_changes(const nlohmann::json& config, const std::filesystem::path& recording);
  /// A description of the site, with all that an update's result depends on.
  /// @param with_ground also the ground when the session was opened
  nlohmann::json description(bool with_ground) const;
  tools::ResumePoint find_start(const std::filesystem::path& folder,
                                std::span<const io::JournalFile> snapshots, bool may_rest);
  /// Call it before an update. @throw std::runtime_error if recording has failed
  void require_recording();
  std::string recording_error(const std::string& why) const;
  template <typename Result>
  void record(const io::JournalUpdate& update, Result& made);
  template <typename Result>
  void record(const MachineState& state, const std::optional<Input>& before, const Input& now,
              const Update& update, Result& made,
              io::JournalUpdate::Kind kind = io::JournalUpdate::Kind::kMove);
  /// @param last the machine's state before, if any; becomes this one
  /// @return why no machine has such a state; empty if one may have
  std::string unlikely(const MachineState& state, std::optional<Input>& last) const;
  /// The same site around another place, if it may be anywhere and nothing has happened.
  void float_to(const Vec3& near_m);
  /// The same, if a map is too far from here. @throw std::invalid_argument if it stays too far
  void reach(const MapGrid& grid);
  template <typename Result, typename Work>
  Result placed(const MachineState& first, const Work& work);
  bool is_likely(std::span<const MachineState> states, BatchResult& refused) const;
  /// What tells a bucket that moves backwards.
  struct Way {
    std::optional<Pose> pose;
    std::int64_t captured = 0, displaced = 0;  ///< samples
  };
  Way way(std::size_t machine) const;
  /// Warns of a sensor that moved, but is said to be nowhere else.
  void look_at_pose(const Sensor& sensor);
  /// Warns of machines from a number on whose buckets are small beside the voxels.
  void warn_of_voxels(std::size_t first);
  /// @param before before an update of the machine
  void look_backwards(std::size_t machine, const Way& before);
  std::unique_ptr<tools::Recorder> new_recorder(tools::RunFolder& to,
                                                tools::SnapshotSchedule schedule) const;
  bool is_snapshot_due(double time_s);
  void write_snapshot(double time_s) { recorder->write_snapshot(site, snapshot_info(time_s)); }
  void set_memory_limit(Ground& ground) const;
  template <typename Result, typename Work, typename Record>
  Result recorded(const Work& work, const Record& record_made) noexcept;

  Settings settings;
  bool warned_of_rays = false;
  /// Where sensors were at their first scan, by name; of those whose poses are said to be exact.
  struct SeenFrom {
    Pose pose;
    bool warned = false;
  };
  std::map<std::string, SeenFrom> seen_from = {};
  std::uint64_t fed_count = 0;  ///< since it was opened
  /// Mass that hoppers received in the last update; empty: no hoppers, or several machines moved.
  std::optional<std::int64_t> hauled = {};
  // Caches for readers; updates do not depend on them.
  std::optional<HeightMap> height_map = {};
  CutGeometry cut = {};  // of the last resistance(), for its storage
  struct MeshHeights {
    explicit MeshHeights(Ground& ground) : surface(ground), changes(ground) { changes.take(); }
    SurfaceHeight surface;
    ChangeFollower changes;
  };
  std::optional<MeshHeights> mesh_heights = {};
  ChangeFollower patches, chunks;                  ///< of changed_patches() and changed_chunks()
  std::string journal_config = {};                 ///< of the recording
  std::unique_ptr<tools::RunFolder> folder = {};   ///< of the recording
  std::unique_ptr<tools::Recorder> recorder = {};  ///< destroyed first, because it reads the site
};

/// The first difference of two sites' descriptions, "machines/0/bucket"; empty if equal.
std::string difference(const nlohmann::json& before, const nlohmann::json& now);

}  // namespace soilvdb::inline v0
