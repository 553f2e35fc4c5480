// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/viewer.h"

#include <boost/asio/post.hpp>
#include <nlohmann/json.hpp>
#include <utility>

#include "io/file/json.h"

namespace soilvdb::tools {
namespace {

namespace net = boost::asio;
namespace beast = boost::beast;
using Json = nlohmann::ordered_json;

constexpr std::size_t kMostTexts = 16;

/// A time of a request. @throw std::invalid_argument
std::optional<double> time_of(const Json& json, const char* key) {
  if (!json.contains(key) || json[key].is_null()) return {};
  if (!json[key].is_number())
    throw std::invalid_argument(std::string("'") + key + "' must be a number of seconds, or null");
  return json[key].get<double>();
}

std::string message(const Json& json) { return io::to_text(json); }

}  // namespace

Viewer::Viewer(ServerState& state, Socket socket, std::string client, Role role)
    : state_(state), socket_(std::move(socket)), client_(std::move(client)), role_(role) {}

void Viewer::start() {
  state_.follow_ground();
  state_.viewers.insert(this);
  ++state_.connections;
  socket_.binary(true);
  texts_.push_back(state_.description());
  texts_.push_back(state_.state_message());
  told_measures_ = state_.measures_message(role_);
  for (const Coord3& block : resident_blocks(*state_.site.session().site().ground))
    due_.insert(block);
  go_on();
  read();
}

void Viewer::changed(const Coord3& block) {
  if (view_ == 0) due_.insert(block);
}

void Viewer::tell(const Bytes& text) {
  texts_.push_back(text);
  go_on();
}

void Viewer::tell_measures(const Bytes& measures) {
  told_measures_ = measures;
  go_on();
}

void Viewer::tell_forces(const Bytes& forces) {
  told_forces_ = forces;
  go_on();
}

void Viewer::read() {
  socket_.async_read(in_, [self = shared_from_this()](beast::error_code error, std::size_t) {
    if (error) {
      self->state_.viewers.erase(self.get());
      --self->state_.connections;
      return;
    }
    self->requested(beast::buffers_to_string(self->in_.data()));
    self->in_.consume(self->in_.size());
    self->go_on();
    self->read();
  });
}

void Viewer::say(const std::string& text) {
  if (texts_.size() < kMostTexts) texts_.push_back(std::make_shared<const std::string>(text));
}

void Viewer::requested(const std::string& text) {
  try {
    const Json json = Json::parse(text, nullptr, /*allow_exceptions=*/false);
    if (json.is_discarded() || !json.is_object())
      throw std::invalid_argument("a request is a JSON object with 'time' and 'against'");
    for (const auto& [key, value] : json.items())
      if (key != "time" && key != "against" && (key != "force" || json.size() > 1))
        throw std::invalid_argument("a request has 'time' and 'against' only, or 'force' only");
    if (!json.contains("force")) return show(time_of(json, "time"), time_of(json, "against"));
    if (!json["force"].is_boolean()) throw std::invalid_argument("'force' must be true or false");
    if (!state_.site.session().earthmoving().soil) throw std::invalid_argument(kForceNeedsSoil);
    const bool wants = json["force"].get<bool>();
    if (std::exchange(wants_force_, wants) == wants) return;
    told_forces_.reset();
    ask_forces();
  } catch (const std::exception& e) {
    say(message({{"type", "error"}, {"error", e.what()}}));
  }
}

/// Has the forces of the shown time sent; those of live buckets follow with each state.
void Viewer::ask_forces() {
  if (!wants_force_) return;
  if (!past_) return state_.tell_soon();
  const bool taken = state_.other_times.try_run(
      client_, [self = shared_from_this(), ground = ground_, view = view_]() mutable {
        std::string text = ground->forces(view);
        net::io_context& io = self->state_.io;
        net::post(
            io, [self = std::move(self), ground = std::move(ground), view, text = std::move(text)] {
              if (self->view_ == view && self->wants_force_) self->say(text);
              self->go_on();
            });
      });
  if (!taken) say(message({{"type", "error"}, {"error", "too many requests; try again later"}}));
}

/// Switches to another view. Live ground with a comparison time is a view of the present time.
void Viewer::show(std::optional<double> time_s, std::optional<double> against_s) {
  if (asking_) throw std::invalid_argument("the view requested before is not ready yet");
  if (!time_s && !against_s) {
    view_ = 0;
    past_ = false;
    ground_.reset();
    due_.clear();
    sent_ = 0;
    whole_ = false;
    for (const Coord3& block : resident_blocks(*state_.site.session().site().ground))
      due_.insert(block);
    say(message({{"type", "view"},
                 {"id", 0},
                 {"time_s", nullptr},
                 {"against_s", nullptr},
                 {"state", nullptr}}));
    return ask_forces();
  }
  if (against_s && time_s && *against_s > *time_s)
    throw std::invalid_argument("compare with an earlier time");
  asking_ = true;
  auto ground = std::make_shared<std::shared_ptr<GroundQuery>>();
  auto blocks = std::make_shared<std::vector<Coord3>>();
  auto state = std::make_shared<Json>();
  const auto self = shared_from_this();
  state_.with_ground(
      time_s, against_s, client_,
      [ground, blocks, state](GroundQuery& view) {
        *state = view.state();
        *ground = std::make_shared<GroundQuery>(view);
        *blocks = resident_blocks(*view.now().site().ground);
        return Reply();
      },
      [self, ground, blocks, state, time_s, against_s](const Reply& reply) {
        self->asking_ = false;
        if (reply.status != 200) {
          Json json = Json::parse(reply.body);
          json["type"] = "error";
          self->say(message(json));
        } else {
          const auto or_null = [](std::optional<double> s) { return s ? Json(*s) : Json(); };
          self->view_ = ++self->views_;
          self->past_ = time_s.has_value();
          self->ground_ = *ground;
          self->told_forces_.reset();
          self->due_ = {blocks->begin(), blocks->end()};
          self->sent_ = 0;
          self->whole_ = false;
          self->say(message({{"type", "view"},
                             {"id", self->view_},
                             {"time_s", or_null(time_s)},
                             {"against_s", or_null(against_s)},
                             {"state", *state}}));
          self->ask_forces();
        }
        self->go_on();
      });
}

/// The next due block that is available. Takes turns, wherever changes come from.
std::optional<Coord3> Viewer::next_block(Bytes& message) {
  constexpr int kAhead = 8;  // blocks that may be requested in advance
  auto next = due_.upper_bound(last_);
  for (std::size_t i = 0; i < due_.size() && i < kAhead; ++i, ++next) {
    if (next == due_.end()) next = due_.begin();
    if (ground_) return *next;
    message = state_.block(*next);
    if (message) return *next;
  }
  state_.make_blocks();
  return {};
}

void Viewer::send(const Bytes& message, bool text) {
  sending_ = true;
  socket_.text(text);
  socket_.async_write(net::buffer(*message),
                      [self = shared_from_this(), message](beast::error_code error, std::size_t) {
                        self->sending_ = false;
                        if (error) {
                          beast::get_lowest_layer(self->socket_).close();
                          return;
                        }
                        // Yields to other handlers: the next message may be a block.
                        net::post(self->state_.io, [self] { self->go_on(); });
                      });
}

void Viewer::close(const char* why) {
  if (std::exchange(closing_, true)) return;
  socket_.async_close({beast::websocket::close_code::going_away, why},
                      [self = shared_from_this()](beast::error_code) {});
}

void Viewer::go_on() {
  if (sending_ || closing_) return;
  if (!texts_.empty()) {
    const Bytes text = texts_.front();
    texts_.pop_front();
    return send(text, true);
  }
  for (Bytes* told : {&told_measures_, &told_, &told_forces_})
    if (*told) return send(std::exchange(*told, nullptr), true);
  Bytes message_of_block;
  const std::optional<Coord3> block = next_block(message_of_block);
  if (!block) {
    if (whole_ || !due_.empty()) return;
    whole_ = true;
    return send(std::make_shared<const std::string>(
                    message({{"type", "whole"}, {"id", view_}, {"blocks", sent_}})),
                true);
  }
  if (!ground_) {
    due_.erase(*block);
    last_ = *block;
    ++sent_;
    return send(message_of_block, false);
  }
  sending_ = true;
  const bool taken = state_.other_times.try_run(
      client_, [self = shared_from_this(), ground = ground_, view = view_, at = *block]() mutable {
        Bytes bytes;
        try {
          bytes = std::make_shared<const std::string>(ground->block(at, view));
        } catch (const std::exception&) {  // the block is left out
        }
        // Moves the references along, so that this thread does not destroy the objects.
        net::io_context& io = self->state_.io;
        net::post(io, [self = std::move(self), ground = std::move(ground), view, at, bytes] {
          self->sending_ = false;
          if (self->view_ == view) {
            self->due_.erase(at);
            self->last_ = at;
            if (bytes) ++self->sent_;
          }
          if (bytes && self->view_ == view) return self->send(bytes, false);
          self->go_on();
        });
      });
  if (!taken) sending_ = false;  // tries again at the next tick
}

}  // namespace soilvdb::tools
