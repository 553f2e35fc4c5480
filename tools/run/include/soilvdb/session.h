// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A site for a program's own loop: the program feeds machine states and reads results.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "soilvdb/boundary_volume.h"
#include "soilvdb/height_map.h"
#include "soilvdb/io/journal.h"
#include "soilvdb/io/site.h"
#include "soilvdb/mesher.h"
#include "soilvdb/resistance.h"
#include "soilvdb/site.h"

namespace soilvdb::inline v0 {

/// The parts of a session.
struct SessionSite {
  double voxel_size_m = 0;   ///< > 0
  io::Terrain terrain = {};  ///< of a snapshot: its ground, and its voxels if they have this size
  std::vector<SiteMachine> machines = {};
  Earthmoving earthmoving = {};  ///< without `soil`, soil is rigid
  /// Where work begins, world; voxels within 2^15 of it are numbered exactly. Default: the
  /// terrain's middle; on a plane, the first pour or else the first state.
  std::optional<Vec3> near_m = {};
  bool limits = true;  ///< see Session::set_limits()
  /// The terrain as a site, if it is open already: undug_site() of a session that was made alike.
  std::optional<io::Site> opened = {};
};

/// Recording of a session to a folder.
struct Recording {
  std::filesystem::path folder;
  double sync_s = 1;  ///< longest time until a state is on disk, s; 0: before update() returns
  std::optional<double> snapshot_every_s = {};  ///< in the states' times; empty: no snapshots
  bool incremental = false;                     ///< snapshots of the changes since the last one
  std::optional<std::size_t> keep = {};         ///< number of snapshots that stay; empty: all
  /// After a full disk: updates are recorded again as soon as there is room. Else no more.
  bool waits_for_room = false;
};

/// A block's part of the surface.
struct SurfacePatch {
  Coord3 block;  ///< index of its first voxel, a multiple of kBlockSide
  Mesh mesh;     ///< points in metres from Session::origin(); empty: no surface is left
};

/// A machine's states that are later than a time, in a recording.
struct StatesAfter {
  std::size_t machine = 0;
  std::uint64_t before = 0;  ///< updates before the first of them
  std::uint64_t states = 0;
  std::uint64_t others = 0;  ///< states of other machines after that
  double about_s = 0;        ///< about how long it takes to make the recording anew without them
};
struct Undone;  // tools/run/session_undo.h

/// A map around the middle of a machine's lip.
struct MapAround {
  std::size_t machine = 0;
  double cell_m = 0;   ///< side of a cell
  int nx = 0, ny = 0;  ///< cells along x and along y
  bool turned = true;  ///< with the lip as the map's y axis; else with the world's axes
};
/// Where a map is.
using MapPlace = std::variant<MapGrid, MapAround>;

/// A site with machines that takes one state after another. It writes files only if it is recorded.
///
/// Guarantees: updates do not throw, nor do heights(), height_map(), cast() and height_maps(). A
/// refused update leaves ground, loads and times unchanged. The same states give the same bits as
/// `soilvdb run` for the same updates, for any number of threads, and whatever is read in between.
/// clone() and restored states continue with the same results. Threads: one thread at a time may
/// use a session; different sessions may be used at once. Work runs in the caller's TBB arena.
///
///     Session site({.voxel_size_m = 0.05, .terrain = io::PlaneTerrain{},
///                   .machines = {{"digger", {.width_m = 1.2, .height_m = 0.9}}}});
///     while (controller.next(state))
///       if (const StepResult step = site.update(state); step.ok()) control(step.update.bucket_m3);
class Session {
 public:
  /// @throw io::InputError, std::invalid_argument with one line, for an invalid site
  explicit Session(SessionSite site);
  /// The site, machines and soil of a scenario, before any machine moved. Machines need no
  /// `motion`; an existing one is ignored.
  /// @param voxel_size_m in place of the scenario's
  /// @throw io::InputError with the message of `soilvdb run`
  static Session open(const std::filesystem::path& scenario,
                      std::optional<double> voxel_size_m = {});
  ~Session();
  Session(Session&&) noexcept;
  Session& operator=(Session&&) noexcept;

  double voxel_size_m() const;
  const Vec3& origin() const;  ///< on a plane it is final with the first state
  const std::vector<SiteMachine>& machines() const;
  const Earthmoving& earthmoving() const;
  /// The ground and its source, for reading between updates.
  const io::Site& site() const;
  /// The index of a machine by name. @throw std::invalid_argument naming the existing machines
  std::size_t machine(std::string_view name) const;
  /// Adds, renames or retires a machine or a hopper. Recordings keep it.
  /// @param list "machines" or "hoppers"
  /// @param json `{"add": {..}}` with the keys of a scenario, `{"rename": {"from": .., "to": ..}}`,
  ///        `{"retire": name}`, or for machines `{"restore": name}`. A hopper must begin, and a
  ///        retired one end ("time"), when no state was made yet that it may have taken soil of.
  /// @throw std::invalid_argument, io::InputError with one line: nothing has changed;
  ///        std::runtime_error if it can't be recorded
  void change_list(const std::string& list, const std::string& json);
  /// Does a machine take no more states? Nothing here refuses them.
  bool is_retired(std::size_t machine) const;
  /// Are they the other's, with buckets and joints?
  bool has_machines_of(const Session& other) const;
  /// world_from_bucket of a machine at joint values. @param base empty: where it stands
  /// @throw std::invalid_argument if it has no chain, or another number of joints
  Pose pose(std::size_t machine, std::span<const double> joints,
            const std::optional<Pose>& base = {}) const;
  /// world_from_root of a machine's chain, as of its last state.
  /// @throw std::invalid_argument if it has no chain
  Pose base(std::size_t machine) const;

  /// A machine's last state, with its pose also if it was given by joints; empty before the first.
  /// The joints are valid until the next update.
  std::optional<MachineState> last(std::size_t machine) const;

  /// Whether states that no machine has are refused, as `soilvdb run` refuses such rows: joints
  /// beyond their limits or wrapped, a bucket or base more than 100 m from the last state, and, if
  /// times are known, more than 50 m/s, 10 rad/s or twice a joint's velocity limit. At first they
  /// are; clones take the setting over.
  void set_limits(bool on);
  bool limits() const;
  /// Why no machine has such a state after its last one; empty if one may have.
  /// @throw std::invalid_argument for a state that update() refuses without limits
  std::string unlikely(const MachineState& state) const;
  /// Warnings since the last call, each once: of a bucket that moves backwards through soil for 2 m
  /// and catches none, of voxels of more than half a bucket's side, of rays of scans that do not
  /// meet the ground, of a sensor that moves without standard deviations of its poses.
  std::vector<std::string> take_warnings();

  StepResult update(const MachineState& state) noexcept;
  /// All states in their order, or none. Machines that are apart move in parallel.
  BatchResult update(std::span<const MachineState> states) noexcept;
  /// A machine is taken to a state without digging, however far it is: see Tracker::place(). Only
  /// limits of joints hold.
  StepResult place(const MachineState& state) noexcept;
  /// Can place() take a machine to a state: is its bucket in the air, a voxel or more from the
  /// ground? @throw std::invalid_argument for a state that update() refuses without limits
  bool in_air(const MachineState& state) const;
  /// Pours fall up to and including a time. A state with a time does this, too, before its machine
  /// moves.
  StepResult pour(double until_s) noexcept;
  /// A machine's wrong clock was set: the time of its next state may be before its last. The bucket
  /// moves straight to that state, as if times were unknown.
  StepResult reset_clock(std::size_t machine) noexcept;
  /// Soil that is too steep or overhangs comes to rest, as at the end of a run.
  StepResult come_to_rest() noexcept;
  /// Takes what a sensor saw, see Site::scan(). What apply_scans() corrects is recorded; a scan
  /// that was not applied yet is not.
  StepResult scan(const Sensor& sensor, std::span<const Vec3> points_m) noexcept;
  /// Corrects the ground by all scans so far. @param survey what was changed
  StepResult apply_scans(Survey& survey) noexcept;
  /// Gives the ground the heights of a survey, as one update: see Tracker::survey().
  /// @param volumes what was changed
  StepResult survey(const SurveyHeights& heights, SurveyVolumes& volumes) noexcept;
  /// Columns are those around a place, if the site is an endless plane, which may be anywhere until
  /// something happens there: to be called before heights of a survey are made.
  /// @throw std::invalid_argument if it is recorded far from there
  void begin_near(const Vec3& at_m);
  /// Sigmas of heights(), m; NaN without ground. @param seen as of GroundScans::sigmas()
  void sigmas(std::span<const Vec2> xy_m, std::span<double> sigmas_m, std::span<double> seen = {});
  /// See GroundScans::seen_squares().
  std::vector<Coord2> seen_squares() const;

  /// @throw std::out_of_range if there is no such machine
  const Ledger& ledger(std::size_t machine) const;
  /// What scans and surveys removed and added so far; empty before any.
  std::optional<Surveyed> surveyed() const;
  /// See Site::lip_errors_m().
  std::vector<Estimate> lip_errors_m() const;
  Ledger total() const;
  MassBalance mass_balance() const;
  /// As above without `ground`, which needs a count of chunks.
  MassBalance mass_balance_without_ground() const;
  /// Mass of a bucket's load; 0 if soil is rigid, because its density is unknown.
  double bucket_kg(std::size_t machine) const;
  double change_m3() const;  ///< volume of the ground minus that of the terrain, counted anew
  /// Digest of the ground, `state_hash` of a run's summary.json.
  std::uint64_t ground_hash() const;
  std::uint64_t memory_bytes() const;

  /// Heights of the topmost soil at places of the world from samples, m; NaN without soil. Cheap
  /// enough for each step of a loop, and without new memory in ground that was looked at: see
  /// HeightMap, also for the ceiling.
  LookResult heights(std::span<const Vec2> xy_m, std::span<double> heights_m,
                     std::optional<double> ceiling_m = {}) noexcept;
  /// A map as of HeightMap::map(), float or double. On a plane that may be anywhere the site goes
  /// where it is looked at, until its first state says where work begins.
  template <typename T>
  LookResult height_map(const MapPlace& place, MapLayer layer, std::span<T> out,
                        std::optional<double> ceiling_m = {},
                        const InitialTerrain* design = nullptr) noexcept;
  /// Distances along rays to the ground, m: see HeightMap::cast().
  LookResult cast(std::span<const Vec3> origins_m, std::span<const Vec3> directions,
                  std::span<double> ranges_m) noexcept;
  /// Gets all memory for looks in an area, see HeightMap::prepare(). To be called again in a clone,
  /// after restore(), and after the first state on a plane without SessionSite::near_m.
  LookResult prepare_looks(const Eigen::AlignedBox2d& area_m) noexcept;
  /// Cells of a map around a machine. @throw std::invalid_argument before its first state
  MapGrid map_around(const MapAround& around) const;
  /// See Site::direction().
  Vec3 direction(std::size_t machine) const;
  /// What a bucket's resistance depends on besides the strength of the soil, as of the last update:
  /// ground, pose, direction and load. Takes some microseconds.
  /// @throw std::invalid_argument before the machine's first state, or for a closed tool
  CutGeometry cut_geometry(std::size_t machine);
  /// The force of the soil on a bucket, see CutGeometry::resistance(). Allocates only where the
  /// ground changed, or is looked at for the first time.
  /// @param soil null: that of the site. @throw as cut_geometry(); std::invalid_argument if soil is
  ///        rigid and none is given
  Resistance resistance(std::size_t machine, const SoilStrength* soil = nullptr,
                        bool crescents = true);
  /// What a force on a machine's bucket does to its joints, see Chain::joint_loads().
  /// @param wrench about the middle of the lip, axes of the world
  /// @throw std::invalid_argument unless the machine's last state was given by joints
  std::vector<double> joint_loads(std::size_t machine, const Wrench& wrench) const;
  /// What was dug and filled inside a boundary, in place, against the terrain; see volume_inside().
  /// @param design null: none
  /// @param with_sigma also sigma_m3, by what is known of the machines' lips and by scans
  BoundaryVolume volume(const std::vector<Vec2>& boundary, const InitialTerrain* design = nullptr,
                        bool with_sigma = false);
  /// See Site::cut_m3() and Site::heap().
  Estimate cut_m3(std::size_t machine);
  Heap heap(const std::vector<Vec2>& boundary);
  /// Heights on the mesh() at places of the world, m; NaN without soil. Meshes what changed since
  /// the last call: milliseconds after an update.
  void mesh_heights(std::span<const Vec2> xy_m, std::span<double> heights_m);
  /// The surface of all touched ground; points in metres from origin().
  Mesh mesh() const;
  /// The patches of that surface that changed since the last call, by block; at first all.
  std::vector<SurfacePatch> changed_patches();
  /// Origins of the chunks that changed since the last call, for programs with their own mesher; at
  /// first all.
  std::vector<Coord3> changed_chunks();

  /// Writes a snapshot that `soilvdb` can continue and export.
  /// @throw std::invalid_argument unless the name ends with .vdb; std::runtime_error if writing
  ///        fails
  void write(const std::filesystem::path& file) const;
  /// The complete state that the next update depends on, as bytes for restore() of the same site.
  std::string save() const;
  /// @throw std::invalid_argument with one line, without any change, unless the bytes are a state
  ///        of this site
  void restore(std::string_view state);
  /// Another session in the same state, changed_patches() included; it is not recorded. Both share
  /// unchanged data: a clone takes some tenths of a microsecond per touched chunk.
  /// @throw std::runtime_error if the session's memory is limited
  Session clone() const;

  /// The scenario's settings for recording, without the folder.
  const Recording& recording() const;
  /// Records all states from here on in a folder; call it before the first state. If the folder
  /// holds a recording of the same site, the session continues from its exact end. While it
  /// records, updates that can't be recorded are refused, and restore() throws.
  /// @param progress called while the session catches up; an exception from it ends that
  /// @return the extent of the folder's recording
  /// @throw io::InputError with one line, without any change, if the folder is damaged, in use, or
  ///        of another site or of `soilvdb run`; std::runtime_error if it can't be written, or if a
  ///        recorded update gives another result
  io::JournalExtent record(const Recording& recording,
                           const std::function<void(const io::JournalExtent&)>& progress = {});
  /// Number of changes so far. A change whose record the disk had no room for counts, too: it is
  /// refused by its result if `sync_s` is 0, and recorded later if the recording waits for room.
  std::uint64_t changes() const;
  /// Why updates can't be recorded now; empty if they can, or need not be.
  std::string recording_fault() const;
  /// The part of the recording that is certainly on disk.
  io::JournalExtent acknowledged() const;
  /// Another session of this site, in the state before the first update later than `time_s`, from a
  /// recording or from `soilvdb run` of its scenario. Another process may continue to record there.
  /// @throw as record()
  Session recorded(const std::filesystem::path& folder, double time_s) const;
  /// The states of a machine that are later than a time, as recorded() sees times, and all that
  /// follow them.
  /// @throw std::invalid_argument if what followed can't be made anew
  StatesAfter states_after(const std::filesystem::path& folder, std::size_t machine,
                           double time_s) const;
  /// Makes a recording of this site anew without them, in a file beside it: others' updates are
  /// made on the ground that they then find. Nothing may be recorded there meanwhile.
  /// @param snapshot_every_s as in Recording
  /// @param made called with each update of the new recording; an exception from it ends that
  /// @throw as recorded()
  std::shared_ptr<Undone> without(const std::filesystem::path& folder, const StatesAfter& states,
                                  std::optional<double> snapshot_every_s,
                                  const std::function<void(const io::JournalUpdate&)>& made) const;
  /// This session, which records there, goes on from that. A crash leaves one of both recordings.
  /// @throw std::exception if it can't be written: nothing has changed
  void undo(Undone& undone);
  /// Has all updates so far written to disk soon, and does not wait.
  /// @return acknowledged().updates when they are there
  std::uint64_t hurry();
  /// Returns when the whole recording is on disk. @throw std::runtime_error if that fails
  void flush();
  /// Calls flush() and releases the folder, even if flush() throws.
  void stop_recording();

  /// Limits memory_bytes(): ground that was unused for longest goes to an unnamed file. Updates
  /// give the same bits. A limited session can't be cloned.
  /// @param folder of that file
  void set_memory_limit(std::uint64_t bytes, const std::filesystem::path& folder);

 private:
  struct State;
  explicit Session(std::unique_ptr<State> state);
  /// A recording's state after a number of updates.
  Session at_update(const std::filesystem::path& folder, std::uint64_t updates) const;
  HeightMap& height_map();
  std::unique_ptr<State> state_;
};

/// One update for each of several different sessions, on all threads of the caller's TBB arena.
/// @param states one per session
std::vector<StepResult> update_many(std::span<Session* const> sessions,
                                    std::span<const MachineState> states) noexcept;

/// A map of each of several different sessions, on all threads of the caller's TBB arena.
/// @param places one per session, or one for all
/// @param out float or double, the cells of the first map, then those of the next
/// @return the first fault, with its session's number; that map is NaN, the others are made. Around
///         a machine before its first state a map is NaN without a fault. A session that is there
///         twice, or sizes that don't fit, are faults of all.
template <typename T>
LookResult height_maps(std::span<Session* const> sessions, std::span<const MapPlace> places,
                       MapLayer layer, std::span<T> out, std::optional<double> ceiling_m = {},
                       const InitialTerrain* design = nullptr) noexcept;

}  // namespace soilvdb::inline v0
