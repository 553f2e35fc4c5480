// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Feeds of a live site by MQTT, by libmosquitto, which is loaded when it is first needed.
// tools/guide/live.md lists the topics.
#pragma once

#include <chrono>
#include <memory>
#include <string>

namespace soilvdb::tools {

struct ServerState;  // tools/serve/server_state.h

struct MqttOptions {
  std::string host, topic;  ///< below which states are published
  int port = 1883;
  bool tls = false;
  std::string user = {}, password = {};
};

/// Each topic `feed/NAME` is a feed, whose messages are answered one after another. A feed of which
/// nothing is heard, whose last will came, or whose broker is gone, is lost. A thread of its own
/// keeps the connection, and connects again and again.
class MqttBridge {
 public:
  /// Says goodbye.
  virtual ~MqttBridge() = default;
  /// Call it often: feeds what came, for a short time.
  /// @param passed time since the last call in which messages could be read
  virtual void work(std::chrono::duration<double> passed) = 0;
};

/// @param state on whose thread the bridge works
/// @throw std::exception with one line for wrong options; that a broker isn't there is only told
std::unique_ptr<MqttBridge> feed_by_mqtt(ServerState& state, const MqttOptions& options);

}  // namespace soilvdb::tools
