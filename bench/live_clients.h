// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A `soilvdb serve` to measure, and those who feed and watch it.
#pragma once

#include <sys/types.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace soilvdb::bench {

using Clock = std::chrono::steady_clock;

/// Runs until it is destroyed or killed.
class LiveServer {
 public:
  LiveServer(const std::filesystem::path& scenario, const std::filesystem::path& out);
  ~LiveServer();
  LiveServer(const LiveServer&) = delete;
  LiveServer& operator=(const LiveServer&) = delete;

  void kill();
  unsigned short port() const { return port_; }
  double rss_bytes() const;
  /// @throw std::runtime_error unless it is answered by 200
  std::string get(const std::string& target) const;

 private:
  pid_t process_ = 0;
  unsigned short port_ = 0;
};

/// A machine's connection.
class Feed {
 public:
  explicit Feed(unsigned short port);
  ~Feed();
  /// Sends a line and waits for its answer.
  std::string ask(const std::string& line);

 private:
  struct Socket;
  std::unique_ptr<Socket> socket_;
};

/// What viewers got.
struct Watched {
  std::uint64_t messages = 0, bytes = 0, blocks = 0, largest_block = 0;
  double seconds_to_whole = -1;  ///< of the last of them
};

/// So many viewers, each with a thread that reads and looks which blocks come when.
class Viewers {
 public:
  using Block = std::array<int, 3>;
  Viewers(unsigned short port, int count);
  ~Viewers();
  Viewers(const Viewers&) = delete;
  Viewers& operator=(const Viewers&) = delete;

  Watched watched() const;
  /// When the first viewer was first sent a block, since this was last asked for.
  std::map<Block, Clock::time_point> take_first_seen();

 private:
  void watch(unsigned short port, bool first);
  std::atomic<bool> stop_ = false;
  mutable std::mutex mutex_;
  Watched watched_;
  std::map<Block, Clock::time_point> seen_;
  std::vector<std::thread> threads_;
};

}  // namespace soilvdb::bench
