// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The state of a server. Private to the server's files.
#pragma once

#include <atomic>
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
#include <vector>

#include "soilvdb/chunk_range.h"
#include "soilvdb/ground_copy.h"
#include "soilvdb/mesher.h"
#include "tools/serve/feed_lines.h"
#include "tools/serve/ground_query.h"
#include "tools/serve/live_forces.h"
#include "tools/serve/live_heights.h"
#include "tools/serve/live_mcap.h"
#include "tools/serve/measures.h"
#include "tools/serve/mqtt_bridge.h"
#include "tools/serve/progress.h"
#include "tools/serve/query_lane.h"
#include "tools/serve/ros_bridge.h"
#include "tools/serve/server.h"
#include "tools/serve/target.h"
#include "tools/serve/terrain_tiles.h"

namespace soilvdb::tools {

class Feeder;
class Viewer;
using Bytes = std::shared_ptr<const std::string>;

/// The answer to a request.
struct Reply {
  unsigned status = 200;
  std::string type = "application/json";
  std::string body = {};
  std::string file = {};      ///< name for saving; empty: the browser shows it
  bool deflate = false;       ///< the body is a zlib stream
  std::string location = {};  ///< with status 301: the new address
  std::string tag = {};  ///< a browser may keep this reply, and asks with the tag for a newer one
};
Reply refusal(unsigned status, const std::string& why);
inline constexpr const char* kEnded = "the site has ended";
inline constexpr const char* kOnlyLookedAt = "this site can only be viewed; nothing can be fed";

/// A file that browsers keep, as it is and compressed, unless that is empty.
struct PageFile {
  Reply plain, packed;
};

/// Each may do what the one before may.
enum class Role { kNobody, kViewer, kFeeder };
inline constexpr const char* kOnlyViewer =
    "whoever sent this may look, but not feed; send the token of feeds";

struct ServerState {
  using Clock = std::chrono::steady_clock;

  ServerState(LiveSite& site, std::unique_ptr<History> history,
              std::shared_ptr<const InitialTerrain> design, const ServerOptions& options);
  ~ServerState() { drop_queries(); }

  /// Answers a GET: calls `done` once, now or later, on the thread of `io`.
  /// @param client whoever sends it, with whom others share the threads of queries
  void answer(const std::string& target, const std::string& client,
              std::function<void(Reply)> done);
  /// Answers a POST of somebody who may feed: calls `done` once, now or later.
  /// @param from whose feed it is
  void post(const std::string& target, std::string body, const std::string& from,
            std::function<void(Reply)> done);
  /// The values of measures, one after another, so that others' queries come in between.
  struct MeasuresCsv {
    std::vector<Measure> measures;
    std::optional<double> time_s, against_s;
    std::string client, csv = measures_csv_head();
    std::size_t next = 0;
  };
  void measures_csv(std::shared_ptr<MeasuresCsv> table, std::function<void(Reply)> done);
  /// Finds the progress of areas, and then makes a reply.
  void with_progress(std::shared_ptr<ProgressQuery> progress, const std::string& client,
                     std::function<Reply()> make, std::function<void(Reply)> done);
  /// Changes measures, and tells viewers.
  nlohmann::ordered_json change_measures(const std::string& change);
  /// The message about measures. @param role of its viewer
  Bytes measures_message(Role role) const;
  /// Changes the machines or hoppers, and tells viewers.
  nlohmann::ordered_json change_list(const std::string& list, const std::string& change);
  /// Feeds lines of a source.
  FeedLines::Feed feed_of(std::shared_ptr<const FeedSource> source);
  /// Tells what undo() would do, and changes nothing.
  void ask_undo(std::size_t machine, double time_s, const std::string& client,
                std::function<void(Reply)> done);
  /// Takes back a machine's states after a time. Feeds wait meanwhile, all else goes on.
  void undo(std::size_t machine, double time_s, std::function<void(Reply)> done);
  /// Is one at work? Then `go_on` is called at its end.
  bool waits_for_undo(std::function<void()> go_on);
  void feed_post(std::shared_ptr<FeedLines> lines, std::shared_ptr<FeedSource> source,
                 std::function<void(Reply)> done);
  /// The role of a request's sender.
  Role role_of(const std::string& target, const std::string& authorization) const;
  /// Must anybody send a token?
  bool has_tokens() const { return !options.token.empty() || !options.view_token.empty(); }

  /// Calls `make` on a thread of queries, and `done` here with its result.
  void query(QueryLane& lane, const std::string& client, std::function<Reply()> make,
             std::function<void(Reply)> done);
  void drop_queries();
  /// As query(), with the ground at given times.
  /// @param time_s empty: live
  /// @param against_s empty: before digging
  void with_ground(std::optional<double> time_s, std::optional<double> against_s,
                   const std::string& client, std::function<Reply(GroundQuery&)> use,
                   std::function<void(Reply)> done);
  /// On the thread of `other_times`. @param changes the site's number of changes of the past at the
  /// request
  /// @throw std::invalid_argument if this time is not recorded
  Past past(double time_s, std::uint64_t changes);

  /// Registers changes of the live ground.
  void follow_ground();
  /// A block's message as last registered; null: make_blocks() makes it and then resumes viewers.
  Bytes block(const Coord3& block);
  void tick();
  /// The next tick tells the state, and the forces to viewers that want them.
  void tell_soon() { told = {}; }
  void tell_forces();
  /// Says goodbye to all clients, and stops when they are gone or a while has passed.
  void end();
  /// Makes room for a new connection if there can be any.
  bool make_room();
  nlohmann::ordered_json times();
  /// The message about the machines that viewers receive repeatedly.
  Bytes state_message();
  Bytes description();

  LiveSite& site;
  std::unique_ptr<History> history;  ///< used by `other_times` during run()
  std::shared_ptr<const InitialTerrain> design;
  const ServerOptions options;
  /// By path: the page, and for whoever may look, its drape and lines.
  std::map<std::string, PageFile> page, shown;
  std::optional<TerrainTiles> terrain;  ///< during run(): the recording determines where work was

  boost::asio::io_context io{1};
  boost::asio::ip::tcp::acceptor acceptor{io};
  boost::asio::steady_timer timer{io}, player{io};
  std::size_t connections = 0;
  /// Drop connections whose requests are not allowed yet, the one that waits longest first.
  std::list<std::function<void()>> waiting;
  std::set<Feeder*> feeders;
  std::set<Viewer*> viewers;
  std::atomic<bool> ending = false;
  bool undoing = false;
  bool surveying = false;                            ///< a survey is being received or taken
  std::size_t replying = 0;                          ///< replies that are being sent
  std::vector<std::function<void()>> waiting_feeds;  ///< until states are taken back
  /// Of Server::feed().
  std::shared_ptr<FeedSource> input = std::make_shared<FeedSource>();
  std::function<bool()> stopped;
  std::function<void()> play;

  /// Messages of live blocks, in the order of their last use.
  struct Cached {
    Bytes message;
    std::list<Coord3>::iterator place;
  };
  std::map<Coord3, Cached, Before> cache;
  std::list<Coord3> cache_order;
  std::size_t cache_bytes = 0;
  void drop(std::map<Coord3, Cached, Before>::iterator cached);
  void keep(const Coord3& block, Bytes message);
  /// Starts jobs for the wanted blocks.
  void make_blocks();
  std::set<Coord3, Before> wanted;
  bool making = false;
  std::uint64_t ticks = 0;
  std::map<Coord3, std::uint64_t, Before> changed_at;  ///< by tick
  std::unique_ptr<Ground> copy;                        ///< of the ground, for make_blocks()
  std::unique_ptr<CachedMesher> mesher;                ///< of `copy`, used by jobs only
  LiveForces forces;

  std::uint64_t told_fed = 0;
  Clock::time_point told{}, asked_times{}, ticked = Clock::now(), ended{};
  Measures measures;
  History::Times known_times;                ///< as a query found them
  std::list<std::pair<double, Past>> pasts;  ///< recent queries, newest first
  std::uint64_t changes_of_pasts = 0;        ///< number of changes that `pasts` belong to
  ProgressSamples progress_samples;          ///< used by `other_times`
  // The last members end first.
  std::unique_ptr<LiveMcap> recording;  ///< null: no recording
  std::unique_ptr<RosBridge> ros;       ///< null: no ROS 2
  std::unique_ptr<MqttBridge> mqtt;     ///< null: no MQTT
  /// Queries that have not begun at the end get no answer. A query of one place waits for no large
  /// one, and a query of the live ground for none of another time.
  std::optional<LiveHeights> place_heights, heights;  ///< during run()
  QueryLane places, queries, other_times;
  QueryLane scans;                     ///< reads points, which needs no site
  std::unique_ptr<GroundCopy> beside;  ///< updates `copy`
};

/// Takes over a connection that requested /feed or /view.
void accept_connection(ServerState& state, boost::asio::ip::tcp::socket socket);

}  // namespace soilvdb::tools
