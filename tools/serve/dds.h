// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Topics of DDS as bytes of CDR, by Cyclone DDS, which is loaded when it is first needed.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace soilvdb::tools {

struct DdsType {
  std::string name;       ///< "sensor_msgs::msg::dds_::JointState_"
  std::string user_data;  ///< that its readers and writers show others
};

struct DdsTopic {
  std::string name;            ///< "rt/joint_states"
  std::vector<DdsType> types;  ///< may be published as any of these
  bool latched = false;        ///< readers that come later get the last message, too
};

/// A participant of a domain. Its threads receive messages and keep the last 1000 of each topic
/// until they are taken. All members throw std::runtime_error with one line. Not thread-safe.
class Dds {
 public:
  struct Message {
    std::size_t topic = 0, type = 0;  ///< numbers in the lists of topics and their types
    std::string cdr;                  ///< unchecked
  };

  /// @param topics to read. A reader is made when somebody publishes its topic: reliable if all who
  ///        publish it are, else as best effort
  /// @param wake called on another thread: there may be something to take
  Dds(int domain, bool only_this_computer, std::vector<DdsTopic> topics,
      std::function<void()> wake);
  ~Dds();
  Dds(const Dds&) = delete;
  Dds& operator=(const Dds&) = delete;

  /// Some of each topic, in the order in which they were sent; nothing if none is left.
  std::vector<Message> take();
  /// Who publishes a topic as another type, and can't be read; each once.
  std::vector<std::string> take_warnings();
  /// How many publish a topic that is read.
  std::size_t senders(std::size_t topic) const;

  /// Publishes the first type of a topic, reliably. @return the number of the writer
  std::size_t add_writer(const DdsTopic& topic);
  bool is_read(std::size_t writer) const;
  void write(std::size_t writer, std::string_view cdr);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace soilvdb::tools
