// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What a server holds. For its own files alone.
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <set>
#include <string>

#include "soilvdb/background.h"
#include "soilvdb/chunk_range.h"
#include "soilvdb/ground_copy.h"
#include "soilvdb/mesher.h"
#include "tools/serve/ground_view.h"
#include "tools/serve/live_mcap.h"
#include "tools/serve/server.h"
#include "tools/serve/target.h"
#include "tools/serve/terrain_tiles.h"

namespace soilvdb::tools {

class Viewer;
using Bytes = std::shared_ptr<const std::string>;

/// What is answered to a request.
struct Reply {
  unsigned status = 200;
  std::string type = "application/json";
  std::string body = {};
  std::string file = {};      ///< name that it is saved by; empty: it is shown
  bool deflate = false;       ///< the body is a zlib stream
  std::string location = {};  ///< with status 301: where it is
};
Reply refusal(unsigned status, const std::string& why);
inline constexpr const char* kOnlyLookedAt = "this site is only looked at; nothing can be fed";

struct ServerState {
  using Clock = std::chrono::steady_clock;

  ServerState(LiveSite& site, std::unique_ptr<History> history,
              std::shared_ptr<const InitialTerrain> design, const ServerOptions& options);
  ~ServerState() { queries.drop(); }

  /// Answers a GET by calling `done` once, at once or later, on the thread of `io`.
  void answer(const std::string& target, std::function<void(Reply)> done);
  /// Answers a POST.
  Reply post(const std::string& target);
  /// May who sent this see more than the page?
  bool has_token(const std::string& target, const std::string& authorization) const;

  /// Calls `make` on the thread of queries, and `done` here with what comes of it.
  void query(std::function<Reply()> make, std::function<void(Reply)> done);
  /// The same, of the ground at times.
  /// @param time_s nothing: live
  /// @param against_s nothing: before digging
  void with_ground(std::optional<double> time_s, std::optional<double> against_s,
                   std::function<Reply(GroundView&)> use, std::function<void(Reply)> done);
  /// On the thread of queries. @param clocks_set the site's, of when it was asked
  /// @throw std::invalid_argument if there is no such time
  Past past(double time_s, std::uint64_t clocks_set);

  /// Takes up what changed of the live ground.
  void follow_ground();
  /// A block of it as it was taken up; null: make_blocks() makes it, then viewers go on.
  Bytes block(const Coord3& block);
  void tick();
  nlohmann::ordered_json times();
  Bytes description();

  LiveSite& site;
  std::unique_ptr<History> history;  ///< on the thread of queries, once it runs
  std::shared_ptr<const InitialTerrain> design;
  const ServerOptions options;
  std::map<std::string, Reply> page;    ///< by path
  std::optional<TerrainTiles> terrain;  ///< while it runs: what was recorded says where work was

  boost::asio::io_context io{1};
  boost::asio::ip::tcp::acceptor acceptor{io};
  boost::asio::steady_timer timer{io}, player{io};
  std::size_t connections = 0;
  std::set<Viewer*> viewers;
  std::function<bool()> stopped;
  std::function<void()> play;

  /// Messages of blocks of the live ground, by how lately they were asked for.
  struct Cached {
    Bytes message;
    std::list<Coord3>::iterator place;
  };
  std::map<Coord3, Cached, Before> cache;
  std::list<Coord3> cache_order;
  std::size_t cache_bytes = 0;
  void drop(std::map<Coord3, Cached, Before>::iterator cached);
  void keep(const Coord3& block, Bytes message);
  /// Has those made that are asked for.
  void make_blocks();
  std::set<Coord3, Before> wanted;
  bool making = false;
  std::uint64_t ticks = 0;
  std::map<Coord3, std::uint64_t, Before> changed_at;  ///< by tick
  std::unique_ptr<Ground> copy;                        ///< of the ground, for the next
  std::unique_ptr<CachedMesher> mesher;                ///< of `copy`, in jobs alone

  std::uint64_t told_fed = 0;
  Clock::time_point told{}, asked_times{};
  History::Times known_times;                ///< as a query found them
  std::list<std::pair<double, Past>> pasts;  ///< of queries, newest first
  std::uint64_t pasts_clocks_set = 0;        ///< that those are by
  // Last, so that these end first.
  std::unique_ptr<LiveMcap> recording;  ///< null: there is none
  Background queries;                   ///< what hasn't begun in the end isn't answered
  std::unique_ptr<GroundCopy> beside;   ///< keeps `copy`
};

/// Goes on with a connection that asked for /feed or /view.
void accept_connection(ServerState& state, boost::asio::ip::tcp::socket socket);

}  // namespace soilvdb::tools
