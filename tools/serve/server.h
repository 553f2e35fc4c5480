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

#include "soilvdb/initial_terrain.h"
#include "tools/serve/history.h"
#include "tools/serve/live_site.h"

namespace soilvdb::tools {

struct ServerState;  // tools/serve/server_state.h

struct ServerOptions {
  std::string listen = "127.0.0.1";          ///< an address of this machine
  std::uint16_t port = 0;                    ///< 0: any that is free
  std::string token = {};                    ///< empty: everybody on this machine may
  std::string base_path = {};                ///< "/dig": it is found below that, too
  bool takes_feeds = true;                   ///< else it is only looked at
  std::filesystem::path page = {};           ///< folder of index.html, view.js and view.css
  std::optional<double> raster_cell_m = {};  ///< of surface.tif; without: voxels
  std::filesystem::path mcap_folder = {};    ///< empty: nothing is recorded as MCAP
};

/// Serves on the thread that calls run(), which the site is then for; what takes long is done on
/// another, with clones of it.
class Server {
 public:
  /// Opens the port.
  /// @param history null: none is kept
  /// @param design null: there is none
  /// @throw io::InputError where it can't listen
  Server(LiveSite& site, std::unique_ptr<History> history,
         std::shared_ptr<const InitialTerrain> design, const ServerOptions& options);
  ~Server();

  /// "http://127.0.0.1:8470/", with the token if there is one.
  std::string url() const;
  /// Until `stopped()` says so, which is asked ten times a second.
  /// @param play called some fifty times a second, for who feeds the site from here
  void run(const std::function<bool()>& stopped, const std::function<void()>& play = {});
  /// Feeds a line from any other thread while it runs. @return the answer; empty: it runs no more
  std::string feed(std::string line);

 private:
  std::unique_ptr<ServerState> state_;
};

}  // namespace soilvdb::tools
