// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a session holds. For its own files alone.
#pragma once

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

struct Session::State : tools::SiteState {
  /// How it is kept, which clones share.
  struct Settings {
    Recording recording = {};                ///< of its scenario, or as it is
    std::filesystem::path scenario = {};     ///< absolute; empty: there is none
    std::uint64_t memory_bytes = 0;          ///< at most; 0: as it comes
    std::filesystem::path swap_folder = {};  ///< where memory is limited
  };

  using Site::broken_, Site::Input, Site::input, Site::inputs_;  // for Session

  explicit State(SiteState site_state)
      : SiteState(std::move(site_state)), patches(*site.ground), chunks(*site.ground) {}
  /// To go on apart from the other.
  State(const State& other)
      : SiteState(other),
        settings(other.settings),
        fed_count(other.fed_count),
        patches(*site.ground, other.patches),
        chunks(*site.ground, other.chunks) {}

  /// Makes ground and machines those of another of the same site: who looks sees all change.
  void become(SiteState&& other);
  /// All of a site that what comes of a state depends on.
  /// @param with_ground also what had been dug when it was opened
  nlohmann::json description(bool with_ground) const;
  tools::ResumePoint find_start(const std::filesystem::path& folder,
                                std::span<const io::JournalFile> snapshots, bool may_rest);
  /// Before an update. @throw std::runtime_error if it can't be recorded
  void require_recording();
  std::string recording_error(const std::string& why) const;
  template <typename Result>
  void record(const io::JournalUpdate& update, Result& made);
  template <typename Result>
  void record(const MachineState& state, const std::optional<Input>& before, const Update& update,
              Result& made);
  bool is_snapshot_due(double time_s);
  void write_snapshot(double time_s) { recorder->write_snapshot(site, snapshot_info(time_s)); }
  void set_memory_limit();
  template <typename Result, typename Work, typename Record>
  Result recorded(const Work& work, const Record& record_made) noexcept;

  Settings settings;
  std::uint64_t fed_count = 0;  ///< since it was opened
  // Of who looks; nothing that updates depend on.
  struct Heights {
    explicit Heights(Ground& ground) : surface(ground), changes(ground) { changes.take(); }
    SurfaceHeight surface;
    ChangeFollower changes;
  };
  std::optional<Heights> heights = {};
  ChangeFollower patches, chunks;                  ///< of changed_patches() and changed_chunks()
  std::unique_ptr<tools::RunFolder> folder = {};   ///< that it is recorded to
  std::unique_ptr<tools::Recorder> recorder = {};  ///< goes first: it reads the site
};

/// The first thing in which two sites' descriptions differ: "machines/0/bucket"; empty: nothing.
std::string difference(const nlohmann::json& before, const nlohmann::json& now);

}  // namespace soilvdb::inline v0
