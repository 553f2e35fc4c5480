// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/feeder.h"

#include <fmt/format.h>

#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <utility>

namespace soilvdb::tools {
namespace {

namespace net = boost::asio;
namespace beast = boost::beast;
namespace websocket = beast::websocket;

/// Silence after which a client is asked, and after which its connection is closed.
constexpr double kAsk_s = 1, kGone_s = 60;
constexpr std::size_t kMostRead = 64 << 10;

}  // namespace

std::string name_of(const net::ip::tcp::socket& socket) {
  beast::error_code none;
  const auto from = socket.remote_endpoint(none);
  return none ? "a connection" : fmt::format("{}:{}", from.address().to_string(), from.port());
}

Feeder::Feeder(ServerState& state, Socket socket, std::size_t most)
    : state_(state), socket_(std::move(socket)), most_(most) {
  source_->name = name_of(beast::get_lowest_layer(socket_).socket());
}

void Feeder::start() {
  ++state_.connections;
  state_.feeders.insert(this);
  socket_.text(true);
  socket_.control_callback([this](websocket::frame_type, beast::string_view) { heard(); });
  read();
}

void Feeder::set_link(FeedSource::Link link) {
  if (source_->set_link(link)) state_.told = {};  // viewers are told now
}

void Feeder::heard() {
  source_->heard();
  asked_s_ = 0;
  set_link(FeedSource::Link::kLive);
}

void Feeder::listen(std::chrono::duration<double> passed) {
  if (state_.undoing || works_) return;  // it may not be read
  source_->silent_s += passed.count();
  if (source_->silent_s >= kLost_s) set_link(FeedSource::Link::kSilent);
  if (source_->silent_s >= kGone_s) beast::get_lowest_layer(socket_).close();
  if (source_->silent_s - asked_s_ < kAsk_s || pinging_ || closing_) return;
  asked_s_ = source_->silent_s;
  pinging_ = true;
  socket_.async_ping({},
                     [self = shared_from_this()](beast::error_code) { self->pinging_ = false; });
}

void Feeder::read() {
  socket_.async_read_some(in_, kMostRead,
                          [self = shared_from_this()](beast::error_code error, std::size_t size) {
                            if (error) return self->end(error != websocket::error::closed);
                            self->heard();
                            self->size_ += size;
                            if (self->size_ > self->most_) self->in_.clear();
                            if (!self->socket_.is_message_done()) return self->read();
                            self->works_ = true;
                            self->take(std::exchange(self->in_, {}), std::exchange(self->size_, 0));
                          });
}

void Feeder::take(beast::flat_buffer message, std::uint64_t) {
  lines_ = FeedLines(beast::buffers_to_string(message.data()));
  work();
}

void Feeder::work() {
  if (state_.waits_for_undo([self = shared_from_this()] { self->work(); })) return;
  if (lines_.feed(state_.feed_of(source_)) && !state_.ending)
    return net::post(state_.io, [self = shared_from_this()] { self->work(); });
  answer(lines_.answers());
}

void Feeder::answer(std::string text) {
  works_ = false;
  source_->silent_s = asked_s_ = 0;  // it was not listened to
  out_ = std::move(text);
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
  if (broken && source_->link == FeedSource::Link::kSilent) return;  // it may have been closed here
  set_link(broken ? FeedSource::Link::kBroken : FeedSource::Link::kEnded);
}

}  // namespace soilvdb::tools
