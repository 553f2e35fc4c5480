// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A connected viewer, which receives changes as fast as it can take them.
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

/// Keeps only the set of due blocks. A slow viewer skips intermediate states, and blocks nothing
/// else.
class Viewer : public std::enable_shared_from_this<Viewer> {
 public:
  using Socket = boost::beast::websocket::stream<boost::beast::tcp_stream>;

  /// @param client as in ServerState::answer()
  Viewer(ServerState& state, Socket socket, std::string client, Role role);

  void start();
  /// A block of the live ground changed.
  void changed(const Coord3& block);
  /// Sends a text in its turn.
  void tell(const Bytes& text);
  /// State of the machines; only the newest is sent.
  void tell_state(const Bytes& state) { told_ = state; }
  /// Sends the named measures; only the newest list is sent.
  void tell_measures(const Bytes& measures);
  Role role() const { return role_; }
  /// Did it ask for forces, and looks at the live machines?
  bool wants_live_forces() const { return wants_force_ && !past_; }
  /// Forces on the live buckets; only the newest are sent.
  void tell_forces(const Bytes& forces);
  /// Sends the next due message, unless one is being sent.
  void go_on();
  /// Ends the connection with a reason.
  void close(const char* why);

 private:
  void read();
  void requested(const std::string& text);
  void show(std::optional<double> time_s, std::optional<double> against_s);
  void ask_forces();
  void say(const std::string& text);
  void send(const Bytes& message, bool text);
  std::optional<Coord3> next_block(Bytes& message);

  ServerState& state_;
  Socket socket_;
  const std::string client_;
  const Role role_;
  boost::beast::flat_buffer in_;
  std::deque<Bytes> texts_;
  Bytes told_measures_, told_, told_forces_;
  std::set<Coord3, Before> due_;
  Coord3 last_ = Coord3::Zero();
  std::uint32_t view_ = 0, views_ = 0;   ///< 0: live; number of other views so far
  std::shared_ptr<GroundQuery> ground_;  ///< of a view other than live
  bool past_ = false;                    ///< are its machines those of another time?
  bool wants_force_ = false;
  std::size_t sent_ = 0;
  bool whole_ = false;  ///< was the viewer informed that all blocks were sent?
  bool sending_ = false, asking_ = false, closing_ = false;
};

}  // namespace soilvdb::tools
