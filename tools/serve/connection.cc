// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// HTTP connections, until they become feeds or views.
#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/ip/address.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <list>
#include <memory>
#include <string>
#include <string_view>
#include <utility>

#include "io/file/text.h"
#include "tools/serve/feeder.h"
#include "tools/serve/scanner.h"
#include "tools/serve/server_state.h"
#include "tools/serve/survey_post.h"
#include "tools/serve/viewer.h"

namespace soilvdb::tools {
namespace {

namespace net = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using net::ip::tcp;
using Socket = Viewer::Socket;
using Request = http::request<http::string_body>;

constexpr std::chrono::seconds kFirstRequestTime{5}, kRequestTime{20}, kAnswerTime{120};
constexpr std::chrono::seconds kHandshakeTime{5}, kSilence{60}, kGoodbyeTime{2};
constexpr std::uint32_t kMostHeader = 8 << 10;
/// Of a survey's bytes, on average: others wait for its end.
constexpr std::uint64_t kLeastPerSecond = 32 << 10;
constexpr std::size_t kMostView = 4 << 10;

std::string text_of(boost::string_view view) { return {view.data(), view.size()}; }

/// Host and port of "Host" or "[::1]:80", the host in lower case.
struct Authority {
  explicit Authority(std::string_view text) {
    const std::size_t colon = text.rfind(':');
    const bool has_port = colon != std::string_view::npos && !text.ends_with(']');
    if (has_port) port = text.substr(colon + 1);
    host = io::lower_case(std::string(text.substr(0, has_port ? colon : text.size())));
  }
  std::string host, port;  ///< empty: the scheme's default port
};

/// Does a page's `origin` match the host of a request? Behind a proxy the scheme is unknown, so a
/// missing port matches the default ports of http and https.
bool is_from(std::string_view origin, const Authority& host) {
  for (const auto& [scheme, own_port] :
       {std::pair("http://", "80"), std::pair("https://", "443")}) {
    if (!origin.starts_with(scheme)) continue;
    origin.remove_prefix(std::string_view(scheme).size());
    const Authority page(origin);
    const auto port_of = [own = own_port](const Authority& of) {
      return of.port.empty() ? own : of.port;
    };
    return page.host == host.host && port_of(page) == port_of(host);
  }
  return false;
}

/// Reads requests one after another until one asks for a feed or a view.
class Connection : public std::enable_shared_from_this<Connection> {
 public:
  Connection(ServerState& state, tcp::socket socket)
      : state_(state), stream_(std::move(socket)), slow_(state.io) {
    ++state_.connections;
  }

  void read() {
    wait();
    parser_.emplace();
    parser_->header_limit(kMostHeader);
    file_parser_.reset();
    file_begun_.reset();
    file_bytes_ = 0;
    parser_->body_limit(kMostSurveyBytes);
    stream_.expires_after(std::exchange(asked_, true) ? kRequestTime : kFirstRequestTime);
    http::async_read_header(
        stream_, in_, *parser_,
        [self = shared_from_this()](beast::error_code error, std::size_t) { self->take(error); });
  }

 private:
  /// Others may take its place from here on, until one of its requests is allowed.
  void wait() {
    if (!waits_)
      waits_ = state_.waiting.insert(state_.waiting.end(), [this] {
        wait_no_more();
        beast::error_code ignored;
        stream_.socket().close(ignored);
      });
  }
  void wait_no_more() {
    if (waits_) state_.waiting.erase(*std::exchange(waits_, std::nullopt));
  }

  void take(beast::error_code error) {
    if (error) return refuse(error);
    const Request& request = parser_->get();
    // A body is read only from those who may post.
    close_after_ = !request.keep_alive() || !parser_->is_done();
    head_ = request.method() == http::verb::head;
    std::string target = text_of(request.target());
    const std::string& base = state_.options.base_path;
    if (!base.empty() && target.starts_with(base + '/')) target.erase(0, base.size());
    const bool upgrade = websocket::is_upgrade(request);
    const bool post = request.method() == http::verb::post;
    const std::string path = target.substr(0, target.find('?'));
    const auto file = state_.page.find(path);
    const bool is_page = file != state_.page.end() && !upgrade && !post;
    if (const std::string why = foreign(request, is_page); !why.empty())
      return send(refusal(403, why));
    if (!upgrade && request.method() != http::verb::get && !head_ && !post)
      return send(refusal(405, "only GET and POST are answered"));
    if (!base.empty() && path == base)
      return send({301, "text/plain", "", {}, false, base + '/' + target.substr(path.size())});
    if (is_page) return send(page_reply(file->second, request));
    const Role role = state_.role_of(target, text_of(request[http::field::authorization]));
    if (role == Role::kNobody)
      return send(refusal(401,
                          "the token is missing or wrong; open the address that soilvdb serve "
                          "printed"));
    wait_no_more();
    if (!post && !parser_->is_done()) return send(refusal(400, "only a POST may have a body"));
    const bool is_stream = path == "/feed" || path == "/scan" || path == "/view";
    if (is_stream && !upgrade && !post)
      return send(refusal(400, path + " is a WebSocket; open it by ws:// or wss://"));
    if (upgrade) {
      if (path == "/view") return go_over(path, role);
      if (!is_stream) return send(refusal(404, "streams are /feed, /scan and /view"));
      if (role != Role::kFeeder) return send(refusal(403, kOnlyViewer));
      return go_over(path, role);
    }
    if (post) {
      if (role != Role::kFeeder) return send(refusal(403, kOnlyViewer));
      if (!state_.options.takes_feeds) return send(refusal(403, kOnlyLookedAt));
      if (path == "/survey") return receive_survey(target);
      if (parser_->content_length().value_or(0) > kMostFeed) return refuse(http::error::body_limit);
      parser_->body_limit(kMostFeed);
      return expect_body([self = shared_from_this(), target] { self->read_body(target); });
    }
    if (const auto shown = state_.shown.find(path); shown != state_.shown.end())
      return send(page_reply(shown->second, request));
    stream_.expires_never();
    state_.answer(target, client_of(request),
                  [self = shared_from_this()](Reply reply) { self->send(std::move(reply)); });
  }

  /// A file of the page, or word that what the browser has is still that.
  static Reply page_reply(const PageFile& file, const Request& request) {
    const std::string& tag = file.plain.tag;
    if (!tag.empty() && text_of(request[http::field::if_none_match]).find(tag) != std::string::npos)
      return {304, file.plain.type, {}, {}, false, {}, tag};
    const bool packs =
        text_of(request[http::field::accept_encoding]).find("deflate") != std::string::npos;
    return packs && !file.packed.body.empty() ? file.packed : file.plain;
  }

  void refuse(beast::error_code error) {
    const bool ours = error.category() == http::make_error_code(http::error::bad_method).category();
    if (!ours || error == http::error::end_of_stream) return end();
    close_after_ = true;
    if (error == http::error::body_limit)
      return send(refusal(
          413, fmt::format("the body is larger than {} kB; send it in parts",
                           (file_parser_ ? kMostSurveyBytes : std::uint64_t{kMostFeed}) >> 10)));
    send(refusal(400, "the request can't be answered: " + error.message()));
  }

  /// Some clients wait until they are asked for the body.
  void expect_body(std::function<void()> read) {
    const bool waits =
        !parser_->is_done() && beast::iequals(parser_->get()[http::field::expect], "100-continue");
    if (!waits) return read();
    auto go_on = std::make_shared<http::response<http::empty_body>>(http::status::continue_, 11);
    http::async_write(stream_, *go_on,
                      [self = shared_from_this(), go_on, read = std::move(read)](
                          beast::error_code error, std::size_t) {
                        if (error) return self->end();
                        read();
                      });
  }

  void receive_survey(const std::string& target) {
    std::shared_ptr<SurveyPost> survey;
    try {
      survey = std::make_shared<SurveyPost>(state_, target, name_of(stream_.socket()));
    } catch (const std::invalid_argument& e) {
      return send(refusal(400, e.what()));
    } catch (const std::exception& e) {
      return send(refusal(503, e.what()));
    }
    expect_body([self = shared_from_this(), survey] {
      self->file_parser_.emplace(std::move(*self->parser_));
      beast::error_code error;
      self->file_parser_->get().body().open(survey->file().c_str(), beast::file_mode::write, error);
      if (error) return self->send(refusal(500, "the survey can't be kept: " + error.message()));
      self->read_file(survey);
    });
  }

  /// Ends reading at a time: `is_slow_`.
  void read_until(ServerState::Clock::time_point time) {
    stream_.expires_never();  // it would close the connection without an answer
    is_slow_ = false;
    slow_.expires_at(time);
    slow_.async_wait([self = shared_from_this()](beast::error_code error) {
      if (error || self->slow_.expiry() > ServerState::Clock::now()) return;  // bytes came as well
      self->is_slow_ = true;
      self->stream_.cancel();
    });
  }
  void end_wait() { slow_.expires_at(ServerState::Clock::time_point::max()); }

  /// While enough comes: a sender that stops, or trickles, must not keep others out.
  void read_file(const std::shared_ptr<SurveyPost>& survey) {
    if (file_parser_->is_done()) {
      file_parser_->get().body().close();
      close_after_ = !file_parser_->get().keep_alive();
      return survey->take(
          [self = shared_from_this()](Reply reply) { self->send(std::move(reply)); });
    }
    const auto now = ServerState::Clock::now();
    if (!file_begun_) file_begun_ = now;
    const std::chrono::seconds of_bytes(file_bytes_ / kLeastPerSecond);
    read_until(std::min(now, *file_begun_ + of_bytes) + kRequestTime);
    http::async_read_some(
        stream_, in_, *file_parser_,
        [self = shared_from_this(), survey](beast::error_code error, std::size_t bytes) {
          self->end_wait();
          self->file_bytes_ += bytes;
          if (error && self->is_slow_)
            return self->send(refusal(
                408, fmt::format("the survey came too slowly, {} kB in {:.0f} s; send {} kB a "
                                 "second or more, without pauses of {} s",
                                 self->file_bytes_ >> 10,
                                 std::chrono::duration<double>(ServerState::Clock::now() -
                                                               *self->file_begun_)
                                     .count(),
                                 kLeastPerSecond >> 10, kRequestTime.count())));
          if (self->state_.ending) return self->send(refusal(503, kEnded));
          if (error == beast::errc::no_space_on_device)
            return self->send(refusal(507, "there is no room for the survey on the server's disk"));
          if (error) return self->refuse(error);
          self->read_file(survey);
        });
  }

  void read_body(const std::string& target) {
    read_until(ServerState::Clock::now() + kRequestTime);
    http::async_read(stream_, in_, *parser_,
                     [self = shared_from_this(), target](beast::error_code error, std::size_t) {
                       self->end_wait();
                       if (error && self->is_slow_)
                         return self->send(refusal(
                             408, fmt::format("the body came too slowly; send it within {} s",
                                              kRequestTime.count())));
                       if (error) return self->refuse(error);
                       self->close_after_ = !self->parser_->get().keep_alive();
                       self->state_.post(target, std::move(self->parser_->get().body()),
                                         name_of(self->stream_.socket()),
                                         [self](Reply reply) { self->send(std::move(reply)); });
                     });
  }

  /// Why a request comes from a foreign page; empty for a page of this server, or no page. Foreign
  /// pages could otherwise reach a server on the loopback address.
  /// @param is_page the request is for the page itself, which can then explain other refusals
  std::string foreign(const Request& request, bool is_page) const {
    const std::string said = text_of(request[http::field::host]);
    const Authority host(said);
    const bool open = !state_.has_tokens();
    const auto origin = request.find(http::field::origin);
    const std::string from = origin == request.end() ? "" : text_of(origin->value());
    if (origin != request.end() && !is_page && !is_from(from, host))
      return fmt::format(
          "pages from elsewhere may not ask: the page is from {}, and the request's Host is {}. If "
          "that is a proxy's doing, have the proxy pass the Host header on: proxy_set_header Host "
          "$http_host{}",
          io::printable(from), io::printable(said),
          open ? "; and give --token-file to soilvdb serve" : "");
    if (open && host.host != "localhost" && host.host != "127.0.0.1" && host.host != "[::1]" &&
        host.host != state_.options.listen)
      return fmt::format(
          "the host isn't this machine: the request's Host is {}. If that is a proxy's name, give "
          "--token-file to soilvdb serve",
          io::printable(said));
    return "";
  }

  /// The address from which a request comes; behind a proxy of this machine, that which it names.
  std::string client_of(const Request& request) const {
    beast::error_code none;
    const net::ip::address from = stream_.socket().remote_endpoint(none).address();
    if (!from.is_loopback()) return from.to_string();
    const std::string said = text_of(request["X-Forwarded-For"]);
    return said.substr(said.rfind(',') + 1);
  }

  void send(Reply reply) {
    auto response = std::make_shared<http::response<http::string_body>>();
    response->version(11);
    response->result(reply.status);
    response->set(http::field::server, "soilvdb");
    response->set(http::field::content_type, reply.type);
    response->set(http::field::cache_control, reply.tag.empty() ? "no-store" : "no-cache");
    if (!reply.tag.empty()) {
      response->set(http::field::etag, reply.tag);
      response->set(http::field::vary, "Accept-Encoding");
    }
    response->set("X-Content-Type-Options", "nosniff");
    response->set("Referrer-Policy", "no-referrer");
    response->set("Content-Security-Policy",
                  "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' blob: "
                  "data:; connect-src 'self' ws: wss:; frame-ancestors 'none'");
    if (reply.deflate) response->set(http::field::content_encoding, "deflate");
    if (!reply.file.empty())
      response->set(http::field::content_disposition,
                    "attachment; filename=\"" + reply.file + "\"");
    if (!reply.location.empty()) response->set(http::field::location, reply.location);
    if (reply.status == 401) response->set(http::field::www_authenticate, "Bearer");
    response->keep_alive(!close_after_);
    response->body() = std::move(reply.body);
    response->prepare_payload();
    if (head_) response->body().clear();
    stream_.expires_after(kAnswerTime);
    ++state_.replying;
    http::async_write(stream_, *response,
                      [self = shared_from_this(), response](beast::error_code error, std::size_t) {
                        --self->state_.replying;
                        if (error || self->close_after_) return self->end();
                        self->read();
                      });
  }

  void go_over(const std::string& path, Role role) {
    const bool feeds = path != "/view";
    const bool scans = path == "/scan";  // a Scanner itself drops what is too long
    const std::string client = client_of(parser_->get());
    auto socket = std::make_shared<Socket>(std::move(stream_));
    beast::get_lowest_layer(*socket).expires_never();
    auto timeout = websocket::stream_base::timeout::suggested(beast::role_type::server);
    timeout.handshake_timeout = kHandshakeTime;
    timeout.idle_timeout =
        feeds ? websocket::stream_base::none() : kSilence;  // a Feeder has its own
    timeout.keep_alive_pings = !feeds;
    socket->set_option(timeout);
    socket->read_message_max(scans ? 0 : feeds ? kMostFeed : kMostView);
    socket->auto_fragment(false);
    auto request = std::make_shared<Request>(parser_->release());
    socket->async_accept(*request, [self = shared_from_this(), socket, request, feeds, scans,
                                    client, role](beast::error_code error) {
      self->end_quietly();
      if (error) return;
      if (scans)
        std::make_shared<Scanner>(self->state_, std::move(*socket))->start();
      else if (feeds)
        std::make_shared<Feeder>(self->state_, std::move(*socket))->start();
      else
        std::make_shared<Viewer>(self->state_, std::move(*socket), client, role)->start();
    });
  }

  void end() {
    beast::error_code ignored;
    if (file_parser_ ? file_parser_->is_done() : !parser_ || parser_->is_done()) {
      stream_.socket().shutdown(tcp::socket::shutdown_both, ignored);
      return end_quietly();
    }
    // If data arrived after the end, the client would lose its answer.
    stream_.socket().shutdown(tcp::socket::shutdown_send, ignored);
    stream_.expires_after(kGoodbyeTime);
    drain();
  }
  void drain() {
    in_.clear();
    stream_.async_read_some(in_.prepare(kMostFeed),
                            [self = shared_from_this()](beast::error_code error, std::size_t) {
                              if (error) return self->end_quietly();
                              self->drain();
                            });
  }
  void end_quietly() {
    wait_no_more();
    --state_.connections;
  }

  ServerState& state_;
  beast::tcp_stream stream_;
  beast::flat_buffer in_;
  std::optional<http::request_parser<http::string_body>> parser_;
  std::optional<http::request_parser<http::file_body>> file_parser_;  ///< takes over for a survey
  std::optional<std::list<std::function<void()>>::iterator> waits_;
  bool asked_ = false, head_ = false, close_after_ = false;
  net::steady_timer slow_;  ///< of a body
  std::optional<ServerState::Clock::time_point> file_begun_;
  std::uint64_t file_bytes_ = 0;
  bool is_slow_ = false;
};

}  // namespace

void accept_connection(ServerState& state, tcp::socket socket) {
  beast::error_code ignored;
  socket.set_option(tcp::no_delay(true), ignored);
  std::make_shared<Connection>(state, std::move(socket))->read();
}

}  // namespace soilvdb::tools
