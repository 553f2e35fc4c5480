// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A live site among nodes of ROS 2: their messages move machines, and they are told loads, forces
// and the ground. tools/guide/live.md lists the topics.
#pragma once

#include <chrono>
#include <cstddef>
#include <deque>
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "soilvdb/chunk_range.h"
#include "soilvdb/ground_copy.h"
#include "tools/run/elevation_map.h"
#include "tools/serve/dds.h"
#include "tools/serve/feed_source.h"
#include "tools/serve/ros_states.h"

namespace soilvdb::tools {

struct ServerState;  // tools/serve/server_state.h

struct RosOptions {
  int domain = 0;
  bool only_this_computer = false;
  std::vector<RosMachine> machines = {};
};

/// Messages become lines of a feed for each machine, with the checks of all lines. A feed of which
/// nothing is heard, or that nobody publishes any more, is lost. Refusals are printed.
class RosBridge {
 public:
  /// @param state whose thread calls all members
  /// @throw std::exception with one line
  RosBridge(ServerState& state, const RosOptions& options);
  RosBridge(const RosBridge&) = delete;
  RosBridge& operator=(const RosBridge&) = delete;

  /// @param change of the list of machines, as in POST /machines; or nothing
  /// @throw io::InputError if two machines would then share topics
  void require_topics(const nlohmann::json& change) const;
  /// Feeds what came, and publishes loads and forces of machines that moved.
  void work();
  /// Call it often. @param passed time since the last call in which messages could be read
  void listen(std::chrono::duration<double> passed);
  /// Publishes the ground once a second, if it changes.
  /// @param changed chunks of the ground; at first all
  void tick(std::span<const Coord3> changed, GroundCopy& beside);

 private:
  using Clock = std::chrono::steady_clock;
  /// A machine that topics move.
  struct Fed {
    RosMachine of;
    std::shared_ptr<FeedSource> source = std::make_shared<FeedSource>();
    bool heard = false;                    ///< ever
    std::vector<std::size_t> inputs = {};  ///< that it reads
    std::vector<std::size_t> movers = {};  ///< those of them that make its states
    Clock::time_point told = {};           ///< when its last refusal was printed
    std::size_t untold = 0;                ///< refusals after that
  };
  /// What is published of a machine.
  struct Told {
    std::string name = {};
    std::size_t load = 0, mass = 0, wrench = 0;  ///< writers
    std::optional<double> time_s = {};
    std::optional<Pose> pose = {};
  };

  void take(const Dds::Message& message);
  void feed(const RosStates::State& state);
  void refuse(Fed& fed, const std::string& why);
  void set_link(Fed& fed, FeedSource::Link link);
  void publish();
  void publish(std::size_t machine, Told& told);
  std::string frame_of(std::size_t machine) const;

  ServerState& state_;
  std::function<void()> work_soon_;  ///< from any thread
  std::deque<Dds::Message> waiting_;
  std::vector<Fed> fed_;
  RosStates states_;
  std::string frame_ = "map";  ///< of the ground
  std::vector<Told> told_;     ///< by machine
  std::size_t ground_ = 0;     ///< writer
  std::vector<Coord3> changed_;
  Clock::time_point mapped_ = {};
  bool mapping_ = false;
  ElevationMap map_;  ///< used by jobs only
  std::unique_ptr<Dds> dds_;
};

}  // namespace soilvdb::tools
