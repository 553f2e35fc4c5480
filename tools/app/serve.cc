// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// soilvdb serve: a live site, or a view of a run's or recording's folder.
#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <memory>
#include <regex>
#include <string>
#include <thread>
#include <utility>

#include "io/file/json.h"
#include "io/file/text.h"
#include "io/terrain/crs.h"
#include "io/terrain/drape.h"
#include "io/terrain/geodetic.h"
#include "soilvdb/io/raster.h"
#include "soilvdb/io/scenario.h"
#include "tools/app/commands.h"
#include "tools/run/run.h"
#include "tools/run/text.h"
#include "tools/serve/alarms.h"
#include "tools/serve/drawn_lines.h"
#include "tools/serve/measures.h"
#include "tools/serve/player.h"
#include "tools/serve/server.h"
#include "tools/serve/temp_folder.h"

namespace soilvdb::tools {
namespace {

namespace fs = std::filesystem;

/// Default interval of a live site's snapshots, from which a restart continues.
constexpr double kSnapshotEvery_s = 300;
constexpr std::size_t kMostToken_bytes = 4096;

/// The page's folder, beside the program or where packages install it.
fs::path page_folder() {
  std::error_code none;
  const fs::path program = fs::read_symlink("/proc/self/exe", none).parent_path();
  for (const fs::path& folder : {program / "view", program / "../share/soilvdb/view"})
    if (fs::exists(folder / "index.html", none)) return folder;
  return {};
}

/// @param site the site of the design
std::shared_ptr<const InitialTerrain> open_design(const std::optional<fs::path>& file,
                                                  const io::Site& site) {
  if (!file) return nullptr;
  const io::RasterInput raster = io::open_raster(*file);
  const Eigen::AlignedBox2d around(
      raster.grid.first, raster.grid.first + raster.grid.spacing.cwiseProduct(
                                                 Vec2(raster.grid.nx - 1, raster.grid.ny - 1)));
  if (!site.bounds.isEmpty() && !site.bounds.intersects(around))
    say(fmt::format(
        "warning: the design {} doesn't overlap the terrain: it goes {}, and the terrain {}",
        file->string(), extent_text(around), extent_text(site.bounds)));
  for (const std::string& warning : raster.warnings) say("warning: " + warning);
  if (!std::holds_alternative<io::PlaneTerrain>(site.undug().terrain))
    for (const std::string& difference : io::crs_differences(
             "the terrain", site.crs_wkt, "the design " + file->string(), raster.crs_wkt))
      say("warning: " + difference);
  return make_height_field(raster.grid, raster.source);
}

std::string open_lines(const std::optional<fs::path>& file, const io::Site& site) {
  if (!file) return "";
  const io::DesignLines lines = io::read_lines(*file, site.crs_wkt);
  const bool on_plane = std::holds_alternative<io::PlaneTerrain>(site.undug().terrain);
  for (const std::string& warning : lines.warnings) say("warning: " + warning);
  Eigen::AlignedBox2d around;
  for (const std::vector<Vec3>& line : lines.lines)
    for (const Vec3& p : line) around.extend(Vec2(p.head<2>()));
  if (!on_plane && !site.bounds.isEmpty() && !site.bounds.intersects(around))
    say(fmt::format(
        "warning: the lines of {} don't meet the terrain: they are at {:.0f}, {:.0f} to "
        "{:.0f}, {:.0f}",
        file->string(), around.min().x(), around.min().y(), around.max().x(), around.max().y()));
  return drawn_lines(lines, site);
}

/// @param site that it lies on
std::shared_ptr<const io::Drape> drape_of(const std::optional<fs::path>& file,
                                          const io::Site& site) {
  if (!file) return nullptr;
  auto drape = std::make_shared<io::Drape>(
      io::open_drape(*file, site.crs_wkt,
                     std::holds_alternative<io::PlaneTerrain>(site.undug().terrain), site.bounds));
  for (const std::string& warning : drape->warnings) say("warning: " + warning);
  const Vec2 size_m = drape->box_m.sizes();
  say(fmt::format("{}: {:.0f} m x {:.0f} m in cells of {:.2g} m ({}), {:.1f} MB", file->string(),
                  size_m.x(), size_m.y(), drape->cell_m,
                  drape->cell_m > 1.01 * drape->file_cell_m
                      ? fmt::format("{:.2g} m in the file", drape->file_cell_m)
                      : std::string("as in the file"),
                  static_cast<double>(drape->webp.size()) / 1e6));
  return drape;
}

/// Refuses receivers whose positions can't be brought into the site, before any comes.
void check_receivers(const io::Scenario& scenario, const io::Site& site) {
  for (const io::MachineInput& machine : scenario.machines) {
    if (!machine.gnss) continue;
    try {
      const std::string doubt = io::Geodetic(*machine.gnss, site.crs_wkt, site.bounds).doubt();
      if (!doubt.empty()) say(fmt::format("warning: machine '{}': {}", machine.name, doubt));
    } catch (const std::invalid_argument& e) {
      throw io::InputError(scenario.file,
                           fmt::format("machine '{}': gnss: {}", machine.name, e.what()));
    }
  }
}

/// A token of the command line, a file or the environment; empty if there is none.
/// @param name of the option, "--token"
std::string token_of(const std::string& name, const std::optional<std::string>& given,
                     const std::optional<fs::path>& file, const char* variable) {
  std::string token, from = name;
  if (given && file) throw io::InputError(fmt::format("give either {0} or {0}-file", name));
  if (given) {
    token = *given;
    say(
        fmt::format("warning: other users of this computer can read {0} in its list of processes; "
                    "use {0}-file or the variable {1}",
                    name, variable));
  } else if (file) {
    from = file->string();
    token = io::read_text(*file, kMostToken_bytes);
    token.erase(token.find_last_not_of(" \t\r\n") + 1);
  } else if (const char* value = std::getenv(variable)) {
    from = variable;
    token = value;
  } else {
    return "";
  }
  const auto fits = [](unsigned char c) {
    return std::isalnum(c) != 0 || c == '-' || c == '_' || c == '.';
  };
  if (token.empty()) throw io::InputError(fmt::format("{} holds no token", from));
  if (!std::all_of(token.begin(), token.end(), fits))
    throw io::InputError(fmt::format("{} must consist of letters, digits, '-', '_' and '.'", from));
  return token;
}

/// The tokens, which must be there if other machines may connect.
void set_tokens(const ServeOptions& options, ServerOptions& all) {
  all.token = token_of("--token", options.token, options.token_file, "SOILVDB_TOKEN");
  all.view_token =
      token_of("--view-token", options.view_token, options.view_token_file, "SOILVDB_VIEW_TOKEN");
  all.public_view = options.public_view;
  const bool loopback =
      options.listen == "127.0.0.1" || options.listen == "::1" || options.listen == "localhost";
  if (!loopback && all.token.empty())
    throw io::InputError(fmt::format(
        "--listen {} lets other machines in; give a --token-file with what they must send",
        io::printable(options.listen)));
  if (all.token.empty() && (all.public_view || !all.view_token.empty()))
    throw io::InputError(
        "those who look are told from those who feed by a token; give a --token-file, too");
  if (all.public_view && !all.view_token.empty())
    throw io::InputError("with --public-view those who look have no token; leave theirs out");
  if (!all.token.empty() && all.token == all.view_token)
    throw io::InputError("those who look and those who feed must have different tokens");
}

/// "/dig", also for "dig" and "/dig/"; empty for the root. @throw io::InputError
std::string base_path_of(std::string path) {
  while (path.ends_with('/')) path.pop_back();
  if (path.empty()) return path;
  if (!path.starts_with('/')) path.insert(0, 1, '/');
  const auto fits = [](unsigned char c) {
    return std::isalnum(c) != 0 || c == '-' || c == '_' || c == '.' || c == '/';
  };
  if (!std::all_of(path.begin(), path.end(), fits) || (path + '/').find("//") != std::string::npos)
    throw io::InputError(fmt::format(
        "--base-path {} must be a path such as /dig, of letters, digits, '-', '_', '.' and '/'",
        io::printable(path)));
  return path;
}

ServerOptions server_options(const ServeOptions& options) {
  ServerOptions all;
  all.listen = options.listen == "localhost" ? "127.0.0.1" : options.listen;
  all.port = static_cast<std::uint16_t>(options.port);
  set_tokens(options, all);
  all.base_path = base_path_of(options.base_path);
  if (options.boundary) all.boundary = read_boundary(*options.boundary);
  all.page = page_folder();
  if (all.page.empty())
    say("warning: the page isn't built: tools/view/build makes it, with node and npm; feeds and "
        "queries work");
  return all;
}

/// ", at 12.5 s": the latest time of a site whose states have times.
std::string at_time(const LiveSite& site) {
  return site.time_s() ? fmt::format(", at {} s", time_text(*site.time_s())) : "";
}

void say_where(const Server& server) {
  fmt::print("{}\n", server.url());
  std::fflush(stdout);
}

void show_past(const ServeOptions& options, ServerOptions all) {
  Opened opened = open_folder(options.scenario);
  LiveSite site(std::move(opened.session), opened.name, std::move(opened.log), opened.before);
  all.takes_feeds = false;
  all.measures = options.scenario / kMeasuresName;
  all.lines = open_lines(options.lines, site.session().site());
  all.drape = drape_of(options.drape, site.session().site());
  Server server(site, std::move(opened.history), open_design(options.design, site.session().site()),
                all);
  stop_on_signals();
  say_where(server);
  server.run([] { return stop_requested.load(); });
}

/// Feeds lines of standard input; answers go to standard output.
void feed_from_input(Server& server) {
  std::string line;
  while (!stop_requested && std::getline(std::cin, line)) {
    if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
    const std::string answer = server.feed(line);
    if (answer.empty()) return;
    fmt::print("{}\n", answer);
    std::fflush(stdout);
  }
  server.end_feed();
}

/// How ROS 2 moves the machines of a scenario. The variables are those of its nodes.
RosOptions ros_options(const io::Scenario& scenario) {
  RosOptions ros;
  if (const char* domain = std::getenv("ROS_DOMAIN_ID"); domain != nullptr && *domain != '\0') {
    constexpr double kMostDomain = 232;
    const std::optional<double> number = io::parse_number(domain);
    if (std::string_view(domain).find_first_not_of("0123456789") != std::string_view::npos ||
        !number || *number > kMostDomain)
      throw io::InputError(
          fmt::format("ROS_DOMAIN_ID is '{}'; it must be a whole number from 0 to {}",
                      io::printable(domain), kMostDomain));
    ros.domain = static_cast<int>(*number);
  }
  const auto is = [](const char* variable, std::string_view value) {
    const char* found = std::getenv(variable);
    return found != nullptr && found == value;
  };
  ros.only_this_computer =
      is("ROS_LOCALHOST_ONLY", "1") || is("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST");
  for (std::size_t i = 0; i < scenario.machines.size(); ++i) {
    const io::MachineInput& machine = scenario.machines[i];
    if (!machine.topic) continue;
    if (machine.angles != io::AngleUnit::kRadians)
      throw io::InputError(
          scenario.file, fmt::format("machine '{}': with --ros angles are in radians, as ROS 2 has "
                                     "them; remove 'angles' and have its topics so, too",
                                     machine.name));
    ros.machines.push_back({i, machine.name, *machine.topic, machine.chain});
  }
  return ros;
}

/// The broker, with the password of a file or the environment. @param name of the scenario
MqttOptions mqtt_options(const ServeOptions& options, const std::string& name) {
  const std::string& address = *options.mqtt;
  static const std::regex kForm(
      R"((mqtts?://)?(?:([^@/:]+)@)?(?:\[([^\]/]+)\]|([^@/:\[]+))(?::([0-9]{1,5}))?(?:/([^+#]+))?)");
  std::smatch parts;
  constexpr int kMostPort = 65535, kPort = 1883, kTlsPort = 8883;
  constexpr std::size_t kLongest = 1000;  // of what a regex of this library may be asked for
  if (address.size() > kLongest || !std::regex_match(address, parts, kForm))
    throw io::InputError(fmt::format(
        "--mqtt {} must be a HOST, or of the form mqtts://USER@HOST:PORT/TOPIC, where each part "
        "but "
        "HOST may be left out, and TOPIC has no + or #; a password is not part of it, but in "
        "--mqtt-password-file or SOILVDB_MQTT_PASSWORD",
        io::printable(address.substr(address.rfind('@') + 1))));
  MqttOptions mqtt{parts[3].matched ? parts[3] : parts[4], parts[6]};
  mqtt.tls = parts[1] == "mqtts://";
  mqtt.port = parts[5].matched ? std::stoi(parts[5]) : mqtt.tls ? kTlsPort : kPort;
  mqtt.user = parts[2];
  if (mqtt.port < 1 || mqtt.port > kMostPort)
    throw io::InputError(fmt::format("--mqtt: the port is {}; it must be 1 to 65535", mqtt.port));
  if (mqtt.topic.empty()) {
    mqtt.topic = "soilvdb/" + name;
    std::replace_if(
        mqtt.topic.begin(), mqtt.topic.end(), [](char c) { return c == '+' || c == '#'; }, '_');
  }
  const auto is_control = [](unsigned char c) { return c < ' ' || c == 0x7F; };
  if (!io::is_utf8(mqtt.topic) || std::any_of(mqtt.topic.begin(), mqtt.topic.end(), is_control))
    throw io::InputError(
        "--mqtt: its topic must be UTF-8 without control characters; give another, HOST/TOPIC");
  if (options.mqtt_password_file) {
    mqtt.password = io::read_text(*options.mqtt_password_file, kMostToken_bytes);
    mqtt.password.erase(mqtt.password.find_last_not_of("\r\n") + 1);
  } else if (const char* value = std::getenv("SOILVDB_MQTT_PASSWORD")) {
    mqtt.password = value;
  }
  if (!mqtt.password.empty() && mqtt.user.empty())
    throw io::InputError("--mqtt has a password, but of whom? Write USER@ before the host");
  return mqtt;
}

/// The command that goes on with a site. Tokens must be given again.
std::string command_again(const ServeOptions& options) {
  std::string command = "soilvdb serve " + io::shell_quoted(options.scenario);
  const auto add = [&](const char* option, const auto& value) {
    if (value) command += fmt::format(" {} {}", option, io::shell_quoted(*value));
  };
  add("--out", options.out);
  add("--design", options.design);
  add("--lines", options.lines);
  add("--drape", options.drape);
  add("--boundary", options.boundary);
  add("--token-file", options.token_file);
  add("--view-token-file", options.view_token_file);
  const ServeOptions usual;
  if (options.listen != usual.listen) command += " --listen " + io::shell_quoted(options.listen);
  if (options.port != usual.port) command += fmt::format(" --port {}", options.port);
  if (!options.base_path.empty()) command += " --base-path " + io::shell_quoted(options.base_path);
  if (options.public_view) command += " --public-view";
  if (options.feed_stdin) command += " --stdin";
  if (options.ros) command += " --ros";
  add("--mqtt", options.mqtt);
  add("--mqtt-password-file", options.mqtt_password_file);
  return command;
}

void serve_live(const ServeOptions& options, ServerOptions all) {
  const io::Scenario scenario = io::read_scenario(options.scenario, {}, io::Motions::kOptional);
  for (const std::string& warning : scenario.warnings) say("warning: " + warning);
  const auto has_motion = [](const io::MachineInput& machine) { return machine.motion.rows() > 0; };
  if (options.speed && std::none_of(scenario.machines.begin(), scenario.machines.end(), has_motion))
    throw io::InputError(
        options.scenario,
        "--speed needs machines with motions, and there are none; feed states instead");
  LiveSite site(Session::open(options.scenario), scenario.name);
  site.set_sensors(scenario.sensors);
  for (const std::string& warning : site.session().site().warnings) say("warning: " + warning);
  for (const std::string& warning : site.session().take_warnings())
    say(fmt::format("warning: {}: {}", options.scenario.string(), warning));
  check_receivers(scenario, site.session().site());
  all.lines = open_lines(options.lines, site.session().site());
  all.raster_cell_m = scenario.raster_cell_m;
  all.drape = drape_of(options.drape, site.session().site());
  if (options.ros) all.ros = ros_options(scenario);
  if (options.mqtt) all.mqtt = mqtt_options(options, scenario.name);
  const auto design = open_design(options.design, site.session().site());
  stop_on_signals();  // files take long to read; nothing is written yet
  Recording recording = site.session().recording();
  std::optional<TempFolder> played;  // what is recorded there is not kept
  if (options.speed && !options.out) played.emplace("the recording");
  recording.folder =
      options.out.value_or(played ? played->path() : fs::path("out") / (scenario.name + "_live"));
  recording.waits_for_room = true;
  if (!recording.snapshot_every_s) {
    recording.snapshot_every_s = kSnapshotEvery_s;
    recording.incremental = true;
  }
  all.folder = recording.folder;
  all.measures = recording.folder / kMeasuresName;
  if (scenario.mcap) all.mcap_folder = recording.folder;
  all.mcap_forces = scenario.force;
  // Errors of the command must be reported before a recording exists.
  const auto server = std::make_shared<Server>(
      site, std::make_unique<History>(site.session().clone(), recording.folder), design, all);
  site.record(recording, {});
  if (site.fed() > 0)
    say(fmt::format("{}: going on after {}{}", recording.folder.string(),
                    counted(site.fed(), "state"), at_time(site)));
  else if (!played)
    say(recording.folder.string() + ": begins here");
  if (all.ros)
    say(fmt::format("ROS 2: domain {}, {} moved by topics; {} may feed and look without a secret",
                    all.ros->domain, counted(all.ros->machines.size(), "machine"),
                    all.ros->only_this_computer ? "whoever is on this computer"
                                                : "whoever reaches this domain"));
  if (all.mqtt)
    say(fmt::format("MQTT: broker {} port {}{}; whoever it lets publish below {}/feed may feed",
                    io::printable(all.mqtt->host), all.mqtt->port, all.mqtt->tls ? " by TLS" : "",
                    io::printable(all.mqtt->topic)));
  std::optional<Player> player;
  if (options.speed) player.emplace(site, scenario, *options.speed);
  if (options.feed_stdin)
    say("serving at " + server->url());
  else
    say_where(*server);
  // Detached, because it may wait for a line until the program ends.
  if (options.feed_stdin) std::thread([server] { feed_from_input(*server); }).detach();
  std::function<void()> play;
  bool at_end = false;
  if (player)
    play = [&] {
      if (at_end) return;
      player->go_on();
      if ((at_end = player->done()))
        say(fmt::format("{} has come to its end{}; it can still be looked at", site.name(),
                        at_time(site)));
    };
  server->run([] { return stop_requested.load(); }, play);
  site.session().flush();
  const io::JournalExtent done = site.session().acknowledged();
  if (!played)
    say(fmt::format("safe in {}: {}, to {} s; `{}` goes on", recording.folder.string(),
                    counted(done.updates, "state"), time_text(done.time_s),
                    command_again(options)));
}

}  // namespace

void serve(const ServeOptions& options) {
  if (fs::is_directory(options.scenario) &&
      (options.out || options.speed || options.feed_stdin || options.ros || options.mqtt))
    throw io::InputError(
        options.scenario,
        "is a folder, which can only be viewed; --out, --speed, --stdin, --ros and --mqtt need a "
        "scenario");
  if (options.ros && options.speed)
    throw io::InputError("--ros and --speed both move machines; leave one of them out");
  if (options.mqtt_password_file && !options.mqtt)
    throw io::InputError("--mqtt-password-file needs --mqtt with the broker that it is for");
  const ServerOptions all = server_options(options);
  with_threads(0, [&](int) {
    if (fs::is_directory(options.scenario))
      show_past(options, all);
    else
      serve_live(options, all);
  });
}

}  // namespace soilvdb::tools
