// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What reaches a live site: lines of a feed, behind "GET " addresses, and behind "machines ",
// "hoppers " and "measures " changes of these lists.
#include <algorithm>
#include <cstddef>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "tests/fuzz/fuzz.h"
#include "tools/serve/feed_lines.h"
#include "tools/serve/live_site.h"
#include "tools/serve/measures.h"
#include "tools/serve/target.h"

using namespace soilvdb;

namespace {

Session site() {
  Chain chain;
  chain.joints = {{"boom", Joint::Type::kRevolute, {}, Vec3::UnitY(), -1, 1},
                  {"stick", Joint::Type::kPrismatic, {}, Vec3::UnitX(), 0, 2}};
  Earthmoving earthmoving;
  earthmoving.soil.emplace().repose_rad = 0.6;
  Gnss gnss;
  gnss.antennas_m = {{0, 1, 2}, {0, -1, 2}};
  gnss.site_crs = "EPSG:32632";
  gnss.undulation_m = 40;
  return Session({.voxel_size_m = 0.2,
                  .terrain = io::PlaneTerrain{},
                  .machines = {{"digger", {1, 1, {}, {}}},
                               {"arm", {1, 1, {}, {}}, chain},
                               {"dozer", {1, 1, {}, {}}, {}, 0.02, gnss}},
                  .earthmoving = earthmoving});
}

std::string feed(tools::LiveSite& live, std::string_view line) {
  const std::uint64_t before = live.session().ground_hash();
  const std::string answer = live.feed(line);
  const auto json = nlohmann::json::parse(answer, nullptr, /*allow_exceptions=*/false);
  fuzz::require(json.is_object() && answer.find('\n') == std::string::npos,
                "an answer is a line of JSON");
  fuzz::require(json.contains("error") != (json.contains("cut_m3") || json.contains("clock")),
                "it is an update, of a clock or an error");
  if (json.contains("error"))
    fuzz::require(live.session().ground_hash() == before, "what is refused changes nothing");
  fuzz::require(json.contains("error") == tools::is_refusal(answer), "a refusal is known as one");
  return answer;
}

void change(tools::LiveSite& live, const std::string& list, std::string_view text) {
  const Session& session = live.session();
  const auto names = [&] {
    std::vector<std::string> all;
    for (const SiteMachine& machine : session.machines()) all.push_back(machine.name);
    for (const Hopper& hopper : session.earthmoving().hoppers) all.push_back(hopper.name);
    return all;
  };
  const std::vector<std::string> before = names();
  const std::uint64_t ground = session.ground_hash();
  try {
    live.change_list(list, text);
  } catch (const std::exception& e) {
    fuzz::require(names() == before, "what is refused changes nothing");
    fuzz::require(std::string_view(e.what()).find('\n') == std::string_view::npos, "it is a line");
  }
  fuzz::require(session.ground_hash() == ground, "the ground stays");
  fuzz::require(live.feeds()["machines"].size() <= session.machines().size() &&
                    live.machine_feeds().size() == session.machines().size(),
                "each machine has a feed");
}

void change(tools::Measures& measures, std::string_view text) {
  const nlohmann::ordered_json before = measures.json();
  try {
    const nlohmann::ordered_json answer = measures.change(text);
    fuzz::require(measures.json() != before || answer.contains("id"), "a change has an answer");
  } catch (const std::exception& e) {
    fuzz::require(measures.json() == before, "what is refused changes nothing");
    fuzz::require(std::string_view(e.what()).find('\n') == std::string_view::npos, "it is a line");
  }
  const nlohmann::ordered_json map = measures.geojson("");
  fuzz::require(map["features"].size() == measures.all().size(), "all are on the map");
  for (const nlohmann::ordered_json& feature : map["features"])
    fuzz::require(!feature["properties"]["name"].get<std::string>().empty(), "all have names");
}

/// Feeds lines as a message does.
void feed_all(tools::LiveSite& live, std::string text) {
  std::ptrdiff_t fed = 0;
  tools::FeedLines lines(std::move(text));
  while (lines.feed([&](std::string_view line) {
    ++fed;
    return feed(live, line);
  }))
    continue;
  const std::string& answers = lines.answers();
  fuzz::require(
      std::count(answers.begin(), answers.end(), '\n') + 1 == std::max(fed, std::ptrdiff_t{1}),
      "each line has an answer, and a message one or more");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const Session start = site();
  tools::LiveSite live(start.clone(), "site");
  const std::string text(reinterpret_cast<const char*>(data), std::min<std::size_t>(size, 4096));
  std::string lines;
  tools::Measures measures({});
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = std::min(text.find('\n', at), text.size());
    const std::string line = text.substr(at, end - at);
    at = end + 1;
    const std::size_t blank = line.find(' ');
    const std::string list = line.substr(0, blank);
    if (list == "machines" || list == "hoppers") {
      if (blank != line.npos) change(live, list, std::string_view(line).substr(blank + 1));
    } else if (list == "measures") {
      if (blank != line.npos) change(measures, std::string_view(line).substr(blank + 1));
    } else if (!line.starts_with("GET ")) {
      lines += line + '\n';
    } else if (const auto target = tools::parse_target(line.substr(4))) {
      fuzz::require(target->path.starts_with('/'), "a path begins with a slash");
    }
  }
  feed_all(live, std::move(lines));
  return 0;
}
