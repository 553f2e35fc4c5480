// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
#include "tools/serve/server.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/ip/address.hpp>
#include <boost/asio/ip/host_name.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/socket_base.hpp>
#include <boost/system/system_error.hpp>
#include <fstream>
#include <functional>
#include <future>
#include <iterator>
#include <nlohmann/json.hpp>
#include <utility>

#include "io/file/json.h"
#include "io/terrain/crs.h"
#include "io/terrain/drape.h"
#include "soilvdb/io/error.h"
#include "tools/serve/alarms.h"
#include "tools/serve/block_message.h"
#include "tools/serve/feeder.h"
#include "tools/serve/server_state.h"
#include "tools/serve/survey_post.h"
#include "tools/serve/viewer.h"

namespace soilvdb::tools {
namespace {

namespace net = boost::asio;
using net::ip::tcp;
using Json = nlohmann::ordered_json;

constexpr std::chrono::milliseconds kTick{50}, kPlay{20}, kTellSoon{100};
constexpr std::chrono::seconds kTellAgain{1}, kAskTimes{2};
constexpr std::size_t kMostConnections = 512, kMostWaiting = 256;
constexpr std::chrono::milliseconds kMostPassed{200}, kGoodbye{1000}, kLookWhoIsLeft{10};
constexpr std::size_t kMostCacheBytes = 64 << 20;
constexpr std::size_t kBlocksAtOnce = 8;

std::string read_file(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

constexpr const char* kNoPage =
    "<!DOCTYPE html><html lang=\"en\"><meta charset=\"utf-8\"><title>soilvdb</title>"
    "<h1>soilvdb</h1><p>The page isn't built: tools/view/build makes it, with node and npm; "
    "then start soilvdb serve again. Feeds and queries work.</p></html>\n";

std::string tag_of(const std::string& text) {
  return fmt::format("W/\"{:016x}\"", std::hash<std::string>{}(text));
}

PageFile packed_file(const char* type, std::string text) {
  const std::string tag = tag_of(text);
  std::string packed = deflated(text);
  return {{200, type, std::move(text), {}, false, {}, tag},
          {200, type, std::move(packed), {}, true, {}, tag}};
}

std::map<std::string, PageFile> read_page(const std::filesystem::path& folder) {
  std::map<std::string, PageFile> page;
  const auto add = [&](const char* path, const char* file, const char* type) {
    std::string text = read_file(folder / file);
    if (!text.empty()) page[path] = packed_file(type, std::move(text));
  };
  if (!folder.empty()) {
    add("/", "index.html", "text/html; charset=utf-8");
    add("/view.js", "view.js", "text/javascript; charset=utf-8");
    add("/view.css", "view.css", "text/css; charset=utf-8");
  }
  if (!page.contains("/")) {
    const Reply none{200, "text/html; charset=utf-8", kNoPage};
    page["/"] = {none, none};
  }
  return page;
}

}  // namespace

ServerState::ServerState(LiveSite& site_, std::unique_ptr<History> history_,
                         std::shared_ptr<const InitialTerrain> design_,
                         const ServerOptions& options_)
    : site(site_),
      history(std::move(history_)),
      design(std::move(design_)),
      options(options_),
      page(read_page(options.page)),
      copy(std::make_unique<Ground>(site.session().voxel_size_m(), site.session().origin(),
                                    site.session().site().ground->shared_terrain())),
      mesher(std::make_unique<CachedMesher>(*copy)),
      forces(site.session(), *copy),
      measures(options.measures),
      recording(
          options.mcap_folder.empty()
              ? nullptr
              : std::make_unique<LiveMcap>(options.mcap_folder, site, *copy, options.mcap_forces)),
      beside(std::make_unique<GroundCopy>(*copy)) {
  if (options.drape)
    shown["/drape"] = {
        {200, "image/webp", options.drape->webp, {}, false, {}, tag_of(options.drape->webp)}, {}};
  if (!options.lines.empty()) shown["/lines"] = packed_file("application/json", options.lines);
  try {
    const tcp::endpoint endpoint(net::ip::make_address(options.listen), options.port);
    acceptor.open(endpoint.protocol());
    acceptor.set_option(net::socket_base::reuse_address(true));
    acceptor.bind(endpoint);
    acceptor.listen();
  } catch (const boost::system::system_error& e) {
    throw io::InputError(fmt::format(
        "can't listen on {} port {}: {}{}", options.listen, options.port, e.code().message(),
        e.code() == boost::system::errc::address_in_use
            ? "; end the program that listens there, or name another --port (0: any that is free)"
            : ""));
  }
  if (recording && options.mcap_forces)
    site.after_states([this](std::size_t machine) { recording->note_force(machine); });
}

void ServerState::drop(std::map<Coord3, Cached, Before>::iterator cached) {
  cache_bytes -= cached->second.message->size();
  cache_order.erase(cached->second.place);
  cache.erase(cached);
}

void ServerState::keep(const Coord3& block, Bytes message) {
  if (const auto found = cache.find(block); found != cache.end()) drop(found);
  cache_order.push_front(block);
  cache_bytes += message->size();
  cache[block] = {std::move(message), cache_order.begin()};
  while (cache_bytes > kMostCacheBytes && cache.size() > 1) drop(cache.find(cache_order.back()));
}

Bytes ServerState::block(const Coord3& block) {
  if (const auto found = cache.find(block); found != cache.end()) {
    cache_order.splice(cache_order.begin(), cache_order, found->second.place);
    return found->second.message;
  }
  wanted.insert(block);
  return nullptr;
}

/// Makes blocks in portions, by jobs beside the feeds, from the newest ground.
void ServerState::make_blocks() {
  if (making || wanted.empty()) return;
  making = true;
  std::vector<Coord3> blocks;
  while (!wanted.empty() && blocks.size() < kBlocksAtOnce)
    blocks.push_back(wanted.extract(wanted.begin()).value());
  const bool soil_moves = site.session().earthmoving().soil.has_value();
  beside->run([this, blocks = std::move(blocks), soil_moves, tick = ticks] {
    const Ground& ground = *copy;
    std::vector<std::pair<Coord3, Bytes>> made;
    for (const Coord3& block : blocks)
      made.emplace_back(
          block, std::make_shared<const std::string>(block_message(
                     ground, block, mesher->block(block), 0, heights_of(ground.initial_terrain()),
                     design ? heights_of(*design) : Heights(), soil_moves)));
    net::post(io, [this, made = std::move(made), tick] {
      making = false;
      for (const auto& [block, message] : made) {
        const auto changed = changed_at.find(block);
        if (changed == changed_at.end() || changed->second <= tick) keep(block, message);
      }
      for (Viewer* viewer : viewers) viewer->go_on();
      make_blocks();
    });
  });
}

Json ServerState::times() {
  if (!history) return nullptr;
  const auto from_s = options.takes_feeds ? site.from_s() : known_times.from_s;
  const auto to_s = options.takes_feeds ? site.time_s() : known_times.to_s;
  if (!from_s || !to_s) return nullptr;
  std::vector<double> snapshots_s = known_times.snapshots_s;
  std::erase_if(snapshots_s, [&](double s) { return s > *to_s; });  // by a clock that was ahead
  return {{"from", *from_s}, {"to", *to_s}, {"snapshots", snapshots_s}};
}

Bytes ServerState::state_message() {
  Json json = site.state();
  json["times"] = times();
  if (options.takes_feeds)
    json["alarms"] = alarms(site, design.get(), options.boundary, options.folder);
  return std::make_shared<const std::string>(io::to_text(json));
}

Bytes ServerState::description() {
  Json json = site.description();
  json["live"] = options.takes_feeds;
  json["terrain"] = terrain->description();
  json["crs"] = io::crs_label(site.session().site().crs_wkt);
  json["design"] = design != nullptr;
  json["lines"] = !options.lines.empty();
  json["drape"] = nullptr;
  if (const io::Drape* of = options.drape.get())
    json["drape"] = {
        {"bounds",
         {of->box_m.min().x(), of->box_m.min().y(), of->box_m.max().x(), of->box_m.max().y()}},
        {"cell_m", of->cell_m},
        {"tag", shown.at("/drape").plain.tag}};
  json["times"] = times();
  return std::make_shared<const std::string>(io::to_text(json));
}

Bytes ServerState::measures_message(Role role) const {
  Json json = {{"type", "measures"}};
  json.update(measures.json());
  json["may_change"] = role == Role::kFeeder && options.takes_feeds;
  // Links are passed on, so they never have the token of feeds.
  const bool can_be_passed_on = !has_tokens() || options.public_view || !options.view_token.empty();
  json["link_token"] = can_be_passed_on ? Json(options.view_token) : Json();
  return std::make_shared<const std::string>(io::to_text(json));
}

Json ServerState::change_measures(const std::string& change) {
  Json answer = measures.change(change);
  const Bytes of_viewers = measures_message(Role::kViewer);
  const Bytes of_feeders = measures_message(Role::kFeeder);
  for (Viewer* viewer : viewers)
    viewer->tell_measures(viewer->role() == Role::kFeeder ? of_feeders : of_viewers);
  return answer;
}

void ServerState::follow_ground() {
  ++ticks;
  const std::vector<Coord3> chunks = site.session().changed_chunks();
  if (!chunks.empty()) beside->post(*site.session().site().ground, chunks);
  for (const Coord3& block : blocks_touched(chunks)) {
    changed_at[block] = ticks;
    if (const auto cached = cache.find(block); cached != cache.end()) drop(cached);
    for (Viewer* viewer : viewers) viewer->changed(block);
  }
  if (recording) recording->tick(chunks, *beside);
  if (ros) ros->tick(chunks, *beside);
}

Json ServerState::change_list(const std::string& list, const std::string& change) {
  if (ros && list == "machines")
    ros->require_topics(nlohmann::json::parse(change, nullptr, /*allow_exceptions=*/false));
  beside->finish();  // its jobs look at the machines
  Json answer = site.change_list(list, change);
  const Bytes site_now = description();
  for (Viewer* viewer : viewers) viewer->tell(site_now);
  tell_soon();
  if (!recording) return answer;
  // The list of machines of an MCAP file is fixed. The next has all of the ground, too.
  follow_ground();
  recording->finish(*beside);
  beside->finish();
  recording = std::make_unique<LiveMcap>(options.mcap_folder, site, *copy, options.mcap_forces);
  recording->tick(site.session().site().ground->origins(), *beside);
  return answer;
}

bool ServerState::make_room() {
  if (waiting.size() < kMostWaiting && connections < kMostConnections) return true;
  if (waiting.empty()) return false;
  const std::function<void()> drop_oldest = waiting.front();
  drop_oldest();
  return true;
}

void ServerState::end() {
  const Clock::time_point now = Clock::now();
  if (!ending.exchange(true)) {
    ended = now;
    for (Feeder* feeder : feeders) feeder->close(kEnded);
    for (Viewer* viewer : viewers) viewer->close(kEnded);
  }
  const bool is_left = !feeders.empty() || !viewers.empty() || surveying || replying > 0;
  if (!is_left || now - ended > kGoodbye) return io.stop();
  timer.expires_after(kLookWhoIsLeft);
  timer.async_wait([this](const boost::system::error_code& error) {
    if (!error) end();
  });
}

/// Nothing is computed if no viewer wants it.
void ServerState::tell_forces() {
  const auto wants = [](const Viewer* viewer) { return viewer->wants_live_forces(); };
  if (std::none_of(viewers.begin(), viewers.end(), wants)) return;
  forces.compute(*beside, [this, wants](std::string message) {
    net::post(io, [this, wants, text = std::make_shared<const std::string>(std::move(message))] {
      for (Viewer* viewer : viewers)
        if (wants(viewer)) viewer->tell_forces(text);
    });
  });
}

/// Sends changes and the machines' state to viewers.
void ServerState::tick() {
  if (stopped()) return end();
  const Clock::time_point now = Clock::now();
  // A server that was busy did not listen meanwhile.
  const auto passed = std::min<Clock::duration>(now - std::exchange(ticked, now), kMostPassed);
  for (Feeder* feeder : feeders) feeder->listen(passed);
  if (ros) {
    ros->work();
    ros->listen(passed);
  }
  if (mqtt) mqtt->work(passed);
  if (!viewers.empty() || recording || ros) follow_ground();
  const auto since = now - told;
  if (!viewers.empty() &&
      (since >= kTellAgain || (site.fed() != told_fed && since >= kTellSoon - kTick / 2))) {
    told = now;
    told_fed = site.fed();
    const Bytes state = state_message();
    for (Viewer* viewer : viewers) viewer->tell_state(state);
    tell_forces();
  }
  for (Viewer* viewer : viewers) viewer->go_on();
  if (history && now - asked_times >= kAskTimes && !viewers.empty()) {
    asked_times = now;
    other_times.try_run("", [this] {
      try {
        net::post(io, [this, found = history->times()] { known_times = found; });
      } catch (const std::exception&) {  // the folder is unreadable for now
      }
    });
  }
  timer.expires_after(kTick);
  timer.async_wait([this](const boost::system::error_code& error) {
    if (!error) tick();
  });
}

Server::Server(LiveSite& site, std::unique_ptr<History> history,
               std::shared_ptr<const InitialTerrain> design, const ServerOptions& options)
    : state_(std::make_unique<ServerState>(site, std::move(history), std::move(design), options)) {
  remove_left_surveys();
  const std::string all = url();
  state_->input->name = "standard input";
  if (options.ros) state_->ros = std::make_unique<RosBridge>(*state_, *options.ros);
  if (options.mqtt) state_->mqtt = feed_by_mqtt(*state_, *options.mqtt);
  site.set_address(
      options.token.empty() ? "curl -X POST" : "curl -X POST -H 'Authorization: Bearer TOKEN'",
      all.substr(0, all.find('#')));
}

Server::~Server() = default;

std::string Server::url() const {
  const tcp::endpoint at = state_->acceptor.local_endpoint();
  std::string host =
      at.address().is_v6() ? '[' + at.address().to_string() + ']' : at.address().to_string();
  if (at.address().is_unspecified()) host = net::ip::host_name();  // all addresses of this machine
  // An address is passed on, so it lets others look only.
  const ServerOptions& options = state_->options;
  const std::string& token = options.public_view          ? std::string()
                             : options.view_token.empty() ? options.token
                                                          : options.view_token;
  return fmt::format("http://{}:{}{}/{}", host, at.port(), options.base_path,
                     token.empty() ? "" : "#token=" + token);
}

void Server::run(const std::function<bool()>& stopped, const std::function<void()>& play) {
  ServerState& s = *state_;
  s.stopped = stopped;
  s.terrain.emplace(s.site.session().site(), work_area(s.site.session()));
  Ground& ground = *s.site.session().site().ground;
  s.place_heights.emplace(ground);
  s.heights.emplace(ground);
  if (s.history) {
    try {
      s.known_times = s.history->times();
    } catch (const std::exception&) {  // nothing is recorded yet
    }
  }
  net::steady_timer rest(s.io);
  const std::function<void()> accept = [&] {
    s.acceptor.async_accept([&](const boost::system::error_code& error, tcp::socket socket) {
      if (!error) {
        if (s.make_room()) accept_connection(s, std::move(socket));
        return accept();
      }
      rest.expires_after(kTick);  // for example, too many open files
      rest.async_wait([&](const boost::system::error_code& stopped_waiting) {
        if (!stopped_waiting) accept();
      });
    });
  };
  const std::function<void()> keep_playing = [&] {
    if (!s.undoing) play();
    s.player.expires_after(kPlay);
    s.player.async_wait([&](const boost::system::error_code& error) {
      if (!error) keep_playing();
    });
  };
  accept();
  if (play) keep_playing();
  s.tick();
  s.io.run();
  s.drop_queries();
  for (QueryLane* lane : {&s.places, &s.queries, &s.other_times, &s.scans}) lane->wait();
  if (s.recording) {
    s.follow_ground();
    s.recording->finish(*s.beside);
  }
  s.beside.reset();
  s.ros.reset();  // say goodbye, also if a thread that reads lines keeps this server
  s.mqtt.reset();
}

std::string Server::feed(std::string line) {
  std::promise<std::string> answer;
  std::future<std::string> future = answer.get_future();
  const std::function<void()> feed = [&] {
    if (state_->waits_for_undo(feed)) return;
    answer.set_value(state_->ending ? "" : state_->feed_of(state_->input)(line));
  };
  net::post(state_->io, feed);
  while (future.wait_for(kTick) != std::future_status::ready)
    if (state_->io.stopped()) return "";
  return future.get();
}

void Server::end_feed() {
  net::post(state_->io, [input = state_->input] { input->link = FeedSource::Link::kEnded; });
}

}  // namespace soilvdb::tools
