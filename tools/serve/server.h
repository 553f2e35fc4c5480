// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// A live site on the network: feeds in, views and queries out.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "soilvdb/initial_terrain.h"
#include "tools/serve/history.h"
#include "tools/serve/live_site.h"
#include "tools/serve/mqtt_bridge.h"
#include "tools/serve/ros_bridge.h"

namespace soilvdb::inline v0::io {
struct Drape;  // io/terrain/drape.h
}

namespace soilvdb::tools {

struct ServerState;  // tools/serve/server_state.h

struct ServerOptions {
  std::string listen = "127.0.0.1";  ///< an address of this machine
  std::uint16_t port = 0;            ///< 0: any free port
  std::string token = {};            ///< of feeds; empty: every user of this machine has access
  std::string view_token = {};       ///< of those who only look; empty: they need `token`
  bool public_view = false;          ///< those who only look need no token
  std::string base_path = {};        ///< "/dig": also served below this path
  bool takes_feeds = true;           ///< false: viewing only
  std::shared_ptr<const io::Drape> drape = {};  ///< null: none
  std::filesystem::path page = {};              ///< folder of index.html, view.js and view.css
  std::optional<double> raster_cell_m = {};     ///< of surface.tif; default: the voxel size
  std::vector<Vec2> boundary = {};              ///< that machines must not leave; empty: none
  std::string lines = {};                       ///< answer of /lines; empty: none
  std::filesystem::path folder = {};            ///< of the recording, whose disk may fill; or empty
  std::filesystem::path mcap_folder = {};       ///< empty: no MCAP is recorded
  bool mcap_forces = false;                     ///< with the soil's forces on buckets
  std::optional<RosOptions> ros = {};           ///< empty: no ROS 2
  std::optional<MqttOptions> mqtt = {};         ///< empty: no MQTT
  std::filesystem::path measures = {};  ///< file of measures that have names; empty: none stay
};

/// Serves on the thread that calls run(), which then owns the site. Slow work runs on another
/// thread, with clones of the site.
class Server {
 public:
  /// Opens the port.
  /// @param history null: no history
  /// @param design null: no design
  /// @throw io::InputError if it can't listen; std::exception if ROS 2 or MQTT can't be had
  Server(LiveSite& site, std::unique_ptr<History> history,
         std::shared_ptr<const InitialTerrain> design, const ServerOptions& options);
  ~Server();

  /// "http://127.0.0.1:8470/", with the token of those who look if there is one.
  std::string url() const;
  /// Runs until `stopped()` returns true; calls it ten times a second.
  /// @param play called some fifty times a second, for a source of states in this process
  void run(const std::function<bool()>& stopped, const std::function<void()>& play = {});
  /// Feeds a line from another thread during run(). @return the answer; empty after run()
  std::string feed(std::string line);
  /// There will be no more such lines.
  void end_feed();

 private:
  std::unique_ptr<ServerState> state_;
};

}  // namespace soilvdb::tools
