// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// One who watches: is sent what changed, as fast as it takes it and no faster.
#pragma once

#include <boost/beast/core.hpp>
#include <boost/beast/websocket.hpp>
#include <deque>
#include <memory>
#include <optional>
#include <set>
#include <string>

#include "tools/serve/server_state.h"

namespace soilvdb::tools {

/// Only which blocks are due is kept for a viewer, so one that stalls misses states in between and
/// holds nothing else up.
class Viewer : public std::enable_shared_from_this<Viewer> {
 public:
  using Socket = boost::beast::websocket::stream<boost::beast::tcp_stream>;

  Viewer(ServerState& state, Socket socket);

  void start();
  /// A block of the live ground changed.
  void changed(const Coord3& block);
  /// Of the machines; the newest wins.
  void tell_state(const Bytes& state) { told_ = state; }
  /// Sends what is due next unless something is on its way.
  void go_on();

 private:
  void read();
  void requested(const std::string& text);
  void show(std::optional<double> time_s, std::optional<double> against_s);
  void shown(std::shared_ptr<GroundView> ground, std::vector<Coord3> blocks, const Bytes& text);
  void say(const std::string& text);
  void send(const Bytes& message, bool text);
  std::optional<Coord3> next_block(Bytes& message);

  ServerState& state_;
  Socket socket_;
  boost::beast::flat_buffer in_;
  std::deque<Bytes> texts_;
  Bytes told_;
  std::set<Coord3, Before> due_;
  Coord3 last_ = Coord3::Zero();
  std::uint32_t view_ = 0, views_ = 0;  ///< 0: live; how many others there were
  std::shared_ptr<GroundView> ground_;  ///< of another view
  std::size_t sent_ = 0;
  bool whole_ = false;  ///< was it told that all were sent?
  bool sending_ = false, asking_ = false;
};

}  // namespace soilvdb::tools
