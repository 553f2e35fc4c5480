// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The one file with headers of libmosquitto.
#include "tools/serve/mqtt_bridge.h"

#ifndef SOILVDB_MQTT_LIBRARY

#include "soilvdb/io/error.h"

namespace soilvdb::tools {

struct MqttBridge::Feeds {};

MqttBridge::MqttBridge(ServerState&, const MqttOptions&) {
  throw io::InputError(
      "--mqtt: this build has no MQTT: install libmosquitto-dev, and then build soilvdb again");
}
MqttBridge::~MqttBridge() = default;
void MqttBridge::work(std::chrono::duration<double>) {}

}  // namespace soilvdb::tools

#else

#include <fmt/format.h>
#include <mosquitto.h>

#include <algorithm>
#include <atomic>
#include <boost/asio/post.hpp>
#include <cerrno>
#include <condition_variable>
#include <cstdio>
#include <cstring>
#include <deque>
#include <functional>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <string_view>
#include <thread>
#include <utility>

#include "io/file/json.h"
#include "io/file/shared_library.h"
#include "io/file/text.h"
#include "soilvdb/io/error.h"
#include "tools/run/text.h"
#include "tools/serve/live_site.h"
#include "tools/serve/server_state.h"

namespace soilvdb::tools {
namespace {

struct MosquittoLibrary {
  const io::SharedLibrary file{SOILVDB_MQTT_LIBRARY, "libmosquitto", "messages of MQTT"};
#define SOILVDB_OF_MQTT(name) const decltype(&::name) name = file.function<decltype(&::name)>(#name)
  SOILVDB_OF_MQTT(mosquitto_connack_string);
  SOILVDB_OF_MQTT(mosquitto_connect);
  SOILVDB_OF_MQTT(mosquitto_connect_callback_set);
  SOILVDB_OF_MQTT(mosquitto_destroy);
  SOILVDB_OF_MQTT(mosquitto_disconnect);
  SOILVDB_OF_MQTT(mosquitto_int_option);
  SOILVDB_OF_MQTT(mosquitto_lib_init);
  SOILVDB_OF_MQTT(mosquitto_log_callback_set);
  SOILVDB_OF_MQTT(mosquitto_loop);
  SOILVDB_OF_MQTT(mosquitto_message_callback_set);
  SOILVDB_OF_MQTT(mosquitto_new);
  SOILVDB_OF_MQTT(mosquitto_publish);
  SOILVDB_OF_MQTT(mosquitto_publish_callback_set);
  SOILVDB_OF_MQTT(mosquitto_strerror);
  SOILVDB_OF_MQTT(mosquitto_subscribe);
  SOILVDB_OF_MQTT(mosquitto_subscribe_callback_set);
  SOILVDB_OF_MQTT(mosquitto_threaded_set);
  SOILVDB_OF_MQTT(mosquitto_username_pw_set);
  SOILVDB_OF_MQTT(mosquitto_want_write);
  SOILVDB_OF_MQTT(mosquitto_will_set);
#undef SOILVDB_OF_MQTT

  MosquittoLibrary() { mosquitto_lib_init(); }
  static const MosquittoLibrary& get() {
    static const MosquittoLibrary library;
    return library;
  }
};

constexpr int kAtMostOnce = 0, kAtLeastOnce = 1;  // quality of service
constexpr int kKeepAlive_s = 10, kLoop_ms = 100;
constexpr std::size_t kMostWaiting_bytes = 4 << 20;
// Of a message, and of what is said about a line: its answer is below 128 kB, quotes or not.
constexpr int kMostLines = 200;
constexpr std::size_t kLongestReason = 400;
/// Answers that the broker has not acknowledged; more messages wait meanwhile.
constexpr int kMostUnacknowledged = 256, kMostSent = 65535;  // the latter is the protocol's
constexpr std::size_t kMostFeeds = 1000;  // whoever may publish could make up names without end
constexpr std::chrono::seconds kTryAgain{2}, kFirstTry{5}, kGoodbye{1};
constexpr std::string_view kLinkLost = R"({"link":"lost"})", kLinkEnded = R"({"link":"ended"})";

/// In a sentence that goes on.
std::string without_stop(std::string text) {
  if (text.ends_with('.')) text.pop_back();
  return text;
}

/// The answer to a line; a long list in a refusal is cut.
std::string shortened(std::string answer) {
  if (answer.size() <= kLongestReason || !is_refusal(answer)) return answer;
  std::string why = nlohmann::json::parse(answer).at("error");
  if (why.size() <= kLongestReason) return answer;
  std::size_t end = kLongestReason;  // not within a UTF-8 character
  while (end > 0 && (static_cast<unsigned char>(why[end]) & 0xC0) == 0x80) --end;
  why.resize(end);
  return io::to_text(nlohmann::ordered_json{{"error", why + "..."}});
}

struct MqttMessage {
  std::string name;        ///< last level of its topic
  std::string text = {};   ///< unchecked
  std::string fault = {};  ///< not empty: why it can't be taken, and then there is no text
};

/// Shared with its thread, which may still wait for the network at the end.
struct MqttLink {
  const MosquittoLibrary& library = MosquittoLibrary::get();
  const MqttOptions options;
  std::atomic<int> unacknowledged = 0;  ///< messages that were published
  std::mutex mutex;
  std::condition_variable changed;
  // Guarded by `mutex`.
  std::function<void()> wake;
  bool starting = true, connected = false, ending = false, ended = false;
  std::string refused = {}, hint = {}, detail = {}, told = {};
  std::deque<MqttMessage> messages = {};
  std::size_t bytes = 0;
  // Not guarded, and last, because it calls until it is destroyed.
  const std::unique_ptr<mosquitto, decltype(&::mosquitto_destroy)> owned{
      library.mosquitto_new(nullptr, /*clean_session=*/true, this), library.mosquitto_destroy};
  mosquitto* const client = owned.get();

  MqttLink(const MqttOptions& options_, std::function<void()> wake_)
      : options(options_), wake(std::move(wake_)) {
    if (client == nullptr) throw std::runtime_error("no client of MQTT can be made");
    library.mosquitto_threaded_set(client, true);
    const std::string& password = options.password;
    if (!options.user.empty())
      need(library.mosquitto_username_pw_set(client, options.user.c_str(),
                                             password.empty() ? nullptr : password.c_str()),
           "user and password can't be given");
    library.mosquitto_int_option(client, MOSQ_OPT_TCP_NODELAY, 1);  // answers go out at once
    need(library.mosquitto_int_option(client, MOSQ_OPT_SEND_MAXIMUM, kMostSent),
         "answers can't go out at once");
    if (options.tls)
      need(library.mosquitto_int_option(client, MOSQ_OPT_TLS_USE_OS_CERTS, 1),
           "TLS with the certificates of this computer can't be had");
    need(library.mosquitto_will_set(client, topic("link").c_str(),
                                    static_cast<int>(kLinkLost.size()), kLinkLost.data(),
                                    kAtLeastOnce, /*retain=*/true),
         "there can't be a topic " + io::printable(topic("link")));
    library.mosquitto_connect_callback_set(client, [](mosquitto*, void* self, int code) {
      called(self, [&](MqttLink& of) { of.came(code); });
    });
    library.mosquitto_subscribe_callback_set(
        client, [](mosquitto*, void* self, int, int count, const int* granted) {
          called(self, [&](MqttLink& of) { of.subscribed(count > 0 && *granted <= kAtLeastOnce); });
        });
    library.mosquitto_publish_callback_set(client, [](mosquitto*, void* self, int) {
      called(self, [](MqttLink& of) { of.acknowledged(); });
    });
    library.mosquitto_message_callback_set(
        client, [](mosquitto*, void* self, const mosquitto_message* message) {
          called(self, [&](MqttLink& of) { of.take(*message); });
        });
    library.mosquitto_log_callback_set(
        client, [](mosquitto*, void* self, int level, const char* text) {
          if (level != MOSQ_LOG_ERR) return;
          called(self, [&](MqttLink& of) {
            const std::string_view all(text);  // of OpenSSL, whose last part has the reason
            of.detail = io::printable(std::string(all.substr(all.rfind(':') + 1)));
          });
        });
  }

  /// Does the work of a callback. The library is C, which no exception may pass.
  template <class Work>
  static void called(void* self, const Work& work) noexcept {
    try {
      work(*static_cast<MqttLink*>(self));
    } catch (const std::exception& error) {
      std::fputs("soilvdb: warning: a message of MQTT is lost: ", stderr);
      std::fputs(error.what(), stderr);
      std::fputs("\n", stderr);
    }
  }
  std::string reason(int code) const { return without_stop(library.mosquitto_strerror(code)); }
  void need(int code, const std::string& fault) const {
    if (code != MOSQ_ERR_SUCCESS) throw io::InputError(line(fault + ": " + reason(code)));
  }
  std::string topic(const std::string& below) const { return options.topic + '/' + below; }
  void publish(const std::string& below, std::string_view text, bool retain = false,
               int quality = kAtLeastOnce) {
    ++unacknowledged;
    const int code =
        library.mosquitto_publish(client, nullptr, topic(below).c_str(),
                                  static_cast<int>(text.size()), text.data(), quality, retain);
    if (code == MOSQ_ERR_SUCCESS || code == MOSQ_ERR_NO_CONN) return;  // it goes out later
    --unacknowledged;
    const std::lock_guard lock(mutex);
    warn("a message to " + io::printable(topic(below)) + " can't be sent: " + reason(code));
  }
  void acknowledged() {
    --unacknowledged;
    const std::lock_guard lock(mutex);
    if (!messages.empty()) wake();
  }
  std::string line(const std::string& what) const {
    return fmt::format("MQTT broker {} port {}: {}", io::printable(options.host), options.port,
                       what);
  }
  /// Each line once, until another comes.
  void warn(const std::string& what) {
    if (std::exchange(told, what) != what) say("warning: " + line(what));
  }

  /// The broker has answered.
  void came(int code) {
    const int asked = code != 0 ? MOSQ_ERR_SUCCESS
                                : library.mosquitto_subscribe(
                                      client, nullptr, topic("feed/+").c_str(), kAtLeastOnce);
    const std::lock_guard lock(mutex);
    connected = code == 0;
    if (!connected) {
      constexpr int kWrongPassword = 4, kNotAuthorised = 5;
      refused = without_stop(library.mosquitto_connack_string(code));
      hint = code == kWrongPassword || code == kNotAuthorised
                 ? "; give USER@ and a --mqtt-password-file"
                 : "";
      ending |= starting;
    } else if (!told.empty()) {
      warn("it is there again");
    }
    if (asked != MOSQ_ERR_SUCCESS)
      warn(io::printable(topic("feed/+")) + " can't be read: " + reason(asked));
    changed.notify_all();
  }

  void subscribed(bool granted) {
    if (granted) return publish("link", R"({"link":"live"})", /*retain=*/true);
    const std::lock_guard lock(mutex);
    warn("this site may not read " + io::printable(topic("feed/+")));
  }

  void take(const mosquitto_message& message) {
    const std::string_view at(message.topic);
    const std::string below = topic("feed/");
    if (!at.starts_with(below)) return;
    MqttMessage made{std::string(at.substr(below.size()))};
    const auto size = static_cast<std::size_t>(message.payloadlen);
    const std::string_view text(size > 0 ? static_cast<const char*>(message.payload) : "", size);
    const std::lock_guard lock(mutex);
    if (bytes > 2 * kMostWaiting_bytes)
      return warn("messages come faster than they can be refused");
    if (message.retain)
      made.fault = "a retained message is of some time before; publish states without 'retain'";
    else if (size > kMostFeed)
      made.fault = "the message is larger than 64 kB; send fewer lines at once";
    else if (std::count(text.begin(), text.end(), '\n') + !text.ends_with('\n') > kMostLines)
      made.fault =
          fmt::format("the message has more than {} lines; send fewer at once", kMostLines);
    else if (bytes + size > kMostWaiting_bytes)
      made.fault = "the site doesn't keep up; send it again, and wait for answers";
    else
      made.text = text;
    bytes += size_of(made);
    messages.push_back(std::move(made));
    wake();
  }
  static std::size_t size_of(const MqttMessage& message) {
    return sizeof(message) + message.name.size() + message.text.size() + message.fault.size();
  }
  /// None while too many answers wait for the broker.
  std::optional<MqttMessage> next() {
    const std::lock_guard lock(mutex);
    if (messages.empty() || unacknowledged >= kMostUnacknowledged) return {};
    MqttMessage first = std::move(messages.front());
    messages.pop_front();
    bytes -= size_of(first);
    return first;
  }

  /// Connects, and reads until the connection ends. @return why it did
  std::string stay() {
    int code = library.mosquitto_connect(client, options.host.c_str(), options.port, kKeepAlive_s);
    while (code == MOSQ_ERR_SUCCESS) {
      code = library.mosquitto_loop(client, kLoop_ms, 1);
      const std::lock_guard lock(mutex);
      if (ending) break;
    }
    if (code == MOSQ_ERR_ERRNO) return std::strerror(errno);
    return reason(code) + (code == MOSQ_ERR_TLS ? ": " + detail : "");
  }

  void run() {
    for (std::unique_lock lock(mutex); !ending;) {
      lock.unlock();
      const std::string why = stay();
      lock.lock();
      connected = false;
      if (ending) break;
      warn((refused.empty() ? why : refused) + "; it is tried again and again");
      changed.notify_all();
      changed.wait_for(lock, kTryAgain, [&] { return ending; });
      refused.clear();
    }
    publish("link", kLinkEnded, /*retain=*/true, kAtMostOnce);
    library.mosquitto_disconnect(client);
    for (int i = 0; library.mosquitto_want_write(client) && i < kLoop_ms; ++i)
      if (library.mosquitto_loop(client, 1, 1) != MOSQ_ERR_SUCCESS) break;
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

}  // namespace

struct MqttBridge::Feeds {
  struct Fed {
    std::shared_ptr<FeedSource> source = std::make_shared<FeedSource>();
    double silent_s = 0;
  };

  ServerState& state;
  std::shared_ptr<MqttLink> link;
  std::optional<MqttMessage> message = {};  ///< that is being fed
  FeedLines lines = {};                     ///< of it
  std::map<std::string, Fed> fed = {};      ///< by name
  std::atomic<bool> asked = false;

  void set_link(Fed& of, FeedSource::Link to) const {
    if (std::exchange(of.source->link, to) != to) state.tell_soon();
  }

  /// A lost name that no machine belongs to. @return is there one?
  bool forget_one() {
    const auto found = std::find_if(fed.begin(), fed.end(), [](const auto& entry) {
      const auto& source = entry.second.source;
      return source->link == FeedSource::Link::kLost && source.use_count() == 1;
    });
    if (found == fed.end()) return false;
    fed.erase(found);
    return true;
  }

  /// Null: there are too many.
  Fed* heard(const std::string& name) {
    auto found = fed.find(name);
    if (found == fed.end()) {
      if (fed.size() >= kMostFeeds && !forget_one()) return nullptr;
      found = fed.emplace(name, Fed()).first;
      found->second.source->name = "MQTT topic " + io::printable(link->topic("feed/" + name));
    }
    found->second.silent_s = 0;
    set_link(found->second, FeedSource::Link::kLive);
    return &found->second;
  }

  /// Takes a last will, or a goodbye.
  bool takes_link() {
    const auto json = nlohmann::json::parse(message->text, nullptr, /*allow_exceptions=*/false);
    const bool lost = json == nlohmann::json::parse(kLinkLost);
    if (!lost && !(json == nlohmann::json::parse(kLinkEnded)))
      return false;  // not !=, if discarded
    if (const auto found = fed.find(message->name); found != fed.end()) {
      set_link(found->second, lost ? FeedSource::Link::kLost : FeedSource::Link::kEnded);
      if (!lost) fed.erase(found);
    }
    return true;
  }

  void refuse(const std::string& why) {
    link->publish("answers/" + message->name, io::to_text(nlohmann::ordered_json{{"error", why}}));
    message.reset();
  }

  void work() {
    if (state.undoing || state.ending) return;
    if (!message) {
      if (!(message = link->next())) return;
      lines = FeedLines(message->text);
      if (!message->fault.empty()) {
        refuse(message->fault);
      } else if (takes_link()) {
        message.reset();
      }
    }
    if (message) {
      if (Fed* from = heard(message->name); from == nullptr) {
        refuse("too many names feed this site; end some of them");
      } else if (!lines.feed([feed = state.feed_of(from->source)](std::string_view line) {
                   return shortened(feed(line));
                 })) {
        link->publish("answers/" + message->name, lines.answers());
        message.reset();
      }
    }
    work_soon();
  }

  /// From any thread.
  void work_soon() {
    if (asked.exchange(true)) return;
    boost::asio::post(state.io, [this] {
      asked = false;
      work();
    });
  }

  void listen(double passed_s) {
    if (state.undoing) return;
    bool connected = false;
    {
      const std::lock_guard lock(link->mutex);
      connected = link->connected;
    }
    for (auto& [name, of] : fed) {
      of.silent_s += passed_s;
      if (!connected || of.silent_s >= kLost_s) set_link(of, FeedSource::Link::kLost);
    }
  }
};

MqttBridge::MqttBridge(ServerState& state, const MqttOptions& options)
    : feeds_(new Feeds{state, nullptr}) {
  feeds_->link =
      std::make_shared<MqttLink>(options, [feeds = feeds_.get()] { feeds->work_soon(); });
  MqttLink& link = *feeds_->link;
  std::thread([shared = feeds_->link] { shared->run(); }).detach();
  std::unique_lock lock(link.mutex);
  link.changed.wait_for(lock, kFirstTry,
                        [&] { return link.connected || link.ending || !link.told.empty(); });
  link.starting = false;
  if (!link.ending) return;
  link.wake = [] {};
  throw io::InputError(link.line(link.refused + link.hint));
}

MqttBridge::~MqttBridge() { feeds_->link->end(); }

void MqttBridge::work(std::chrono::duration<double> passed) {
  feeds_->listen(passed.count());
  feeds_->work_soon();  // it may have waited for states that were taken back
}

}  // namespace soilvdb::tools

#endif
