// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// States of machines from messages of ROS 2 as they come: what the motion of a machine in MCAP
// files is to a run (io/motion/mcap_rows.h).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "io/motion/mcap_messages.h"
#include "soilvdb/io/motion_source.h"
#include "soilvdb/kinematics.h"

namespace soilvdb::tools {

/// A machine that topics move; its number is its place in the site's list.
struct RosMachine {
  std::size_t machine = 0;
  std::string name;
  io::McapTopic topic;
  std::optional<Chain> chain = {};
};

/// A stamp makes a state as soon as all that the state needs is known then: joints, transforms and
/// bases have values at their stamps, and between two stamps at most a second apart. A state waits
/// for them a quarter of a second at most. Not thread-safe.
class RosStates {
 public:
  struct Input {
    std::string topic;
    std::vector<io::McapType> types;  ///< as any of which it may come
    bool fixed = false;               ///< transforms that hold at all times
  };
  struct State {
    std::size_t machine = 0;
    std::int64_t time_ns = 0;
    std::vector<double> joints;  ///< of a machine with a chain
    std::optional<Pose> pose;    ///< of the bucket; with joints, of the base that drives
  };
  /// Why a machine has no state at a stamp, or a message says nothing.
  struct Fault {
    std::size_t machine = 0;
    std::string why;
  };

  /// @throw io::InputError if a machine's motion can't be heard
  explicit RosStates(std::vector<RosMachine> machines);

  const std::vector<Input>& inputs() const { return inputs_; }
  /// @param now_ns when it came, of any clock that doesn't go back @param host_ns the same in ns
  /// since 1970, which is its time if it has no stamp
  /// @return the machines that get a state by it, now or later @throw io::CdrError
  std::vector<std::size_t> take(std::size_t input, io::McapType type, std::string_view cdr,
                                std::int64_t now_ns, std::int64_t host_ns);
  /// States that are complete, each machine's by time.
  std::vector<State> states(std::int64_t now_ns);
  std::vector<Fault> take_faults();

 private:
  using Values = std::array<double, kPoseNumbers>;
  /// Values of a joint, or numbers of a pose, by time.
  struct Track {
    struct Sample {
      std::int64_t time_ns = 0;
      Values values = {};
    };
    std::deque<Sample> samples = {};
    bool put(std::int64_t time_ns, const Values& values);
  };
  struct Frame {
    std::string parent;
    bool fixed = false;
    Track track = {};
  };
  struct Frames {
    std::map<std::string, Frame, std::less<>> named = {};
    std::size_t fixed = 0;  ///< number of those that are fixed
  };
  struct Poses {
    std::string frame;
    Track track = {};
  };
  struct Row {
    std::int64_t time_ns = 0, came_ns = 0;
  };
  struct Machine {
    RosMachine of;
    std::vector<std::string> names = {};  ///< of its joints
    std::vector<bool> goes_round = {};
    std::vector<Track> joints = {};
    std::deque<Row> rows = {};  ///< that wait, by time
    std::optional<std::int64_t> done_ns = {};

    /// Where poses of its bucket or base come from; null: nowhere.
    const io::McapTopic* poses() const { return of.chain ? of.topic.base.get() : &of.topic; }
  };

  void listen(const std::string& topic, std::vector<io::McapType> types, bool fixed = false);
  void listen_to_poses(const RosMachine& machine, const io::McapTopic& topic, const char* whose);
  void take_joints(const std::string& topic, const io::McapItem& item, const Row& row);
  void take_transform(const std::string& topic, bool fixed, const io::McapItem& item,
                      const Row& row);
  void take_pose(const std::string& topic, const io::McapItem& item, const Row& row);
  void add_row(Machine& machine, const Row& row);
  void add_fault(const Machine& machine, std::string why);
  /// The links from the frame up, or why they don't reach the parent.
  std::vector<const Frame*> links_of(const io::McapTopic& topic) const;
  bool is_in_chain(const io::McapTopic& topic, std::string_view frame) const;
  /// Is a frame in the chain of a machine?
  bool is_needed(const std::string& topic, std::string_view frame) const;
  /// @return false if there are too many frames
  bool make_room(const std::string& topic, bool fixed);
  Values at(const Track& track, const Row& row, std::int64_t now_ns, const std::string& what,
            bool angle, bool pose) const;
  Pose pose_at(const io::McapTopic& topic, const Row& row, std::int64_t now_ns) const;
  State state_at(const Machine& machine, const Row& row, std::int64_t now_ns) const;

  std::vector<Input> inputs_;
  std::vector<Machine> machines_;
  std::map<std::string, Frames, std::less<>> frames_;  ///< by topic
  std::map<std::string, Poses, std::less<>> poses_;    ///< by topic
  std::vector<io::McapItem> items_;
  std::vector<std::size_t> heard_;
  std::vector<Fault> faults_;
};

}  // namespace soilvdb::tools
