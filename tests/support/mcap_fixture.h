// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Recordings of robots, message by message, in any order, and the motions that are read from them.
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "io/mcap/cdr.h"
#include "io/mcap/mcap_writer.h"
#include "soilvdb/io/motion_csv.h"
#include "soilvdb/io/motion_file.h"
#include "tests/support/temp_folder.h"

namespace soilvdb::io {

/// Writes messages in the order of the calls. Times are in seconds; those of recording are the
/// stamps' unless they are given.
class Recording {
 public:
  explicit Recording(const std::filesystem::path& file) : writer_(file, "ros2") {}

  using Names = std::vector<std::string>;
  void joints(const std::string& topic, double stamp_s, const Names& names,
              const std::vector<double>& positions, std::optional<double> log_s = {}) {
    CdrWriter cdr = stamped(stamp_s, "");
    cdr.put(static_cast<std::uint32_t>(names.size()));
    for (const std::string& name : names) cdr.put(std::string_view(name));
    cdr.put(static_cast<std::uint32_t>(positions.size()));
    for (const double position : positions) cdr.put(position);
    cdr.put_all(std::uint32_t{0}, std::uint32_t{0});  // neither velocities nor efforts
    write(topic, "sensor_msgs/msg/JointState", cdr, log_s.value_or(stamp_s));
  }
  void pose(const std::string& topic, double stamp_s, const Vec3& p,
            const std::string& frame = "map", std::optional<double> log_s = {}) {
    CdrWriter cdr = stamped(stamp_s, frame);
    put(cdr, p);
    write(topic, "geometry_msgs/msg/PoseStamped", cdr, log_s.value_or(stamp_s));
  }
  void odometry(const std::string& topic, double stamp_s, const Vec3& p) {
    CdrWriter cdr = stamped(stamp_s, "map");
    cdr.put(std::string_view("bucket"));
    put(cdr, p);
    for (int i = 0; i < 36 + 6 + 36; ++i) cdr.put(0.5 + i);  // covariances and speeds
    write(topic, "nav_msgs/msg/Odometry", cdr, stamp_s);
  }
  void transform(double stamp_s, const std::string& parent, const std::string& child, const Vec3& p,
                 std::optional<double> log_s = {}, const std::string& topic = "/tf") {
    CdrWriter cdr;
    cdr.put(std::uint32_t{1});
    put_stamp(cdr, stamp_s);
    cdr.put(std::string_view(parent));
    cdr.put(std::string_view(child));
    put(cdr, p);
    write(topic, "tf2_msgs/msg/TFMessage", cdr, log_s.value_or(stamp_s));
  }
  void bytes(const std::string& topic, double log_s, const std::string& message) {
    writer_.write(channels_.at(topic), ns(log_s), message);
  }
  /// A message of any type.
  void message(const std::string& topic, const std::string& type, const CdrWriter& cdr,
               double log_s) {
    write(topic, type, cdr, log_s);
  }
  /// The head of a message with a stamp and a frame.
  static CdrWriter stamped(double s, const std::string& frame) {
    CdrWriter cdr;
    put_stamp(cdr, s);
    cdr.put(std::string_view(frame));
    return cdr;
  }
  /// What comes next is in another chunk.
  void chunk() { writer_.flush(); }
  void close() { writer_.close(); }

 private:
  static std::uint64_t ns(double s) { return static_cast<std::uint64_t>(std::llround(s * 1e9)); }
  static void put_stamp(CdrWriter& cdr, double s) {
    cdr.put(static_cast<std::int32_t>(ns(s) / 1'000'000'000));
    cdr.put(static_cast<std::uint32_t>(ns(s) % 1'000'000'000));
  }
  static void put(CdrWriter& cdr, const Vec3& p) {
    cdr.put_all(p.x(), p.y(), p.z(), 0.0, 0.0, 0.0, 1.0);
  }
  void write(const std::string& topic, const std::string& type, const CdrWriter& cdr,
             double log_s) {
    if (!channels_.contains(topic))
      channels_[topic] = writer_.add_channel(topic, {type, "ros2msg", "# as ROS has it"}, "cdr");
    writer_.write(channels_[topic], ns(log_s), cdr.bytes());
  }

  McapWriter writer_;
  std::map<std::string, std::uint16_t> channels_;
};

class RecordedMotion : public ::testing::Test {
 protected:
  /// Its good rows, its bad ones and its warnings.
  struct Read {
    std::vector<double> times_s;
    std::vector<Vec3> positions;  ///< of the lip
    BadRows bad;
    std::vector<std::string> warnings;
  };
  Read read(const MotionSource& source, const std::optional<Chain>& chain = {}) const {
    MotionReader reader(source, chain);
    const Motion motion = reader.next(1'000'000);
    Read read{motion.times_s(), {}, reader.bad_rows(), reader.warnings()};
    for (std::size_t i = 0; i < read.times_s.size(); ++i)
      read.positions.push_back(motion.row(i).position);
    return read;
  }
  std::string error(const MotionSource& source, const std::optional<Chain>& chain = {}) const {
    return test::message_of(folder_, [&] { read_motion(source, chain); });
  }
  /// Writes a file of this folder.
  std::filesystem::path record(const std::string& name, const auto& messages) const {
    Recording recording(folder_ / name);
    messages(recording);
    recording.close();
    return folder_ / name;
  }

  const test::TempFolder folder_;
};

}  // namespace soilvdb::io
