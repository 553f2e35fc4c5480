// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// What reaches a live site: lines of a feed, and, behind "GET ", addresses.
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "tests/fuzz/fuzz.h"
#include "tools/serve/live_site.h"
#include "tools/serve/target.h"

using namespace soilvdb;

namespace {

Session site() {
  Chain chain;
  chain.joints = {{"boom", Joint::Type::kRevolute, {}, Vec3::UnitY(), -1, 1},
                  {"stick", Joint::Type::kPrismatic, {}, Vec3::UnitX(), 0, 2}};
  return Session({.voxel_size_m = 0.2,
                  .terrain = io::PlaneTerrain{},
                  .machines = {{"digger", {1, 1, {}, {}}}, {"arm", {1, 1, {}, {}}, chain}}});
}

void feed(tools::LiveSite& live, std::string_view line) {
  const std::uint64_t before = live.session().ground_hash();
  const std::string answer = live.feed(line);
  const auto json = nlohmann::json::parse(answer, nullptr, /*allow_exceptions=*/false);
  fuzz::require(json.is_object() && answer.find('\n') == std::string::npos,
                "an answer is a line of JSON");
  fuzz::require(json.contains("error") != (json.contains("cut_m3") || json.contains("clock")),
                "it is an update, of a clock or an error");
  if (json.contains("error"))
    fuzz::require(live.session().ground_hash() == before, "what is refused changes nothing");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const Session start = site();
  tools::LiveSite live(start.clone(), "site");
  const std::string text(reinterpret_cast<const char*>(data), std::min<std::size_t>(size, 4096));
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = std::min(text.find('\n', at), text.size());
    const std::string line = text.substr(at, end - at);
    at = end + 1;
    if (!line.starts_with("GET ")) {
      feed(live, line);
    } else if (const auto target = tools::parse_target(line.substr(4))) {
      fuzz::require(target->path.starts_with('/'), "a path begins with a slash");
    }
  }
  return 0;
}
