// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A site for a program's own loop: machine states in, ground and loads brought up to date. Needs no
// files.
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
#include "soilvdb/kinematics.h"
#include "soilvdb/tracker.h"

namespace soilvdb::inline v0 {

struct SiteMachine {
  std::string name;
  Bucket bucket;
  std::optional<Chain> chain = {};  ///< for states that are joints
};

/// What no update changes. Clones of a site share it.
struct SiteModel {
  std::vector<SiteMachine> machines;  ///< names differ
  Earthmoving earthmoving = {};       ///< without `soil` soil is rigid

  /// The machine of that name. @throw std::invalid_argument naming those that there are
  std::size_t machine(std::string_view name) const;
};

/// Where a machine is at a time; its first state places it. Between states with times its joints,
/// or its position and rotation, change evenly, as between rows of a motion; else its bucket moves
/// in a straight line.
struct MachineState {
  std::size_t machine = 0;
  /// s, in any frame of time that all share; without: not known. A machine's time must not go back,
  /// but after Site::reset_clock().
  std::optional<double> time_s = {};
  /// world_from_bucket, unless there are `joints`.
  Pose pose = {};
  /// rad or m, of the machine's chain, one for each movable joint.
  std::span<const double> joints = {};
};

enum class Status {
  kOk,
  kBadState,  ///< unknown machine, invalid pose or joints, or time that decreases
  kNoGround,  ///< the bucket would reach ground that the terrain has no height for
  kFailed,    ///< something else went wrong, on the way or with the recording: see `why`
};

/// Result of one state. Unless `status` is kOk nothing has changed, and `why` is one line.
struct StepResult {
  Status status = Status::kOk;
  std::string why = {};
  Update update = {};
  bool ok() const { return status == Status::kOk; }
};

/// Result of several states: all were applied, or `bad` is the index of the first invalid one and
/// none was.
struct BatchResult {
  Status status = Status::kOk;
  std::string why = {};
  std::size_t bad = 0;
  std::vector<Update> updates = {};  ///< one for each state
  bool ok() const { return status == Status::kOk; }
};

/// The ground of a site and its machines, brought up to date state by state.
///
/// Guarantees: updates don't throw. An update that isn't made leaves ground, loads and times as
/// they were, to the bit. The same states give the same bits for any number of threads, whoever
/// looks in between. A clone, and a site that takes progress() on a copy of the ground, go on as
/// this one would.
/// Threads: a site is for one thread at a time; different ones may be used at once. Work runs in
/// the caller's TBB arena.
///
///     Site site(std::make_shared<Ground>(0.05, Vec3::Zero(), make_plane(0, {0, 0})),
///               {{{"digger", {.width_m = 1.2, .height_m = 0.9}}}});
///     while (controller.next(state))
///       if (const StepResult step = site.update(state); step.ok()) control(step.update.bucket_m3);
class Site {
 public:
  /// @throw std::invalid_argument in one line for machines or soil that can't be
  Site(std::shared_ptr<Ground> ground, SiteModel model);
  /// A copy goes on apart from the other. It shares the model, and each chunk's samples until one
  /// of the two changes them. @throw std::logic_error as Ground::clone()
  Site(const Site& other);
  Site(Site&&) noexcept = default;
  Site& operator=(Site&&) noexcept = default;

  const SiteModel& model() const { return *model_; }
  const Ground& ground() const { return *ground_; }
  const Tracker& tracker() const { return *tracker_; }

  /// world_from_bucket of a machine at joint values. @throw std::invalid_argument if it has no
  /// chain, or another number of joints
  Pose pose(std::size_t machine, std::span<const double> joints) const;
  /// The last state of a machine, its pose known also where that was joints; nothing before. Its
  /// joints hold until the next update. @throw std::invalid_argument if there is no such machine
  std::optional<MachineState> last(std::size_t machine) const;
  /// The latest of the machines' times.
  std::optional<double> last_s() const;

  StepResult update(const MachineState& state) noexcept;
  /// All of these, in their order, or none of them. Machines that are apart move in parallel.
  BatchResult update(std::span<const MachineState> states) noexcept;
  /// Pours fall up to and including a time. Each state that has a time pours up to it first.
  StepResult pour(double until_s) noexcept;
  /// A machine's clock was wrong and is set: the time of its next state may be earlier than the
  /// last. Its bucket moves there in a straight line, as where no time is known.
  StepResult reset_clock(std::size_t machine) noexcept;
  /// Soil that stands or hangs too steep comes to rest, as at the end of a run.
  StepResult come_to_rest() noexcept;

  /// All that the next update depends on besides the ground and the model, as bytes.
  std::string progress() const;
  /// @throw std::invalid_argument if it isn't of these machines; nothing has changed then
  void set_progress(std::string_view bytes);

 protected:
  /// The last state of a machine.
  struct Input {
    std::optional<double> time_s = {};
    Pose pose = {};
    std::vector<double> joints = {};  ///< empty: it was a pose
  };

  std::string name(std::size_t machine) const;
  /// @throw std::invalid_argument if there is no such machine
  void require(std::size_t machine) const;
  /// A state as input. @throw std::invalid_argument if it can't be
  Input input(const MachineState& state) const;
  /// Pours that fall before a machine's move to that time, if it has one.
  void pour_before(std::optional<double> time_s);
  void pour_until(double until_s);
  /// Nothing can be done from here on: part of an update was made.
  void fail(const std::string& why) noexcept;

  std::shared_ptr<Ground> ground_;
  std::shared_ptr<const SiteModel> model_;
  std::unique_ptr<Tracker> tracker_;
  std::vector<std::optional<Input>> inputs_;  // of each machine
  bool at_rest_ = false;                      // soil has come to rest at a run's end
  std::string broken_ = {};                   // why nothing can be done any more

 private:
  template <typename Result, typename Work>
  Result guarded(const Work& work) noexcept;
  Move move(const MachineState& state, std::optional<Input>& last,
            std::deque<Motion>& motions) const;

  std::optional<double> poured_s_ = {};     // up to which pours fell
  std::optional<double> next_pour_s_ = {};  // no part falls before
};

}  // namespace soilvdb::inline v0
