// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A site that is fed lines of JSON, and the state of its machines.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "io/journal/report.h"
#include "io/terrain/geodetic.h"
#include "soilvdb/io/scenario.h"
#include "soilvdb/session.h"
#include "tools/run/run_totals.h"
#include "tools/serve/machine_feed.h"
#include "tools/serve/machine_places.h"
#include "tools/serve/work_log.h"

namespace soilvdb::tools {

struct ScanHead;

/// A site's change before it was opened.
struct ChangeBefore {
  double change_m3 = 0;
  std::int64_t mass = 0;  ///< in MassUnits
};

/// What was fed so far, from live states or a journal.
struct FedStates {
  explicit FedStates(const Session& site) : log(site) {}
  void add(const io::JournalUpdate& update);
  /// A state has this time.
  void note_time(std::optional<double> time_s);

  WorkLog log;
  MachinePlaces places = {};
  io::Durations durations = {};
  std::uint64_t count = 0;
  std::optional<double> latest_s = {};   ///< of all states, also by clocks that were ahead
  bool is_untimed = false;               ///< a state had no time
  std::map<std::size_t, bool> dug = {};  ///< by machine: not placed last, as journals tell it
};

/// Is an answer of LiveSite::feed() a refusal?
inline bool is_refusal(std::string_view answer) { return answer.starts_with(R"({"error")"); }

/// Not thread-safe.
class LiveSite {
 public:
  /// @param session before its first state
  explicit LiveSite(Session session, std::string name);
  /// A site for viewing only, after its last state.
  LiveSite(Session session, std::string name, WorkLog log, const ChangeBefore& before);

  /// Records it from here on, or continues a recording.
  void record(const Recording& recording,
              const std::function<void(const io::JournalExtent&)>& progress);

  /// Feeds a line: `{"machine": "digger", "time": 12.3, "joints": {"boom": 0.3, ..}}` or with
  /// `"position": [x, y, z], "rotation": [x, y, z, w]`. A line `{"machine": "digger", "clock":
  /// "reset"}` declares a machine's clock right from here on: its times may go back, and its
  /// earlier times are forgotten.
  /// @param source where it comes from; null: unknown
  /// @return a line: the update, or `{"error": ..}`, and then the site is unchanged
  std::string feed(std::string_view line, const std::shared_ptr<const FeedSource>& source = {});
  StepResult feed(const MachineState& state);
  /// Has this called after each state that was taken, with the number of its machine.
  void after_states(std::function<void(std::size_t)> call) { after_state_ = std::move(call); }
  /// Those of its scenario.
  void set_sensors(std::map<std::string, io::SensorInput> sensors) {
    sensors_ = std::move(sensors);
  }
  /// The sensor of a scan at its place in the world, as far as states were fed.
  /// @throw std::invalid_argument with one line
  Sensor sensor_of(const ScanHead& head) const;
  /// Corrects the ground by a scan. @param points_m where its rays ended, world
  /// @return what was changed; `acknowledged_s` is left to the caller
  /// @throw std::exception with one line, and then the site is unchanged
  nlohmann::ordered_json scan(const ScanHead& head, const Sensor& sensor,
                              std::span<const Vec3> points_m);
  /// Gives the ground the heights of a survey, or of a part of it.
  /// @return why it is not on disk yet, empty if it will be
  /// @throw std::exception with one line, and then the site is unchanged
  std::string survey(const SurveyHeights& heights, SurveyVolumes& volumes);
  /// Adds, renames or retires a machine or hopper, see Session::change_list(). Without a time,
  /// hoppers come and go now.
  /// @return the list. @throw std::exception with one line
  nlohmann::ordered_json change_list(const std::string& list, std::string_view text);
  /// Takes a machine's states back.
  /// @param undone the recording without them @param fed what it has
  /// @throw std::exception with one line
  void undo(std::size_t machine, Undone& undone, FedStates fed);
  /// GET /machines: how each machine is fed, and where its feed can go on.
  nlohmann::ordered_json feeds() const;
  const std::vector<MachineFeed>& machine_feeds() const { return feeds_; }

  Session& session() { return session_; }
  const Session& session() const { return session_; }
  const std::string& name() const { return name_; }
  /// Number of fed states.
  std::uint64_t fed() const { return fed_.count; }
  /// First and latest time fed, if a state had one.
  std::optional<double> from_s() const { return fed_.log.from_s(); }
  std::optional<double> time_s() const { return fed_.log.time_s(); }
  const WorkLog& log() const { return fed_.log; }
  /// Number of changes of the past: clocks set, after which earlier states have other times,
  /// states taken back, and surveys, which count from the latest state on.
  std::uint64_t changes_of_past() const { return changes_of_past_; }
  std::uint64_t undos() const { return undos_; }
  /// Sets the commands in messages. @param curl "curl -X POST" with its options
  /// @param address of the server, "http://127.0.0.1:8470/"
  void set_address(std::string curl, std::string address) {
    curl_ = std::move(curl);
    address_ = std::move(address);
  }
  bool recorded() const { return recorded_; }

  /// The machines' state, which viewers receive repeatedly.
  nlohmann::ordered_json state() const;
  /// The site's description, which viewers receive once.
  nlohmann::ordered_json description() const;
  /// summary.json without totals().
  io::Summary summary() const;
  /// The totals of a session of this site; thread-safe.
  RunTotals totals(const Session& ground) const;

 private:
  using Clock = std::chrono::steady_clock;
  MachineState parse(const nlohmann::json& json, std::vector<double>& joints);
  /// What "geodetic" of a line says: the pose of the chain's root, or without one of the bucket.
  Pose parse_geodetic(const nlohmann::json& json, std::size_t machine);
  /// The answer to a state without "sequence".
  nlohmann::ordered_json dig(const nlohmann::json& json, const MachineState& state);
  /// As dig() of a state whose position is not good enough, or follows such a state.
  nlohmann::ordered_json place(const MachineState& state);
  /// Counts what a step changed, also if its record waits for room on the disk.
  /// @param before changes of the session before it
  StepResult taken(const MachineState& state, StepResult step, std::uint64_t before);
  /// @throw std::runtime_error if the step changed nothing
  void require_made(const StepResult& step, std::uint64_t before);
  void require_on_disk() const;
  nlohmann::ordered_json answer_to(const StepResult& step, std::size_t machine);
  /// @throw std::invalid_argument if no force is known of that machine
  bool asks_for_force(const nlohmann::json& json, std::size_t machine) const;
  void reset_clock(const nlohmann::json& json);
  Pose carried(const io::SensorInput& input, std::optional<double> time_s) const;
  void set_time(nlohmann::json& change) const;
  /// Keeps a record of each machine of the session.
  void follow_machines();
  std::string how_to_set_clock(std::size_t machine) const;
  void require_soon(const MachineState& state);
  /// How far a state's time is ahead of this computer's clock, if it counts from 1970.
  static std::optional<double> clock_ahead_s(const MachineState& state);

  Session session_;
  std::string name_;
  std::string curl_ = "curl -X POST", address_ = "/";
  std::vector<std::vector<std::string>> joints_;  ///< of each machine, by name
  FedStates fed_;
  std::map<std::string, io::SensorInput> sensors_;  ///< by name
  struct Scans {
    std::optional<double> time_s = {};  ///< of the last; the site's if it had none
    Clock::time_point heard = {};
    std::uint64_t count = 0;
  };
  std::map<std::string, Scans> scans_;            ///< since this program began, by sensor
  std::map<std::size_t, io::Geodetic> geodetic_;  ///< by machine, from its first position on
  std::vector<Clock::time_point> moved_;          ///< by machine
  std::vector<MachineFeed> feeds_;                ///< by machine
  std::vector<std::optional<double>> doubted_s_;  ///< by machine: refused as too far ahead
  Clock::time_point begin_ = Clock::now();
  std::uint64_t undos_ = 0;
  std::uint64_t changes_of_past_ = 0;
  std::int64_t hauled_ = 0;  ///< so far, units of mass
  std::string not_on_disk_;  ///< why the last state, which was taken, is not on disk
  ChangeBefore before_;
  bool recorded_ = false;
  std::function<void(std::size_t)> after_state_;
};

}  // namespace soilvdb::tools
