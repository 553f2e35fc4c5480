// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "bench/live_clients.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <cstdlib>
#include <fstream>
#include <stdexcept>

namespace soilvdb::bench {
namespace {

namespace net = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using tcp = net::ip::tcp;
using WebSocket = beast::websocket::stream<tcp::socket>;

tcp::endpoint local(unsigned short port) { return {net::ip::address_v4::loopback(), port}; }

void open(WebSocket& socket, unsigned short port, const std::string& path) {
  socket.next_layer().connect(local(port));
  socket.next_layer().set_option(tcp::no_delay(true));
  socket.handshake("127.0.0.1:" + std::to_string(port), path);
}

/// The first numbers of a block.
std::array<int, 3> block_of(const beast::flat_buffer& message) {
  std::array<int, 3> block{};
  z_stream stream{};
  stream.next_in = static_cast<Bytef*>(const_cast<void*>(message.data().data()));
  stream.avail_in = static_cast<uInt>(message.size());
  stream.next_out = reinterpret_cast<Bytef*>(block.data());
  stream.avail_out = sizeof(block);
  inflateInit(&stream);
  inflate(&stream, Z_SYNC_FLUSH);
  inflateEnd(&stream);
  return block;
}

}  // namespace

LiveServer::LiveServer(const std::filesystem::path& scenario, const std::filesystem::path& out) {
  int ends[2];
  if (pipe(ends) != 0) throw std::runtime_error("no pipe");
  process_ = fork();
  if (process_ == 0) {
    dup2(ends[1], STDOUT_FILENO);
    const int null = ::open("/dev/null", O_WRONLY);
    dup2(null, STDERR_FILENO);
    close(ends[0]);
    execl(SOILVDB_PROGRAM, SOILVDB_PROGRAM, "serve", scenario.c_str(), "--port", "0", "--out",
          out.c_str(), static_cast<char*>(nullptr));
    _exit(127);
  }
  close(ends[1]);
  std::string line;
  for (char c = 0; read(ends[0], &c, 1) == 1 && c != '\n';) line += c;
  close(ends[0]);
  const std::size_t colon = line.rfind(':');
  if (colon == std::string::npos) throw std::runtime_error("soilvdb serve doesn't begin");
  port_ = static_cast<unsigned short>(std::atoi(line.c_str() + colon + 1));
}

LiveServer::~LiveServer() {
  if (process_ == 0) return;
  ::kill(process_, SIGTERM);
  waitpid(process_, nullptr, 0);
}

void LiveServer::kill() {
  ::kill(process_, SIGKILL);
  waitpid(process_, nullptr, 0);
  process_ = 0;
}

double LiveServer::rss_bytes() const {
  std::ifstream in(fmt::format("/proc/{}/statm", process_));
  double all = 0, resident = 0;
  in >> all >> resident;
  return resident * static_cast<double>(sysconf(_SC_PAGESIZE));
}

std::string LiveServer::get(const std::string& target) const {
  net::io_context io;
  tcp::socket socket(io);
  socket.connect(local(port_));
  http::request<http::empty_body> request(http::verb::get, target, 11);
  request.set(http::field::host, "127.0.0.1");
  http::write(socket, request);
  beast::flat_buffer buffer;
  http::response_parser<http::string_body> parser;
  parser.body_limit(std::uint64_t{1} << 32);
  http::read(socket, buffer, parser);
  if (parser.get().result_int() != 200)
    throw std::runtime_error(target + ": " + parser.get().body());
  return parser.get().body();
}

struct Feed::Socket {
  net::io_context io;
  WebSocket stream{io};
  beast::flat_buffer in;
};

Feed::Feed(unsigned short port) : socket_(std::make_unique<Socket>()) {
  open(socket_->stream, port, "/feed");
  socket_->stream.text(true);
}

Feed::~Feed() = default;

std::string Feed::ask(const std::string& line) {
  socket_->stream.write(net::buffer(line));
  socket_->in.clear();
  socket_->stream.read(socket_->in);
  return beast::buffers_to_string(socket_->in.data());
}

Viewers::Viewers(unsigned short port, int count) {
  for (int i = 0; i < count; ++i)
    threads_.emplace_back([this, port, first = i == 0] { watch(port, first); });
}

Viewers::~Viewers() {
  stop_ = true;
  for (std::thread& thread : threads_) thread.join();
}

Watched Viewers::watched() const {
  const std::lock_guard lock(mutex_);
  return watched_;
}

std::map<Viewers::Block, Clock::time_point> Viewers::take_first_seen() {
  const std::lock_guard lock(mutex_);
  return std::exchange(seen_, {});
}

void Viewers::watch(unsigned short port, bool first) try {
  net::io_context io;
  WebSocket socket(io);
  const Clock::time_point begin = Clock::now();
  open(socket, port, "/view");
  beast::flat_buffer in;
  while (!stop_) {
    // There is a state a second at least.
    in.clear();
    socket.read(in);
    const Clock::time_point now = Clock::now();
    const std::lock_guard lock(mutex_);
    ++watched_.messages;
    watched_.bytes += in.size();
    if (socket.got_binary()) {
      ++watched_.blocks;
      watched_.largest_block = std::max<std::uint64_t>(watched_.largest_block, in.size());
      if (first) seen_.try_emplace(block_of(in), now);
    } else if (beast::buffers_to_string(in.data()).find("\"whole\"") != std::string::npos) {
      watched_.seconds_to_whole =
          std::max(watched_.seconds_to_whole, std::chrono::duration<double>(now - begin).count());
    }
  }
} catch (const std::exception&) {  // the server went
}

}  // namespace soilvdb::bench
