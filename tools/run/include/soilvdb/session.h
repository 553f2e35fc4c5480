// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A site for a program's own loop: fed machine states one by one, looked at in between.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "soilvdb/io/journal.h"
#include "soilvdb/io/site.h"
#include "soilvdb/mesher.h"
#include "soilvdb/site.h"

namespace soilvdb::inline v0 {

/// What a session is made of.
struct SessionSite {
  double voxel_size_m = 0;   ///< > 0
  io::Terrain terrain = {};  ///< a snapshot: its ground, with its voxels if they are as large
  std::vector<SiteMachine> machines = {};
  Earthmoving earthmoving = {};  ///< without `soil` soil is rigid
  /// Where work begins, world; voxels within 2^15 of it are numbered exactly. Without: the
  /// terrain's middle, or the world's origin.
  std::optional<Vec3> near_m = {};
};

/// How a session is kept in a folder.
struct Recording {
  std::filesystem::path folder;
  double sync_s = 1;  ///< at most so long until what was fed is on disk; 0: before it is answered
  std::optional<double> snapshot_every_s = {};  ///< of the states' times; without: none on the way
  bool incremental = false;                     ///< snapshots of what changed since the one before
  std::optional<std::size_t> keep = {};         ///< that many of them stay; without: all
};

/// A block's part of the surface.
struct SurfacePatch {
  Coord3 block;  ///< index of its first voxel, a multiple of kBlockSide
  Mesh mesh;     ///< points in metres from Session::origin(); empty: there is no surface any more
};

/// A site with machines, brought up to date state by state, without any file unless recorded.
///
/// Guarantees: updates don't throw, and one that isn't made leaves ground, loads and times as they
/// were, to the bit; the same states give the same bits as `soilvdb run` gives for the same
/// updates, for any number of threads, and whoever looks in between. clone() and restored states go
/// on as this one would.
/// Threads: a session is for one thread at a time; different ones may be used at once. Work runs in
/// the caller's TBB arena.
///
///     Session site({.voxel_size_m = 0.05, .terrain = io::PlaneTerrain{},
///                   .machines = {{"digger", {.width_m = 1.2, .height_m = 0.9}}}});
///     while (controller.next(state))
///       if (const StepResult step = site.update(state); step.ok()) control(step.update.bucket_m3);
class Session {
 public:
  /// @throw io::InputError, std::invalid_argument in one line for what can't be a site
  explicit Session(SessionSite site);
  /// The site, machines and soil of a scenario, before anything moved; its machines need no
  /// `motion`, and one that is there isn't gone along.
  /// @param voxel_size_m in place of the scenario's
  /// @throw io::InputError as `soilvdb run` says it
  static Session open(const std::filesystem::path& scenario,
                      std::optional<double> voxel_size_m = {});
  ~Session();
  Session(Session&&) noexcept;
  Session& operator=(Session&&) noexcept;

  double voxel_size_m() const;
  const Vec3& origin() const;
  const std::vector<SiteMachine>& machines() const;
  const Earthmoving& earthmoving() const;
  /// The ground and where it comes from, to be looked at between updates.
  const io::Site& site() const;
  /// The machine of that name. @throw std::invalid_argument naming those that there are
  std::size_t machine(std::string_view name) const;
  /// world_from_bucket of a machine at joint values. @throw std::invalid_argument if it has no
  /// chain, or another number of joints
  Pose pose(std::size_t machine, std::span<const double> joints) const;

  /// What a machine was fed last, its pose known also where that were joints; nothing before. Its
  /// joints hold until the next update.
  std::optional<MachineState> last(std::size_t machine) const;

  StepResult update(const MachineState& state) noexcept;
  /// All of these, in their order, or none of them. Machines that are apart move in parallel.
  BatchResult update(std::span<const MachineState> states) noexcept;
  /// Pours come down up to a time, that included; before each state that has one they do up to it.
  StepResult pour(double until_s) noexcept;
  /// The clock of a machine was wrong and is set: the time of its next state may be earlier than
  /// the last. Its bucket goes straight there, as where no time is known.
  StepResult reset_clock(std::size_t machine) noexcept;
  /// Soil that stands or hangs too steep comes to rest, as at the end of a run.
  StepResult come_to_rest() noexcept;

  /// @throw std::out_of_range if there is no such machine
  const Ledger& ledger(std::size_t machine) const;
  Ledger total() const;
  MassBalance mass_balance() const;
  /// The same but for `ground`, without counting chunks.
  MassBalance mass_balance_without_ground() const;
  /// Mass that a bucket holds; 0 where soil is rigid, for no density is known.
  double bucket_kg(std::size_t machine) const;
  double change_m3() const;  ///< volume of the ground less that of the terrain, counted anew
  /// Digest of the ground, `state_hash` of a run's summary.json.
  std::uint64_t ground_hash() const;
  std::uint64_t memory_bytes() const;

  /// Heights of the topmost soil at places of the world, m; NaN where there is none.
  void heights(std::span<const Vec2> xy_m, std::span<double> heights_m);
  /// The surface of all ground that was touched; points in metres from origin().
  Mesh mesh() const;
  /// The patches of it that changed since the last call, by block; at first all.
  std::vector<SurfacePatch> changed_patches();
  /// Origins of the chunks that changed since the last call of this, for programs that mesh by
  /// themselves; at first all.
  std::vector<Coord3> changed_chunks();

  /// Writes a snapshot that `soilvdb` goes on from and makes other files of.
  /// @throw std::invalid_argument unless its name ends with .vdb; std::runtime_error if it can't be
  ///        written
  void write(const std::filesystem::path& file) const;
  /// All that the next update depends on, as bytes, for restore() of a session of the same site.
  std::string save() const;
  /// @throw std::invalid_argument in one line if the bytes are no state of this site; nothing has
  ///        changed then
  void restore(std::string_view state);
  /// Another session that goes on as this one would, its changed_patches() too; it isn't recorded.
  /// Shares what neither changes: some tenths of a microsecond for each chunk that was touched.
  /// @throw std::runtime_error where memory is limited
  Session clone() const;

  /// How its scenario says that it is to be recorded, but for the folder.
  const Recording& recording() const;
  /// Keeps what is fed from here on in a folder, before the first state. A folder that holds a
  /// recording of the same site is gone on with: the session is then where that was, to the bit.
  /// While it is recorded an update that can't be is refused, and restore() is, too.
  /// @param progress told how far it is while it goes on; what it throws ends that
  /// @return what the folder held
  /// @throw io::InputError in one line for a folder that can't be used: one of another site or of
  ///        `soilvdb run`, a damaged one, one that somebody else records to; nothing has changed
  ///        then. std::runtime_error if it can't be written, or comes out otherwise than it was
  io::JournalExtent record(const Recording& recording,
                           const std::function<void(const io::JournalExtent&)>& progress = {});
  /// Of what was recorded, that which is on disk for sure.
  io::JournalExtent acknowledged() const;
  /// Another session of this site, with all that was done before the first update that is later
  /// than a time, by a recording or by `soilvdb run` of its scenario. Whoever records there may go
  /// on meanwhile.
  /// @throw as record()
  Session recorded(const std::filesystem::path& folder, double time_s) const;
  /// Returns when all of it is. @throw std::runtime_error if it can't be
  void flush();
  /// The same, and lets go of the folder, also where it throws.
  void stop_recording();

  /// Keeps memory_bytes() to a limit: ground that wasn't used for longest goes to a file without a
  /// name. The same bits come of it. A limited session can't be cloned.
  /// @param folder for that file
  void set_memory_limit(std::uint64_t bytes, const std::filesystem::path& folder);

 private:
  struct State;
  explicit Session(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

/// One state for each of these sessions, which differ, on all threads of the caller's TBB arena.
/// @param states as many as sessions
std::vector<StepResult> update_many(std::span<Session* const> sessions,
                                    std::span<const MachineState> states) noexcept;

}  // namespace soilvdb::inline v0
