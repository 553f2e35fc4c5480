// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The one file with headers of libmosquitto.
#include "tools/serve/mqtt_bridge.h"

#include "soilvdb/io/error.h"

#ifndef SOILVDB_MQTT_LIBRARY

std::unique_ptr<soilvdb::tools::MqttBridge> soilvdb::tools::feed_by_mqtt(ServerState&,
                                                                         const MqttOptions&) {
  throw io::InputError(
      "--mqtt: this build has no MQTT: install libmosquitto-dev, and then build soilvdb again");
}

#else

#include <fmt/format.h>
#include <mosquitto.h>
#include <mqtt_protocol.h>

#include <algorithm>
#include <atomic>
#include <boost/asio/post.hpp>
#include <cerrno>
#include <condition_variable>
#include <deque>
#include <map>
#include <mutex>
#include <string_view>
#include <thread>
#include <utility>

#include "io/file/shared_library.h"
#include "io/file/text.h"
#include "tools/run/text.h"
#include "tools/serve/server_state.h"

namespace soilvdb::tools {
namespace {

constexpr int kAtMostOnce = 0, kAtLeastOnce = 1;  // quality of service
constexpr int kKeepAlive_s = 10, kLoop_ms = 100;
constexpr std::size_t kMostWaiting_bytes = 4 << 20;
constexpr std::size_t kMostAnswer_bytes = 128 << 10;  // which every broker takes
constexpr std::chrono::seconds kTryAgain{2}, kGoodbye{1};
constexpr std::string_view kLinkLost = R"({"link":"lost"})", kLinkEnded = R"({"link":"ended"})";

struct MosquittoLibrary {
  const io::SharedLibrary library{SOILVDB_MQTT_LIBRARY, "libmosquitto", "messages of MQTT"};
  SOILVDB_FUNCTIONS(mosquitto_connack_string, mosquitto_connect, mosquitto_connect_callback_set,
                    mosquitto_destroy, mosquitto_disconnect, mosquitto_int_option,
                    mosquitto_lib_init, mosquitto_log_callback_set, mosquitto_loop,
                    mosquitto_message_callback_set, mosquitto_new, mosquitto_publish,
                    mosquitto_publish_callback_set, mosquitto_strerror, mosquitto_subscribe,
                    mosquitto_subscribe_callback_set, mosquitto_threaded_set,
                    mosquitto_username_pw_set, mosquitto_want_write, mosquitto_will_set);
  MosquittoLibrary() { mosquitto_lib_init(); }
};

struct MqttMessage {
  std::string name;       ///< last level of its topic
  FeedLines lines;        ///< unchecked
  FeedSource::Link link;  ///< not live: a last will or a goodbye, which isn't fed
  std::size_t bytes;
};

/// Shared with its thread, which may still wait for the network at the end.
struct MqttLink {
  const MosquittoLibrary functions;
  const MqttOptions options;
  std::atomic<bool> connected = false, ending = false;
  bool gone = false;  ///< of its thread alone, as the next
  std::string refused = {}, told = {};
  std::mutex mutex;
  std::condition_variable changed;
  // Guarded by `mutex`, with which nothing of the library may be called: it has locks of its own.
  std::function<void()> wake;
  bool ended = false;
  std::deque<MqttMessage> messages = {};
  std::size_t bytes = 0;  ///< of `messages`
  // Last, because it calls until it is destroyed.
  const std::unique_ptr<mosquitto, decltype(&::mosquitto_destroy)> owned{
      functions.mosquitto_new(nullptr, /*clean_session=*/true, this), functions.mosquitto_destroy};
  mosquitto* const client = owned.get();

  MqttLink(const MqttOptions& options_, std::function<void()> wake_)
      : options(options_), wake(std::move(wake_)) {
    if (client == nullptr) throw std::runtime_error("no client of MQTT can be made");
    functions.mosquitto_threaded_set(client, true);
    functions.mosquitto_int_option(client, MOSQ_OPT_TCP_NODELAY, 1);  // answers go out at once
    if (!options.user.empty())
      need(functions.mosquitto_username_pw_set(
          client, options.user.c_str(),
          options.password.empty() ? nullptr : options.password.c_str()));
    if (options.tls) need(functions.mosquitto_int_option(client, MOSQ_OPT_TLS_USE_OS_CERTS, 1));
    need(functions.mosquitto_will_set(client, topic("link").c_str(),
                                      static_cast<int>(kLinkLost.size()), kLinkLost.data(),
                                      kAtLeastOnce, /*retain=*/true));
    functions.mosquitto_connect_callback_set(client, callback<&MqttLink::came>);
    functions.mosquitto_subscribe_callback_set(client, callback<&MqttLink::subscribed>);
    functions.mosquitto_publish_callback_set(client, callback<&MqttLink::published>);
    functions.mosquitto_message_callback_set(client, callback<&MqttLink::take>);
    functions.mosquitto_log_callback_set(client, callback<&MqttLink::log>);
  }

  template <auto member, class... Arguments>
  static void callback(mosquitto*, void* self, Arguments... arguments) noexcept {
    (static_cast<MqttLink*>(self)->*member)(arguments...);
  }
  void need(int code) const {
    if (code != MOSQ_ERR_SUCCESS)
      throw io::InputError(fmt::format("--mqtt: {}", functions.mosquitto_strerror(code)));
  }
  std::string topic(const std::string& below) const { return options.topic + '/' + below; }
  /// Each line once, until another comes.
  void warn(const std::string& what) {
    if (std::exchange(told, what) == what) return;
    say(fmt::format("warning: MQTT broker {} port {} {}", io::printable(options.host), options.port,
                    what));
  }

  /// At most once: a message for which a broker ends the connection must not be sent again.
  void publish(const std::string& below, std::string_view text, bool retain = false) {
    functions.mosquitto_publish(client, nullptr, topic(below).c_str(),
                                static_cast<int>(text.size()), text.data(), kAtMostOnce, retain);
  }

  /// The broker has answered.
  void came(int code) {
    if (connected = code == 0; connected)
      functions.mosquitto_subscribe(client, nullptr, topic("feed/+").c_str(), kAtLeastOnce);
    else
      refused = functions.mosquitto_connack_string(code);
    if (code == CONNACK_REFUSED_BAD_USERNAME_PASSWORD || code == CONNACK_REFUSED_NOT_AUTHORIZED)
      refused += " Are USER@ and the --mqtt-password-file right?";
  }
  void subscribed(int, int, const int* granted) {
    if (*granted <= kAtLeastOnce) return publish("link", R"({"link":"live"})", /*retain=*/true);
    warn("does not let this site read " + io::printable(topic("feed/+")));
  }
  void published(int) {
    const std::lock_guard lock(mutex);
    if (!messages.empty()) wake();
  }
  void log(int level, const char* text) {
    const std::string_view all(text);  // of OpenSSL, whose last part has the reason
    if (level == MOSQ_LOG_ERR) refused = io::printable(std::string(all.substr(all.rfind(':') + 1)));
  }
  void take(const mosquitto_message* message) {
    const std::string_view at(message->topic);
    const std::string below = topic("feed/");
    if (!at.starts_with(below) || message->retain) return;
    std::string text(static_cast<const char*>(message->payload),
                     std::min(std::size_t(message->payloadlen), kMostFeed));  // it is refused then
    const std::size_t more = sizeof(MqttMessage) + at.size() + text.size();
    const std::lock_guard lock(mutex);
    if (bytes + more > kMostWaiting_bytes)
      return warn("brings messages faster than they can be fed; some are lost");
    bytes += more;
    std::string bare = text;  // a link's strings have no blanks
    std::erase_if(bare, [](char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n'; });
    const FeedSource::Link link = bare == kLinkLost    ? FeedSource::Link::kBroken
                                  : bare == kLinkEnded ? FeedSource::Link::kEnded
                                                       : FeedSource::Link::kLive;
    messages.push_back(
        {std::string(at.substr(below.size())), FeedLines(std::move(text)), link, more});
    wake();
  }
  /// None while an answer waits for a slow connection.
  std::optional<MqttMessage> next() {
    if (connected && functions.mosquitto_want_write(client)) return {};
    const std::lock_guard lock(mutex);
    if (messages.empty()) return {};
    MqttMessage first = std::move(messages.front());
    messages.pop_front();
    bytes -= first.bytes;
    return first;
  }

  /// Connects, and reads until the connection ends, again and again.
  void run() {
    while (!ending) {
      const auto begin = ServerState::Clock::now();
      int code =
          functions.mosquitto_connect(client, options.host.c_str(), options.port, kKeepAlive_s);
      while (code == MOSQ_ERR_SUCCESS && !ending) {
        code = functions.mosquitto_loop(client, kLoop_ms, 1);
        if (code == MOSQ_ERR_ERRNO && errno == EPIPE) code = MOSQ_ERR_CONN_LOST;  // while it writes
        if (!functions.mosquitto_want_write(client)) published(0);  // also of what is no message
        if (connected && ServerState::Clock::now() - begin > kTryAgain &&
            std::exchange(gone, false))
          warn("is there again");
      }
      if (ending) break;
      connected = false;
      gone = true;
      if (code == MOSQ_ERR_CONN_LOST)
        refused = "The connection was lost; if it is after long answers, send fewer lines at once";
      warn("is tried again and again: " +
           (refused.empty() ? functions.mosquitto_strerror(code) : std::exchange(refused, {})));
      std::unique_lock lock(mutex);
      changed.wait_for(lock, kTryAgain, [&] { return ending.load(); });
    }
    publish("link", kLinkEnded, /*retain=*/true);
    functions.mosquitto_disconnect(client);
    for (int i = 0; functions.mosquitto_want_write(client) && i < kLoop_ms; ++i)
      if (functions.mosquitto_loop(client, 1, 1) != MOSQ_ERR_SUCCESS) break;
    const std::lock_guard lock(mutex);
    ended = true;
    changed.notify_all();
  }
  /// Waits for the thread for a while.
  void end() {
    std::unique_lock lock(mutex);
    ending = true;
    wake = [] {};
    changed.notify_all();
    changed.wait_for(lock, kGoodbye, [&] { return ended; });
  }
};

class MqttFeeds : public MqttBridge {
 public:
  MqttFeeds(ServerState& state, const MqttOptions& options)
      : state_(state), link_(std::make_shared<MqttLink>(options, [this] { work_soon(); })) {
    std::thread([link = link_] { link->run(); }).detach();
  }
  ~MqttFeeds() override { link_->end(); }

  void work(std::chrono::duration<double> passed) override {
    for (auto& [name, of] : fed_) {
      if (state_.undoing) return;
      of->silent_s += passed.count();
      if (!link_->connected)
        set_link(*of, FeedSource::Link::kBroken);
      else if (of->silent_s >= kLost_s)
        set_link(*of, FeedSource::Link::kSilent);
    }
    work_soon();  // it may have waited for states that were taken back
  }

 private:
  void set_link(FeedSource& of, FeedSource::Link to) const {
    if (of.set_link(to)) state_.tell_soon();
  }

  /// Feeds lines of the message for a short time, and then answers it. @return are more left?
  bool feed(const std::shared_ptr<FeedSource>& from) {
    std::string_view answer =
        R"({"error":"the message is larger than 64 kB; send fewer lines at once"})";
    if (message_->bytes <= kMostFeed) {
      if (message_->lines.feed(state_.feed_of(from))) return true;
      answer = message_->lines.answers();
      if (answer.size() > kMostAnswer_bytes)
        answer =
            R"({"error":"it was fed, but its answers exceed 128 kB; send fewer lines at once"})";
    }
    if (link_->connected) link_->publish("answers/" + message_->name, answer);
    return false;
  }

  void work() {
    if (state_.undoing || state_.ending || (!message_ && !(message_ = link_->next()))) return;
    work_soon();
    const bool lives = message_->link == FeedSource::Link::kLive;
    std::shared_ptr<FeedSource>& from = fed_[message_->name];
    if (!from) from = std::make_shared<FeedSource>();
    from->name = "MQTT topic " + io::printable(link_->topic("feed/" + message_->name));
    from->heard();
    set_link(*from, lives && !link_->connected ? FeedSource::Link::kBroken : message_->link);
    if (lives && feed(from)) return;
    message_.reset();
    std::erase_if(fed_, [](const auto& of) {  // no machine is fed by it any more
      return of.second.use_count() == 1 || of.second->link == FeedSource::Link::kEnded;
    });
  }

  /// From any thread.
  void work_soon() {
    if (asked_.exchange(true)) return;
    boost::asio::post(state_.io, [this] {
      asked_ = false;
      work();
    });
  }

  ServerState& state_;
  const std::shared_ptr<MqttLink> link_;
  std::optional<MqttMessage> message_ = {};  ///< that is being fed
  /// By name: those that a machine is fed by, or `message_` comes from.
  std::map<std::string, std::shared_ptr<FeedSource> > fed_ = {};
  std::atomic<bool> asked_ = false;
};

}  // namespace

std::unique_ptr<MqttBridge> feed_by_mqtt(ServerState& state, const MqttOptions& options) {
  return std::make_unique<MqttFeeds>(state, options);
}

}  // namespace soilvdb::tools

#endif
