// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A site for a program's own loop: machine states update ground and loads. Needs no files.
#pragma once

#include <cstddef>
#include <deque>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "soilvdb/bucket.h"
#include "soilvdb/earthmoving.h"
#include "soilvdb/gnss.h"
#include "soilvdb/kinematics.h"
#include "soilvdb/resistance.h"
#include "soilvdb/survey.h"
#include "soilvdb/survey_heights.h"
#include "soilvdb/tracker.h"

namespace soilvdb::inline v0 {

struct SiteMachine {
  std::string name;
  Bucket bucket;
  std::optional<Chain> chain = {};  ///< for states with joint values
  double lip_sigma_m = 0.02;        ///< standard deviation of its lip's height as told, for scans
  std::optional<Gnss> gnss = {};    ///< for feeds with positions by latitude and longitude
};

/// The part of a site that no update changes. Clones share it.
struct SiteModel {
  std::vector<SiteMachine> machines;  ///< names must be unique
  Earthmoving earthmoving = {};       ///< without `soil` the soil is rigid

  /// Index of the machine with a name. @throw std::invalid_argument with the existing names
  std::size_t machine(std::string_view name) const;
};

/// State of a machine at a time; the first state places the machine. Between states with times the
/// joints and base, or position and rotation, are interpolated as between rows of a Motion.
/// Otherwise the bucket moves in a straight line.
struct MachineState {
  std::size_t machine = 0;
  /// s, in one time frame for all machines; unset: unknown. The time of a machine must not
  /// decrease, except after Site::reset_clock().
  std::optional<double> time_s = {};
  /// world_from_bucket; ignored if `joints` is not empty.
  Pose pose = {};
  /// rad or m, one value per movable joint of the machine's chain.
  std::span<const double> joints = {};
  /// world_from_root of the chain, of a machine that drives; only with `joints`. Unset: as in the
  /// state before, or that of the chain if that had none or was a pose.
  std::optional<Pose> base = {};
};

/// Joints and base of a state as a configuration of its chain.
std::vector<double> configuration_of(const MachineState& state);

enum class Status {
  kOk,
  kBadState,  ///< unknown machine, invalid pose or joints, or decreasing time
  kNoGround,  ///< the bucket would reach ground without a height
  kFailed,    ///< other error, during the work or the recording: see `why`
};

/// Result of one state. Unless `status` is kOk, `why` is one line and nothing has changed. Only
/// kFailed during the work leaves a partial update; the site then refuses all later updates.
struct StepResult {
  Status status = Status::kOk;
  std::string why = {};
  Update update = {};
  bool ok() const { return status == Status::kOk; }
};

/// Result of several states: all were applied, or `bad` is the index of the first invalid state and
/// no state was applied; kFailed as in StepResult.
struct BatchResult {
  Status status = Status::kOk;
  std::string why = {};
  std::size_t bad = 0;
  std::vector<Update> updates = {};  ///< one per state
  bool ok() const { return status == Status::kOk; }
};

/// The ground and the machines of a site, updated state by state.
///
/// Guarantees: updates do not throw. A refused update leaves ground, loads and times bitwise
/// unchanged. The same states give the same bits for any number of threads; reads in between have
/// no effect. A clone, and a site that takes progress() on a copy of the ground, continue as this
/// site.
/// Threads: one thread at a time may use a site; different sites may be used concurrently. Work
/// runs in the caller's TBB arena.
///
///     Site site(std::make_shared<Ground>(0.05, Vec3::Zero(), make_plane(0, {0, 0})),
///               {{{"digger", {.width_m = 1.2, .height_m = 0.9}}}});
///     while (controller.next(state))
///       if (const StepResult step = site.update(state); step.ok()) control(step.update.bucket_m3);
class Site {
 public:
  /// @throw std::invalid_argument with one line for invalid machines or soil
  Site(std::shared_ptr<Ground> ground, SiteModel model);
  /// An independent copy. It shares the model, and each chunk's samples until one site changes
  /// them. @throw std::logic_error as Ground::clone()
  Site(const Site& other);
  Site(Site&&) noexcept = default;
  Site& operator=(Site&&) noexcept = default;

  const SiteModel& model() const { return *model_; }
  const Ground& ground() const { return *ground_; }
  const Tracker& tracker() const { return *tracker_; }

  /// world_from_bucket at joint values. @param base empty: where the machine stands
  /// @throw std::invalid_argument without a chain, or for a wrong number of joints or values that
  /// are not finite, or a base that is no pose
  Pose pose(std::size_t machine, std::span<const double> joints,
            const std::optional<Pose>& base = {}) const;
  /// world_from_root of a machine's chain, as of its last state.
  /// @throw std::invalid_argument without a chain
  Pose base(std::size_t machine) const;
  /// Last state of a machine, always with its pose; std::nullopt before the first. `joints` is
  /// valid until the next update. @throw std::invalid_argument for an unknown machine
  std::optional<MachineState> last(std::size_t machine) const;
  /// Direction in which a machine's lip last moved by a tenth of a voxel or more, of unit length,
  /// world; zero before that and after place(). @throw std::invalid_argument for an unknown machine
  Vec3 direction(std::size_t machine) const;
  /// What a machine's resistance depends on besides the strength of the soil, as of its last
  /// update.
  /// @param map of this site's ground. @throw std::invalid_argument before the machine's first
  ///        state, or for a closed tool; as HeightMap
  /// @param out keeps its storage: CutGeometry::read()
  void cut_geometry(std::size_t machine, HeightMap& map, CutGeometry& out) const;
  CutGeometry cut_geometry(std::size_t machine, HeightMap& map) const;
  /// The latest time of all machines.
  std::optional<double> last_s() const;

  StepResult update(const MachineState& state) noexcept;
  /// Applies all states in order, or no state. Machines that are far apart move in parallel.
  BatchResult update(std::span<const MachineState> states) noexcept;
  /// Takes a machine to a state without digging, however far it is, as if it were lifted off: see
  /// Tracker::place(). The next state moves it on from there.
  StepResult place(const MachineState& state) noexcept;
  /// Lets pours fall up to and including a time. A state with a time first lets the pours before
  /// that time fall.
  StepResult pour(double until_s) noexcept;
  /// Resets the clock of a machine: its next time may be earlier than the last. The bucket moves
  /// there in a straight line, as for an unknown time.
  StepResult reset_clock(std::size_t machine) noexcept;
  /// Lets soil that is too steep or overhangs come to rest, as at the end of a run.
  StepResult come_to_rest() noexcept;

  /// Takes what a sensor saw, to correct the ground by it. See GroundScans.
  /// @param points_m where its rays ended, world
  StepResult scan(const Sensor& sensor, std::span<const Vec3> points_m) noexcept;
  /// Corrects the ground by all scans so far; without any nothing changes. What scans add or remove
  /// is in Tracker::surveyed(); loads stay.
  /// @param survey what was changed @param record receives what repeat_survey() takes; null: nobody
  /// needs it
  StepResult apply_scans(Survey& survey, std::string* record = nullptr) noexcept;
  /// Gives the ground the heights of a survey, see Tracker::survey(). Booked as what scans change
  /// is.
  /// @param volumes what was changed @param record as of apply_scans()
  StepResult survey(const SurveyHeights& heights, SurveyVolumes& volumes,
                    std::string* record = nullptr) noexcept;
  /// Corrects the ground as apply_scans() or survey() did in another copy of this site. It has that
  /// site's state of scans from then on. @throw std::invalid_argument for bytes of another site
  void repeat_survey(std::string_view record);
  /// Is a record of apply_scans(), which only fits the ground that the scans saw?
  static bool is_of_scans(std::string_view record);
  /// Of each machine: its lip's height as told less the true, as scans know it; empty before any.
  std::vector<Estimate> lip_errors_m() const;
  /// Sigmas of the heights of the ground, m, NaN without ground: of what is known of machines, and
  /// by scans. @param seen as of GroundScans::sigmas(). @throw as HeightMap::at()
  void sigmas(std::span<const Vec2> xy_m, std::span<double> sigmas_m, std::span<double> seen = {});
  /// See GroundScans::seen_squares().
  std::vector<Coord2> seen_squares() const;
  /// Sigma of the change of volume inside a boundary against the terrain, by the same. Ground that
  /// nobody touched has no part in it. @param boundary corners, world, m; inside by the even-odd
  /// rule
  double volume_sigma_m3(const std::vector<Vec2>& boundary);
  /// What a machine cut so far: the ledger's volume, corrected by what scans know of its lip. See
  /// tools/guide/sensing.md. @throw std::invalid_argument if it is not known which machine dug
  /// what
  Estimate cut_m3(std::size_t machine);
  /// Swell and angle of repose of the heap inside a boundary, as scans saw it.
  /// @param boundary as above; around the whole heap, and nothing else that was dug or filled
  /// @throw std::invalid_argument with one line if soil is rigid, scans saw too little of it, it is
  /// too small, or touches cut ground
  Heap heap(const std::vector<Vec2>& boundary);

  /// Serialized state for the next update, without the ground and the model.
  std::string progress() const;
  /// Machines that follow those of the bytes came later; they must have no state yet.
  /// @throw std::invalid_argument if the bytes are of other machines; nothing has changed then
  void set_progress(std::string_view bytes);

 protected:
  struct Input {
    std::optional<double> time_s = {};
    Pose pose = {};
    std::vector<double> configuration = {};  ///< of the chain; empty: the state was a pose
    Vec3 direction = Vec3::Zero();           ///< of the lip when it last moved, unit; zero: unknown
    Vec3 moved_from = Vec3::Zero();          ///< where the lip was when that was known
  };

  std::string name(std::size_t machine) const;
  /// @throw std::invalid_argument for an unknown machine
  void require(std::size_t machine) const;
  /// The chain of a machine. @throw std::invalid_argument if it has none
  const Chain& chain(std::size_t machine) const;
  /// A chain's configuration after the machine's state before, which `base` may be left to.
  /// @throw std::invalid_argument as pose()
  std::vector<double> configuration(std::size_t machine, std::span<const double> joints,
                                    const std::optional<Pose>& base,
                                    const std::optional<Input>& before) const;
  /// Checks and converts a state. @param before the machine's state before
  /// @throw std::invalid_argument for an invalid state
  Input input(const MachineState& state, const std::optional<Input>& before) const;
  Input input(const MachineState& state) const;
  /// The configuration of a state, as one that has the root's pose if another has it.
  std::vector<double> like(const Input& input, const Input& other, std::size_t machine) const;
  /// Sets direction and moved_from of the state after `last`.
  void set_direction(Input& now, const std::optional<Input>& last) const;
  /// @throw std::invalid_argument if a machine's time would go back
  void require_order(std::size_t machine, const std::optional<Input>& last,
                     std::optional<double> time_s) const;
  /// May some of a pour fall before a move to a time?
  bool pours_before(std::optional<double> time_s) const;
  /// Lets the pours fall that precede a move to a time, if the time is known.
  void pour_before(std::optional<double> time_s);
  void pour_until(double until_s);
  /// Makes moves; one by one if it must be known which machine dug what.
  std::vector<Update> make(std::span<const Move> moves);
  /// Tells the survey that the ground may have changed. @param machine whose work it was, if any's
  void tell_survey(std::optional<std::size_t> machine = {},
                   GroundScans::Work how = GroundScans::Work::kOther);
  /// Makes all later updates fail: an update was applied in part.
  void fail(const std::string& why) noexcept;

  std::shared_ptr<Ground> ground_;
  std::shared_ptr<const SiteModel> model_;
  std::unique_ptr<Tracker> tracker_;
  std::vector<std::optional<Input>> inputs_;  // per machine
  bool at_rest_ = false;                      // soil has come to rest at the end of a run
  std::string broken_ = {};  // why the site refuses all updates; empty: it does not
  std::shared_ptr<SurveyedHeights> surveyed_ =
      std::make_shared<SurveyedHeights>();    // survey_ reads it
  std::unique_ptr<GroundScans> survey_ = {};  // from the first scan on

 private:
  template <typename Result, typename Work>
  Result guarded(const Work& work) noexcept;
  Move move(const MachineState& state, std::optional<Input>& last,
            std::deque<Motion>& motions) const;

  /// @return columns that have another height than before
  std::int64_t take_survey(const SurveyHeights& heights);
  GroundScans& scans();
  std::unique_ptr<GroundScans> new_survey() const;
  /// Of each machine, see GroundScans.
  std::vector<Estimate> cut_errors_m3(GroundScans& of) const;

  std::optional<double> poured_s_ = {};     // time up to which pours have fallen
  std::optional<double> next_pour_s_ = {};  // no part falls earlier
};

}  // namespace soilvdb::inline v0
