// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/feeder.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <string_view>
#include <utility>

namespace soilvdb::tools {
namespace {

namespace net = boost::asio;
namespace beast = boost::beast;
namespace websocket = beast::websocket;

/// Silence after which a client is asked, and after which it is lost. Viewers must know within 5 s,
/// and they are told once a second. After a minute its connection is closed.
constexpr double kAsk_s = 1, kLost_s = 3.8, kGone_s = 60;
constexpr std::size_t kMostRead = 16 << 10;
/// Longest work on lines before others have their turn.
constexpr std::chrono::microseconds kLinesTurn{200};

}  // namespace

Feeder::Feeder(ServerState& state, Socket socket) : state_(state), socket_(std::move(socket)) {
  beast::error_code none;
  const auto from = beast::get_lowest_layer(socket_).socket().remote_endpoint(none);
  source_->name =
      none ? "a connection" : fmt::format("{}:{}", from.address().to_string(), from.port());
}

void Feeder::start() {
  ++state_.connections;
  state_.feeders.insert(this);
  socket_.text(true);
  socket_.control_callback([this](websocket::frame_type, beast::string_view) { heard(); });
  read();
}

void Feeder::set_link(FeedSource::Link link) {
  if (std::exchange(source_->link, link) != link) state_.told = {};  // viewers are told now
}

void Feeder::heard() {
  silent_s_ = asked_s_ = 0;
  set_link(FeedSource::Link::kLive);
}

void Feeder::listen(std::chrono::duration<double> passed) {
  silent_s_ += passed.count();
  if (silent_s_ >= kLost_s) set_link(FeedSource::Link::kLost);
  if (silent_s_ >= kGone_s) beast::get_lowest_layer(socket_).close();
  if (silent_s_ - asked_s_ < kAsk_s || pinging_ || closing_) return;
  asked_s_ = silent_s_;
  pinging_ = true;
  socket_.async_ping({},
                     [self = shared_from_this()](beast::error_code) { self->pinging_ = false; });
}

void Feeder::read() {
  socket_.async_read_some(in_, kMostRead,
                          [self = shared_from_this()](beast::error_code error, std::size_t) {
                            if (error) return self->end(error != websocket::error::closed);
                            self->heard();
                            if (!self->socket_.is_message_done()) return self->read();
                            self->take();
                          });
}

void Feeder::take() {
  lines_ = beast::buffers_to_string(in_.data());
  in_.consume(in_.size());
  at_ = 0;
  out_.clear();
  work();
}

void Feeder::work() {
  const auto until = ServerState::Clock::now() + kLinesTurn;
  while (at_ < lines_.size() && !state_.ending) {
    const std::size_t end = std::min(lines_.find('\n', at_), lines_.size());
    const std::string_view line = std::string_view(lines_).substr(at_, end - at_);
    at_ = end + 1;
    if (line.find_first_not_of(" \t\r") == std::string_view::npos) continue;
    if (!out_.empty()) out_ += '\n';
    out_ += state_.options.takes_feeds ? state_.site.feed(line, source_)
                                       : fmt::format(R"({{"error":"{}"}})", kOnlyLookedAt);
    if (ServerState::Clock::now() < until) continue;
    silent_s_ = 0;  // it was not listened to
    return net::post(state_.io, [self = shared_from_this()] { self->work(); });
  }
  if (out_.empty()) out_ = R"({"error":"an empty message; send a line of JSON"})";
  socket_.async_write(net::buffer(out_),
                      [self = shared_from_this()](beast::error_code error, std::size_t) {
                        if (error) return self->end(true);
                        self->read();
                      });
}

void Feeder::close(const char* why) {
  if (std::exchange(closing_, true)) return;
  socket_.async_close({websocket::close_code::going_away, why},
                      [self = shared_from_this()](beast::error_code) {});
}

void Feeder::end(bool broken) {
  state_.feeders.erase(this);
  --state_.connections;
  set_link(broken ? FeedSource::Link::kLost : FeedSource::Link::kEnded);
}

}  // namespace soilvdb::tools
