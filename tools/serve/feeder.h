// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A connected feed, whose lines are answered one after another.
#pragma once

#include <boost/beast/core.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#include "tools/serve/feed_lines.h"
#include "tools/serve/feed_source.h"
#include "tools/serve/server_state.h"

namespace soilvdb::tools {

/// "127.0.0.1:40000": where a feed comes from.
std::string name_of(const boost::asio::ip::tcp::socket& socket);

/// Reads no faster than it answers. A Feeder takes messages of lines. Between lines, other clients
/// have their turn.
///
/// A client of which nothing is heard, neither data nor answers to pings, is lost after
/// some seconds. It is live again when it is heard again.
class Feeder : public std::enable_shared_from_this<Feeder> {
 public:
  using Socket = boost::beast::websocket::stream<boost::beast::tcp_stream>;

  /// @param most bytes of a message that are kept
  Feeder(ServerState& state, Socket socket, std::size_t most = kMostFeed);
  virtual ~Feeder() = default;
  Feeder(const Feeder&) = delete;
  Feeder& operator=(const Feeder&) = delete;

  void start();
  /// Call it often. @param passed time since the last call in which the server could listen
  void listen(std::chrono::duration<double> passed);
  /// Ends the connection with a reason.
  void close(const char* why);

 protected:
  /// Takes a message, and answers it now or later.
  /// @param size of the whole message; what is over `most` is lost, and then nothing is kept
  virtual void take(boost::beast::flat_buffer message, std::uint64_t size);
  void answer(std::string text);

  ServerState& state_;
  Socket socket_;
  std::shared_ptr<FeedSource> source_ = std::make_shared<FeedSource>();

 private:
  void read();
  void work();
  void heard();
  void end(bool broken);
  void set_link(FeedSource::Link link);

  const std::size_t most_;
  std::uint64_t size_ = 0;  ///< of the message so far
  boost::beast::flat_buffer in_;
  FeedLines lines_;
  std::string out_;
  bool works_ = false;  ///< on a message, and does not listen
  double asked_s_ = 0;  ///< `source_->silent_s` at the last ping
  bool pinging_ = false, closing_ = false;
};

}  // namespace soilvdb::tools
